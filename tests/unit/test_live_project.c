/* test_live_project.c - keyframes as a COLMAP project. */
#include "../testing.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <splatfit/live.h>
#include <splatfit/source.h>

#include "live/live.h"

enum { WIDTH = 96, HEIGHT = 72, FRAMES = 40 };

static sf_live *run_live(sf_context *ctx, sf_source *source) {
    sf_live_options o = sf_live_options_default();
    sf_live *live;
    o.own_poses = 1, o.steps_per_frame = 3, o.hold_out = 4;
    o.fit.max_gaussians = 1500;
    assert_ok(ctx, sf_live_create(ctx, source, &o, &live));
    assert_int_equal(sf_live_save_project(live, test_path("early")), SF_ERR_EMPTY);
    sf_status status;
    do status = sf_live_step(live);
    while (!status);
    assert_int_equal(status, SF_ERR_END);
    return live;
}

/* Whether a point lies in the picture. */
static int is_seen(const sf_camera *c, const float xyz[3]) {
    double q[3];
    for (int k = 0; k < 3; k++) {
        q[k] = c->t_cw[k];
        for (int j = 0; j < 3; j++) q[k] += c->R_cw[3 * k + j] * (double)xyz[j];
    }
    double x = c->fx * q[0] / q[2] + c->cx, y = c->fy * q[1] / q[2] + c->cy;
    return q[2] > 0 && x > 0 && y > 0 && x < c->width && y < c->height;
}

static void check_cameras(sf_context *ctx, sf_live *live, sf_scene *scene) {
    for (size_t i = 0; i < live->keyframes.count; i++) {
        sf_view_info view;
        sf_camera camera;
        char file[32];
        assert_ok(ctx, sf_scene_get_view(scene, i, &view));
        snprintf(file, sizeof file, "frame_%06u.jpg", (unsigned)live->keyframes.list[i].id);
        assert_string_equal(view.name, file);
        assert_ok(ctx, sf_fitter_get_camera(live->fitter, live->keyframes.list[i].id, &camera));
        for (int k = 0; k < 9; k++) assert_true(fabs(view.camera.R_cw[k] - camera.R_cw[k]) < 1e-9);
        for (int k = 0; k < 3; k++) assert_true(fabs(view.camera.t_cw[k] - camera.t_cw[k]) < 1e-9);
        assert_true(view.camera.fx == camera.fx && view.camera.cy == camera.cy);
    }
}

static void check_points(sf_context *ctx, sf_scene *scene, const sf_scene_info *info) {
    for (size_t i = 0; i < info->points; i++) {
        float xyz[3];
        size_t seen = 0;
        assert_int_equal(sf_scene_get_points(scene, i, 1, xyz, NULL), 1);
        for (size_t v = 0; v < info->views; v++) {
            sf_view_info view;
            assert_ok(ctx, sf_scene_get_view(scene, v, &view));
            seen += is_seen(&view.camera, xyz) != 0;
        }
        assert_true(seen >= 2);
    }
}

/* The first one, but for what JPEG takes. */
static void check_picture(sf_context *ctx, sf_live *live, sf_scene *scene) {
    size_t values = 3 * (size_t)WIDTH * HEIGHT;
    float *a = malloc(values * sizeof *a), *b = malloc(values * sizeof *b);
    double squares = 0;
    sf_view_info view;
    assert_ok(ctx, sf_scene_get_view(scene, 0, &view));
    assert_ok(ctx, sf_scene_get_pixels(scene, view.id, a, NULL));
    assert_ok(ctx, sf_scene_get_pixels(sf_live_scene(live), live->keyframes.list[0].id, b, NULL));
    for (size_t i = 0; i < values; i++) squares += pow((double)(a[i] - b[i]), 2);
    assert_true(sqrt(squares / (double)values) < 0.02);
    free(a);
    free(b);
}

/* The same cameras and pictures as the fit has, and points that two of them see. */
static void is_read_as_it_was(void **state) {
    (void)state;
    test_skip_emulated();
    sf_context *ctx = test_context(), *source_ctx = test_context_threads(1);
    sf_source *source;
    char name[96];
    snprintf(name, sizeof name, "sim:studio?width=%d&height=%d&fps=0&frames=%d", WIDTH, HEIGHT, FRAMES);
    assert_ok(source_ctx, sf_source_open(source_ctx, name, &source));
    sf_live *live = run_live(ctx, source);
    assert_ok(ctx, sf_live_save_project(live, test_path("project")));
    sf_load_options load = sf_load_options_default();
    sf_scene *scene;
    sf_scene_info info;
    load.hold_out = 0;
    assert_ok(ctx, sf_scene_load(ctx, test_path("project"), &load, &scene));
    sf_scene_get_info(scene, &info);
    print_message("%zu keyframes, %zu points\n", info.views, info.points);
    assert_string_equal(info.kind, "COLMAP");
    assert_int_equal(info.views, live->keyframes.count);
    assert_int_equal(info.undistorted_views, 0);
    assert_true(info.points > 20);
    check_cameras(ctx, live, scene);
    check_points(ctx, scene, &info);
    check_picture(ctx, live, scene);
    sf_scene_destroy(&scene);
    sf_live_destroy(&live);
    sf_source_close(&source);
    sf_context_destroy(&source_ctx);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(is_read_as_it_was)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
