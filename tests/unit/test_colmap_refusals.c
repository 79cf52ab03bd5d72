/* test_colmap_refusals.c - malformed COLMAP projects, and memory that runs out. */
#include "colmap_fixture.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

/* Malformed projects. */

static void check_truncations(sf_context *ctx, const char *name, const buffer *b) {
    for (size_t size = 0; size < b->size; size++) {
        sf_scene *scene;
        test_write(test_path_in("cut", name), b->data, size);
        sf_status status = sf_scene_load(ctx, test_path("cut"), NULL, &scene);
        if (status != SF_ERR_FORMAT)
            fail_msg("%s cut to %zu of %zu bytes: %s", name, size, b->size, sf_status_text(status));
        assert_null(scene);
        assert_error_names(ctx, name);
    }
    test_write(test_path_in("cut", name), b->data, b->size);
    sf_scene *scene = test_load_scene(ctx, test_path("cut"), NULL);
    sf_scene_destroy(&scene);
}

static void test_truncation_at_every_byte(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    files f = colmap_binary_files();
    colmap_write_project(ctx, "cut");
    check_truncations(ctx, "sparse/0/cameras.bin", &f.cameras);
    check_truncations(ctx, "sparse/0/images.bin", &f.images);
    check_truncations(ctx, "sparse/0/points3D.bin", &f.points);
    sf_context_destroy(&ctx);
}

static void check_flips(sf_context *ctx, const char *name, const buffer *b) {
    for (size_t at = 0; at < b->size; at++) {
        buffer flipped = *b;
        sf_scene *scene;
        flipped.data[at] ^= 0x81;
        test_write(test_path_in("flip", name), flipped.data, flipped.size);
        sf_status status = sf_scene_load(ctx, test_path("flip"), NULL, &scene);
        assert_int_equal(scene != NULL, status == SF_OK);
        if (!status) assert_between(test_scene_info(scene).views, 1, IMAGES);
        sf_scene_destroy(&scene);
    }
    test_write(test_path_in("flip", name), b->data, b->size);
}

static void test_flipped_bits(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    files f = colmap_binary_files();
    colmap_write_project(ctx, "flip");
    check_flips(ctx, "sparse/0/cameras.bin", &f.cameras);
    check_flips(ctx, "sparse/0/images.bin", &f.images);
    check_flips(ctx, "sparse/0/points3D.bin", &f.points);
    sf_context_destroy(&ctx);
}

static void test_counts_beyond_the_file(void **state) {
    (void)state;
    static const uint64_t counts[] = {(uint64_t)1 << 63, UINT64_MAX, (uint64_t)1 << 32, 0xffffffff, 100};
    static const char *const names[] = {"cameras.bin", "images.bin", "points3D.bin"};
    sf_context *ctx = test_context();
    colmap_write_project(ctx, "counts");
    for (size_t i = 0; i < sizeof counts / sizeof *counts; i++)
        for (int k = 0; k < 3; k++) {
            files f = colmap_binary_files();
            buffer *b = k == 0 ? &f.cameras : k == 1 ? &f.images : &f.points;
            char value[32];
            for (int byte = 0; byte < 8; byte++) b->data[byte] = (uint8_t)(counts[i] >> (8 * byte));
            colmap_write_model("counts", "sparse/0/", &f, ".bin");
            snprintf(value, sizeof value, "%llu", (unsigned long long)counts[i]);
            colmap_assert_refused(ctx, test_path("counts"), SF_ERR_FORMAT, names[k]);
            assert_error_names(ctx, value);
        }
    sf_context_destroy(&ctx);
}

/* The offset of image `index`'s number of observations. */
static size_t observations_at(int index) {
    buffer b = {.size = 8};
    for (int i = 0; i < index; i++) colmap_add_image(&b, &colmap_images[i]);
    return b.size + 4 + 7 * 8 + 4 + strlen(colmap_images[index].name) + 1;
}

static void test_inner_counts_beyond_the_file(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    colmap_write_project(ctx, "inner");
    for (size_t byte = 0; byte < 8; byte++) {
        files f = colmap_binary_files();
        f.images.data[observations_at(1) + byte] |= 0x80;
        colmap_write_model("inner", "sparse/0/", &f, ".bin");
        colmap_assert_refused(ctx, test_path("inner"), SF_ERR_FORMAT, "images.bin");
        f = colmap_binary_files();
        f.points.data[8 + 43 + byte] |= 0x80; /* the first point's track */
        colmap_write_model("inner", "sparse/0/", &f, ".bin");
        colmap_assert_refused(ctx, test_path("inner"), SF_ERR_FORMAT, "points3D.bin");
    }
    sf_context_destroy(&ctx);
}

/* Loads the project with one other camera in place of the first. */
/* Of COLMAP 4.2's models those that are not supported: number and parameters. */
static const struct {
    int model, parameters;
    const char *name;
} unsupported[] = {{11, 16, "RAD_TAN_THIN_PRISM_FISHEYE"},
                   {12, 4, "SIMPLE_DIVISION"},
                   {13, 5, "DIVISION"},
                   {16, 6, "EUCM"},
                   {17, 2, "EQUIRECTANGULAR"}};

/* They are refused where a picture uses them, and skipped where none does. */
static void test_unsupported_cameras(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = NULL;
    char part[96];
    colmap_write_project(ctx, "unused");
    for (size_t i = 0; i < sizeof unsupported / sizeof *unsupported; i++)
        for (unsigned used = 0; used < 2; used++) {
            camera c = {used ? 7 : 42, unsupported[i].model, "", 10, 10, unsupported[i].parameters,
                        {1, 1, 1, 1}};
            files f = colmap_binary_files();
            f.cameras.size = 0;
            colmap_add_uint(&f.cameras, CAMERAS + !used, 8);
            colmap_add_camera(&f.cameras, &c);
            for (int k = used ? 1 : 0; k < CAMERAS; k++) colmap_add_camera(&f.cameras, &colmap_cameras[k]);
            colmap_write_model("unused", "sparse/0/", &f, ".bin");
            snprintf(part, sizeof part, "images.bin: camera 7: model %s is not supported",
                     unsupported[i].name);
            if (used) {
                colmap_assert_refused(ctx, test_path("unused"), SF_ERR_UNSUPPORTED, part);
                int panorama = !strcmp(unsupported[i].name, "EQUIRECTANGULAR");
                assert_int_equal(strstr(sf_last_error(ctx), "image_undistorter") == NULL, panorama);
                continue;
            }
            assert_ok(ctx, sf_scene_load(ctx, test_path("unused"), NULL, &scene));
            assert_int_equal(test_scene_info(scene).views, IMAGES);
            sf_scene_destroy(&scene);
        }
    sf_context_destroy(&ctx);
}

static void refuse_camera(sf_context *ctx, const camera *c, sf_status expected, const char *part) {
    files f = colmap_binary_files();
    f.cameras.size = 8;
    colmap_add_camera(&f.cameras, c);
    for (int i = 1; i < CAMERAS; i++) colmap_add_camera(&f.cameras, &colmap_cameras[i]);
    colmap_write_model("other", "sparse/0/", &f, ".bin");
    colmap_assert_refused(ctx, test_path("other"), expected, "cameras.bin");
    assert_error_names(ctx, part);
}

static void test_other_cameras(void **state) {
    (void)state;
    static const int unknown[] = {-1, 18, 1 << 20};
    static const double sizes[] = {0, 65536, 9e18};
    sf_context *ctx = test_context();
    colmap_write_project(ctx, "other");
    for (size_t i = 0; i < 3; i++) {
        camera c = colmap_cameras[0];
        c.model = unknown[i];
        refuse_camera(ctx, &c, SF_ERR_FORMAT, "camera 7: model: number");
        c = colmap_cameras[0];
        c.width = sizes[i];
        refuse_camera(ctx, &c, SF_ERR_FORMAT, "camera 7: width: ");
        c = colmap_cameras[0];
        c.height = sizes[i];
        refuse_camera(ctx, &c, SF_ERR_FORMAT, "camera 7: height: ");
    }
    camera twice = colmap_cameras[0];
    twice.id = colmap_cameras[2].id;
    refuse_camera(ctx, &twice, SF_ERR_FORMAT, "camera 3 appears twice");
    sf_context_destroy(&ctx);
}

/* Loads the project with one other image in place of the first. */
static void refuse_image(sf_context *ctx, const image *v, const char *part) {
    files f = colmap_binary_files();
    f.images.size = 8;
    colmap_add_image(&f.images, v);
    for (int i = 1; i < IMAGES; i++) colmap_add_image(&f.images, &colmap_images[i]);
    colmap_write_model("other", "sparse/0/", &f, ".bin");
    colmap_assert_refused(ctx, test_path("other"), SF_ERR_FORMAT, part);
}

static void test_other_images(void **state) {
    (void)state;
    static const char *const escapes[] = {"/etc/passwd", "../a.png", "sub/../../a.png", "..", "",
                                          ".",           "sub/.."};
    sf_context *ctx = test_context();
    colmap_write_project(ctx, "other");
    image v = colmap_images[0];
    v.camera = 99;
    refuse_image(ctx, &v, "images.bin: image 4: camera 99 does not exist");
    v = colmap_images[0];
    v.id = colmap_images[2].id;
    refuse_image(ctx, &v, "images.bin: image 9 appears twice");
    v = colmap_images[0];
    v.name = colmap_images[1].name;
    refuse_image(ctx, &v, "'b.png' appears twice");
    for (size_t i = 0; i < sizeof escapes / sizeof *escapes; i++) {
        v = colmap_images[0];
        v.name = escapes[i];
        refuse_image(ctx, &v, "images.bin: picture name");
    }
    sf_context_destroy(&ctx);
}

static void test_bytes_that_follow(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    colmap_write_project(ctx, "follow");
    for (int k = 0; k < 3; k++) {
        files f = colmap_binary_files();
        colmap_add_uint(k == 0 ? &f.cameras : k == 1 ? &f.images : &f.points, 0, 1);
        colmap_write_model("follow", "sparse/0/", &f, ".bin");
        colmap_assert_refused(ctx, test_path("follow"), SF_ERR_FORMAT, "1 bytes follow");
    }
    sf_context_destroy(&ctx);
}

static void test_garbage(void **state) {
    (void)state;
    static const char *const names[] = {"sparse/0/cameras.bin", "sparse/0/images.bin",
                                        "sparse/0/points3D.bin"};
    sf_context *ctx = test_context();
    uint8_t garbage[500];
    for (int k = 0; k < 3; k++) {
        colmap_write_project(ctx, "garbage");
        for (unsigned seed = 0; seed < 20; seed++) {
            for (size_t i = 0; i < sizeof garbage; i++)
                garbage[i] = i < 8 ? (uint8_t)(i == 0) : (uint8_t)((i * 2654435761u + seed * 40503u) >> 11);
            test_write(test_path_in("garbage", names[k]), garbage, sizeof garbage);
            colmap_assert_refused(ctx, test_path("garbage"), SF_ERR_FORMAT, names[k]);
        }
    }
    sf_context_destroy(&ctx);
}

static void test_absent_files(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    colmap_write_project(ctx, "absent");
    colmap_assert_refused(ctx, test_path("nothing-here"), SF_ERR_IO, "nothing-here");
    colmap_assert_refused(ctx, test_path_in("absent", "images"), SF_ERR_IO,
                          "its pictures belong to the project in");
    colmap_assert_refused(ctx, test_path_in("absent", "sparse/0/cameras.bin"), SF_ERR_FORMAT,
                          "neither a folder nor");
    assert_int_equal(unlink(test_path_in("absent", "sparse/0/cameras.bin")), 0);
    colmap_assert_refused(ctx, test_path("absent"), SF_ERR_IO,
                          "sparse/0: holds neither cameras.bin nor cameras.txt");
    colmap_write_project(ctx, "absent");
    assert_int_equal(unlink(test_path_in("absent", "sparse/0/images.bin")), 0);
    colmap_assert_refused(ctx, test_path("absent"), SF_ERR_IO, "holds neither images.bin nor images.txt");
    colmap_make_folder(test_path_in("absent", "sparse/0/images.bin")); /* a folder is no file */
    colmap_assert_refused(ctx, test_path("absent"), SF_ERR_IO, "holds neither images.bin nor images.txt");
    sf_context_destroy(&ctx);
}

static void test_no_images(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    colmap_write_project(ctx, "none");
    test_write(test_path_in("none", "sparse/0/images.bin"), "\0\0\0\0\0\0\0", 8);
    colmap_assert_refused(ctx, test_path("none"), SF_ERR_EMPTY, "names no picture");
    sf_context_destroy(&ctx);
}

static void test_malformed_text(void **state) {
    (void)state;
    static const struct {
        const char *file, *text;
        sf_status status;
        const char *part;
    } cases[] = {
        {"cameras.txt", "x PINHOLE 24 16 1 1 1 1\n", SF_ERR_FORMAT, "line 1: camera id: 'x'"},
        {"cameras.txt", "#\n-1 PINHOLE 24 16 1 1 1 1\n", SF_ERR_FORMAT, "line 2: camera id: '-1'"},
        {"cameras.txt", "4294967296 PINHOLE 24 16 1 1 1 1\n", SF_ERR_FORMAT, "camera id"},
        {"cameras.txt", "1 PINWHEEL 24 16 1 1 1 1\n", SF_ERR_FORMAT, "model: 'PINWHEEL' is not known"},
        {"cameras.txt", "7 EUCM 24 16 1 1 1 1 1 1\n", SF_ERR_UNSUPPORTED,
         "images.txt: camera 7: model EUCM is not supported"},
        {"cameras.txt", "7 EUCM 24 16 1 1 1 1\n", SF_ERR_FORMAT, "parameters: ''"},
        {"cameras.txt", "1 PINHOLE 0 16 1 1 1 1\n", SF_ERR_FORMAT, "camera 1: width: 0"},
        {"cameras.txt", "1 PINHOLE 24 99999999999999999999 1 1 1 1\n", SF_ERR_FORMAT, "height: '9999"},
        {"cameras.txt", "1 PINHOLE 24 16 1 1 1\n", SF_ERR_FORMAT, "parameters: ''"},
        {"cameras.txt", "1 PINHOLE 24 16 1 1 1 1 1\n", SF_ERR_FORMAT, "end of line: '1'"},
        {"cameras.txt", "1 PINHOLE 24 16 1 1 1 one\n", SF_ERR_FORMAT, "parameters: 'one'"},
        {"cameras.txt", "", SF_ERR_FORMAT, "camera 7 does not exist"},
        {"images.txt", "4 1 0 0\n", SF_ERR_FORMAT, "line 1: quaternion: ''"},
        {"images.txt", "4 1 0 0 0 1 1 1 7\n\n", SF_ERR_FORMAT, "picture name: ''"},
        {"images.txt", "4 1 0 0 0 1 1 1 8 c.png\n\n", SF_ERR_FORMAT, "image 4: camera 8 does not exist"},
        {"images.txt", "4 1 0 0 0 1 1 1 7 c.png\n5 1 0 0 0 1 1 1 7 b.png\n", SF_ERR_FORMAT,
         "line 2: observations"},
        {"images.txt", "# nothing\n", SF_ERR_EMPTY, "names no picture"},
        {"points3D.txt", "1 1 2 three 0 0 0 1\n", SF_ERR_FORMAT, "line 1: position: 'three'"},
        {"points3D.txt", "1 1 2 3 256 0 0 1\n", SF_ERR_FORMAT, "colour: '256'"},
        {"points3D.txt", "1 1 2\n", SF_ERR_FORMAT, "position: ''"},
    };
    sf_context *ctx = test_context();
    files f = colmap_text_files();
    colmap_write_pictures(ctx, "words", "images", 1);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        colmap_write_model("words", "", &f, ".txt");
        test_write(test_path_in("words", cases[i].file), cases[i].text, strlen(cases[i].text));
        colmap_assert_refused(ctx, test_path("words"), cases[i].status, cases[i].part);
    }
    colmap_write_model("words", "", &f, ".txt");
    test_write(test_path_in("words", "cameras.txt"), "1 PINHOLE\0", 10);
    colmap_assert_refused(ctx, test_path("words"), SF_ERR_FORMAT, "zero byte");
    sf_context_destroy(&ctx);
}

static void test_not_finite_text(void **state) {
    (void)state;
    static const char text[] =
        "4 nan 0 0 0 1 1 1 7 c.png\n\n5 1 0 0 0 1 1 1 7 a.png\n\n1 1 0 0 0 1 1 1e999 7 b.png\n";
    sf_context *ctx = test_context();
    sf_load_options options = sf_load_options_default();
    files f = colmap_text_files();
    options.hold_out = 0;
    colmap_write_pictures(ctx, "nan", "images", 1);
    colmap_write_model("nan", "", &f, ".txt");
    test_write(test_path_in("nan", "images.txt"), text, strlen(text));
    sf_scene *scene = test_load_scene(ctx, test_path("nan"), &options);
    assert_int_equal(test_scene_info(scene).views, 1);
    assert_int_equal(test_scene_info(scene).skipped_pose, 2);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* No memory. */

static void check_each_allocation(const char *project, long least) {
    long countdown = -1, at = 0;
    sf_allocator allocator = {test_refuse_alloc, test_refuse_free, &countdown};
    sf_context_options options = {.allocator = &allocator, .threads = 1};
    sf_context *ctx;
    sf_scene *scene;
    assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
    for (;; at++) {
        countdown = at;
        sf_status status = sf_scene_load(ctx, test_path(project), NULL, &scene);
        if (countdown >= 0) { /* it took fewer allocations than that */
            assert_ok(ctx, status);
            break;
        }
        assert_status(ctx, status, SF_ERR_MEMORY);
        assert_null(scene);
        assert_error_names(ctx, "out of memory");
    }
    assert_int_equal(test_scene_info(scene).views, IMAGES);
    assert_true(at > least);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_each_allocation_may_fail(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    files text = colmap_text_files();
    colmap_write_project(ctx, "memory");
    colmap_make_folder(test_path_in("memory", "sparse/1"));
    colmap_write_model("memory", "sparse/1/", &text, ".txt");
    check_each_allocation("memory", 50);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_truncation_at_every_byte),
        cmocka_unit_test(test_flipped_bits),
        cmocka_unit_test(test_counts_beyond_the_file),
        cmocka_unit_test(test_inner_counts_beyond_the_file),
        cmocka_unit_test(test_unsupported_cameras),
        cmocka_unit_test(test_other_cameras),
        cmocka_unit_test(test_other_images),
        cmocka_unit_test(test_bytes_that_follow),
        cmocka_unit_test(test_garbage),
        cmocka_unit_test(test_absent_files),
        cmocka_unit_test(test_no_images),
        cmocka_unit_test(test_malformed_text),
        cmocka_unit_test(test_not_finite_text),
        cmocka_unit_test(test_each_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
