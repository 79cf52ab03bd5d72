/* test_kernels.c - the small scalar kernels against float64: exp2, Adam, unpacking, the tiles of a Gaussian.
 */
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

/* One rounding to float. */
#define UNIT 0x1p-24

static int is_quick(void) {
    const char *quick = getenv("SPLATFIT_QUICK");
    return quick && *quick && strcmp(quick, "0");
}

static sf_context *scalar_context(void) {
    sf_context *ctx;
    sf_context_options options = {.threads = 2, .isa = "scalar"};
    assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
    return ctx;
}

static float float_of(uint32_t bits) {
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static uint32_t bits_of(float value) {
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits;
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
        double error = exp2_error(float_of(bits | s->sign));
        worst = error > worst ? error : worst;
    }
    s->worst[part] = worst;
}

/* The largest relative error over the floats between `least` (> 0) and `most`, with a sign. */
static double worst_exp2(sf_context *ctx, float least, float most, uint32_t sign, uint32_t step) {
    enum { PARTS = 64 };
    double parts[PARTS], worst = 0;
    sweep s = {bits_of(least), bits_of(most) + 1, sign, step, PARTS, parts};
    sf_pool_run(ctx->pool, PARTS, sweep_task, &s);
    for (int i = 0; i < PARTS; i++) worst = fmax(worst, parts[i]);
    return worst;
}

/* Every float of [-9, 1]; of those below 2^-26, where the polynomial is its last term and 2^x within 2e-8 of
 * 1, every 1021st. */
static void exp2_is_within_its_bound(void **state) {
    (void)state;
    const uint32_t minus = 0x80000000u, step = is_quick() ? 64 : 1;
    sf_context *ctx = scalar_context();
    double worst = fmax(worst_exp2(ctx, 0x1p-26f, 9, minus, step), worst_exp2(ctx, 0x1p-26f, 1, 0, step));
    for (uint32_t bits = 0; bits <= bits_of(0x1p-26f); bits += 1021) {
        worst = fmax(worst, exp2_error(float_of(bits)));
        worst = fmax(worst, exp2_error(float_of(bits | minus)));
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

enum { ADAM_COUNT = 4096, ADAM_FRAME = 16 };

/* Parameters, gradients and moments over many magnitudes; some are 0. */
typedef struct adam_case {
    float p[ADAM_COUNT], g[ADAM_COUNT], m[ADAM_COUNT], v[ADAM_COUNT];
} adam_case;

static float any_magnitude(sf_rng *rng) {
    if (sf_rng_below(rng, 20) == 0) return 0;
    double value = pow(10, test_random_between(rng, -12, 4));
    return (float)(sf_rng_below(rng, 2) ? value : -value);
}

static void adam_fill(adam_case *c, uint64_t seed) {
    sf_rng rng;
    sf_rng_seed(&rng, seed);
    for (size_t i = 0; i < ADAM_COUNT; i++) {
        c->p[i] = any_magnitude(&rng);
        c->g[i] = any_magnitude(&rng);
        c->m[i] = any_magnitude(&rng);
        c->v[i] = fabsf(any_magnitude(&rng));
    }
}

/* The bounds count the roundings of each line: 1 - beta, its product, beta's product and the sum; g^2 has one
 * more. The step has at most 7 half of which the root halves again. What underflows adds FLT_MIN. */
static void assert_adam(const adam_case *before, const adam_case *after, size_t i, const sf_adam *a) {
    double g = before->g[i], from_m = (double)a->beta1 * before->m[i],
           from_v = (double)a->beta2 * before->v[i];
    double to_m = (1 - (double)a->beta1) * g, to_v = (1 - (double)a->beta2) * g * g;
    assert_true(fabs(after->m[i] - (from_m + to_m)) <= 4 * UNIT * (fabs(from_m) + fabs(to_m)) + FLT_MIN);
    assert_true(fabs(after->v[i] - (from_v + to_v)) <= 5 * UNIT * (from_v + to_v) + 2 * (double)FLT_MIN);

    double denominator = sqrt((double)after->v[i] * a->v_scale) + (double)a->epsilon;
    double step = (double)a->rate * after->m[i] / denominator, p = before->p[i] - step;
    assert_true(fabs(after->p[i] - p) <= UNIT * fabs(p) + 6 * UNIT * fabs(step) + FLT_MIN);
}

static void adam_agrees_with_float64(void **state) {
    (void)state;
    static const sf_adam steps[] = {
        {0.01f / (1 - 0.9f), 0.9f, 0.999f, 1 / (1 - 0.999f), 1e-15f}, /* the first */
        {0.01f, 0.9f, 0.999f, 1, 1e-15f},                             /* a late one */
        {1e-5f, 0, 0, 1, 1e-8f},
        {3, 0.9999f, 0.999999f, 1e6f, 1e-15f},
    };
    static adam_case before, after;
    sf_context *ctx = scalar_context();
    for (size_t s = 0; s < sizeof steps / sizeof *steps; s++) {
        adam_fill(&before, 100 + s);
        after = before;
        ctx->kernels->adam(after.p, after.g, after.m, after.v, ADAM_COUNT, &steps[s]);
        assert_memory_equal(after.g, before.g, sizeof before.g);
        for (size_t i = 0; i < ADAM_COUNT; i++) assert_adam(&before, &after, i, &steps[s]);
    }
    sf_context_destroy(&ctx);
}

static void adam_touches_n_values(void **state) {
    (void)state;
    static adam_case before, after;
    sf_context *ctx = scalar_context();
    const sf_adam step = {0.1f, 0.9f, 0.999f, 1, 1e-15f};
    adam_fill(&before, 7);
    for (size_t n = 0; n <= 64; n += SF_LANES) {
        after = before;
        ctx->kernels->adam(after.p, after.g, after.m, after.v, n, &step);
        size_t rest = (ADAM_COUNT - n) * sizeof(float);
        assert_memory_equal(after.p + n, before.p + n, rest);
        assert_memory_equal(after.m + n, before.m + n, rest);
        assert_memory_equal(after.v + n, before.v + n, rest);
        if (n) assert_memory_not_equal(after.m, before.m, n * sizeof(float));
    }
    sf_context_destroy(&ctx);
}

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

/* ---- unpacking ------------------------------------------------------------------------------------------
 */

enum { UNPACK_WIDTH = 21, UNPACK_MOST = 64, UNPACK_SPARE = 5 };

/* The sum, that of white and their quotient are rounded once each. */
static void assert_unpacked(float got, double exact) {
    assert_true(fabs(got - exact) <= 3.001 * UNIT * exact);
    assert_true(got >= 0 && got <= 1);
}

typedef struct unpack_case {
    const uint8_t *src, *weight; /* either may be NULL */
    size_t stride;
    int factor;
} unpack_case;

static double exact_mean(const unpack_case *c, int i) {
    double sum = 0, area = (double)c->factor * c->factor;
    for (int y = 0; y < c->factor; y++)
        for (int x = 0; x < c->factor; x++) {
            size_t at = (size_t)y * c->stride + (size_t)(i * c->factor + x);
            sum += (c->src ? c->src[at] / 255.0 : 1) * (c->weight ? c->weight[at] / 255.0 : 1);
        }
    return sum / area;
}

static void check_unpack(const sf_kernels *kernels, const unpack_case *c) {
    float dst[UNPACK_WIDTH + 1];
    for (int width = 1; width <= UNPACK_WIDTH; width++) {
        for (int i = 0; i <= UNPACK_WIDTH; i++) dst[i] = -7;
        kernels->unpack(c->src, c->weight, c->stride, c->factor, dst, width);
        for (int i = 0; i < width; i++) assert_unpacked(dst[i], exact_mean(c, i));
        for (int i = width; i <= UNPACK_WIDTH; i++) assert_true(dst[i] == -7);
    }
}

static void unpack_is_the_weighted_mean(void **state) {
    (void)state;
    static const int factors[] = {1, 2, 3, 4, 64};
    static uint8_t src[UNPACK_MOST * (UNPACK_MOST * UNPACK_WIDTH + UNPACK_SPARE)], weight[sizeof src];
    sf_context *ctx = scalar_context();
    sf_rng rng;
    sf_rng_seed(&rng, 3);
    for (int content = 0; content < 3; content++)
        for (size_t f = 0; f < sizeof factors / sizeof *factors; f++) {
            size_t stride = (size_t)(factors[f] * UNPACK_WIDTH + UNPACK_SPARE);
            for (size_t k = 0; k < sizeof src; k++) {
                src[k] = content == 0 ? (uint8_t)sf_rng_below(&rng, 256) : content == 1 ? 255 : 0;
                weight[k] = content == 2 ? 255 : (uint8_t)sf_rng_below(&rng, 256);
            }
            check_unpack(ctx->kernels, &(unpack_case){src, NULL, stride, factors[f]});
            check_unpack(ctx->kernels, &(unpack_case){src, weight, stride, factors[f]});
            check_unpack(ctx->kernels, &(unpack_case){NULL, weight, stride, factors[f]});
        }
    sf_context_destroy(&ctx);
}

/* Black is 0 and white is 1 at any factor, with full weights or none given. */
static void unpack_keeps_black_and_white(void **state) {
    (void)state;
    static uint8_t black[UNPACK_MOST * UNPACK_MOST], white[sizeof black];
    sf_context *ctx = scalar_context();
    memset(white, 255, sizeof white);
    for (int factor = 1; factor <= UNPACK_MOST; factor++) {
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
    assert_ok(b->ctx, sf_stage_project(&b->ws, &b->model->params, scene->count, scene->sh_degree,
                                       scene->antialiased));
    b->offset = calloc(scene->count + 1, sizeof *b->offset);
    assert_non_null(b->offset);
    for (size_t i = 0; i < scene->count; i++) b->offset[i + 1] = b->offset[i] + b->ws.rows[i];
    b->spans = calloc((size_t)b->offset[scene->count] + 1, sizeof *b->spans);
    assert_non_null(b->spans);
    b->tiles = calloc(scene->count + 1, sizeof *b->tiles);
    assert_non_null(b->tiles);
    b->ctx->kernels->spans(b->ws.splats, b->ws.first_row, b->ws.rows, b->offset, 0, scene->count,
                           b->ws.eye.tiles_x, b->spans, b->tiles);
}

static void unbin(binned *b) {
    free(b->offset);
    free(b->spans);
    free(b->tiles);
    sf_workspace_free(&b->ws);
    sf_model_destroy(&b->model);
    sf_context_destroy(&b->ctx);
}

/* Whether the list of Gaussian i holds tile (x, y). */
static int holds(const binned *b, size_t i, int x, int y) {
    int row = y - b->ws.first_row[i];
    if (row < 0 || row >= b->ws.rows[i]) return 0;
    sf_span span = b->spans[b->offset[i] + (uint32_t)row];
    return x >= span.x0 && x < span.x1;
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

/* Whether a pixel of the tile has o g >= 1/255, in float64 (M.1). */
static int is_visible_in(const test_ref_splat *s, const sf_camera *camera, int x0, int y0) {
    double b = s->cov2d[1], c = s->cov2d[2], r2 = 2 * log(255 * s->opacity);
    for (int y = y0; y < y0 + SF_TILE && y < camera->height; y++)
        for (int x = x0; x < x0 + SF_TILE && x < camera->width; x++) {
            double d0 = x + 0.5 - s->mean2d[0], d1 = y + 0.5 - s->mean2d[1];
            double t = (c * d0 - b * d1) / sqrt(c * s->det);
            if (t * t + d1 * d1 / c <= r2) return 1;
        }
    return 0;
}

typedef struct coverage {
    size_t seen, needed, missing, listed;
} coverage;

static void cover(const test_ref_scene *scene, const binned *b, coverage *sum) {
    for (size_t i = 0; i < scene->count; i++) {
        test_ref_splat splat;
        test_ref_project(scene, i, &splat);
        sum->seen += b->ws.state[i] == SF_SEEN;
        sum->listed += tiles_of(b, i);
        if (!splat.visible) assert_int_not_equal(b->ws.state[i], SF_SEEN);
        for (int y = 0; splat.visible && y < b->ws.eye.tiles_y; y++)
            for (int x = 0; x < b->ws.eye.tiles_x; x++) {
                if (!is_visible_in(&splat, &scene->camera, x * SF_TILE, y * SF_TILE)) continue;
                sum->needed++;
                if (holds(b, i, x, y)) continue;
                sum->missing++;
                print_error("Gaussian %zu at (%g, %g), a %g b %g c %g: tile %d, %d is missing\n", i,
                            splat.mean2d[0], splat.mean2d[1], splat.cov2d[0], splat.cov2d[1], splat.cov2d[2],
                            x, y);
            }
    }
}

/* Kinds of Gaussians, by their standard deviations in the camera's pixels. A thin one may enter a tile
 * between its pixels: the list holds it there all the same. */
typedef struct kind {
    const char *name;
    double size[3][2];       /* px: least and most of each axis */
    double place[2];         /* middle of the picture +- this many half pictures */
    double depth[2];         /* z, in near planes */
    double most_superfluous; /* of the tiles listed, as a fraction */
} kind;

static void make_kind(test_ref_scene *scene, const kind *k, sf_rng *rng) {
    const sf_camera *c = &scene->camera;
    for (size_t i = 0; i < scene->count; i++) {
        double z = scene->near_plane * exp(test_random_between(rng, log(k->depth[0]), log(k->depth[1])));
        double x = test_random_between(rng, -k->place[0], k->place[0]) * c->width / (2 * c->fx);
        double y = test_random_between(rng, -k->place[1], k->place[1]) * c->height / (2 * c->fy);
        test_random_place(scene, i, (const double[]){x * z, y * z, z});
        scene->gaussians.logit_opacities[i] = (float)test_random_between(rng, -6, 6);
        for (size_t axis = 0; axis < 3; axis++) {
            double px = exp(test_random_between(rng, log(k->size[axis][0]), log(k->size[axis][1])));
            scene->gaussians.log_scales[3 * i + axis] = (float)log(px * z / c->fx);
        }
    }
}

static void tile_lists_hold_what_is_visible(void **state) {
    (void)state;
    static const kind kinds[] = {
        {"round", {{8, 9}, {8, 9}, {8, 9}}, {1, 1}, {2, 20}, 0.02},
        {"needles", {{30, 300}, {0.01, 0.5}, {0.01, 0.5}}, {1.5, 1.5}, {2, 20}, 0.08},
        {"plates", {{10, 60}, {10, 60}, {0.01, 0.02}}, {1.5, 1.5}, {2, 20}, 0.02},
        {"huge", {{300, 3000}, {300, 3000}, {300, 3000}}, {3, 3}, {2, 20}, 0.02},
        {"tiny", {{1e-4, 0.5}, {1e-4, 0.5}, {1e-4, 0.5}}, {1.1, 1.1}, {2, 20}, 0.05},
        {"beside", {{1, 50}, {1, 50}, {1, 50}}, {5, 5}, {2, 20}, 0.02},
        {"near", {{1, 100}, {1, 100}, {1, 100}}, {1.5, 1.5}, {0.9, 1.1}, 0.02},
    };
    size_t count = is_quick() ? 300 : 2000;
    coverage all = {0};
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; k++) {
        sf_rng rng;
        sf_rng_seed(&rng, 40 + k);
        test_ref_scene scene = test_random_scene(40 + k, count, 0, 150, 117);
        binned b;
        coverage sum = {0};
        make_kind(&scene, &kinds[k], &rng);
        bin(&scene, &b);
        cover(&scene, &b, &sum);
        double superfluous = (double)(sum.listed - sum.needed) / (double)sum.listed;
        print_message("%s: %zu seen, %zu tiles, %zu missing, %.2f %% superfluous\n", kinds[k].name, sum.seen,
                      sum.needed, sum.missing, 100 * superfluous);
        assert_true(sum.seen > count / 20);
        assert_true(superfluous <= kinds[k].most_superfluous);
        all.needed += sum.needed, all.missing += sum.missing, all.listed += sum.listed;
        unbin(&b);
        test_ref_gaussians_free(&scene.gaussians);
    }
    assert_int_equal(all.missing, 0);
    assert_true((double)(all.listed - all.needed) <= 0.02 * (double)all.listed);
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
        cmocka_unit_test(exp2_is_within_its_bound),       cmocka_unit_test(exp2_holds_over_its_whole_range),
        cmocka_unit_test(adam_agrees_with_float64),       cmocka_unit_test(adam_touches_n_values),
        cmocka_unit_test(first_step_of_adam_is_the_rate), cmocka_unit_test(unpack_is_the_weighted_mean),
        cmocka_unit_test(unpack_keeps_black_and_white),   cmocka_unit_test(tile_lists_hold_what_is_visible),
        cmocka_unit_test(tiles_end_with_the_picture),
    };
    return cmocka_run_group_tests_name("kernels", tests, NULL, NULL);
}
