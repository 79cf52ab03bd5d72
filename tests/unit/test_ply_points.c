/* test_ply_points.c - points of .ply files. */
#include "ply_fixture.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "io/ply.h"

#define WITHOUT_Z "property float x\nproperty float y\n"

typedef struct points {
    double *xyz;
    uint8_t *rgb;
    size_t count;
} points;

static points read_points(sf_context *ctx, const file *f) {
    points p;
    assert_ok(ctx, sf_ply_read_points(ctx, ply_write_file(f), &p.xyz, &p.rgb, &p.count));
    return p;
}

static void free_points(sf_context *ctx, points *p) {
    sf_free(ctx, p->xyz);
    sf_free(ctx, p->rgb);
}

static void test_points_binary(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    file f = {0};
    ply_put_text(&f,
                 VERTEX("3") "property double x\nproperty double y\nproperty double z\nproperty float nx\n"
                             "property uchar red\nproperty uchar green\nproperty uchar blue\n" END);
    for (int i = 0; i < 3; i++) {
        ply_put_f64(&f, i + 0.5), ply_put_f64(&f, i == 1 ? NAN : -i), ply_put_f64(&f, i == 2 ? 1e300 : 7),
            ply_put_f32(&f, 1);
        for (int c = 0; c < 3; c++) ply_put_uint(&f, (uint64_t)(100 * i + c), 1);
    }
    points p = read_points(ctx, &f);
    assert_int_equal(p.count, 3);
    for (int i = 0; i < 3; i++) {
        assert_true(p.xyz[3 * i] == i + 0.5);
        for (int c = 0; c < 3; c++) assert_int_equal(p.rgb[3 * i + c], 100 * i + c);
    }
    assert_true(isnan(p.xyz[4]));
    assert_true(p.xyz[8] > (double)FLT_MAX);
    assert_true(p.xyz[5] == 7);
    free_points(ctx, &p);
    sf_context_destroy(&ctx);
}

#define ASCII_POINTS                                                                                         \
    "ply\nformat ascii 1.0\nelement vertex 2\n" POINT                                                        \
    "property uchar red\nproperty uchar green\nproperty uchar blue\n" END

static void test_points_ascii(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    file f = {0};
    ply_put_text(&f, ASCII_POINTS "1 2 3 255 0 1\n4 5 6 7 8 9\n");
    points p = read_points(ctx, &f);
    assert_int_equal(p.count, 2);
    assert_memory_equal(p.xyz, ((double[]){1, 2, 3, 4, 5, 6}), 6 * sizeof(double));
    assert_memory_equal(p.rgb, ((uint8_t[]){255, 0, 1, 7, 8, 9}), 6);
    free_points(ctx, &p);
    sf_context_destroy(&ctx);
}

static void assert_grey(sf_context *ctx, const char *color_properties, int color_bytes) {
    file f = {0};
    ply_put_text(&f, VERTEX("2") POINT);
    ply_put_text(&f, color_properties);
    ply_put_text(&f, END);
    for (int i = 0; i < 2; i++) {
        for (int k = 0; k < 3; k++) ply_put_f32(&f, (float)(3 * i + k));
        ply_put_uint(&f, 0, color_bytes);
    }
    test_log_clear();
    points p = read_points(ctx, &f);
    assert_memory_equal(p.xyz, ((double[]){0, 1, 2, 3, 4, 5}), 6 * sizeof(double));
    assert_memory_equal(p.rgb, ((uint8_t[]){128, 128, 128, 128, 128, 128}), 6);
    assert_non_null(strstr(test_log, "grey"));
    free_points(ctx, &p);
}

static void test_points_without_colors_are_grey(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    assert_grey(ctx, "", 0);
    assert_grey(ctx, "property ushort red\nproperty ushort green\nproperty ushort blue\n", 6);
    assert_grey(ctx, "property uchar red\nproperty uchar green\n", 2);
    sf_context_destroy(&ctx);
}

static void test_points_none(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    file f = {0};
    ply_put_text(&f, VERTEX("0") POINT END);
    points p = read_points(ctx, &f);
    assert_int_equal(p.count, 0);
    free_points(ctx, &p);
    sf_context_destroy(&ctx);
}

static void test_points_refused(void **state) {
    (void)state;
    static const struct {
        const char *text, *part;
    } cases[] = {
        {VERTEX("0") WITHOUT_Z END, "property z is missing"},
        {VERTEX("1") POINT END "12345678901", "truncated: 1 bytes are missing"},
        {VERTEX("2147483647") POINT END, "bytes are missing"},
        {VERTEX("9223372036854775808") POINT END, "count '9223372036854775808'"},
        {"ply\nformat ascii 1.0\nelement vertex 2\n" POINT END "1.0 2.0 3.0 4.0 5.0\n",
         "ends before property z of vertex 1"},
        {ASCII_POINTS "1 2 3 255 0 1\n1 2 3 0 -1 0\n", "vertex 1: property green: -1 is not in 0..255"},
        {ASCII_POINTS "1 2 3 255 0 256\n1 2 3 0 1 0\n", "vertex 0: property blue: 256 is not in 0..255"},
        {ASCII_POINTS "1 2 3 1e99 0 1\n1 2 3 0 1 0\n", "vertex 0: property red: 1e+99 is not in 0..255"},
        {"", "not a .ply file"},
    };
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        points p = {(double *)ctx, (uint8_t *)ctx, 1};
        const char *path = ply_write_text(cases[i].text);
        assert_status(ctx, sf_ply_read_points(ctx, path, &p.xyz, &p.rgb, &p.count), SF_ERR_FORMAT);
        assert_null(p.xyz);
        assert_null(p.rgb);
        assert_int_equal(p.count, 0);
        assert_error_names(ctx, path);
        assert_error_names(ctx, cases[i].part);
    }
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_points_binary),
        cmocka_unit_test(test_points_ascii),
        cmocka_unit_test(test_points_without_colors_are_grey),
        cmocka_unit_test(test_points_none),
        cmocka_unit_test(test_points_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
