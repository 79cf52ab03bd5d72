/* test_sog.c - SOG of versions 1 and 2 by hand, files that lie, and files of our own. */
#include "testing.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(SF_HAVE_LIBZIP) && defined(SF_HAVE_LIBWEBP)

#include <webp/encode.h>

/* A picture of `width` texels, all alike. */
static void put_picture(const char *name, int width, int height, const uint8_t texel[4]) {
    static uint8_t rgba[4 * 192 * 4];
    uint8_t *packed;
    assert_true(4 * width * height <= (int)sizeof rgba);
    for (int i = 0; i < 4 * width * height; i++) rgba[i] = texel[i % 4];
    size_t size = WebPEncodeLosslessRGBA(rgba, width, height, 4 * width, &packed);
    assert_true(size > 0);
    test_write(test_path(name), packed, size);
    WebPFree(packed);
}

static void put_pictures(void) {
    put_picture("ml.webp", 4, 1, (const uint8_t[]){0xff, 0, 0, 255});
    put_picture("mu.webp", 4, 1, (const uint8_t[]){0xff, 0, 0x80, 255});
    put_picture("q.webp", 4, 1, (const uint8_t[]){255, 128, 128, 253});
    put_picture("s.webp", 4, 1, (const uint8_t[]){0, 1, 2, 255});
    put_picture("c.webp", 4, 1, (const uint8_t[]){2, 1, 0, 51});
    put_picture("centroids.webp", 192, 1, (const uint8_t[]){1, 2, 0, 255});
    put_picture("labels.webp", 4, 1, (const uint8_t[]){63, 0, 0, 255});
}

#define MEANS "\"mins\":[-1,-2,0],\"maxs\":[1,2,2],\"files\":[\"%s\",\"mu.webp\"]"
#define BOOK  "\"codebook\":[-3,-2,0.5]"

static const char *put_meta(int count, const char *version, const char *means_low) {
    static char text[2048];
    int size = snprintf(text, sizeof text,
                        "{\"version\":%s,\"count\":%d,\"model\":\"antialiased\",\"means\":{" MEANS
                        "},\"scales\":{" BOOK ",\"files\":[\"s.webp\"]},\"quats\":{\"files\":[\"q.webp\"]},"
                        "\"sh0\":{" BOOK ",\"files\":[\"c.webp\"]},\"shN\":{\"count\":64,\"bands\":1," BOOK
                        ",\"files\":[\"centroids.webp\",\"labels.webp\"]}}",
                        version, count, means_low);
    test_write(test_path("meta.json"), text, (size_t)size);
    return test_path("meta.json");
}

static void get_one(sf_context *ctx, const char *path, int degree, float values[60]) {
    sf_gaussians f = {values, values + 3, values + 7, values + 10, values + 11};
    sf_model *model;
    assert_ok(ctx, sf_model_load(ctx, path, &model));
    assert_int_equal(sf_model_sh_degree(model), degree);
    assert_ok(ctx, sf_model_get(model, 2, 1, &f));
    sf_model_destroy(&model);
}

static void test_reads_version_2(void **state) {
    sf_context *ctx = test_context();
    float v[60];
    (void)state;
    put_pictures();
    get_one(ctx, put_meta(3, "2", "ml.webp"), 1, v);
    assert_float_equal(v[0], expm1(1), 1e-6);
    assert_float_equal(v[1], -expm1(2), 1e-6);
    assert_float_equal(v[2], expm1(2 * 32768.0 / 65535), 1e-5);
    assert_float_equal(v[3], sqrt(0.5), 2e-2); /* w is 1/sqrt(2), x the greatest */
    assert_float_equal(v[4], sqrt(0.5), 2e-2);
    assert_float_equal(v[7], -3, 0);
    assert_float_equal(v[8], -2, 0);
    assert_float_equal(v[9], 0.5, 0);
    assert_float_equal(v[10], log(0.2 / 0.8), 1e-6);
    assert_float_equal(v[11], 0.5, 0);
    assert_float_equal(v[14], -2, 0); /* band 1: red, green, blue of the centroid */
    assert_float_equal(v[15], 0.5, 0);
    assert_float_equal(v[16], -3, 0);
    sf_context_destroy(&ctx);
}

static void test_reads_version_1(void **state) {
    static const char text[] =
        "{\"means\":{\"shape\":[3,3],\"mins\":[0,0,0],\"maxs\":[1,1,1],\"files\":[\"ml.webp\",\"mu.webp\"]},"
        "\"scales\":{\"mins\":[-5,-5,-5],\"maxs\":[0,0,0],\"files\":[\"s.webp\"]},"
        "\"quats\":{\"files\":[\"q.webp\"]},\"sh0\":{\"mins\":[0,0,0,-2],\"maxs\":[1,1,1,3],"
        "\"files\":[\"c.webp\"]}}";
    sf_context *ctx = test_context();
    float v[60];
    (void)state;
    put_pictures();
    test_write(test_path("meta.json"), text, sizeof text - 1);
    get_one(ctx, test_path("meta.json"), 0, v);
    assert_float_equal(v[7], -5, 0);
    assert_float_equal(v[8], -5 + 5 / 255.0, 1e-6);
    assert_float_equal(v[10], -1, 1e-6); /* a logit between its ends */
    assert_float_equal(v[11], 2 / 255.0, 1e-6);
    sf_context_destroy(&ctx);
}

static void test_refuses_what_lies(void **state) {
    static const struct {
        int count;
        const char *version, *means, *part;
    } cases[] = {
        {5, "2", "ml.webp", "does not go with 5"},
        {2000000000, "2", "ml.webp", "count"},
        {0, "2", "ml.webp", "count"},
        {3, "3", "ml.webp", "version: 3"},
        {3, "2", "../ml.webp", "leads out"},
        {3, "2", "meta.json", "is no WebP"},
    };
    sf_context *ctx = test_context();
    (void)state;
    put_pictures();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        sf_model *model;
        const char *path = put_meta(cases[i].count, cases[i].version, cases[i].means);
        assert_int_not_equal(sf_model_load(ctx, path, &model), SF_OK);
        assert_null(model);
        assert_error_names(ctx, path);
        assert_error_names(ctx, cases[i].part);
    }
    sf_context_destroy(&ctx);
}

/* ---- Out ---- */

enum { COUNT = 300, VALUES = 59 };

/* The i-th by its place along x: values that no two share, opacities down to 0 and up to 1. */
static void make_values(int i, float v[VALUES]) {
    for (int k = 0; k < VALUES; k++) v[k] = sinf(0.7f * (float)(VALUES * i + k));
    v[0] = 2 * (float)i - 300; /* farther apart than the widest step */
    for (int k = 7; k < 10; k++) v[k] = 3 * v[k] - 4;
    v[10] = (float)(i - 150) / 8;
}

static sf_gaussians fields_of(float v[VALUES]) { return (sf_gaussians){v, v + 3, v + 7, v + 10, v + 11}; }

static void save_many(sf_context *ctx, const char *path, int degree, int antialiased) {
    sf_model_file_options options = sf_model_file_options_default();
    float v[VALUES];
    sf_model *model;
    assert_ok(ctx, sf_model_create(ctx, COUNT, 3, &model));
    for (int i = 0; i < COUNT; i++) {
        const sf_gaussians f = fields_of(v);
        make_values(i, v);
        assert_ok(ctx, sf_model_set(model, (size_t)i, 1, &f));
    }
    sf_model_set_antialiased(model, antialiased);
    options.sh_degree = degree;
    assert_ok(ctx, sf_model_save_as(model, path, &options));
    sf_model_destroy(&model);
}

static int by_place(const void *a, const void *b) {
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

static double step_of(double x, double least, double most) { /* of 16 bits of the logarithm */
    return (1 + fabs(x)) * (log1p(most) + log1p(least)) / 65535;
}

/* `levels` of 3 COUNT values in -range .. range: half the widest step is far below a 64th of the range. */
static void assert_alike(const float was[VALUES], const float is[VALUES], int values) {
    double norm = 0, along = 0;
    for (int k = 0; k < 3; k++)
        assert_true(fabs((double)is[k] - (double)was[k]) <= step_of((double)was[k], 300, 300));
    for (int k = 3; k < 7; k++) {
        norm += (double)was[k] * (double)was[k];
        along += (double)was[k] * (double)is[k];
    }
    assert_true(1 - fabs(along) / sqrt(norm) < 6 / (255.0 * 255)); /* three of half a step of 2/255/sqrt(2) */
    for (int k = 7; k < 10; k++) assert_float_equal(is[k], was[k], 3.0 / 64);
    double opacity = 1 / (1 + exp(-(double)was[10])), read = 1 / (1 + exp(-(double)is[10]));
    assert_true(fabs(opacity - read) <= 0.5 / 255 + 1e-6);
    for (int k = 11; k < values; k++) assert_float_equal(is[k], was[k], 1.0 / 64);
}

static void check_round(sf_context *ctx, int degree, int antialiased) {
    static float read[COUNT][VALUES];
    const char *path = test_path("many.sog");
    int values = 11 + 3 * (degree + 1) * (degree + 1);
    sf_model *model;
    save_many(ctx, path, degree, antialiased);
    assert_ok(ctx, sf_model_load(ctx, path, &model));
    assert_int_equal(sf_model_count(model), COUNT);
    assert_int_equal(sf_model_sh_degree(model), degree);
    assert_int_equal(sf_model_antialiased(model), antialiased);
    for (size_t i = 0; i < COUNT; i++) {
        const sf_gaussians f = fields_of(read[i]);
        assert_ok(ctx, sf_model_get(model, i, 1, &f));
    }
    sf_model_destroy(&model);
    qsort(read, COUNT, sizeof *read, by_place);
    for (int i = 0; i < COUNT; i++) {
        float was[VALUES];
        make_values(i, was);
        assert_alike(was, read[i], values);
    }
}

static void test_round(void **state) {
    sf_context *ctx = test_context();
    (void)state;
    for (int degree = 0; degree <= 3; degree++) check_round(ctx, degree, degree == 3);
    sf_context_destroy(&ctx);
}

static void test_same_bytes(void **state) {
    size_t size, again;
    (void)state;
    for (int threads = 1; threads <= 3; threads += 2) {
        sf_context *ctx = test_context_threads(threads);
        save_many(ctx, test_path(threads == 1 ? "one.sog" : "three.sog"), 3, 0);
        sf_context_destroy(&ctx);
    }
    uint8_t *one = test_read(test_path("one.sog"), &size), *three = test_read(test_path("three.sog"), &again);
    assert_int_equal(size, again);
    assert_memory_equal(one, three, size);
    free(one);
    free(three);
}

static void test_writes_no_empty_model(void **state) {
    sf_context *ctx = test_context();
    sf_model *model;
    (void)state;
    assert_ok(ctx, sf_model_create(ctx, 0, 0, &model));
    assert_status(ctx, sf_model_save(model, test_path("empty.sog")), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "cannot hold 0 Gaussians");
    assert_false(test_exists(test_path("empty.sog")));
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_round),
        cmocka_unit_test(test_same_bytes),
        cmocka_unit_test(test_writes_no_empty_model),
        cmocka_unit_test(test_reads_version_2),
        cmocka_unit_test(test_reads_version_1),
        cmocka_unit_test(test_refuses_what_lies),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

#else

static void test_says_what_is_missing(void **state) {
    sf_context *ctx = test_context();
    sf_model *model;
    (void)state;
    test_write(test_path("meta.json"), "{}", 2);
    assert_status(ctx, sf_model_load(ctx, test_path("meta.json"), &model), SF_ERR_UNSUPPORTED);
    assert_error_names(ctx, "libwebp");
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_says_what_is_missing)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}

#endif
