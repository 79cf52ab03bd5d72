/* test_remap.c - undistorted and downscaled planes against the lens in float64. */
#include "testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"

enum { WIDTH = 83, HEIGHT = 61, STRIDE = WIDTH + 5, PIXELS = STRIDE * HEIGHT };

static const sf_lens mild = {80, 76, 43, 29, -0.15, 0.03, 0.004, -0.003, 0};
static const sf_lens plain = {80, 76, 43, 29, 0, 0, 0, 0, 0};

static float *planes(size_t values, float *rgb[3]) {
    float *all = malloc(3 * values * sizeof *all);
    assert_non_null(all);
    memset(all, 0xff, 3 * values * sizeof *all); /* not numbers */
    for (size_t c = 0; c < 3; c++) rgb[c] = all + c * values;
    return all;
}

/* Any values: what interpolation does to them is as steep as it can be. */
static float *noise(float *rgb[3]) {
    sf_rng rng;
    float *all = planes(PIXELS, rgb);
    sf_rng_seed(&rng, 3);
    for (int c = 0; c < 3; c++)
        for (int y = 0; y < HEIGHT; y++)
            for (int x = 0; x < WIDTH; x++) rgb[c][y * STRIDE + x] = (float)sf_rng_uniform(&rng);
    return all;
}

/* ---- the lens, again ------------------------------------------------------------------------------------
 */

static void distort(const sf_lens *l, double x, double y, double out[2]) {
    double r2 = x * x + y * y, d = 1 + l->k1 * r2 + l->k2 * r2 * r2 + l->k3 * r2 * r2 * r2;
    out[0] = x * d + 2 * l->p1 * x * y + l->p2 * (r2 + 2 * x * x);
    out[1] = y * d + 2 * l->p2 * x * y + l->p1 * (r2 + 2 * y * y);
}

/* Whether r d(r) grows all the way to (x, y), in small steps. */
static int grows(const sf_lens *l, double x, double y) {
    for (int k = 1; k <= 64; k++) {
        double s = (x * x + y * y) * k * k / (64 * 64);
        if (1 + 3 * l->k1 * s + 5 * l->k2 * s * s + 7 * l->k3 * s * s * s < 0) return 0;
    }
    return 1;
}

/* Where the undistorted picture's pixel (i, j) comes from, of pixel centres; 0: not from the picture; -1:
 * from within 1e-4 px of its border. */
static int source_of(const sf_lens *l, int i, int j, double at[2]) {
    double x = (i + 0.5 - l->cx) / l->fx, y = (j + 0.5 - l->cy) / l->fy;
    if (!grows(l, x, y)) return 0;
    distort(l, x, y, at);
    at[0] = l->fx * at[0] + l->cx - 0.5;
    at[1] = l->fy * at[1] + l->cy - 0.5;
    double inside = fmin(fmin(at[0], WIDTH - 1 - at[0]), fmin(at[1], HEIGHT - 1 - at[1]));
    return fabs(inside) < 1e-4 ? -1 : inside > 0;
}

static double bilinear(const float *plane, const double at[2]) {
    int x = (int)at[0], y = (int)at[1];
    double h = at[0] - x, v = at[1] - y;
    const float *p = plane + y * STRIDE + x;
    return (1 - v) * ((1 - h) * (double)p[0] + h * (double)p[1]) +
           v * ((1 - h) * (double)p[STRIDE] + h * (double)p[STRIDE + 1]);
}

/* Pixel (x, y) of the result and its weight; 0 where a sample may be in or out. */
static int expect(const sf_lens *l, float *const rgb[3], int factor, int x, int y, double out[4]) {
    int count = 0;
    memset(out, 0, 4 * sizeof *out);
    for (int k = 0; k < factor * factor; k++) {
        double at[2];
        int found = source_of(l, x * factor + k % factor, y * factor + k / factor, at);
        if (found < 0) return 0;
        if (!found) continue;
        for (int c = 0; c < 3; c++) out[c] += bilinear(rgb[c], at);
        count++;
    }
    for (int c = 0; c < 3; c++) out[c] /= count ? count : 1;
    out[3] = (double)count / (factor * factor);
    return 1;
}

/* ---- results --------------------------------------------------------------------------------------------
 */

typedef struct result {
    sf_camera camera;
    size_t stride;
    float *all, *rgb[3], *weight;
} result;

static result remap(sf_context *ctx, const sf_lens *lens, int factor, float *const rgb[3]) {
    sf_remap *r;
    result got;
    assert_ok(ctx, sf_remap_create(ctx, lens, WIDTH, HEIGHT, factor, &r));
    sf_remap_camera(r, &got.camera);
    got.stride = (size_t)got.camera.width + 2;
    got.all = planes(got.stride * (size_t)got.camera.height, got.rgb);
    got.weight = calloc(got.stride * (size_t)got.camera.height, sizeof(float));
    assert_non_null(got.weight);
    assert_ok(ctx, sf_remap_run(r, rgb, STRIDE, got.rgb, got.stride, got.weight));
    sf_remap_destroy(&r);
    assert_null(r);
    return got;
}

static void result_free(result *r) {
    free(r->all);
    free(r->weight);
}

/* Map positions are rounded to 2^-15 px: values change by at most that on either axis. */
static void check_lens(const sf_lens *lens, int factor, int least_inside, int least_cut) {
    sf_context *ctx = test_context();
    float *rgb[3], *all = noise(rgb);
    result got = remap(ctx, lens, factor, rgb);
    int inside = 0, cut = 0, open = 0;
    for (int y = 0; y < got.camera.height; y++)
        for (int x = 0; x < got.camera.width; x++) {
            double want[4];
            size_t at = (size_t)y * got.stride + (size_t)x;
            if (!expect(lens, rgb, factor, x, y, want)) {
                open++;
                continue;
            }
            assert_true(fabs((double)got.weight[at] - want[3]) < 1e-6);
            for (int c = 0; c < 3; c++) assert_true(fabs((double)got.rgb[c][at] - want[c]) < 4e-5);
            inside += want[3] == 1;
            cut += want[3] < 1;
        }
    assert_true(inside >= least_inside && cut >= least_cut && open <= 2);
    result_free(&got);
    free(all);
    sf_context_destroy(&ctx);
}

static void test_known_lenses(void **state) {
    (void)state;
    const sf_lens barrel = {80, 80, 41.5, 30.5, -0.1, 0, 0, 0, 0};
    const sf_lens pincushion = {80, 80, 41, 30, 0.3, 0.1, 0, 0, 0};
    const sf_lens tangential = {80, 80, 41, 30, 0, 0, 0.02, -0.015, 0};
    const sf_lens turning = {30, 30, 41, 30, -1.0 / 3, 0, 0, 0, 0}; /* back at r = 1 */
    const sf_lens six = {80, 76, 43, 29, 0.05, 0.02, 0.002, -0.001, -0.11};
    const sf_lens turning_six = {30, 30, 41, 30, 0, 0, 0, 0, -1.0 / 7}; /* back at r = 1 */
    check_lens(&six, 1, 4500, 0);
    check_lens(&six, 3, 450, 0);
    check_lens(&turning_six, 1, 2000, 2000);
    check_lens(&mild, 1, 4500, 0);
    check_lens(&barrel, 1, 4500, 0);
    check_lens(&pincushion, 1, 3000, 500);
    check_lens(&tangential, 1, 4000, 150);
    check_lens(&turning, 1, 2000, 2000);
    check_lens(&turning, 3, 200, 100);
    for (int factor = 2; factor <= 5; factor++) check_lens(&mild, factor, 4000 / factor / factor, 0);
    check_lens(&pincushion, 7, 50, 10);
}

static void test_weight_may_be_left_out(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    float *rgb[3], *out[3], *all = noise(rgb), *bare = planes(PIXELS, out);
    sf_remap *r;
    assert_ok(ctx, sf_remap_create(ctx, &mild, WIDTH, HEIGHT, 1, &r));
    assert_ok(ctx, sf_remap_run(r, rgb, STRIDE, out, STRIDE, NULL));
    result with = remap(ctx, &mild, 1, rgb);
    for (int c = 0; c < 3; c++)
        for (size_t y = 0; y < HEIGHT; y++)
            assert_memory_equal(out[c] + y * STRIDE, with.rgb[c] + y * with.stride, WIDTH * sizeof(float));
    sf_remap_destroy(&r);
    result_free(&with);
    free(all);
    free(bare);
    sf_context_destroy(&ctx);
}

static void test_no_distortion_is_a_copy(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    float *rgb[3], *all = noise(rgb);
    result got = remap(ctx, &plain, 1, rgb);
    for (size_t y = 0; y < HEIGHT; y++) {
        for (int c = 0; c < 3; c++)
            assert_memory_equal(rgb[c] + y * STRIDE, got.rgb[c] + y * got.stride, WIDTH * sizeof(float));
        for (size_t x = 0; x < WIDTH; x++) assert_true(got.weight[y * got.stride + x] == 1);
        assert_true(isnan(got.rgb[0][y * got.stride + WIDTH])); /* beside it nothing is written */
    }
    result_free(&got);
    free(all);
    sf_context_destroy(&ctx);
}

static void test_no_distortion_is_averaged(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    float *rgb[3], *all = noise(rgb);
    for (int factor = 2; factor <= 61; factor += 1 + factor / 2) {
        result got = remap(ctx, &plain, factor, rgb);
        assert_int_equal(got.camera.width, WIDTH / factor);
        assert_int_equal(got.camera.height, HEIGHT / factor);
        for (int y = 0; y < got.camera.height; y++)
            for (int x = 0; x < got.camera.width; x++) {
                double sum = 0;
                for (int k = 0; k < factor * factor; k++)
                    sum += (double)rgb[1][(y * factor + k / factor) * STRIDE + x * factor + k % factor];
                size_t at = (size_t)y * got.stride + (size_t)x;
                assert_true(fabs((double)got.rgb[1][at] - sum / (factor * factor)) < 1e-6);
                assert_true(got.weight[at] == 1);
            }
        result_free(&got);
    }
    free(all);
    sf_context_destroy(&ctx);
}

/* A picture of one colour stays that colour wherever the lens sees it. */
static void test_one_colour_stays(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    float *rgb[3], *all = noise(rgb);
    for (int i = 0; i < 3 * PIXELS; i++) all[i] = i / PIXELS == 2 ? 1 : 0.3f;
    result got = remap(ctx, &mild, 1, rgb);
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++) {
            size_t at = (size_t)y * got.stride + (size_t)x;
            assert_true(got.rgb[0][at] == (got.weight[at] > 0 ? 0.3f : 0));
            assert_true(got.rgb[2][at] == (got.weight[at] > 0 ? 1 : 0));
        }
    result_free(&got);
    free(all);
    sf_context_destroy(&ctx);
}

static void test_threads_change_nothing(void **state) {
    (void)state;
    float *rgb[3], *all = noise(rgb);
    result got[3];
    for (int i = 0; i < 3; i++) {
        sf_context *ctx = test_context_threads(i + 1);
        got[i] = remap(ctx, &mild, 2, rgb);
        sf_context_destroy(&ctx);
    }
    size_t values = got[0].stride * (size_t)got[0].camera.height;
    for (int i = 1; i < 3; i++) {
        assert_memory_equal(got[0].all, got[i].all, 3 * values * sizeof(float));
        assert_memory_equal(got[0].weight, got[i].weight, values * sizeof(float));
    }
    for (int i = 0; i < 3; i++) result_free(&got[i]);
    free(all);
}

static void test_camera(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_remap *r;
    sf_camera camera;
    assert_ok(ctx, sf_remap_create(ctx, &mild, WIDTH, HEIGHT, 4, &r));
    sf_remap_camera(r, &camera);
    assert_int_equal(sf_camera_check(&camera), SF_OK);
    assert_int_equal(camera.width, 20);
    assert_int_equal(camera.height, 15);
    assert_true(camera.fx == 20 && camera.fy == 19 && camera.cx == 10.75 && camera.cy == 7.25);
    for (int k = 0; k < 9; k++) assert_true(camera.R_cw[k] == (k % 4 == 0));
    for (int k = 0; k < 3; k++) assert_true(camera.t_cw[k] == 0);
    sf_remap_destroy(&r);
    sf_context_destroy(&ctx);
}

/* A side of one pixel has no neighbour. */
static void test_smallest_pictures(void **state) {
    (void)state;
    static const int32_t sizes[][2] = {{1, 1}, {1, 2}, {2, 1}};
    sf_context *ctx = test_context();
    for (int s = 0; s < 3; s++) {
        sf_lens tiny = {1, 1, sizes[s][0] / 2.0, sizes[s][1] / 2.0, -0.01, 0, 0, 0, 0};
        float in[2] = {0.25f, 0.25f}, out[2] = {9, 9}, weight[2];
        float *rgb[3] = {in, in, in}, *to[3] = {out, out, out};
        sf_remap *r;
        size_t width = (size_t)sizes[s][0];
        assert_ok(ctx, sf_remap_create(ctx, &tiny, sizes[s][0], sizes[s][1], 1, &r));
        assert_ok(ctx, sf_remap_run(r, rgb, width, to, width, weight));
        for (int i = 0; i < sizes[s][0] * sizes[s][1]; i++) assert_true(out[i] == 0.25f && weight[i] == 1);
        sf_remap_destroy(&r);
    }
    sf_context_destroy(&ctx);
}

static void assert_refused(sf_context *ctx, const sf_lens *lens, int width, int height, int factor,
                           const char *part) {
    int nothing;
    sf_remap *r = (sf_remap *)(void *)&nothing;
    assert_status(ctx, sf_remap_create(ctx, lens, width, height, factor, &r), SF_ERR_ARGUMENT);
    assert_null(r);
    assert_error_names(ctx, part);
}

static void test_bad_arguments(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_lens bad = mild;
    sf_remap *r;
    float value, *rgb[3] = {&value, &value, &value};
    assert_refused(ctx, &mild, 0, HEIGHT, 1, "size: 0 x 61");
    assert_refused(ctx, &mild, WIDTH, 65536, 1, "size: 83 x 65536");
    assert_refused(ctx, &mild, WIDTH, HEIGHT, 0, "downscale: 0");
    assert_refused(ctx, &mild, WIDTH, HEIGHT, 62, "downscale: 62");
    assert_refused(ctx, &mild, 100, 100, 65, "downscale: 65");
    bad.k2 = NAN;
    assert_refused(ctx, &bad, WIDTH, HEIGHT, 1, "lens");
    bad = mild, bad.fx = 0;
    assert_refused(ctx, &bad, WIDTH, HEIGHT, 1, "fx 0");
    assert_ok(ctx, sf_remap_create(ctx, &mild, WIDTH, HEIGHT, 2, &r));
    assert_status(ctx, sf_remap_run(r, rgb, WIDTH - 1, rgb, WIDTH, NULL), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "stride: 82");
    assert_status(ctx, sf_remap_run(r, rgb, WIDTH, rgb, 40, NULL), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "out_stride: 40");
    sf_remap_destroy(&r);
    sf_remap_destroy(&r);
    sf_context_destroy(&ctx);
}

/* A lens that throws all far out of the picture, or to infinity. */
static void test_wild_lenses(void **state) {
    (void)state;
    const sf_lens wild[] = {{1e-3, 1e-3, 40, 30, 1e300, 1e300, 0, 0, 0},
                            {80, 76, 1e9, 29, 0.1, 0, 0, 0, 0},
                            {80, 76, 43, 29, 0, 1e6, 1e5, -1e5, 0}};
    sf_context *ctx = test_context();
    float *rgb[3], *all = noise(rgb);
    for (size_t i = 0; i < sizeof wild / sizeof *wild; i++) {
        result got = remap(ctx, &wild[i], 1, rgb);
        for (int y = 0; y < HEIGHT; y++)
            for (int x = 0; x < WIDTH; x++) {
                float weight = got.weight[(size_t)y * got.stride + (size_t)x];
                float value = got.rgb[0][(size_t)y * got.stride + (size_t)x];
                assert_true(weight == 0 ? value == 0 : weight == 1 && value >= 0 && value <= 1);
            }
        result_free(&got);
    }
    free(all);
    sf_context_destroy(&ctx);
}

static void test_memory_ends(void **state) {
    (void)state;
    test_allocations a = {0};
    sf_allocator allocator = {test_count_alloc, test_count_free, &a};
    sf_context_options options = {.allocator = &allocator, .threads = 1};
    sf_context *ctx;
    assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
    long before = a.live;
    for (long fail = 1; fail <= 2; fail++) {
        sf_remap *r;
        a.fail_at = a.calls + fail;
        assert_status(ctx, sf_remap_create(ctx, &mild, WIDTH, HEIGHT, 1, &r), SF_ERR_MEMORY);
        assert_null(r);
        assert_int_equal(a.live, before);
    }
    sf_context_destroy(&ctx);
    assert_int_equal(a.live, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_known_lenses),
        cmocka_unit_test(test_weight_may_be_left_out),
        cmocka_unit_test(test_no_distortion_is_a_copy),
        cmocka_unit_test(test_no_distortion_is_averaged),
        cmocka_unit_test(test_one_colour_stays),
        cmocka_unit_test(test_threads_change_nothing),
        cmocka_unit_test(test_camera),
        cmocka_unit_test(test_smallest_pictures),
        cmocka_unit_test(test_bad_arguments),
        cmocka_unit_test(test_wild_lenses),
        cmocka_unit_test(test_memory_ends),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
