/* test_spz.c - Gaussians to .spz and back: bytes by hand, errors within the format's steps. */
#include "spz_fixture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "scene/gaussian_math.h"

/* What a file of the library unpacks to. */
static file unpacked(const char *path) {
    size_t size;
    uint8_t *data = test_read(path, &size);
    file f = {0};
    z_stream z = {.next_in = data, .avail_in = (uInt)size, .next_out = f.data, .avail_out = sizeof f.data};
    assert_int_equal(inflateInit2(&z, 31), Z_OK);
    assert_int_equal(inflate(&z, Z_FINISH), Z_STREAM_END);
    f.size = sizeof f.data - z.avail_out;
    inflateEnd(&z);
    free(data);
    return f;
}

/* Two Gaussians of degree 1, with the bytes that the format's text asks for worked out by hand. They are at
 * 0 and 1 of x, in this order along the curve; scales of 1 and means below 2 take 4 fractional bits
 * (12 steps of the median middle axis of 1, up to a power of two). */
static void test_bytes(void **state) {
    (void)state;
    static values v = {
        .means = {0, -0.5f, 1.25f, 1, 1, 1.5f},
        .quats = {0.5f, 0.5f, -0.5f, 0.5f, 0, 0, 0, -2},
        .log_scales = {0, 0, 0, -10, 5.9375f, 0},
        .logit_opacities = {0, 20},
        .sh = {0, 1, -1, 0.125f, -0.25f, 0.5f, 0, 0, 0, 0.0625f, 0.03f, -0.0625f, 3.3333333f, -3.3333333f,
               0.2f},
    };
    static const uint8_t expected[] = {
        'N', 'G', 'S', 'P', 3, 0, 0, 0, 2, 0, 0, 0, 1, 4, 1, 0,
        /* means: 0 -8 20, 16 16 24 of sixteenths */
        0, 0, 0, 0xf8, 0xff, 0xff, 20, 0, 0, 16, 0, 0, 16, 0, 0, 24, 0, 0,
        /* alphas */
        128, 255,
        /* colours: 127.5 + 38.25 f_dc */
        128, 166, 89, 255, 0, 135,
        /* scales: 16 (s + 10) */
        160, 160, 160, 0, 255, 160,
        /* rotations: x is the first of the largest (index 0), positive: y -.5, z .5, w .5; 511 sqrt(2) / 2 =
         * 361.3, the nearest multiple of 4 is 360: 1 101101000, 0 101101000, 0 101101000. The other one is z
         * alone. */
        0x68, 0xa1, 0x85, 0x36, 0, 0, 0, 0x80,
        /* SH at 5 bits: steps of 8 around 128 */
        144, 96, 192, 128, 128, 128, 136, 128, 120, 128, 128, 128, 128, 128, 128, 128, 128, 128};
    sf_context *ctx = test_context();
    sf_model *model = spz_model_of(ctx, &v, 2, 1);
    sf_model_set_antialiased(model, 1);
    sf_model_file_options options = sf_model_file_options_default();
    options.sh_bits[0] = 5;
    options.sh_bits[1] = 4;
    const char *path = test_path("bytes.spz");
    assert_ok(ctx, sf_model_save_as(model, path, &options));
    file f = unpacked(path);
    assert_int_equal(f.size, sizeof expected);
    for (size_t i = 0; i < sizeof expected; i++)
        if (f.data[i] != expected[i]) fail_msg("byte %zu is %d, not %d", i, f.data[i], expected[i]);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* Every field comes back within half a step of the format. `sh_steps` of band 1 and of those above. */
static void assert_within_steps(const values *was, const values *is, int count, int coefficients,
                                double mean_step, const double sh_steps[2]) {
    const double rounding = 1e-5;
    /* Three components each within half of 4 / 511 sqrt(1/2): the largest follows, with at most as much
     * times 3. */
    double rotation = 4 / 511.0 * sqrt(0.5) / 2;
    for (int j = 0; j < count; j++) {
        int i = (int)lround(8 * (double)is->means[3 * j]);
        assert_true(i >= 0 && i < count);
        for (int k = 0; k < 3; k++) {
            spz_assert_near("mean", (double)is->means[3 * j + k], (double)was->means[3 * i + k],
                            mean_step / 2 + rounding);
            spz_assert_near("log-scale", (double)is->log_scales[3 * j + k],
                            (double)was->log_scales[3 * i + k], 1 / 32.0 + rounding);
        }
        spz_assert_same_rotation(is->quats + 4 * j, was->quats + 4 * i, 6 * rotation * rotation + rounding);
        spz_assert_near("opacity", sf_sigmoid((double)is->logit_opacities[j]),
                        sf_sigmoid((double)was->logit_opacities[i]), 0.5 / 255 + rounding);
        for (int k = 0; k < 3 * coefficients; k++) {
            double step = k < 3 ? 1 / 255.0 / 0.15 : sh_steps[k >= 12];
            spz_assert_near("SH", (double)is->sh[3 * coefficients * j + k],
                            (double)was->sh[3 * coefficients * i + k], step / 2 + rounding);
        }
    }
}

static void round_trip(sf_context *ctx, int degree, sf_spz_frame frame) {
    static values was, is;
    int k = (degree + 1) * (degree + 1);
    sf_model_file_options options = sf_model_file_options_default();
    options.sh_bits[0] = 6;
    options.sh_bits[1] = 5;
    options.spz_frame = frame;
    spz_make_values(&was, MAX_COUNT, k, (uint64_t)degree + 1);
    sf_model *model = spz_model_of(ctx, &was, MAX_COUNT, degree), *again;
    const char *path = test_path("round.spz");
    test_log_clear();
    assert_ok(ctx, sf_model_save_as(model, path, &options));
    assert_string_equal(test_log, "");
    assert_ok(ctx, sf_model_load_as(ctx, path, &options, &again));
    assert_int_equal(sf_model_count(again), MAX_COUNT);
    assert_int_equal(sf_model_sh_degree(again), degree);
    assert_int_equal(sf_model_antialiased(again), 0);
    sf_gaussians g = spz_arrays_of(&is);
    assert_ok(ctx, sf_model_get(again, 0, MAX_COUNT, &g));
    double mean_step = ldexp(1, -unpacked(path).data[13]);
    assert_within_steps(&was, &is, MAX_COUNT, k, mean_step, (double[]){1 / 32.0, 1 / 16.0});
    sf_model_destroy(&again);
    sf_model_destroy(&model);
}

static void test_round_trip(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    for (int degree = 0; degree <= SF_MAX_SH_DEGREE; degree++)
        for (int frame = SF_SPZ_FRAME_OWN; frame <= SF_SPZ_FRAME_RUB; frame++)
            round_trip(ctx, degree, (sf_spz_frame)frame);
    sf_context_destroy(&ctx);
}

/* A half turn about x changes what is stored, and nothing of what a camera that turned with it sees. */
static void test_frame(void **state) {
    (void)state;
    static values v;
    enum { SIDE = 32 };
    static float before[3 * SIDE * SIDE], after[3 * SIDE * SIDE];
    sf_context *ctx = test_context();
    sf_renderer *renderer;
    sf_quality q;
    spz_make_values(&v, MAX_COUNT, 16, 3);
    for (int i = 0; i < MAX_COUNT; i++) {
        v.means[3 * i] = v.means[3 * i] / 4 - 1, v.means[3 * i + 2] += 8;
        for (int k = 0; k < 3; k++) v.log_scales[3 * i + k] = -1 - (float)k;
    }
    sf_model *model = spz_model_of(ctx, &v, MAX_COUNT, 3), *turned, *kept;
    sf_model_file_options options = sf_model_file_options_default();
    options.sh_bits[0] = options.sh_bits[1] = 8;
    const char *path = test_path("frame.spz");
    assert_ok(ctx, sf_model_save_as(model, path, &options));
    assert_ok(ctx, sf_model_load_as(ctx, path, &options, &kept));
    options.spz_frame = SF_SPZ_FRAME_RUB;
    assert_ok(ctx, sf_model_load_as(ctx, path, &options, &turned));
    const sf_camera camera = {SIDE,     SIDE, SIDE, SIDE, SIDE / 2.0, SIDE / 2.0, {1, 0, 0, 0, 1, 0, 0, 0, 1},
                              {0, 0, 0}};
    sf_camera other = camera;
    other.R_cw[4] = other.R_cw[8] = -1;
    assert_ok(ctx, sf_renderer_create(ctx, &renderer));
    assert_ok(ctx, sf_render(renderer, kept, &camera, NULL, &(sf_image_out){.rgb = before}));
    for (int i = 0; i < 3 * SIDE * SIDE; i++) before[i] = fminf(before[i], 1); /* as a picture */
    assert_ok(ctx, sf_render(renderer, turned, &other, NULL, &(sf_image_out){.rgb = after}));
    assert_ok(ctx, sf_compare(renderer, SIDE, SIDE, after, before, NULL, &q));
    assert_true(q.psnr > 90);
    assert_ok(ctx, sf_render(renderer, turned, &camera, NULL, &(sf_image_out){.rgb = after}));
    assert_ok(ctx, sf_compare(renderer, SIDE, SIDE, after, before, NULL, &q));
    assert_true(q.psnr < 30); /* and it was turned */
    sf_renderer_destroy(&renderer);
    sf_model_destroy(&kept);
    sf_model_destroy(&turned);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* Without sh_bits heavier Gaussians keep more: errors fall with the weight. */
static void test_bits_by_weight(void **state) {
    (void)state;
    static values v, w;
    sf_context *ctx = test_context();
    spz_make_values(&v, MAX_COUNT, 16, 9);
    for (int i = 0; i < MAX_COUNT; i++) {
        v.logit_opacities[i] = i < MAX_COUNT / 2 ? 4 : -4;
        for (int k = 0; k < 3; k++) v.log_scales[3 * i + k] = i < MAX_COUNT / 2 ? -2 : -5;
    }
    sf_model *model = spz_model_of(ctx, &v, MAX_COUNT, 3), *again;
    const char *path = test_path("weight.spz");
    assert_ok(ctx, sf_model_save(model, path));
    assert_ok(ctx, sf_model_load(ctx, path, &again));
    sf_gaussians g = spz_arrays_of(&w);
    assert_ok(ctx, sf_model_get(again, 0, MAX_COUNT, &g));
    double error[2] = {0, 0};
    for (int j = 0; j < MAX_COUNT; j++) {
        int i = (int)lround(8 * (double)w.means[3 * j]);
        for (int k = 12; k < 48; k++)
            error[i < MAX_COUNT / 2] += fabs((double)w.sh[48 * j + k] - (double)v.sh[48 * i + k]);
    }
    assert_true(error[1] > 0);
    assert_true(error[0] > 4 * error[1]);
    sf_model_destroy(&again);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* Beyond the format: moved to its edge, counted and said. */
static void test_clips(void **state) {
    (void)state;
    static values v, w;
    sf_context *ctx = test_context();
    spz_make_values(&v, 4, 4, 5);
    v.log_scales[3] = -15;
    v.log_scales[4] = 12;
    v.sh[12 * 2] = 9;
    v.sh[12 * 2 + 5] = -3;
    v.means[3 * 3 + 1] = 1e9f;
    sf_model *model = spz_model_of(ctx, &v, 4, 1), *again;
    const char *path = test_path("clips.spz");
    test_log_clear();
    assert_ok(ctx, sf_model_save(model, path));
    assert_non_null(strstr(test_log, "clips.spz: 1 coordinates"));
    assert_non_null(strstr(test_log, "2 log-scales"));
    assert_non_null(strstr(test_log, "1 values f_dc"));
    assert_non_null(strstr(test_log, "1 values of higher SH bands"));
    assert_non_null(strstr(test_log, "coordinates of up to 1e+09 leave steps of 1 to the means"));
    assert_ok(ctx, sf_model_load(ctx, path, &again));
    sf_gaussians g = spz_arrays_of(&w);
    assert_ok(ctx, sf_model_get(again, 0, 4, &g));
    float least = 0, most = 0, furthest = 0;
    for (int i = 0; i < 12; i++) {
        least = fminf(least, w.log_scales[i]);
        most = fmaxf(most, w.log_scales[i]);
        furthest = fmaxf(furthest, w.means[i]);
    }
    assert_true(least == -10);
    assert_true(most == 5.9375f);
    assert_true(furthest == (1 << 23) - 1);
    sf_model_destroy(&again);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

static void test_options(void **state) {
    (void)state;
    static values v;
    sf_context *ctx = test_context();
    spz_make_values(&v, 3, 16, 5);
    sf_model *model = spz_model_of(ctx, &v, 3, 3), *again;
    const char *path = test_path("options.spz");
    sf_model_file_options options = sf_model_file_options_default();
    options.sh_degree = 1;
    assert_ok(ctx, sf_model_save_as(model, path, &options));
    assert_ok(ctx, sf_model_load(ctx, path, &again));
    assert_int_equal(sf_model_sh_degree(again), 1);
    sf_model_destroy(&again);
    options.sh_degree = 0;
    assert_ok(ctx, sf_model_load_as(ctx, path, &options, &again));
    assert_int_equal(sf_model_sh_degree(again), 0);
    sf_model_destroy(&again);
    static const struct {
        sf_model_file_options o;
        const char *part;
    } wrong[] = {
        {{.sh_degree = 4}, "sh_degree: 4"},
        {{.sh_degree = -1, .sh_bits = {9, 4}}, "sh_bits: 9"},
        {{.sh_degree = -1, .sh_bits = {0, 4}}, "sh_bits: 0 and 4"},
        {{.sh_degree = -1, .spz_frame = (sf_spz_frame)2}, "spz_frame: 2"},
        {{.sh_degree = -1, .format = (sf_model_format)99}, "format: 99"},
    };
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        assert_status(ctx, sf_model_save_as(model, path, &wrong[i].o), SF_ERR_ARGUMENT);
        assert_error_names(ctx, wrong[i].part);
    }
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

static void test_empty_model(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_model *model, *again;
    const char *path = test_path("none.spz");
    assert_ok(ctx, sf_model_create(ctx, 0, 2, &model));
    assert_ok(ctx, sf_model_save(model, path));
    assert_ok(ctx, sf_model_load(ctx, path, &again));
    assert_int_equal(sf_model_count(again), 0);
    assert_int_equal(sf_model_sh_degree(again), 2);
    sf_model_destroy(&again);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_bytes),       cmocka_unit_test(test_round_trip),
        cmocka_unit_test(test_frame),       cmocka_unit_test(test_bits_by_weight),
        cmocka_unit_test(test_clips),       cmocka_unit_test(test_options),
        cmocka_unit_test(test_empty_model),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
