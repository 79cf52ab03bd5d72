/* test_kernels.c - what tests/check leaves to say of the small scalar kernels: exp2, Adam's first step, the
 * rounding of its moments, black and white, where the tiles end. */
#include "testing.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../arch/scalar/exp2.h"
#include "base/pool.h"
#include "reference/random.h"
#include "render/workspace.h"
#include "scene/gaussians.h"

static sf_context *scalar_context(void) {
    sf_context *ctx;
    sf_context_options options = {.threads = 2, .isa = "scalar"};
    assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
    return ctx;
}

/* ---- exp2 -----------------------------------------------------------------------------------------------
 */

/* Positive floats first .. end-1 by their bits, with a sign, `step` apart, in `parts`. */
typedef struct sweep {
    uint32_t first, end, sign, step;
    size_t parts;
    double *worst; /* [parts] largest relative error */
} sweep;

static double exp2_error(float x) {
    double exact = exp2((double)x);
    return fabs((double)sf_exp2(x) - exact) / exact;
}

static void sweep_task(void *sweep_pointer, size_t part, int thread) {
    (void)thread;
    const sweep *s = sweep_pointer;
    uint32_t length = (s->end - s->first) / (uint32_t)s->parts + 1,
             first = s->first + (uint32_t)part * length;
    double worst = 0;
    for (uint32_t bits = first; bits - first < length && bits < s->end; bits += s->step) {
        double error = exp2_error(sf_float_of(bits | s->sign));
        worst = error > worst ? error : worst;
    }
    s->worst[part] = worst;
}

/* The largest relative error over the floats between `least` (> 0) and `most`, with a sign. */
static double worst_exp2(sf_context *ctx, float least, float most, uint32_t sign, uint32_t step) {
    enum { PARTS = 64 };
    double parts[PARTS], worst = 0;
    sweep s = {sf_bits_of(least), sf_bits_of(most) + 1, sign, step, PARTS, parts};
    sf_pool_run(ctx->pool, PARTS, sweep_task, &s);
    for (int i = 0; i < PARTS; i++) worst = fmax(worst, parts[i]);
    return worst;
}

/* Every float of [-9, 1]; of those below 2^-26, where the polynomial is its last term and 2^x within 2e-8 of
 * 1, every 1021st. */
static void exp2_is_within_its_bound(void **state) {
    (void)state;
    const uint32_t minus = 0x80000000u, step = test_is_quick() ? 64 : 1;
    sf_context *ctx = scalar_context();
    double worst = fmax(worst_exp2(ctx, 0x1p-26f, 9, minus, step), worst_exp2(ctx, 0x1p-26f, 1, 0, step));
    for (uint32_t bits = 0; bits <= sf_bits_of(0x1p-26f); bits += 1021) {
        worst = fmax(worst, exp2_error(sf_float_of(bits)));
        worst = fmax(worst, exp2_error(sf_float_of(bits | minus)));
    }
    print_message("exp2 on [-9, 1]: relative error %.4g\n", worst);
    assert_true(worst < 2.4e-7); /* as exp2.h says */
    assert_true(worst > 1e-8);   /* of a float: something was measured */
    sf_context_destroy(&ctx);
}

static void exp2_holds_over_its_whole_range(void **state) {
    (void)state;
    double worst = 0;
    for (float x = -126; x <= 127; x += 0x1.23p-10f) worst = fmax(worst, exp2_error(x));
    worst = fmax(worst, fmax(exp2_error(-126), exp2_error(127)));
    assert_true(worst < 2.4e-7);
}

/* ---- Adam -----------------------------------------------------------------------------------------------
 */

/* Corrected for their start, the moments of the first step are those of its gradient: p moves by the rate,
 * whatever the gradient's size. Where there never was one, it stays. */
static void first_step_of_adam_is_the_rate(void **state) {
    (void)state;
    sf_context *ctx = scalar_context();
    const sf_adam step = {0.01f / (1 - 0.9f), 0.9f, 0.999f, 1 / (1 - 0.999f), 1e-15f};
    float p[SF_LANES], g[SF_LANES], m[SF_LANES] = {0}, v[SF_LANES] = {0};
    for (int i = 0; i < SF_LANES; i++) {
        p[i] = 1;
        g[i] = i == 0 ? 0.0f : (float)((i % 2 ? -1 : 1) * pow(10, -8 + i % 11));
    }
    ctx->kernels->adam(p, g, m, v, SF_LANES, &step);
    assert_true(p[0] == 1 && m[0] == 0 && v[0] == 0);
    for (int i = 1; i < SF_LANES; i++) assert_true(fabs(p[i] - (1 - (g[i] > 0 ? 0.01 : -0.01))) < 4e-7);
    sf_context_destroy(&ctx);
}

enum { HALVES = 1 << 16 };

static double m_of(uint32_t word) { return (double)sf_float_of(word & 0xffff0000u); }
static double v_of(uint32_t word) { return (double)sf_float_of((word & 0xffffu) << 15); }

/* Both moments of HALVES words against what they stand for: each within a last bit, the mean far closer. */
static void check_mean(const uint32_t *words, double m, double v) {
    double m_sum = 0, v_sum = 0, m_bit = fabs(m) * 0x1p-7, v_bit = v * 0x1p-8;
    for (int i = 0; i < HALVES; i++) {
        m_sum += m_of(words[i]) - m;
        v_sum += v_of(words[i]) - v;
        assert_true(fabs(m_of(words[i]) - m) <= m_bit && fabs(v_of(words[i]) - v) <= v_bit);
    }
    /* a deviation of at most half a bit each: five of the mean's */
    assert_true(fabs(m_sum / HALVES) <= 5 * m_bit / 2 / sqrt(HALVES));
    assert_true(fabs(v_sum / HALVES) <= 5 * v_bit / 2 / sqrt(HALVES));
}

/* One step from nothing, of many parameters with one gradient: each word is off by less than a bit, their
 * mean by nothing; the next step's numbers give other words with the same mean. What has no gradient keeps
 * its word of 0. */
static void half_moments_are_right_on_average(void **state) {
    (void)state;
    sf_context *ctx = scalar_context();
    const sf_adam step = {0.01f, 0.7f, 0.999f, 1, 1e-15f};
    static float p[HALVES], g[HALVES];
    static uint32_t words[HALVES], others[HALVES];
    double same = 0, all = 0;
    for (int e = -14; e <= 8; e++)
        for (int sign = -1; sign <= 1; sign += 2) {
            double gradient = sign * 1.2345 * pow(10, e);
            for (int i = 0; i < HALVES; i++) g[i] = (float)gradient;
            memset(words, 0, sizeof words);
            memset(others, 0, sizeof others);
            ctx->kernels->adam_half(p, g, words, HALVES, &step, 77u + (uint32_t)e);
            ctx->kernels->adam_half(p, g, others, HALVES, &step, 77u + 0x80000000u + (uint32_t)e);
            check_mean(words, (double)(1 - step.beta1) * gradient,
                       (double)(1 - step.beta2) * gradient * gradient);
            check_mean(others, (double)(1 - step.beta1) * gradient,
                       (double)(1 - step.beta2) * gradient * gradient);
            for (int i = 0; i < HALVES; i++, all++) same += words[i] == others[i];
        }
    assert_true(same < 0.75 * all);
    memset(g, 0, sizeof g);
    memset(words, 0, sizeof words);
    ctx->kernels->adam_half(p, g, words, HALVES, &step, 1);
    for (int i = 0; i < HALVES; i++) assert_int_equal(words[i], 0);
    sf_context_destroy(&ctx);
}

/* A second moment that decays by less than its last bit a step reaches what floats reach; rounded to the
 * nearest it would stand still. */
static void half_moments_decay_as_they_must(void **state) {
    (void)state;
    enum { N = 1024, STEPS = 2000 };
    sf_context *ctx = scalar_context();
    const sf_adam step = {0, 0.7f, 0.999f, 1, 1e-15f};
    static float p[N], g[N];
    static uint32_t words[N];
    sf_rng rng;
    sf_rng_seed(&rng, 5);
    for (int i = 0; i < N; i++) g[i] = 1e-5f;
    for (int t = 0; t < STEPS; t++) {
        ctx->kernels->adam_half(p, g, words, N, &step, (uint32_t)sf_rng_next(&rng));
        if (t == 0) memset(g, 0, sizeof g);
    }
    double sum = 0, expected = 0.001 * 1e-10 * pow((double)step.beta2, STEPS - 1);
    for (int i = 0; i < N; i++) sum += v_of(words[i]);
    assert_true(fabs(sum / N / expected - 1) < 0.02);
    sf_context_destroy(&ctx);
}

/* Steps of the greatest and the least gradients leave finite numbers everywhere, at every level. */
static void half_moments_hold_extremes(void **state) {
    (void)state;
    static const float extremes[] = {FLT_MAX, -FLT_MAX, 1e20f,   -1e20f,   1e15f, 1e2f,  1e-10f, 1e-19f,
                                     1e-20f,  -1e-30f,  FLT_MIN, -FLT_MIN, 0,     -0.0f, 1,      -1};
    static const sf_adam steps[] = {{0.01f / (1 - 0.7f), 0.7f, 0.999f, 1 / (1 - 0.999f), 1e-15f},
                                    {0.01f, 0.9999f, 0.999999f, 1e6f, 1e-30f},
                                    {0.01f, 0, 0, 1, 1e-30f}};
    sf_isa_info info;
    for (size_t level = 0; !sf_isa_describe(level, &info); level++) {
        unsigned mask;
        sf_kernels kernels;
        if (sf_cpu_choose(info.name, &mask)) continue;
        sf_kernels_init(&kernels, mask);
        for (size_t s = 0; s < sizeof steps / sizeof *steps; s++) {
            _Alignas(64) float p[SF_LANES] = {0}, g[SF_LANES];
            _Alignas(64) uint32_t words[SF_LANES] = {0};
            for (uint32_t t = 0; t < 200; t++) {
                for (uint32_t i = 0; i < SF_LANES; i++) g[i] = extremes[t / 50 % 2 ? i : (i + t) % SF_LANES];
                kernels.adam_half(p, g, words, SF_LANES, &steps[s], t);
                for (int i = 0; i < SF_LANES; i++)
                    assert_true(isfinite(p[i]) && isfinite(m_of(words[i])) && isfinite(v_of(words[i])));
            }
        }
    }
}

/* ---- unpacking ------------------------------------------------------------------------------------------
 */

/* Black is 0 and white is 1 at any factor, with full weights or none given. */
static void unpack_keeps_black_and_white(void **state) {
    (void)state;
    enum { MOST = 64 };
    static uint8_t black[MOST * MOST], white[sizeof black];
    sf_context *ctx = scalar_context();
    memset(white, 255, sizeof white);
    for (int factor = 1; factor <= MOST; factor++) {
        size_t stride = (size_t)factor;
        float got[5];
        ctx->kernels->unpack(black, NULL, stride, factor, &got[0], 1);
        ctx->kernels->unpack(white, black, stride, factor, &got[1], 1);
        ctx->kernels->unpack(white, NULL, stride, factor, &got[2], 1);
        ctx->kernels->unpack(white, white, stride, factor, &got[3], 1);
        ctx->kernels->unpack(NULL, white, stride, factor, &got[4], 1);
        assert_true(got[0] == 0 && got[1] == 0);
        assert_true(got[2] == 1 && got[3] == 1 && got[4] == 1);
    }
    sf_context_destroy(&ctx);
}

/* ---- the tiles of a Gaussian ----------------------------------------------------------------------------
 */

/* All Gaussians of a scene through the scalar project and spans; the reference sees the same scene. */
typedef struct binned {
    sf_context *ctx;
    sf_model *model;
    sf_workspace ws;
    uint32_t *offset;
    sf_span *spans;
    uint32_t *tiles;
} binned;

static void bin(const test_ref_scene *scene, binned *b) {
    b->ctx = scalar_context();
    b->model = test_model_of(b->ctx, scene);
    sf_workspace_init(&b->ws, b->ctx);
    assert_ok(b->ctx, sf_workspace_look(&b->ws, &scene->camera, (float)scene->near_plane));
    assert_ok(b->ctx, sf_stage_project(&b->ws, b->model, scene->sh_degree, scene->antialiased));
    b->offset = calloc(scene->count + 1, sizeof *b->offset);
    assert_non_null(b->offset);
    for (size_t i = 0; i < scene->count; i++) b->offset[i + 1] = b->offset[i] + b->ws.rows[i];
    b->spans = calloc((size_t)b->offset[scene->count] + 1, sizeof *b->spans);
    assert_non_null(b->spans);
    b->tiles = calloc(scene->count + 1, sizeof *b->tiles);
    assert_non_null(b->tiles);
    b->ctx->kernels->spans(b->ws.splats, b->ws.first_row, b->ws.rows, b->offset, 0, scene->count,
                           b->ws.eye.tiles_x, b->spans, b->tiles, b->ws.depth_of);
}

static void unbin(binned *b) {
    free(b->offset);
    free(b->spans);
    free(b->tiles);
    sf_workspace_free(&b->ws);
    sf_model_destroy(&b->model);
    sf_context_destroy(&b->ctx);
}

static size_t tiles_of(const binned *b, size_t i) {
    size_t tiles = 0;
    for (uint32_t r = b->offset[i]; r < b->offset[i + 1]; r++) {
        assert_true(b->spans[r].x0 <= b->spans[r].x1 && b->spans[r].x1 <= b->ws.eye.tiles_x);
        tiles += (size_t)(b->spans[r].x1 - b->spans[r].x0);
    }
    assert_int_equal(tiles, b->tiles[i]);
    return tiles;
}

/* Beside each side of the picture: a Gaussian that ends 0.6 px before the outermost centres touches no tile,
 * one that ends 0.6 px past them does. */
static void tiles_end_with_the_picture(void **state) {
    (void)state;
    enum { WIDTH = 40, HEIGHT = 24 };
    static const double sides[4][2] = {{-1, 0}, {1, 0}, {0, -1}, {0, 1}};
    test_ref_scene scene = test_random_scene(1, 8, 0, WIDTH, HEIGHT);
    scene.camera = (sf_camera){.width = WIDTH,
                               .height = HEIGHT,
                               .fx = 64,
                               .fy = 64,
                               .cx = 20,
                               .cy = 12,
                               .R_cw = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    for (size_t i = 0; i < scene.count; i++) {
        const double *side = sides[i % 4], outside = i < 4 ? 0.6 : -0.6;
        double reach = 0;
        scene.gaussians.logit_opacities[i] = 2;
        for (size_t k = 0; k < 3; k++) scene.gaussians.log_scales[3 * i + k] = (float)log(3.0 / 64);
        for (int pass = 0; pass < 3; pass++) { /* the reach depends a little on the place */
            test_ref_splat splat;
            double u = side[0] * (WIDTH / 2.0 + reach - 0.5 + outside);
            double v = side[1] * (HEIGHT / 2.0 + reach - 0.5 + outside);
            test_random_place(&scene, i, (const double[]){u / 64, v / 64, 1});
            test_ref_project(&scene, i, &splat);
            reach = sqrt(2 * log(255 * splat.opacity) * splat.cov2d[side[0] != 0 ? 0 : 2]);
        }
    }
    binned b;
    bin(&scene, &b);
    for (size_t i = 0; i < 8; i++) {
        assert_int_equal(b.ws.state[i], i < 4 ? SF_OUT_OF_VIEW : SF_SEEN);
        assert_int_equal(tiles_of(&b, i) > 0, i >= 4);
    }
    unbin(&b);
    test_ref_gaussians_free(&scene.gaussians);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(exp2_is_within_its_bound),
        cmocka_unit_test(exp2_holds_over_its_whole_range),
        cmocka_unit_test(first_step_of_adam_is_the_rate),
        cmocka_unit_test(half_moments_are_right_on_average),
        cmocka_unit_test(half_moments_decay_as_they_must),
        cmocka_unit_test(half_moments_hold_extremes),
        cmocka_unit_test(unpack_keeps_black_and_white),
        cmocka_unit_test(tiles_end_with_the_picture),
    };
    return cmocka_run_group_tests_name("kernels", tests, NULL, NULL);
}
