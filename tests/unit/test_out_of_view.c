/* test_out_of_view.c - the optimizer state of groups of Gaussians that are out of view. */
#include "testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fit/fitter.h"
#include "fit/optimizer_state.h"
#include "fit/out_of_view.h"

enum { STEPS = 40, COUNT = 4000, GROUP = SF_PROJECT_BLOCKS * SF_LANES, VALUES = 14 };

/* A corridor: each view sees a part of it. */
static sf_fitter *fitter_of(sf_context *ctx, int64_t moments, int64_t densify, int average,
                            sf_scene **scene) {
    sf_fitter *f;
    sf_fit_options options = sf_fit_options_default();
    options.steps = 200;
    options.max_gaussians = COUNT;
    options.densify_every = 1000;
    options.moments = moments;
    options.densify = densify;
    options.validate = 0;
    options.ema_steps = average ? 5 : 0;
    assert_ok(ctx, sf_scene_load(ctx, "sim:corridor?width=48&height=36&frames=12", NULL, scene));
    assert_ok(ctx, sf_fitter_create(ctx, *scene, NULL, &options, &f));
    return f;
}

static size_t groups_of(const sf_fitter *f) { return (f->model->count + GROUP - 1) / GROUP; }

/* Parameters and moments of a Gaussian that momentum moves. */
typedef struct gaussian {
    float p[VALUES], m[VALUES], v[VALUES];
} gaussian;

static gaussian get(const sf_fitter *f, size_t i) {
    gaussian g;
    int k = 0;
    for (int field = 0; sf_has_momentum(field); field++)
        for (int c = 0; c < sf_field_components(field); c++, k++) {
            size_t at = sf_at(i, sf_field_components(field), c);
            g.p[k] = *sf_value(&f->model->params, field, i, c);
            g.m[k] = ((float *)f->moments.part[0][field])[at];
            g.v[k] = ((float *)f->moments.part[1][field])[at];
        }
    assert_int_equal(k, VALUES);
    return g;
}

/* A group out of view stays as it is, with its momentum; one in view does not. */
static void test_groups_out_of_view_stay(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene;
    sf_fitter *f = fitter_of(ctx, SF_MOMENTS_FLOAT, SF_DENSIFY_ERROR, 0, &scene);
    size_t count = f->model->count, stayed = 0, moved = 0, momentum = 0;
    gaussian *before = malloc(count * sizeof *before);
    assert_true(before && count > 2 * GROUP && sf_skips_out_of_view(f));
    for (int step = 0; step < STEPS; step++) {
        for (size_t i = 0; i < count; i++) before[i] = get(f, i);
        assert_ok(ctx, sf_fitter_step(f));
        assert_int_equal(f->model->count, count);
        for (size_t i = 0; i < count; i++) {
            gaussian after = get(f, i);
            if (f->out_of_view.steps[i / GROUP]) {
                assert_false(f->workspace.in_view[i / GROUP]);
                assert_memory_equal(&after, &before[i], sizeof after);
                stayed++;
                momentum += after.m[0] != 0;
            } else {
                assert_true(f->workspace.in_view[i / GROUP]);
                moved += after.p[0] != before[i].p[0];
            }
        }
    }
    assert_true(stayed > GROUP && moved > GROUP && momentum > GROUP); /* else nothing was tested */
    free(before);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Second moments fall by beta2 in each step out of view, whether they are brought up to date after each of
 * them, once, or by what saves the fit: all that follows is the same to the byte. */
static void test_when_moments_are_updated_changes_nothing(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene[3];
    sf_fitter *f[3];
    uint32_t longest = 0;
    for (int k = 0; k < 3; k++) f[k] = fitter_of(ctx, SF_MOMENTS_FLOAT, SF_DENSIFY_ERROR, 0, &scene[k]);
    size_t count = f[0]->model->count;
    for (int step = 0; step < STEPS; step++) {
        for (int k = 0; k < 3; k++) assert_ok(ctx, sf_fitter_step(f[k]));
        for (size_t group = 0; group < groups_of(f[0]); group++)
            if (f[0]->out_of_view.steps[group] > longest) longest = f[0]->out_of_view.steps[group];
        sf_update_second_moments(f[1]);
        if (step % 7 == 3) assert_ok(ctx, sf_fitter_save(f[2], test_path("fit.checkpoint")));
    }
    assert_true(longest > 3); /* else nothing was tested */
    for (int k = 0; k < 3; k++) sf_update_second_moments(f[k]);
    for (size_t i = 0; i < count; i++) {
        gaussian first = get(f[0], i);
        for (int k = 1; k < 3; k++) {
            gaussian other = get(f[k], i);
            assert_memory_equal(&other, &first, sizeof first);
        }
    }
    for (int k = 0; k < 3; k++) {
        sf_fitter_destroy(&f[k]);
        sf_scene_destroy(&scene[k]);
    }
    sf_context_destroy(&ctx);
}

/* What a group that is out of view for n steps has of its second moments when it is in view again. */
static void test_second_moments_fall(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene;
    sf_fitter *f = fitter_of(ctx, SF_MOMENTS_FLOAT, SF_DENSIFY_ERROR, 0, &scene);
    for (int step = 0; step < 10; step++) assert_ok(ctx, sf_fitter_step(f));
    sf_update_second_moments(f);
    gaussian before = get(f, 1), beside = get(f, GROUP);
    f->out_of_view.steps[0] = 6;
    sf_update_second_moments(f);
    gaussian after = get(f, 1), other = get(f, GROUP);
    double fall = pow(f->options.adam_beta2, 6), seen = 0;
    for (int k = 0; k < VALUES; k++) {
        double right = fall * (double)before.v[k];
        assert_true(fabs((double)after.v[k] - right) <= 1e-6 * right);
        seen += right;
    }
    assert_true(seen > 0);
    assert_memory_equal(after.p, before.p, sizeof after.p);
    assert_memory_equal(&other, &beside, sizeof other);
    assert_int_equal(f->out_of_view.steps[0], 0);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Where something changes in every step, groups out of view take part in each: 16-bit moments are rounded at
 * random, relocation adds noise, and the moving average follows. */
static void test_others_make_each_step(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    for (int kind = 0; kind < 3; kind++) {
        sf_scene *scene;
        sf_fitter *f = fitter_of(ctx, kind == 0 ? SF_MOMENTS_HALF : SF_MOMENTS_FLOAT,
                                 kind == 1 ? SF_DENSIFY_RELOCATE : SF_DENSIFY_ERROR, kind == 2, &scene);
        assert_false(sf_skips_out_of_view(f));
        for (int step = 0; step < 6; step++) assert_ok(ctx, sf_fitter_step(f));
        for (size_t group = 0; group < groups_of(f); group++)
            assert_int_equal(f->out_of_view.steps[group], 0);
        sf_fitter_destroy(&f);
        sf_scene_destroy(&scene);
    }
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_groups_out_of_view_stay),
        cmocka_unit_test(test_when_moments_are_updated_changes_nothing),
        cmocka_unit_test(test_second_moments_fall),
        cmocka_unit_test(test_others_make_each_step),
    };
    return cmocka_run_group_tests_name("out_of_view", tests, NULL, NULL);
}
