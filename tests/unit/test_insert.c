/* test_insert.c - what a live fit asks of a fitter: points, views that come, held poses, no end. */
#include "../testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fit/fitter.h"
#include "fit/schedule.h"
#include "fit/views.h"

enum { SIDE = 48, VIEWS = 6, POINTS = 60 };

static uint8_t picture[3 * SIDE * SIDE];

static void add_view(sf_context *ctx, sf_scene *scene, int i, uint32_t *id) {
    sf_camera camera = {.width = SIDE,
                        .height = SIDE,
                        .fx = SIDE,
                        .fy = SIDE,
                        .cx = SIDE / 2.0,
                        .cy = SIDE / 2.0,
                        .R_cw = {1, 0, 0, 0, 1, 0, 0, 0, 1},
                        .t_cw = {0.2 * i - 0.5, 0.1 * (i % 2), 3}};
    sf_pixels pixels = {picture, 3 * SIDE, NULL};
    for (int k = 0; k < 3 * SIDE * SIDE; k++) picture[k] = (uint8_t)(40 + (k / 60 + 7 * i) % 150);
    assert_ok(ctx, sf_scene_add_view(scene, NULL, &camera, &pixels, SF_SPLIT_TRAIN, id));
}

static sf_scene *scene_of(sf_context *ctx) {
    sf_scene *scene;
    float xyz[3 * POINTS];
    uint64_t state = 5;
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    for (int i = 0; i < VIEWS; i++) add_view(ctx, scene, i, NULL);
    for (int i = 0; i < 3 * POINTS; i++) {
        state = state * 6364136223846793005u + 1442695040888963407u;
        xyz[i] = (float)(state >> 40) / (float)(1 << 24) - 0.5f;
    }
    assert_ok(ctx, sf_scene_add_points(scene, POINTS, xyz, NULL));
    return scene;
}

static sf_fit_options options_of(int64_t steps) {
    sf_fit_options o = sf_fit_options_default();
    o.steps = steps;
    o.init = SF_INIT_POINTS;
    o.size = SF_SIZE_CAP;
    o.validate = 0;
    o.max_gaussians = POINTS + 5;
    o.densify_per_step = 0;
    o.prune_opacity = 0;
    return o;
}

static void points_become_gaussians(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = scene_of(ctx);
    sf_fitter *fitter;
    sf_fit_options o = options_of(40);
    o.extent = 1; /* so that means and scales are in the world's unit */
    const float xyz[] = {0.1f, 0.2f, 0.3f, NAN, 0, 0, 0.4f, 0.5f, 0.6f, 1, 1, 1};
    const uint8_t rgb[] = {255, 0, 51, 1, 2, 3, 10, 20, 30, 9, 9, 9};
    const float radius[] = {0.02f, 0.02f, 0.05f, 0};
    size_t added = 99;
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &o, &fitter));
    for (int i = 0; i < 5; i++) assert_ok(ctx, sf_fitter_step(fitter));
    size_t had = fitter->model->count;
    sf_model *before;
    assert_ok(ctx, sf_fitter_snapshot(fitter, &before));
    assert_ok(ctx, sf_fitter_add_points(fitter, 4, xyz, rgb, radius, &added));
    assert_int_equal(added, 2); /* neither what is not finite nor what has no size */
    assert_int_equal(fitter->model->count, had + 2);
    int found = 0;
    for (size_t i = 0; i < had + 2; i++) {
        float mean[3], log_scale[3], logit;
        sf_gaussians to = {.means = mean, .log_scales = log_scale, .logit_opacities = &logit};
        assert_int_equal(sf_model_get(fitter->model, i, 1, &to), SF_OK);
        if (fabsf(mean[0] - 0.4f) > 0 || fabsf(mean[1] - 0.5f) > 0) continue;
        found++;
        assert_true(fabsf(log_scale[1] - logf(0.05f)) < 1e-6f);
        assert_true(fabs(1 / (1 + exp(-(double)logit)) - o.init_opacity) < 1e-6);
    }
    assert_int_equal(found, 1);
    float *old = malloc(3 * had * sizeof *old), *now = malloc(3 * had * sizeof *now);
    assert_non_null(old);
    assert_non_null(now);
    sf_gaussians all = {.means = old};
    assert_int_equal(sf_model_get(before, 0, had, &all), SF_OK);
    all.means = now;
    assert_int_equal(sf_model_get(fitter->model, 0, had, &all), SF_OK);
    assert_memory_equal(old, now, 3 * had * sizeof *old); /* who was there is as before */
    for (int i = 0; i < 10; i++) assert_ok(ctx, sf_fitter_add_points(fitter, 4, xyz, rgb, radius, &added));
    assert_int_equal(fitter->model->count, o.max_gaussians);
    assert_int_equal(added, 0);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    free(old);
    free(now);
    sf_model_destroy(&before);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* A pass has each view once, and goes on where views come meanwhile: who comes is next, and nobody is passed
 * over for it, however often that happens. */
static void newcomers_are_next_and_nobody_waits(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = scene_of(ctx);
    sf_fitter *fitter;
    sf_fit_options o = options_of(200);
    o.exposure = 1; /* its steps tell which views were trained on */
    uint32_t id, first = 0;
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &o, &fitter));
    for (int came = 0; came < 6; came++) { /* one in the midst of each pass */
        for (int i = 0; i < 3; i++) assert_ok(ctx, sf_fitter_step(fitter));
        add_view(ctx, scene, VIEWS + came, &id);
        if (!came) first = id;
        assert_null(sf_view_state_of(&fitter->views, id));
        assert_ok(ctx, sf_fitter_step(fitter));
        assert_int_equal(sf_view_state_of(&fitter->views, id)->exposure.steps, 1);
    }
    int64_t most = 0, least = INT64_MAX, all = 0;
    for (size_t i = 0; i < fitter->views.count; i++) {
        int64_t steps = fitter->views.states[i].exposure.steps;
        most = steps > most ? steps : most, all += steps;
        if (fitter->views.states[i].id < first && steps < least) least = steps;
    }
    print_message("%d steps: of the views that were there first %d at least, %d at most\n", (int)all,
                  (int)least, (int)most);
    assert_int_equal(all, 24);
    assert_true(most - least <= 1);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void poses_are_held(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = scene_of(ctx);
    sf_fitter *fitter;
    sf_fit_options o = options_of(60);
    o.refine_poses = 1;
    o.refine_start = 0;
    sf_view_info view[2];
    sf_camera camera;
    assert_ok(ctx, sf_scene_get_view(scene, 0, &view[0]));
    assert_ok(ctx, sf_scene_get_view(scene, 3, &view[1]));
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &o, &fitter));
    assert_int_equal(sf_fitter_hold_pose(fitter, view[1].id), SF_ERR_ARGUMENT); /* not taken up yet */
    assert_ok(ctx, sf_fitter_step(fitter));
    sf_view_state *state_of = sf_view_state_of(&fitter->views, view[1].id);
    state_of->t_cw[0] += 0.01; /* as a step may have left it */
    assert_ok(ctx, sf_fitter_hold_pose(fitter, view[1].id));
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    assert_ok(ctx, sf_fitter_get_camera(fitter, view[1].id, &camera));
    assert_memory_equal(camera.t_cw, view[1].camera.t_cw, sizeof camera.t_cw);
    assert_ok(ctx, sf_fitter_get_camera(fitter, view[0].id, &camera));
    assert_memory_not_equal(camera.t_cw, view[0].camera.t_cw, sizeof camera.t_cw);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* A pose given between steps is what the next steps are of. */
static void poses_are_given(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = scene_of(ctx);
    sf_fitter *fitter;
    sf_fit_options o = options_of(40);
    sf_view_info view;
    sf_camera camera;
    o.exposure = 1; /* something is learned of each view */
    assert_ok(ctx, sf_scene_get_view(scene, 0, &view));
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &o, &fitter));
    double t[3] = {view.camera.t_cw[0] + 0.01, view.camera.t_cw[1], view.camera.t_cw[2]};
    const double none[9] = {0};
    assert_int_equal(sf_fitter_set_pose(fitter, view.id, view.camera.R_cw, t), SF_ERR_ARGUMENT); /* not yet */
    assert_ok(ctx, sf_fitter_step(fitter));
    assert_int_equal(sf_fitter_set_pose(fitter, view.id, none, t), SF_ERR_ARGUMENT);
    assert_non_null(strstr(sf_last_error(ctx), "pose"));
    assert_ok(ctx, sf_fitter_set_pose(fitter, view.id, view.camera.R_cw, t));
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    assert_ok(ctx, sf_fitter_get_camera(fitter, view.id, &camera));
    assert_memory_equal(camera.t_cw, t, sizeof t);
    assert_memory_equal(camera.R_cw, view.camera.R_cw, sizeof camera.R_cw);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void runs_without_an_end_go_on(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = scene_of(ctx);
    sf_fitter *fitter;
    sf_fit_options o = options_of(20);
    o.open_end = 1;
    o.extent = 2.5;
    o.lr_boost = 1;
    sf_fit_progress p;
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &o, &fitter));
    assert_true(fabs(fitter->extent - 2.5) < 1e-12);
    double rate = 0;
    for (int i = 0; i < 60; i++) {
        assert_ok(ctx, sf_fitter_step(fitter));
        if (i == 20) rate = sf_scheduled_rate(fitter, sf_fraction(fitter), SF_FIELD_logit_opacity);
    }
    sf_fitter_get_progress(fitter, &p);
    assert_int_equal(p.step, 60);
    assert_true(p.fraction < o.cool_down && p.end == SF_FIT_GOES_ON);
    assert_true(fabs(rate - o.lr_opacity) < 1e-12); /* the rates have not fallen */
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(points_become_gaussians),
        cmocka_unit_test(newcomers_are_next_and_nobody_waits),
        cmocka_unit_test(poses_are_held),
        cmocka_unit_test(poses_are_given),
        cmocka_unit_test(runs_without_an_end_go_on),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
