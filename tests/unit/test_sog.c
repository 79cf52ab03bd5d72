/* test_sog.c - SOG of versions 1 and 2 by hand, and files that lie. */
#include "testing.h"

#include <math.h>
#include <stdio.h>
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

int main(void) {
    const struct CMUnitTest tests[] = {
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
