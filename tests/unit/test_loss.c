/* test_loss.c - the loss, its gradient and the figures of merit against the float64 reference. */
#include "testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "reference/random.h"
#include "render/workspace.h"

/* float32 against float64, as for the golden cases: values absolute, the gradient relative to its largest. */
static const double VALUE_BOUND = 1e-6, GRADIENT_BOUND = 2e-4;

/* ---- two pictures ---------------------------------------------------------------------------------------
 */

enum weighting {
    WEIGHT_NONE,     /* NULL */
    WEIGHT_ONE,      /* an array of 1 */
    WEIGHT_FRACTION, /* anything in 0..1 */
    WEIGHT_REGION,   /* a part of the picture does not count, with a soft edge */
    WEIGHTINGS
};

typedef struct pair {
    int width, height;
    size_t pixels;
    float *rgb, *target, *weight; /* weight NULL: 1 */
} pair;

static float *floats(size_t n) {
    float *values = calloc(n, sizeof *values);
    assert_non_null(values);
    return values;
}

static float weight_at(enum weighting how, int x, int y, int width, sf_rng *rng) {
    double edge = x - 0.4 * width + 0.3 * y; /* a slanting line */
    if (how == WEIGHT_FRACTION) return (float)sf_rng_uniform(rng);
    if (how == WEIGHT_REGION) return (float)fmin(fmax(0.5 * edge, 0), 1);
    return 1;
}

/* Smooth pictures with noise, alike but for a tenth; a few values lie beyond 0..1. */
static pair pair_create(uint64_t seed, int width, int height, enum weighting how) {
    pair p = {.width = width, .height = height, .pixels = (size_t)width * (size_t)height};
    sf_rng rng;
    sf_rng_seed(&rng, seed);
    p.rgb = floats(3 * p.pixels);
    p.target = floats(3 * p.pixels);
    if (how != WEIGHT_NONE) p.weight = floats(p.pixels);
    for (size_t i = 0; i < 3 * p.pixels; i++) {
        size_t x = i / 3 % (size_t)width, y = i / 3 / (size_t)width;
        double smooth = 0.5 + 0.3 * sin(0.3 * (double)x + (double)(i % 3)) * cos(0.2 * (double)y);
        p.target[i] = (float)(smooth + 0.1 * sf_rng_normal(&rng));
        p.rgb[i] = (float)((double)p.target[i] + 0.1 * sf_rng_normal(&rng));
    }
    for (size_t i = 0; p.weight && i < p.pixels; i++)
        p.weight[i] = weight_at(how, (int)(i % (size_t)width), (int)(i / (size_t)width), width, &rng);
    if (p.weight) p.weight[p.pixels - 1] = 0.75f; /* never all 0 */
    return p;
}

static void pair_free(pair *p) {
    free(p->rgb);
    free(p->target);
    free(p->weight);
}

/* What the library makes of a pair. */
typedef struct outcome {
    sf_loss_value value;
    float *d_rgb;
} outcome;

static outcome loss_with(sf_context *ctx, sf_renderer *renderer, const pair *p, double lambda) {
    outcome o = {.d_rgb = floats(3 * p->pixels)};
    assert_ok(ctx, sf_loss(renderer, &(sf_image_pair){p->width, p->height, p->rgb, p->target, p->weight},
                           lambda, &o.value, o.d_rgb));
    return o;
}

static void assert_same(const pair *p, const outcome *a, const outcome *b) {
    assert_memory_equal(&a->value, &b->value, sizeof a->value);
    assert_memory_equal(a->d_rgb, b->d_rgb, 3 * p->pixels * sizeof(float));
}

/* A context and a renderer for a test. */
typedef struct bench {
    sf_context *ctx;
    sf_renderer *renderer;
} bench;

static bench bench_create(int threads) {
    bench b = {.ctx = test_context_threads(threads)};
    assert_ok(b.ctx, sf_renderer_create(b.ctx, &b.renderer));
    return b;
}

static void bench_free(bench *b) {
    sf_renderer_destroy(&b->renderer);
    sf_context_destroy(&b->ctx);
}

/* ---- against float64 ------------------------------------------------------------------------------------
 */

static double *to_double(const float *from, size_t n) {
    if (!from) return NULL;
    double *to = test_ref_numbers(n);
    for (size_t i = 0; i < n; i++) to[i] = from[i];
    return to;
}

typedef struct errors {
    double value, gradient;
} errors;

static void note(double *worst, double error) { *worst = isnan(error) ? INFINITY : fmax(*worst, error); }

static void compare(const bench *b, const pair *p, double lambda, errors *w) {
    outcome o = loss_with(b->ctx, b->renderer, p, lambda);
    size_t n = 3 * p->pixels;
    double *rgb = to_double(p->rgb, n), *target = to_double(p->target, n);
    double *weight = to_double(p->weight, p->pixels), *d_rgb = test_ref_numbers(n), largest = 0;
    test_ref_pair both = {p->width, p->height, rgb, target, weight, lambda, 0};
    test_ref_loss expected = test_ref_compare(&both, d_rgb);
    note(&w->value, fabs(o.value.loss - expected.loss));
    note(&w->value, fabs(o.value.l1 - expected.l1));
    note(&w->value, fabs(o.value.ssim - expected.ssim));
    for (size_t i = 0; i < n; i++) largest = fmax(largest, fabs(d_rgb[i]));
    for (size_t i = 0; i < n; i++) note(&w->gradient, fabs(o.d_rgb[i] - d_rgb[i]) / largest);
    for (size_t i = 0; p->weight && i < n; i++)
        if (p->weight[i / 3] == 0) assert_true(o.d_rgb[i] == 0);
    free(rgb);
    free(target);
    free(weight);
    free(d_rgb);
    free(o.d_rgb);
}

static void loss_matches_the_reference(void **state) {
    (void)state;
    static const int sizes[][2] = {{1, 1},   {5, 40},  {40, 5},  {11, 11}, {16, 16},
                                   {17, 33}, {33, 17}, {4, 100}, {77, 45}};
    static const double lambdas[] = {0, 0.2, 1};
    bench b = bench_create(2);
    for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++) {
        errors w = {0};
        for (int how = 0; how < WEIGHTINGS; how++)
            for (size_t l = 0; l < sizeof lambdas / sizeof *lambdas; l++) {
                pair p = pair_create(10 * s + (uint64_t)how, sizes[s][0], sizes[s][1], (enum weighting)how);
                compare(&b, &p, lambdas[l], &w);
                pair_free(&p);
            }
        print_message("%dx%d: value %.1e gradient %.1e\n", sizes[s][0], sizes[s][1], w.value, w.gradient);
        assert_true(w.value <= VALUE_BOUND);
        assert_true(w.gradient <= GRADIENT_BOUND);
    }
    bench_free(&b);
}

static void thread_count_does_not_matter(void **state) {
    (void)state;
    static const int threads[] = {2, 3, 4, 8};
    pair p = pair_create(5, 130, 101, WEIGHT_FRACTION);
    bench one = bench_create(1);
    outcome expected = loss_with(one.ctx, one.renderer, &p, 0.2);
    for (size_t t = 0; t < sizeof threads / sizeof *threads; t++) {
        bench many = bench_create(threads[t]);
        outcome o = loss_with(many.ctx, many.renderer, &p, 0.2);
        assert_same(&p, &expected, &o);
        free(o.d_rgb);
        bench_free(&many);
    }
    free(expected.d_rgb);
    bench_free(&one);
    pair_free(&p);
}

/* Nothing of an earlier pair shows, be it larger or with weights. */
static void renderer_can_be_used_again(void **state) {
    (void)state;
    pair pairs[] = {pair_create(1, 64, 64, WEIGHT_FRACTION), pair_create(2, 17, 33, WEIGHT_NONE),
                    pair_create(3, 33, 17, WEIGHT_REGION), pair_create(4, 64, 64, WEIGHT_NONE)};
    enum { PAIRS = sizeof pairs / sizeof *pairs };
    bench again = bench_create(2);
    for (size_t k = 0; k < 2 * PAIRS; k++) {
        const pair *p = &pairs[k % PAIRS];
        bench fresh = bench_create(2);
        double lambda = k % 3 * 0.5;
        outcome a = loss_with(again.ctx, again.renderer, p, lambda);
        outcome b = loss_with(fresh.ctx, fresh.renderer, p, lambda);
        assert_same(p, &a, &b);
        free(a.d_rgb);
        free(b.d_rgb);
        bench_free(&fresh);
    }
    bench_free(&again);
    for (size_t k = 0; k < PAIRS; k++) pair_free(&pairs[k]);
}

static void weights_of_one_are_none(void **state) {
    (void)state;
    pair with = pair_create(6, 40, 30, WEIGHT_ONE), without = pair_create(6, 40, 30, WEIGHT_NONE);
    with.weight[with.pixels - 1] = 1;
    bench b = bench_create(2);
    outcome x = loss_with(b.ctx, b.renderer, &with, 0.2), y = loss_with(b.ctx, b.renderer, &without, 0.2);
    assert_same(&with, &x, &y);
    free(x.d_rgb);
    free(y.d_rgb);
    bench_free(&b);
    pair_free(&with);
    pair_free(&without);
}

/* Where the weight is 0 the pictures may hold anything. */
static void ignored_pixels_are_ignored(void **state) {
    (void)state;
    pair p = pair_create(7, 60, 40, WEIGHT_REGION);
    bench b = bench_create(2);
    outcome before = loss_with(b.ctx, b.renderer, &p, 0.2);
    sf_quality quality, changed;
    assert_ok(b.ctx, sf_compare(b.renderer, p.width, p.height, p.rgb, p.target, p.weight, &quality));
    size_t ignored = 0;
    for (size_t i = 0; i < 3 * p.pixels; i++) {
        if (p.weight[i / 3] != 0) continue;
        p.rgb[i] = 0.9f;
        p.target[i] = 0.1f;
        ignored++;
    }
    assert_between(ignored, p.pixels / 3, 2 * p.pixels);
    outcome after = loss_with(b.ctx, b.renderer, &p, 0.2);
    assert_same(&p, &before, &after);
    assert_ok(b.ctx, sf_compare(b.renderer, p.width, p.height, p.rgb, p.target, p.weight, &changed));
    assert_memory_equal(&quality, &changed, sizeof quality);
    free(before.d_rgb);
    free(after.d_rgb);
    bench_free(&b);
    pair_free(&p);
}

static void gradient_is_optional(void **state) {
    (void)state;
    pair p = pair_create(8, 23, 19, WEIGHT_FRACTION);
    bench b = bench_create(2);
    outcome o = loss_with(b.ctx, b.renderer, &p, 0.2);
    sf_loss_value value;
    assert_ok(b.ctx,
              sf_loss(b.renderer, &(sf_image_pair){23, 19, p.rgb, p.target, p.weight}, 0.2, &value, NULL));
    assert_memory_equal(&value, &o.value, sizeof value);
    free(o.d_rgb);
    bench_free(&b);
    pair_free(&p);
}

/* A tile reaches beyond the picture; what a larger one has left there must not count as a gradient. */
static void gradient_is_0_beyond_the_picture(void **state) {
    (void)state;
    enum { WIDTH = 21, HEIGHT = 35 };
    const sf_camera large = {.width = 100, .height = 80}, small = {.width = WIDTH, .height = HEIGHT};
    bench b = bench_create(2);
    sf_workspace ws;
    sf_loss_value value;
    sf_workspace_init(&ws, b.ctx);
    assert_ok(b.ctx, sf_workspace_look(&ws, &large, 1));
    for (size_t ch = 0; ch < SF_CHANNELS; ch++)
        for (size_t i = 0; i < ws.plane_rows * ws.stride; i++) ws.d_rgb[ch][i] = 7;
    assert_ok(b.ctx, sf_workspace_look(&ws, &small, 1));
    assert_ok(b.ctx, sf_workspace_loss_room(&ws));
    for (size_t ch = 0; ch < SF_CHANNELS; ch++)
        for (size_t i = 0; i < ws.plane_rows * ws.stride; i++) ws.rgb[ch][i] = 0.5f, ws.target[ch][i] = 0;
    sf_stage_loss(&ws, 0.2, 0, WIDTH * HEIGHT, 0, 1, &value);
    for (size_t ch = 0; ch < SF_CHANNELS; ch++)
        for (size_t i = 0; i < ws.plane_rows * ws.stride; i++) {
            int inside = i % ws.stride < WIDTH && i / ws.stride < HEIGHT;
            assert_int_equal(ws.d_rgb[ch][i] != 0, inside);
        }
    sf_workspace_free(&ws);
    bench_free(&b);
}

/* Of one difference d in all channels and pixels the mean is that of one: both halves, and where they meet.
 */
static void differences_below_delta_are_squared(void **state) {
    (void)state;
    enum { SIDE = 20 };
    static const float differences[] = {0, 0.03f, -0.03f, 0.25f, 0.5f, -0.5f};
    const double delta = 0.25;
    const sf_camera camera = {.width = SIDE, .height = SIDE};
    bench b = bench_create(2);
    sf_workspace ws;
    sf_workspace_init(&ws, b.ctx);
    assert_ok(b.ctx, sf_workspace_look(&ws, &camera, 1));
    assert_ok(b.ctx, sf_workspace_loss_room(&ws));
    for (size_t k = 0; k < sizeof differences / sizeof *differences; k++) {
        double d = (double)differences[k], far = fabs(d);
        for (size_t ch = 0; ch < SF_CHANNELS; ch++)
            for (size_t i = 0; i < ws.plane_rows * ws.stride; i++)
                ws.rgb[ch][i] = 0.5f + differences[k], ws.target[ch][i] = 0.5f;
        sf_loss_value value;
        sf_stage_loss(&ws, 0, delta, SIDE * SIDE, 0, 1, &value);
        double expected = far < delta ? d * d / (2 * delta) : far - delta / 2;
        double slope = fmin(fmax(d / delta, -1), 1) / (3 * SIDE * SIDE);
        assert_true(fabs(value.loss - expected) < 1e-6);
        assert_true(fabs((double)ws.d_rgb[1][3] - slope) < 1e-6 * fabs(slope) + 1e-12);
    }
    sf_workspace_free(&ws);
    bench_free(&b);
}

static void identical_pictures_have_no_loss(void **state) {
    (void)state;
    for (int how = 0; how < WEIGHTINGS; how++) {
        pair p = pair_create(9, 37, 29, (enum weighting)how);
        bench b = bench_create(2);
        memcpy(p.rgb, p.target, 3 * p.pixels * sizeof(float));
        outcome o = loss_with(b.ctx, b.renderer, &p, 0.2);
        assert_true(o.value.l1 == 0);
        assert_true(fabs(o.value.ssim - 1) <= 1e-6);
        assert_true(fabs(o.value.loss) <= 1e-6);
        for (size_t i = 0; i < 3 * p.pixels; i++) assert_true(fabs(o.d_rgb[i]) * (double)p.pixels < 1e-4);
        free(o.d_rgb);
        bench_free(&b);
        pair_free(&p);
    }
}

/* ---- arguments ------------------------------------------------------------------------------------------
 */

static void bad_arguments_are_refused(void **state) {
    (void)state;
    static const double lambdas[] = {-0.01, 1.01, NAN, INFINITY};
    static const int sizes[][2] = {{0, 5}, {5, 0}, {-1, 5}, {65536, 1}, {1, 65536}};
    pair p = pair_create(1, 8, 8, WEIGHT_ONE);
    bench b = bench_create(2);
    sf_loss_value value;
    sf_quality quality;
    for (size_t k = 0; k < sizeof lambdas / sizeof *lambdas; k++) {
        assert_status(
            b.ctx,
            sf_loss(b.renderer, &(sf_image_pair){8, 8, p.rgb, p.target, NULL}, lambdas[k], &value, NULL),
            SF_ERR_ARGUMENT);
        assert_error_names(b.ctx, "lambda");
    }
    for (size_t k = 0; k < sizeof sizes / sizeof *sizes; k++) {
        int width = sizes[k][0], height = sizes[k][1];
        assert_status(
            b.ctx,
            sf_loss(b.renderer, &(sf_image_pair){width, height, p.rgb, p.target, NULL}, 0, &value, NULL),
            SF_ERR_ARGUMENT);
        assert_error_names(b.ctx, "size");
        assert_status(b.ctx, sf_compare(b.renderer, width, height, p.rgb, p.target, NULL, &quality),
                      SF_ERR_ARGUMENT);
    }
    bench_free(&b);
    pair_free(&p);
}

static void bad_weights_are_refused(void **state) {
    (void)state;
    static const float weights[] = {-0.001f, 1.001f, 255, NAN, INFINITY, -INFINITY};
    pair p = pair_create(1, 8, 8, WEIGHT_ONE);
    bench b = bench_create(2);
    sf_loss_value value;
    sf_quality quality;
    for (size_t k = 0; k < sizeof weights / sizeof *weights; k++) {
        p.weight[37] = weights[k];
        assert_status(
            b.ctx, sf_loss(b.renderer, &(sf_image_pair){8, 8, p.rgb, p.target, p.weight}, 0.2, &value, NULL),
            SF_ERR_ARGUMENT);
        assert_error_names(b.ctx, "pixel 37");
        assert_status(b.ctx, sf_compare(b.renderer, 8, 8, p.rgb, p.target, p.weight, &quality),
                      SF_ERR_ARGUMENT);
        assert_error_names(b.ctx, "pixel 37");
    }
    for (size_t i = 0; i < p.pixels; i++) p.weight[i] = 0;
    assert_status(b.ctx,
                  sf_loss(b.renderer, &(sf_image_pair){8, 8, p.rgb, p.target, p.weight}, 0.2, &value, NULL),
                  SF_ERR_EMPTY);
    assert_status(b.ctx, sf_compare(b.renderer, 8, 8, p.rgb, p.target, p.weight, &quality), SF_ERR_EMPTY);
    p.weight[37] = 0.001f; /* little is not nothing */
    assert_ok(b.ctx,
              sf_loss(b.renderer, &(sf_image_pair){8, 8, p.rgb, p.target, p.weight}, 0.2, &value, NULL));
    bench_free(&b);
    pair_free(&p);
}

/* ---- figures of merit -----------------------------------------------------------------------------------
 */

static sf_quality quality_of(const bench *b, const pair *p) {
    sf_quality quality;
    assert_ok(b->ctx, sf_compare(b->renderer, p->width, p->height, p->rgb, p->target, p->weight, &quality));
    return quality;
}

static void fill(pair *p, float rgb, float target) {
    for (size_t i = 0; i < 3 * p->pixels; i++) p->rgb[i] = rgb, p->target[i] = target;
}

static void psnr_of_known_errors(void **state) {
    (void)state;
    pair p = pair_create(1, 20, 10, WEIGHT_NONE);
    bench b = bench_create(2);
    fill(&p, 0.5f, 0.5f);
    sf_quality same = quality_of(&b, &p);
    assert_true(same.psnr == 100);
    assert_true(fabs(same.ssim - 1) <= 1e-6);
    fill(&p, 0.75f, 0.5f); /* MSE 1/16 */
    assert_true(fabs(quality_of(&b, &p).psnr - 10 * log10(16)) < 1e-9);
    fill(&p, 1, 0);
    assert_true(fabs(quality_of(&b, &p).psnr) < 1e-9);
    fill(&p, 0.5f, 0.5f);
    p.rgb[77] = 1; /* one value of 600: MSE 1/2400 */
    assert_true(fabs(quality_of(&b, &p).psnr - 10 * log10(2400)) < 1e-9);
    fill(&p, 0.5f, 0.5f + 0x1p-20f); /* below the floor */
    assert_true(quality_of(&b, &p).psnr == 100);
    bench_free(&b);
    pair_free(&p);
}

static void psnr_counts_by_weight(void **state) {
    (void)state;
    pair p = pair_create(1, 20, 10, WEIGHT_ONE);
    bench b = bench_create(2);
    for (size_t i = 0; i < p.pixels; i++) {
        p.weight[i] = i % 2 ? 0.25f : 0.75f;
        for (size_t k = 0; k < 3; k++) {
            p.target[3 * i + k] = 0.25f;
            p.rgb[3 * i + k] = i % 2 ? 0.75f : 0.25f;
        }
    }
    /* a quarter of the weight with an error of 1/4 */
    assert_true(fabs(quality_of(&b, &p).psnr - 10 * log10(16)) < 1e-9);
    bench_free(&b);
    pair_free(&p);
}

/* The picture is clamped to 0..1, where exposure is corrected to 0..2, and what is no number is 0; the
 * caller's array stays as it is. */
static void compare_clamps_the_picture(void **state) {
    (void)state;
    static const float beyond[] = {1.5f, -0.25f, NAN, INFINITY, -INFINITY, 1e30f};
    static const float clamped[] = {1, 0, 0, 1, 0, 1}, bright[] = {1.5f, 0, 0, 2, 0, 2};
    pair p = pair_create(2, 31, 18, WEIGHT_NONE), q = pair_create(2, 31, 18, WEIGHT_NONE);
    bench b = bench_create(2);
    for (size_t i = 0; i < 3 * p.pixels; i++) {
        p.rgb[i] = q.rgb[i] = fminf(fmaxf(p.rgb[i], 0), 1);
        if (i % 7) continue;
        p.rgb[i] = beyond[i / 7 % 6];
        q.rgb[i] = clamped[i / 7 % 6];
    }
    float *before = floats(3 * p.pixels);
    memcpy(before, p.rgb, 3 * p.pixels * sizeof(float));
    sf_quality x = quality_of(&b, &p), y = quality_of(&b, &q);
    assert_true(isfinite(x.psnr) && isfinite(x.ssim) && isfinite(x.psnr_corrected));
    assert_true(x.psnr == y.psnr && x.ssim == y.ssim);
    for (size_t i = 0; i < 3 * p.pixels; i += 7) q.rgb[i] = bright[i / 7 % 6];
    y = quality_of(&b, &q);
    assert_memory_equal(&x, &y, sizeof x);
    assert_memory_equal(p.rgb, before, 3 * p.pixels * sizeof(float));
    free(before);
    bench_free(&b);
    pair_free(&p);
    pair_free(&q);
}

static void quality_matches_the_reference(void **state) {
    (void)state;
    bench b = bench_create(2);
    for (int how = 0; how < WEIGHTINGS; how++) {
        pair p = pair_create(20 + (uint64_t)how, 53, 38, (enum weighting)how);
        double squares = 0, weights = 0;
        for (size_t i = 0; i < 3 * p.pixels; i++) {
            p.rgb[i] = fminf(fmaxf(p.rgb[i], 0), 1);
            double weight = p.weight ? p.weight[i / 3] : 1, error = (double)p.rgb[i] - (double)p.target[i];
            squares += weight * error * error;
            weights += weight;
        }
        double *rgb = to_double(p.rgb, 3 * p.pixels), *target = to_double(p.target, 3 * p.pixels);
        double *weight = to_double(p.weight, p.pixels);
        test_ref_loss expected =
            test_ref_compare(&(test_ref_pair){53, 38, rgb, target, weight, 0.2, 0}, NULL);
        sf_quality quality = quality_of(&b, &p);
        assert_true(fabs(quality.psnr + 10 * log10(squares / weights)) < 1e-6);
        assert_true(fabs(quality.ssim - expected.ssim) <= VALUE_BOUND);
        free(rgb);
        free(target);
        free(weight);
        pair_free(&p);
    }
    bench_free(&b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(loss_matches_the_reference),
        cmocka_unit_test(thread_count_does_not_matter),
        cmocka_unit_test(renderer_can_be_used_again),
        cmocka_unit_test(weights_of_one_are_none),
        cmocka_unit_test(ignored_pixels_are_ignored),
        cmocka_unit_test(gradient_is_optional),
        cmocka_unit_test(gradient_is_0_beyond_the_picture),
        cmocka_unit_test(differences_below_delta_are_squared),
        cmocka_unit_test(identical_pictures_have_no_loss),
        cmocka_unit_test(bad_arguments_are_refused),
        cmocka_unit_test(bad_weights_are_refused),
        cmocka_unit_test(psnr_of_known_errors),
        cmocka_unit_test(psnr_counts_by_weight),
        cmocka_unit_test(compare_clamps_the_picture),
        cmocka_unit_test(quality_matches_the_reference),
    };
    return cmocka_run_group_tests_name("loss", tests, NULL, NULL);
}
