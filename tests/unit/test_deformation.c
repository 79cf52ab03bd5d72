/* test_deformation.c - Gaussians that go with keyframes whose poses are corrected. */
#include "../testing.h"

#include <math.h>
#include <string.h>

#include "fit/fitter.h"
#include "fit/restore_point.h"
#include "fit/select_importance.h"
#include "fit/select_merge.h"
#include "live/deformation.h"
#include "pose/track.h"

enum { COUNT = 3000, SIDE = 100 }; /* more than a task takes */

static const double EVERYWHERE[3] = {0, 0, 4}, ASIDE[3] = {0.5, -0.2, 5};

static sf_model *model_of(sf_context *ctx, float mean[3 * COUNT]) {
    sf_model *model;
    uint64_t state = 7;
    for (int i = 0; i < 3 * COUNT; i++) {
        state = state * 6364136223846793005u + 1442695040888963407u;
        mean[i] = (float)(state >> 40) / (float)(1 << 24) - 0.5f;
    }
    assert_ok(ctx, sf_model_create(ctx, COUNT, 0, &model));
    sf_gaussians from = {.means = mean};
    assert_ok(ctx, sf_model_set(model, 0, COUNT, &from));
    return model;
}

static void get_means(const sf_model *model, float mean[3 * COUNT]) {
    sf_gaussians to = {.means = mean};
    assert_int_equal(sf_model_get(model, 0, COUNT, &to), SF_OK);
}

/* A camera that looks along z from -at, corrected by a left twist. */
static sf_correction correction_of(const double at[3], const double twist[SF_TWIST]) {
    sf_correction c = {.camera = {.width = SIDE,
                                  .height = SIDE,
                                  .fx = SIDE,
                                  .fy = SIDE,
                                  .cx = SIDE / 2.0,
                                  .cy = SIDE / 2.0,
                                  .R_cw = {1, 0, 0, 0, 1, 0, 0, 0, 1}},
                       .zoom = 1,
                       .scale = 1};
    memcpy(c.camera.t_cw, at, sizeof c.camera.t_cw);
    memcpy(c.to.R, c.camera.R_cw, sizeof c.to.R);
    memcpy(c.to.t, at, sizeof c.to.t);
    sf_rigid_move(&c.to, twist);
    return c;
}

/* Where a place is seen, before or after the correction. */
static void seen_at(const sf_correction *c, int after, const float x[3], double p[3]) {
    const double at[3] = {(double)x[0], (double)x[1], (double)x[2]};
    sf_rigid before;
    memcpy(before.R, c->camera.R_cw, sizeof before.R), memcpy(before.t, c->camera.t_cw, sizeof before.t);
    sf_rigid_apply(after ? &c->to : &before, at, p);
}

/* Each place keeps its pixel where the focal length becomes `zoom` times as long and depths `scale` times as
 * great. */
static void stays_in_its_picture(double zoom, double scale) {
    static float before[3 * COUNT], after[3 * COUNT];
    const double twist[SF_TWIST] = {0.03, -0.02, 0.05, 0.01, 0.02, -0.015};
    sf_context *ctx = test_context_threads(2);
    sf_model *model = model_of(ctx, before);
    sf_correction c = correction_of(EVERYWHERE, twist);
    double moved = 0;
    c.zoom = zoom, c.scale = scale;
    assert_ok(ctx, sf_deform_map(ctx, model, &c, 1));
    get_means(model, after);
    for (int i = 0; i < COUNT; i++) {
        double p[3], q[3];
        seen_at(&c, 0, before + 3 * i, p);
        seen_at(&c, 1, after + 3 * i, q);
        assert_true(fabs(q[2] - scale * p[2]) < 2e-6);
        for (int k = 0; k < 2; k++) assert_true(fabs(q[k] - scale / zoom * p[k]) < 2e-6);
        for (int k = 0; k < 3; k++) moved = fmax(moved, fabs((double)(after[3 * i + k] - before[3 * i + k])));
    }
    assert_true(moved > 0.04);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

static void what_one_sees_stays_in_its_picture(void **state) {
    (void)state;
    stays_in_its_picture(1, 1);
    stays_in_its_picture(1.1, 0.9);
}

/* A camera that is twice as near counts four times; what neither sees stays to the bit. */
static void near_ones_count_more(void **state) {
    (void)state;
    static float before[3 * COUNT], after[3 * COUNT];
    const double right[SF_TWIST] = {-0.05}, left[SF_TWIST] = {0.05};
    sf_context *ctx = test_context();
    sf_model *model = model_of(ctx, before);
    /* 0 in the middle of both, 1 beside, 2 behind */
    float at[9] = {0, 0, 0, 3, 3, 0, 0, 0, -9};
    sf_gaussians from = {.means = at};
    assert_ok(ctx, sf_model_set(model, 0, 3, &from));
    sf_correction two[] = {correction_of((const double[3]){0, 0, 2}, right),
                           correction_of((const double[3]){0, 0, 4}, left)};
    assert_ok(ctx, sf_deform_map(ctx, model, two, 2));
    get_means(model, after);
    assert_true(fabsf(after[0] - 0.05f * (4.0f - 1.0f) / 5) < 1e-6f);
    assert_true(fabsf(after[1]) < 1e-6f && fabsf(after[2]) < 1e-6f);
    assert_memory_equal(after + 3, at + 3, 6 * sizeof *at);
    assert_ok(ctx, sf_deform_map(ctx, model, two, 0)); /* none moves anything */
    get_means(model, before);
    assert_memory_equal(after, before, sizeof after);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* Corrected all by one motion of the world, the model goes through that motion. */
static void one_motion_of_all_is_the_models(void **state) {
    (void)state;
    static float before[3 * COUNT], after[3 * COUNT];
    const double twist[SF_TWIST] = {0.04, 0.01, -0.02, 0.02, -0.01, 0.03};
    sf_context *ctx = test_context();
    sf_model *model = model_of(ctx, before);
    sf_rigid motion = {.R = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    sf_rigid_move(&motion, twist);
    sf_correction two[] = {correction_of(EVERYWHERE, (const double[SF_TWIST]){0}),
                           correction_of(ASIDE, (const double[SF_TWIST]){0})};
    for (int n = 0; n < 2; n++) { /* pose' = pose motion^-1, both rotations of the poses being none */
        sf_rigid *to = &two[n].to;
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++) to->R[3 * r + c] = motion.R[3 * c + r];
        double back[3];
        sf_rigid_apply_back(&motion, (const double[3]){0, 0, 0}, back);
        for (int k = 0; k < 3; k++) to->t[k] = two[n].camera.t_cw[k] + back[k];
    }
    assert_ok(ctx, sf_deform_map(ctx, model, two, 2));
    get_means(model, after);
    for (int i = 0; i < COUNT; i++) {
        double p[3], x[3] = {(double)before[3 * i], (double)before[3 * i + 1], (double)before[3 * i + 2]};
        sf_rigid_apply(&motion, x, p);
        for (int k = 0; k < 3; k++) assert_true(fabs(p[k] - (double)after[3 * i + k]) < 1e-6);
    }
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* A fit that goes back does not go back to where things were before the poses were corrected, nor does a pair
 * on trial that is undone. */
static void all_of_a_fit_goes_along(void **state) {
    (void)state;
    static float mean[3 * COUNT], deformed[3 * COUNT], back[3 * COUNT];
    static uint8_t gray[3 * SIDE * SIDE];
    const double twist[SF_TWIST] = {0.03, -0.02, 0.05, 0.01, 0.02, -0.015};
    sf_context *ctx = test_context_threads(2);
    sf_correction c = correction_of(EVERYWHERE, twist);
    sf_pixels pixels = {gray, 3 * SIDE, NULL};
    sf_model *model = model_of(ctx, mean);
    sf_fit_options options = sf_fit_options_default();
    sf_scene *scene;
    sf_fitter *f;
    sf_importance w;
    for (size_t i = 0; i < COUNT; i++) {
        *sf_value(&model->params, SF_FIELD_logit_opacity, i, 0) = 0;
        for (int k = 0; k < 3; k++) *sf_value(&model->params, SF_FIELD_log_scale, i, k) = -2.5f;
    }
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    assert_ok(ctx, sf_scene_add_view(scene, NULL, &c.camera, &pixels, SF_SPLIT_TRAIN, NULL));
    options.extent = 4; /* so that units are tested */
    assert_ok(ctx, sf_fitter_create(ctx, scene, model, &options, &f));
    assert_ok(ctx, sf_save_restore_point(f));
    get_means(f->model, mean);
    int unit = f->model->unit;
    assert_int_equal(unit, 2);
    assert_ok(ctx, sf_measure_importance(f, 0, &w));
    f->options.merge = 1;
    assert_ok(ctx, sf_merges_begin(f, &w));
    sf_importance_free(ctx, &w);
    assert_true(f->merges.count > 0);

    assert_ok(ctx, sf_deform_fit(ctx, f, &c, 1));
    sf_merges_undo_all(f);
    get_means(f->model, deformed);
    for (int i = 0; i < COUNT; i++) {
        float from[3], to[3];
        double p[3], q[3];
        for (int k = 0; k < 3; k++) from[k] = ldexpf(mean[3 * i + k], unit);
        for (int k = 0; k < 3; k++) to[k] = ldexpf(deformed[3 * i + k], unit);
        seen_at(&c, 0, from, p);
        seen_at(&c, 1, to, q);
        for (int k = 0; k < 3; k++) assert_true(fabs(p[k] - q[k]) < 2e-6);
    }
    assert_ok(ctx, sf_go_to_restore_point(f));
    get_means(f->model, back);
    assert_memory_equal(back, deformed, sizeof back);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_one_sees_stays_in_its_picture),
        cmocka_unit_test(near_ones_count_more),
        cmocka_unit_test(one_motion_of_all_is_the_models),
        cmocka_unit_test(all_of_a_fit_goes_along),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
