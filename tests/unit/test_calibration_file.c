/* test_calibration_file.c - calibrations in files: our own, OpenCV's, COLMAP's; and what is none. */
#include "testing.h"

#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const sf_calibration example = {
    .width = 640,
    .height = 480,
    .lens = {613.4, 610.9, 327.3, 235.8, -0.21, 0.06, 0.0012, -0.0008, -0.11},
    .sigma = {0.5, 0.6, 0.7, 0.8, 0.001, 0.002, 0.0001, 0.0002, 0},
    .rms = 0.21,
    .worst_rms = 0.4,
    .coverage = 0.875,
    .tilt_most = 41,
    .tilt_spread = 70,
    .views = 16,
    .views_rejected = 1,
    .corners = 1200,
    .corners_rejected = 9,
};

static void test_round_trip(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_calibration c;
    assert_ok(ctx, sf_calibration_save(ctx, &example, test_path("camera.json")));
    assert_ok(ctx, sf_calibration_load(ctx, test_path("camera.json"), &c));
    assert_memory_equal(&c.lens, &example.lens, sizeof c.lens);
    assert_memory_equal(&c.sigma, &example.sigma, sizeof c.sigma);
    assert_true(c.width == 640 && c.height == 480 && c.rms == example.rms &&
                c.worst_rms == example.worst_rms);
    assert_true(c.coverage == example.coverage && c.tilt_most == 41 && c.tilt_spread == 70);
    assert_true(c.views == 16 && c.views_rejected == 1 && c.corners == 1200 && c.corners_rejected == 9);
    static const char marked[] =
        "\xEF\xBB\xBF# as Windows' editors begin a text\n1 PINHOLE 640 480 500 501 320 240\n";
    test_write(test_path("cameras.txt"), marked, sizeof marked - 1);
    assert_ok(ctx, sf_calibration_load(ctx, test_path("cameras.txt"), &c));
    assert_true(c.lens.fx == 500 && c.lens.fy == 501);
    sf_calibration bad = example;
    bad.lens.fy = NAN;
    assert_status(ctx, sf_calibration_save(ctx, &bad, test_path("bad.json")), SF_ERR_ARGUMENT);
    assert_false(test_exists(test_path("bad.json")));
    assert_status(ctx, sf_calibration_save(ctx, &example, "no/such/folder/camera.json"), SF_ERR_IO);
    assert_status(ctx, sf_calibration_load(ctx, test_path("none.json"), &c), SF_ERR_IO);
    sf_context_destroy(&ctx);
}

static sf_status load(sf_context *ctx, const void *data, size_t size, sf_calibration *c) {
    test_write(test_path("file"), data, size);
    return sf_calibration_load(ctx, test_path("file"), c);
}

static sf_status load_text(sf_context *ctx, const char *text, sf_calibration *c) {
    return load(ctx, text, strlen(text), c);
}

/* As OpenCV's calibration program writes it. */
#define YAML_HEAD   "%YAML:1.0\n---\ncalibration_time: \"Sat\"\nimage_width: 640\nimage_height: 480\n"
#define YAML_MATRIX "camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
#define MATRIX                                                                                               \
    YAML_MATRIX "   data: [ 6.134e+02, 0., 3.268e+02, 0.,\n       6.109e+02, 2.353e+02, 0., 0., 1. ]\n"
#define YAML_COEFFICIENTS(n, list)                                                                           \
    "distortion_coefficients: !!opencv-matrix\n   rows: " n "\n   cols: 1\n   dt: d\n   data: [ " list " ]"  \
    "\n"
#define FIVE "-2.1e-01, 6.0e-02,\n       1.2e-03, -8.0e-04, -1.1e-01"

/* The same in the other forms that cv::FileStorage writes. */
#define XML_HEAD                                                                                             \
    "<?xml version=\"1.0\"?>\n<opencv_storage>\n<!-- <K>1</K> -->\n<flags>0</flags>\n"                       \
    "<image_width>640</image_width>\n<image_height>480</image_height>\n<views><K>2</K></views>\n<board/>\n"
#define XML_MATRIX(key, list)                                                                                \
    "<" key " type_id=\"opencv-matrix\">\n  <rows>3</rows>\n  <cols>3</cols>\n  <dt>d</dt>\n  <data>\n    "  \
    "" list "</data></" key ">\n"
#define XML_LENS(K, D)                                                                                       \
    XML_MATRIX(K, "6.134e+02 0. 3.268e+02 0.\n    6.109e+02 2.353e+02 0. 0. 1.")                             \
    XML_MATRIX(D, "-2.1e-01 6.0e-02\n    1.2e-03 -8.0e-04 -1.1e-01")
#define XML(K, D)     XML_HEAD XML_LENS(K, D) "</opencv_storage>\n"
#define JSON_HEAD     "{\n    \"image_width\": 640,\n    \"image_height\": 480,\n    "
#define JSON_KEY(key) "\"" key "\": "
#define JSON_MATRIX(key, list)                                                                               \
    JSON_KEY(key)                                                                                            \
    "{\n        \"type_id\": \"opencv-matrix\",\n        \"rows\": 3,\n        \"data\": [ " list " ]\n    " \
    "}"
#define JSON(K, D)                                                                                           \
    JSON_HEAD                                                                                                \
    JSON_MATRIX(K, "6.134e+02, 0.0, 3.268e+02, 0.0, 6.109e+02, 2.353e+02, 0.0, 0.0, 1.0")                    \
    ",\n   "                                                                                                 \
    " " JSON_MATRIX(D, "-2.1e-01, "                                                                          \
                       "6.0e-02, "                                                                           \
                       "1.2e-03, "                                                                           \
                       "-8.0e-04, "                                                                          \
                       "-1.1e-01") "\n}\n"
#define ROWS      "[[613.4, 0, 326.8], [0, 610.9, 235.3], [0, 0, 1]]"
#define FLAT_ROWS "[[-0.21, 0.06, 0.0012, -0.0008, -0.11]]"

static void assert_example(sf_context *ctx, const char *text) {
    sf_calibration c;
    assert_ok(ctx, load_text(ctx, text, &c));
    for (int k = 0; k < 9; k++) assert_true(fabs((&c.lens.fx)[k] - (&example.lens.fx)[k]) < 1e-9);
    assert_true(c.width == 640 && c.height == 480 && c.sigma.fx == 0);
}

static void test_opencv(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    setlocale(LC_ALL, "de_DE.UTF-8"); /* where there is one, its comma must not matter */
    const char *texts[] = {
        YAML_HEAD MATRIX YAML_COEFFICIENTS("5", FIVE),
        "image_width: 640\nimage_height: 480\ncamera_name: cam\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
        "  data: [613.4, 0, 326.8, 0, 610.9, 235.3, 0, 0, 1]\ndistortion_model: plumb_bob\n"
        "distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-0.21, 0.06, 0.0012, -0.0008, -0.11]\n",
        YAML_HEAD MATRIX YAML_COEFFICIENTS("8", FIVE ", 0, 0, 0"),
        YAML_HEAD MATRIX YAML_COEFFICIENTS("12", FIVE ", 0, 0, 0, 0, 0, 0, 0"),
        YAML_HEAD MATRIX YAML_COEFFICIENTS("14", FIVE ", 0, 0, 0, 0, 0, 0, 0, 0, 0"),
        YAML_HEAD "fisheye_model: 0\n" MATRIX YAML_COEFFICIENTS("5", FIVE),
        "%YAML:1.0\n---\nimage_size: [ 640, 480 ]\nK: " ROWS "\nD: " FLAT_ROWS "\n",
        "imageSize: [ 640, 480 ]\ncameraMatrix: " ROWS "\ndistCoeffs: " FLAT_ROWS "\n",
        "image_width: 640\nimage_height: 480\ncamera_matrix: " ROWS "\ndist_coeffs: " FLAT_ROWS "\n",
        XML("camera_matrix", "distortion_coefficients"),
        XML("K", "D"),
        "<opencv_storage><imageSize>\n  640 480</imageSize>" XML_LENS("cameraMatrix",
                                                                      "distCoeffs") "</opencv_storage>",
        JSON("camera_matrix", "distortion_coefficients"),
        JSON("K", "D"),
        "{\"image_size\": [640, 480], \"fisheye_model\": false, \"cameraMatrix\": " ROWS
        ", \"dist_coeffs\": " FLAT_ROWS "}"};
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) assert_example(ctx, texts[i]);
    sf_calibration c;
    assert_ok(ctx, load_text(ctx, YAML_HEAD MATRIX YAML_COEFFICIENTS("4", "1e-1, 2e-2, 3e-3, 4e-4"), &c));
    assert_true(c.lens.k1 == 1e-1 && c.lens.k2 == 2e-2 && c.lens.p1 == 3e-3 && c.lens.p2 == 4e-4 &&
                c.lens.k3 == 0);
    setlocale(LC_ALL, "C");
    sf_context_destroy(&ctx);
}

static void test_colmap(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_calibration c;
    assert_ok(ctx,
              load_text(ctx,
                        "# Camera list\n1 OPENCV 640 480 613.4 610.9 327.3 235.8 -0.21 0.06 0.0012 -0.0008\n",
                        &c));
    assert_memory_equal(&c.lens, &example.lens, 8 * sizeof(double));
    assert_true(c.width == 640 && c.height == 480 && c.lens.k3 == 0);
    assert_ok(ctx,
              load_text(ctx,
                        "1 FULL_OPENCV 640 480 613.4 610.9 327.3 235.8 -0.21 0.06 0.0012 -0.0008 -0.11 0 "
                        "0 0\n",
                        &c));
    assert_memory_equal(&c.lens, &example.lens, sizeof c.lens);
    assert_ok(ctx,
              load_text(ctx,
                        "7 SIMPLE_RADIAL 640 480 600 320 240 0.1\n8 SIMPLE_RADIAL 640 480 600 320 240 0.1\n",
                        &c));
    assert_true(c.lens.fx == 600 && c.lens.fy == 600 && c.lens.k1 == 0.1);
    /* cameras.bin: one PINHOLE, little-endian. */
    uint8_t binary[64] = {1, 0, 0, 0, 0, 0, 0, 0, 5, 0, 0, 0, 1, 0, 0, 0, 0x80, 2, 0, 0, 0, 0, 0, 0, 0xe0, 1};
    const uint8_t six_hundred[2] = {0xc0, 0x82}; /* 600.0 ends in these */
    for (int i = 0; i < 4; i++) {
        binary[32 + 8 * i + 6] = six_hundred[0];
        binary[32 + 8 * i + 7] = 0x40;
        binary[32 + 8 * i + 6] = six_hundred[1];
        binary[32 + 8 * i + 5] = six_hundred[0];
    }
    assert_ok(ctx, load(ctx, binary, sizeof binary, &c));
    assert_true(c.width == 640 && c.height == 480 && c.lens.fx == 600 && c.lens.cy == 600 && c.lens.k1 == 0);
    for (size_t cut = 1; cut < sizeof binary; cut++) {
        assert_status(ctx, load(ctx, binary, cut, &c), SF_ERR_FORMAT);
        assert_true(c.width == 0);
    }
    sf_context_destroy(&ctx);
}

/* Files of before k3 are of lenses without it. */
static void test_lens_without_k3(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_calibration c;
    assert_ok(ctx,
              load_text(ctx,
                        "{\"model\": \"OPENCV\", \"width\": 640, \"height\": 480, \"fx\": 600, \"fy\": 601, "
                        "\"cx\": 320, \"cy\": 240, \"k1\": 0.1, \"k2\": 0.2, \"p1\": 0.3, \"p2\": 0.4}",
                        &c));
    const sf_lens want = {600, 601, 320, 240, 0.1, 0.2, 0.3, 0.4, 0};
    assert_memory_equal(&c.lens, &want, sizeof want);
    assert_ok(ctx, sf_calibration_save(ctx, &example, test_path("k3.json")));
    size_t size;
    char *text = (char *)test_read(test_path("k3.json"), &size);
    assert_non_null(strstr(text, "\"FULL_OPENCV\"")); /* a program that knows no k3 refuses it */
    free(text);
    sf_context_destroy(&ctx);
}

#define LENS "\"fx\": 600, \"fy\": 600, \"cx\": 320, \"cy\": 240"
static const struct {
    sf_status status;
    const char *text, *names;
} hostile_files[] = {
    {SF_ERR_FORMAT, "", "is empty"},
    {SF_ERR_FORMAT, " \n", "is empty"},
    {SF_ERR_FORMAT, "hello", "is neither"},
    {SF_ERR_FORMAT, "{", "line 1"},
    {SF_ERR_FORMAT, "[1, 2]", "is not an object"},
    {SF_ERR_FORMAT, "{}", "width: is missing"},
    {SF_ERR_FORMAT, "{\"width\": 640}", "height: is missing"},
    {SF_ERR_FORMAT, "{\"width\": 0, \"height\": 480, " LENS "}", "width"},
    {SF_ERR_FORMAT, "{\"width\": 640.5, \"height\": 480, " LENS "}", "width"},
    {SF_ERR_FORMAT, "{\"width\": 640, \"height\": 480, \"fx\": 600}", "fy: is missing"},
    {SF_ERR_FORMAT, "{\"width\": 640, \"height\": 480, \"fx\": \"600\"}", "fx: is not a number"},
    {SF_ERR_FORMAT, "{\"width\": 640, \"height\": 480, \"fx\": -1, \"fy\": 600, \"cx\": 1, \"cy\": 1}", "fx"},
    {SF_ERR_FORMAT, "{\"width\": 640, \"height\": 480, " LENS ", \"k1\": null}", "k1: is not a number"},
    {SF_ERR_FORMAT, "{\"width\": 640, \"height\": 480, " LENS ", \"views\": -4}", "views"},
    {SF_ERR_FORMAT, "{\"width\": 640, \"height\": 480, " LENS ", \"sigma\": {\"fx\": []}}", "fx"},
    {SF_ERR_UNSUPPORTED, "{\"model\": \"OPENCV_FISHEYE\", \"width\": 640, \"height\": 480, " LENS "}",
     "model: \"OPENCV_FISHEYE\""},
    {SF_ERR_UNSUPPORTED, "{\"model\": \"FULL_OPENCV\", \"width\": 6, \"height\": 4, " LENS ", \"k4\": 0.2}",
     "k4: 0.2 is not supported"},
    {SF_ERR_FORMAT, "{\"width\": 640, \"height\": 480, " LENS ", \"k3\": \"0\"}", "k3: is not a number"},
    {SF_ERR_FORMAT, "%YAML:1.0\n", "image_width: is missing"},
    {SF_ERR_FORMAT, "%YAML:1.0\nimage_width: 640\n", "image_height: is missing"},
    {SF_ERR_FORMAT, "%YAML:1.0\nimage_width: abc\n", "image_width: is not a number"},
    {SF_ERR_FORMAT, YAML_HEAD, "camera_matrix: is missing"},
    {SF_ERR_FORMAT, YAML_HEAD MATRIX, "distortion_coefficients: is missing"},
    {SF_ERR_FORMAT, YAML_HEAD YAML_MATRIX YAML_COEFFICIENTS("5", FIVE), "camera_matrix: has no data"},
    {SF_ERR_FORMAT, YAML_HEAD YAML_MATRIX "   data: [ 1, 2\n", "camera_matrix: is not a number"},
    {SF_ERR_FORMAT, YAML_HEAD YAML_MATRIX "   data: [ 1, 2, x ]\n", "camera_matrix: is not a number"},
    {SF_ERR_FORMAT, YAML_HEAD YAML_MATRIX "   data: [ .nan, 2 ]\n", "camera_matrix: is not a number"},
    {SF_ERR_FORMAT, YAML_HEAD YAML_MATRIX "   data: [ 1, 2 ]\n", "camera_matrix: is not [fx"},
    {SF_ERR_FORMAT, YAML_HEAD YAML_MATRIX "   data: [ 1,0,1,0,1,1,0,0,1,5 ]\n", "more than 9"},
    {SF_ERR_UNSUPPORTED, YAML_HEAD YAML_MATRIX "   data: [ 600,1,320,0,600,240,0,0,1 ]\n", "skew: 1"},
    {SF_ERR_FORMAT, YAML_HEAD MATRIX YAML_COEFFICIENTS("2", "0, 0"), "2 numbers are not 4, 5, 8"},
    {SF_ERR_FORMAT, YAML_HEAD MATRIX YAML_COEFFICIENTS("0", ""), "0 numbers are not 4, 5, 8"},
    {SF_ERR_UNSUPPORTED, YAML_HEAD MATRIX YAML_COEFFICIENTS("8", "0, 0, 0, 0, 0.2, 0, 0.1, 0"), "k5: 0.1"},
    {SF_ERR_UNSUPPORTED, YAML_HEAD MATRIX YAML_COEFFICIENTS("8", "0, 0, 0, 0, 0, 0.1, 0, 0"), "k4: 0.1"},
    {SF_ERR_UNSUPPORTED, YAML_HEAD MATRIX YAML_COEFFICIENTS("8", "0, 0, 0, 0, 0, 0, 0, 0.3"), "k6: 0.3"},
    {SF_ERR_FORMAT, YAML_HEAD MATRIX YAML_COEFFICIENTS("6", "0, 0, 0, 0, 0, 0"), "6 numbers are not"},
    {SF_ERR_FORMAT, YAML_HEAD MATRIX YAML_COEFFICIENTS("5", "1, , 0, 0, 0"), "is not a number"},
    {SF_ERR_FORMAT, YAML_HEAD MATRIX YAML_COEFFICIENTS("5", "1, 0, 0, 0, "), "is not a number"},
    {SF_ERR_FORMAT, YAML_HEAD MATRIX YAML_COEFFICIENTS("5", "1 0 0 0"), "is not a number"},
    {SF_ERR_UNSUPPORTED, YAML_HEAD MATRIX YAML_COEFFICIENTS("12", "0,0,0,0,0,0,0,0,0,0,0.4,0"), "s3: 0.4"},
    {SF_ERR_UNSUPPORTED, YAML_HEAD MATRIX YAML_COEFFICIENTS("14", "0,0,0,0,0,0,0,0,0,0,0,0,0,0.5"),
     "tau_y: 0.5"},
    /* A fisheye's four are k1 to k4, not k1, k2, p1, p2. */
    {SF_ERR_UNSUPPORTED, YAML_HEAD "fisheye_model: 1\n" MATRIX YAML_COEFFICIENTS("4", "0.1, 0, 0, 0"),
     "fisheye_model: 1: the coefficients are k1 to k4"},
    {SF_ERR_UNSUPPORTED, XML_HEAD "<fisheye_model>1</fisheye_model>" XML_LENS("K", "D") "</opencv_storage>",
     "undistort the pictures first"},
    {SF_ERR_UNSUPPORTED, JSON_HEAD "\"fisheye_model\": true, \"K\": " ROWS ", \"D\": " FLAT_ROWS "}",
     "fisheye_model: true"},
    {SF_ERR_UNSUPPORTED, JSON_HEAD "\"fisheye_model\": 1, \"K\": " ROWS ", \"D\": " FLAT_ROWS "}",
     "fisheye_model: 1"},
    {SF_ERR_FORMAT, "K: " ROWS "\nD: " FLAT_ROWS "\n", "image_width: is missing: add image_width"},
    {SF_ERR_FORMAT, "image_size: [ 640 ]\nK: " ROWS "\n", "image_size: is not [width, height]"},
    {SF_ERR_FORMAT, "image_size: [ 640, 0 ]\nK: " ROWS "\n", "image_size: is not a number in its range"},
    {SF_ERR_FORMAT, XML_HEAD "</opencv_storage>", "camera_matrix: is missing"},
    {SF_ERR_FORMAT, XML_HEAD XML_MATRIX("K", "1 2 x"), "K: is not a number"},
    {SF_ERR_FORMAT, XML_HEAD XML_MATRIX("K", "1 2"), "K: is not [fx"},
    {SF_ERR_FORMAT, XML_HEAD "<K><rows>3</rows></K>", "K: has no data"},
    {SF_ERR_FORMAT, "<svg></svg>", "is neither"},
    {SF_ERR_FORMAT, JSON_HEAD "\"K\": 3}", "K: has no data"},
    {SF_ERR_FORMAT, JSON_HEAD "\"K\": [\"1\"]}", "K: is not a number"},
    {SF_ERR_FORMAT, JSON_HEAD "\"K\": " ROWS "}", "distortion_coefficients: is missing"},
    {SF_ERR_UNSUPPORTED, YAML_HEAD "distortion_model: equidistant\n" MATRIX, "distortion_model: equidistant"},
    {SF_ERR_FORMAT, "# nothing\n", "holds no camera"},
    {SF_ERR_UNSUPPORTED, "1 FOV 640 480 1 2 3 4 5\n", "FOV is not supported"},
    {SF_ERR_FORMAT, "1 PINHOLE 640 480 600\n", "line 1"},
    {SF_ERR_FORMAT, "1 PINHOLE 640 480 0 600 320 240\n", "fx"},
    {SF_ERR_UNSUPPORTED, "1 SIMPLE_PINHOLE 640 480 600 320 240\n2 SIMPLE_PINHOLE 640 480 601 320 240\n",
     "2 cameras that differ"},
};

/* Each with one line that names the file and the field. */
static void test_hostile_files(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_calibration c, none = {0};
    for (size_t i = 0; i < sizeof hostile_files / sizeof *hostile_files; i++) {
        assert_status(ctx, load_text(ctx, hostile_files[i].text, &c), hostile_files[i].status);
        assert_error_names(ctx, "/file: ");
        assert_error_names(ctx, hostile_files[i].names);
        assert_null(strchr(sf_last_error(ctx), '\n'));
        assert_memory_equal(&c, &none, sizeof c);
    }
    sf_context_destroy(&ctx);
}

/* Whatever is cut off or changed is read or refused: never more. */
static void test_damage(void **state) {
    (void)state;
    static const struct {
        const char *text;
        size_t rest; /* that nothing needs */
    } files[] = {{YAML_HEAD MATRIX YAML_COEFFICIENTS("5", FIVE), 1},
                 {XML("K", "D"), sizeof "\n</opencv_storage>\n" - 1},
                 {JSON("K", "D"), 1}};
    sf_context *ctx = test_context();
    sf_calibration c;
    char copy[1024];
    for (size_t f = 0; f < 3; f++) {
        size_t good = 0, tried = 0, size = strlen(files[f].text);
        assert_true(size < sizeof copy);
        for (size_t i = 0; i < size; i++) {
            memcpy(copy, files[f].text, size);
            sf_status status = load(ctx, copy, i, &c);
            assert_true((status == SF_OK) == (i >= size - files[f].rest));
            copy[i] = "x9[,\n"[i % 5];
            status = load(ctx, copy, size, &c);
            assert_true(status == SF_OK || status == SF_ERR_FORMAT || status == SF_ERR_UNSUPPORTED);
            good += status == SF_OK;
            tried++;
        }
        assert_true(good > 0 && good < tried);
    }
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_round_trip), cmocka_unit_test(test_opencv),
        cmocka_unit_test(test_colmap),     cmocka_unit_test(test_hostile_files),
        cmocka_unit_test(test_damage),     cmocka_unit_test(test_lens_without_k3),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
