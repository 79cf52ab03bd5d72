/* test_compressed_ply.c - the compressed .ply of PlayCanvas and SuperSplat, by hand: what its words stand
 * for, and files that lie. */
#include "testing.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

enum { CHUNK = 256, COUNT = CHUNK + 1, VALUES = 14 };

static char text[1 << 16];
static size_t length;

__attribute__((format(printf, 1, 2))) static void put(const char *format, ...) {
    va_list list;
    va_start(list, format);
    int n = vsnprintf(text + length, sizeof text - length, format, list);
    va_end(list);
    assert_true(n >= 0 && (size_t)n < sizeof text - length);
    length += (size_t)n;
}

static const char *finish(void) {
    test_write(test_path("packed.ply"), text, length);
    length = 0;
    return test_path("packed.ply");
}

static void put_header(const char *before, int chunks, int vertices, int colors) {
    static const char *const ends[] = {"x", "y", "z", "scale_x", "scale_y", "scale_z", "r", "g", "b"};
    length = 0;
    put("ply\nformat ascii 1.0\n%selement chunk %d\n", before, chunks);
    for (int i = 0; i < (colors ? 9 : 6); i++)
        put("property float min_%s\nproperty float max_%s\n", ends[i], ends[i]);
    put("element vertex %d\nproperty uint packed_position\nproperty uint packed_rotation\n"
        "property uint packed_scale\nproperty uint packed_color\n",
        vertices);
}

static void put_sh_header(int rows, int values) {
    put("element sh %d\n", rows);
    for (int i = 0; i < values; i++) put("property uchar f_rest_%d\n", i);
}

/* x -1..1, y 0..10, z 5..5; log-scales -8..0, -4..-2, -6..-1. */
#define CHUNK_ENDS "-1 1 0 10 5 5 -8 0 -4 -2 -6 -1"

/* 11, 10 and 11 bits: x at its end, y at 511 of 1023, z at 0. */
static const unsigned long word_xyz = 2047ul << 21 | 511ul << 11;
/* The largest is x (1 of w x y z); w at 1023, y at 0, z at 511 of 1023. */
static const unsigned long word_rotation = 1ul << 30 | 1023ul << 20 | 511;
static const unsigned long word_color = 255ul << 24 | 51ul << 16 | 0ul << 8 | 102;

static void put_vertex(void) { put("%lu %lu %lu %lu\n", word_xyz, word_rotation, word_xyz, word_color); }

static void get_last(sf_context *ctx, const char *path, int degree, float *values) {
    sf_gaussians f = {values, values + 3, values + 7, values + 10, values + 11};
    sf_model *model;
    assert_ok(ctx, sf_model_load(ctx, path, &model));
    assert_int_equal(sf_model_sh_degree(model), degree);
    assert_ok(ctx, sf_model_get(model, sf_model_count(model) - 1, 1, &f));
    sf_model_destroy(&model);
}

static void assert_values(const float *found, const double *wanted, int count) {
    for (int i = 0; i < count; i++)
        if (!(fabs((double)found[i] - wanted[i]) <= 1e-5))
            fail_msg("value %d is %.9g, not %.9g", i, (double)found[i], wanted[i]);
}

/* Mean, quaternion, log-scales, logit of the opacity, colour: of the last of 257, by the ends of the second
 * chunk. */
static void test_unpacks_words(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const double y = 511 / 1023.0, h = sqrt(0.5), z = (y - 0.5) * sqrt(2), sh_0 = 0.28209479177387814;
    const double quat_x = sqrt(fmax(0, 1 - h * h - h * h - z * z));
    float values[VALUES];
    for (int colors = 0; colors <= 1; colors++) {
        put_header("", 2, COUNT, colors);
        put("end_header\n9 9 9 9 9 9 -9 -9 -9 -9 -9 -9 %s\n" CHUNK_ENDS " %s\n", colors ? "0 0 0 0 0 0" : "",
            colors ? "-0.5 1.5 0 2 0.25 4" : "");
        for (int i = 0; i < COUNT; i++) put_vertex();
        get_last(ctx, finish(), 0, values);
        const double red = colors ? 1.5 : 1, green = colors ? 0.4 : 0.2, blue = colors ? 0.25 : 0;
        assert_values(values,
                      (const double[]){1, 10 * y, 5, h, quat_x, -h, z, 0, -4 + 2 * y, -6, log(0.4 / 0.6),
                                       (red - 0.5) / sh_0, (green - 0.5) / sh_0, (blue - 0.5) / sh_0},
                      VALUES);
    }
    sf_context_destroy(&ctx);
}

/* w, x, y and z in turn are the largest; the three others are 0.5 but for a 1023rd. */
static void test_finds_the_largest_of_a_rotation(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const double least = (0 - 0.5) * sqrt(2), middle = (512 / 1023.0 - 0.5) * sqrt(2);
    for (unsigned largest = 0; largest < 4; largest++) {
        float values[VALUES];
        double wanted[4];
        put_header("", 1, 1, 0);
        put("end_header\n" CHUNK_ENDS "\n0 %lu 0 0\n", (unsigned long)largest << 30 | 512ul << 10 | 512);
        get_last(ctx, finish(), 0, values);
        for (unsigned k = 0, n = 0; k < 4; k++)
            wanted[k] = k == largest ? sqrt(1 - least * least - 2 * middle * middle) : n++ ? middle : least;
        assert_values(values + 3, wanted, 4);
    }
    sf_context_destroy(&ctx);
}

/* All reds first; the ends of a byte are -4 and 4. What of a file is not wanted is left out between. */
static void test_reads_sh(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    static const int counts[] = {0, 9, 24, 45};
    for (int degree = 0; degree <= 3; degree++) {
        float values[11 + 48];
        const int higher = counts[degree] / 3;
        put_header("", 1, 1, 0);
        put_sh_header(1, counts[degree]);
        put("end_header\n" CHUNK_ENDS "\n");
        put_vertex();
        for (int i = 0; i < counts[degree]; i++)
            put("%d ", i == 0 ? 0 : i == counts[degree] - 1 ? 255 : 100 + i);
        get_last(ctx, finish(), degree, values);
        for (int k = 0; k < higher; k++)
            for (int c = 0; c < 3; c++) {
                const int i = c * higher + k;
                const double part = i == 0 ? 0 : i == counts[degree] - 1 ? 1 : (100.5 + i) / 256;
                assert_values(&values[11 + 3 * (k + 1) + c], (const double[]){8 * part - 4}, 1);
            }
        if (degree < 3) continue;
        sf_model_file_options o = sf_model_file_options_default();
        sf_model *model;
        o.sh_degree = 1;
        assert_ok(ctx, sf_model_load_as(ctx, test_path("packed.ply"), &o, &model));
        assert_int_equal(sf_model_sh_degree(model), 1);
        sf_model_destroy(&model);
    }
    sf_context_destroy(&ctx);
}

/* Elements are found by their names, as their readers do. */
static void test_takes_elements_in_any_order(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    float first[VALUES + 9], second[VALUES + 9];
    const char *bytes = "1 2 3 4 5 6 7 8 9\n";
    put_header("comment SplatRenderMode: mip\n", 1, 1, 0);
    put_sh_header(1, 9);
    put("end_header\n" CHUNK_ENDS "\n");
    put_vertex();
    put("%s", bytes);
    get_last(ctx, finish(), 1, first);
    put_header("element sh 1\nproperty uchar f_rest_0\nproperty uchar f_rest_1\nproperty uchar f_rest_2\n"
               "property uchar f_rest_3\nproperty uchar f_rest_4\nproperty uchar f_rest_5\n"
               "property uchar f_rest_6\nproperty uchar f_rest_7\nproperty uchar f_rest_8\n",
               1, 1, 0);
    put("end_header\n%s" CHUNK_ENDS "\n", bytes);
    put_vertex();
    get_last(ctx, finish(), 1, second);
    assert_memory_equal(first, second, sizeof first);
    sf_context_destroy(&ctx);
}

static void assert_refused(sf_context *ctx, const char *part) {
    sf_model *model;
    assert_status(ctx, sf_model_load(ctx, finish(), &model), SF_ERR_FORMAT);
    assert_null(model);
    assert_error_names(ctx, part);
    assert_error_names(ctx, "packed.ply");
}

static void test_refuses_files_that_lie(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    put_header("", 1, COUNT, 0);
    put("end_header\n" CHUNK_ENDS "\n");
    for (int i = 0; i < COUNT; i++) put_vertex();
    assert_refused(ctx, "element chunk: 1 rows, not 2 for 257 vertices");
    put_header("", 1, 1, 0);
    put_sh_header(2, 9);
    put("end_header\n" CHUNK_ENDS "\n");
    put_vertex();
    put("1 2 3 4 5 6 7 8 9\n1 2 3 4 5 6 7 8 9\n");
    assert_refused(ctx, "element sh: 2 rows, not 1");
    put_header("", 1, 1, 0);
    put_sh_header(1, 8);
    put("end_header\n" CHUNK_ENDS "\n");
    put_vertex();
    put("1 2 3 4 5 6 7 8\n");
    assert_refused(ctx, "8 properties f_rest, not");
    put_header("", 1, 1, 0);
    put("end_header\n" CHUNK_ENDS "\n0 4294967296 0 0\n");
    assert_refused(ctx, "vertex 0: property packed_rotation: 4.29497e+09 is not in 0..4294967295");
    put("ply\nformat ascii 1.0\nelement vertex 1\nproperty uint packed_position\nend_header\n1\n");
    assert_refused(ctx, "element chunk is missing");
    put("ply\nformat ascii 1.0\nelement chunk 1\nproperty float min_x\nelement vertex 1\n"
        "property uint packed_position\nend_header\n1\n1\n");
    assert_refused(ctx, "element chunk: property max_x is missing");
    put_header("", 1, 1, 0);
    put("end_header\n" CHUNK_ENDS "\n1 2 3\n");
    assert_refused(ctx, "truncated");
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_unpacks_words),
        cmocka_unit_test(test_finds_the_largest_of_a_rotation),
        cmocka_unit_test(test_reads_sh),
        cmocka_unit_test(test_takes_elements_in_any_order),
        cmocka_unit_test(test_refuses_files_that_lie),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
