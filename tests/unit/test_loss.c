/* test_loss.c - the loss and its gradient against the float64 reference. */
#include "loss_fixture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "reference/random.h"
#include "render/workspace.h"

/* What the library makes of a pair. */
typedef struct outcome {
    sf_loss_value value;
    float *d_rgb;
} outcome;

static outcome loss_with(sf_context *ctx, sf_renderer *renderer, const pair *p, double lambda) {
    outcome o = {.d_rgb = loss_floats(3 * p->pixels)};
    assert_ok(ctx, sf_loss(renderer, &(sf_image_pair){p->width, p->height, p->rgb, p->target, p->weight},
                           lambda, &o.value, o.d_rgb));
    return o;
}

static void assert_same(const pair *p, const outcome *a, const outcome *b) {
    assert_memory_equal(&a->value, &b->value, sizeof a->value);
    assert_memory_equal(a->d_rgb, b->d_rgb, 3 * p->pixels * sizeof(float));
}

typedef struct errors {
    double value, gradient;
} errors;

static void note(double *worst, double error) { *worst = isnan(error) ? INFINITY : fmax(*worst, error); }

static void compare(const bench *b, const pair *p, double lambda, errors *w) {
    outcome o = loss_with(b->ctx, b->renderer, p, lambda);
    size_t n = 3 * p->pixels;
    double *rgb = loss_to_double(p->rgb, n), *target = loss_to_double(p->target, n);
    double *weight = loss_to_double(p->weight, p->pixels), *d_rgb = test_ref_numbers(n), largest = 0;
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
    bench b = loss_bench_create(2);
    for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++) {
        errors w = {0};
        for (int how = 0; how < WEIGHTINGS; how++)
            for (size_t l = 0; l < sizeof lambdas / sizeof *lambdas; l++) {
                pair p =
                    loss_pair_create(10 * s + (uint64_t)how, sizes[s][0], sizes[s][1], (enum weighting)how);
                compare(&b, &p, lambdas[l], &w);
                loss_pair_free(&p);
            }
        print_message("%dx%d: value %.1e gradient %.1e\n", sizes[s][0], sizes[s][1], w.value, w.gradient);
        assert_true(w.value <= loss_VALUE_BOUND);
        assert_true(w.gradient <= loss_GRADIENT_BOUND);
    }
    loss_bench_free(&b);
}

static void thread_count_does_not_matter(void **state) {
    (void)state;
    static const int threads[] = {2, 3, 4, 8};
    pair p = loss_pair_create(5, 130, 101, WEIGHT_FRACTION);
    bench one = loss_bench_create(1);
    outcome expected = loss_with(one.ctx, one.renderer, &p, 0.2);
    for (size_t t = 0; t < sizeof threads / sizeof *threads; t++) {
        bench many = loss_bench_create(threads[t]);
        outcome o = loss_with(many.ctx, many.renderer, &p, 0.2);
        assert_same(&p, &expected, &o);
        free(o.d_rgb);
        loss_bench_free(&many);
    }
    free(expected.d_rgb);
    loss_bench_free(&one);
    loss_pair_free(&p);
}

/* Nothing of an earlier pair shows, be it larger or with weights. */
static void renderer_can_be_used_again(void **state) {
    (void)state;
    pair pairs[] = {loss_pair_create(1, 64, 64, WEIGHT_FRACTION), loss_pair_create(2, 17, 33, WEIGHT_NONE),
                    loss_pair_create(3, 33, 17, WEIGHT_REGION), loss_pair_create(4, 64, 64, WEIGHT_NONE)};
    enum { PAIRS = sizeof pairs / sizeof *pairs };
    bench again = loss_bench_create(2);
    for (size_t k = 0; k < 2 * PAIRS; k++) {
        const pair *p = &pairs[k % PAIRS];
        bench fresh = loss_bench_create(2);
        double lambda = k % 3 * 0.5;
        outcome a = loss_with(again.ctx, again.renderer, p, lambda);
        outcome b = loss_with(fresh.ctx, fresh.renderer, p, lambda);
        assert_same(p, &a, &b);
        free(a.d_rgb);
        free(b.d_rgb);
        loss_bench_free(&fresh);
    }
    loss_bench_free(&again);
    for (size_t k = 0; k < PAIRS; k++) loss_pair_free(&pairs[k]);
}

static void weights_of_one_are_none(void **state) {
    (void)state;
    pair with = loss_pair_create(6, 40, 30, WEIGHT_ONE), without = loss_pair_create(6, 40, 30, WEIGHT_NONE);
    with.weight[with.pixels - 1] = 1;
    bench b = loss_bench_create(2);
    outcome x = loss_with(b.ctx, b.renderer, &with, 0.2), y = loss_with(b.ctx, b.renderer, &without, 0.2);
    assert_same(&with, &x, &y);
    free(x.d_rgb);
    free(y.d_rgb);
    loss_bench_free(&b);
    loss_pair_free(&with);
    loss_pair_free(&without);
}

/* Where the weight is 0 the pictures may hold anything. */
static void ignored_pixels_are_ignored(void **state) {
    (void)state;
    pair p = loss_pair_create(7, 60, 40, WEIGHT_REGION);
    bench b = loss_bench_create(2);
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
    loss_bench_free(&b);
    loss_pair_free(&p);
}

static void gradient_is_optional(void **state) {
    (void)state;
    pair p = loss_pair_create(8, 23, 19, WEIGHT_FRACTION);
    bench b = loss_bench_create(2);
    outcome o = loss_with(b.ctx, b.renderer, &p, 0.2);
    sf_loss_value value;
    assert_ok(b.ctx,
              sf_loss(b.renderer, &(sf_image_pair){23, 19, p.rgb, p.target, p.weight}, 0.2, &value, NULL));
    assert_memory_equal(&value, &o.value, sizeof value);
    free(o.d_rgb);
    loss_bench_free(&b);
    loss_pair_free(&p);
}

/* A tile reaches beyond the picture; what a larger one has left there must not count as a gradient. */
static void gradient_is_0_beyond_the_picture(void **state) {
    (void)state;
    enum { WIDTH = 21, HEIGHT = 35 };
    const sf_camera large = {.width = 100, .height = 80}, small = {.width = WIDTH, .height = HEIGHT};
    bench b = loss_bench_create(2);
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
    loss_bench_free(&b);
}

/* Of one difference d in all channels and pixels the mean is that of one: both halves, and where they meet.
 */
static void differences_below_delta_are_squared(void **state) {
    (void)state;
    enum { SIDE = 20 };
    static const float differences[] = {0, 0.03f, -0.03f, 0.25f, 0.5f, -0.5f};
    const double delta = 0.25;
    const sf_camera camera = {.width = SIDE, .height = SIDE};
    bench b = loss_bench_create(2);
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
    loss_bench_free(&b);
}

static void identical_pictures_have_no_loss(void **state) {
    (void)state;
    for (int how = 0; how < WEIGHTINGS; how++) {
        pair p = loss_pair_create(9, 37, 29, (enum weighting)how);
        bench b = loss_bench_create(2);
        memcpy(p.rgb, p.target, 3 * p.pixels * sizeof(float));
        outcome o = loss_with(b.ctx, b.renderer, &p, 0.2);
        assert_true(o.value.l1 == 0);
        assert_true(fabs(o.value.ssim - 1) <= 1e-6);
        assert_true(fabs(o.value.loss) <= 1e-6);
        for (size_t i = 0; i < 3 * p.pixels; i++) assert_true(fabs(o.d_rgb[i]) * (double)p.pixels < 1e-4);
        free(o.d_rgb);
        loss_bench_free(&b);
        loss_pair_free(&p);
    }
}

static void bad_arguments_are_refused(void **state) {
    (void)state;
    static const double lambdas[] = {-0.01, 1.01, NAN, INFINITY};
    static const int sizes[][2] = {{0, 5}, {5, 0}, {-1, 5}, {65536, 1}, {1, 65536}};
    pair p = loss_pair_create(1, 8, 8, WEIGHT_ONE);
    bench b = loss_bench_create(2);
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
    loss_bench_free(&b);
    loss_pair_free(&p);
}

static void bad_weights_are_refused(void **state) {
    (void)state;
    static const float weights[] = {-0.001f, 1.001f, 255, NAN, INFINITY, -INFINITY};
    pair p = loss_pair_create(1, 8, 8, WEIGHT_ONE);
    bench b = loss_bench_create(2);
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
    loss_bench_free(&b);
    loss_pair_free(&p);
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
    };
    return cmocka_run_group_tests_name("loss", tests, NULL, NULL);
}
