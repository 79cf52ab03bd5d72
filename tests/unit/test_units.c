/* test_units.c - a fit does not depend on the world's unit, on where its origin is, or on one far camera. */
#include "scale_fixture.h"

#include <math.h>
#include <string.h>

#include "fit/fitter.h"
#include "render/near_plane.h"
#include "scene/curve.h"
#include "scene/scene.h"

enum { WIDTH = 64, HEIGHT = 48, STEPS = 30, POINTS = 300 };

/* The embedded scene with its cameras, and points around the middle, times 2^k and moved. The camera
 * `far_view`
 * (-1: none) is moved by a further `distance`. */
static sf_scene *scaled_scene(sf_context *ctx, int k, int far_view, double distance) {
    sf_scene *plain, *scene;
    static float rgb[3 * WIDTH * HEIGHT];
    static uint8_t bytes[3 * WIDTH * HEIGHT];
    assert_ok(ctx, sf_scene_load(ctx, "sim:studio?width=64&height=48&frames=9", NULL, &plain));
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    sf_view_info view;
    for (size_t i = 0; i < 9; i++) {
        assert_ok(ctx, sf_scene_get_view(plain, i, &view));
        assert_ok(ctx, sf_scene_get_pixels(plain, view.id, rgb, NULL));
        for (size_t p = 0; p < 3 * WIDTH * HEIGHT; p++) bytes[p] = (uint8_t)lroundf(255 * rgb[p]);
        sf_camera camera = view.camera;
        if ((int)i == far_view) camera.t_cw[0] += distance;
        for (int axis = 0; axis < 3; axis++) camera.t_cw[axis] = ldexp(camera.t_cw[axis], k);
        sf_pixels pixels = {.rgb = bytes, .stride = 3 * WIDTH};
        assert_ok(ctx, sf_scene_add_view(scene, NULL, &camera, &pixels, view.split, NULL));
    }
    static float xyz[3 * POINTS];
    for (int i = 0; i < POINTS; i++) {
        xyz[3 * i] = ldexpf((float)(i % 10) / 5 - 1, k);
        xyz[3 * i + 1] = ldexpf((float)(i / 10 % 6) / 3 - 1, k);
        xyz[3 * i + 2] = ldexpf((float)(i / 60) / 4, k);
    }
    assert_ok(ctx, sf_scene_add_points(scene, POINTS, xyz, NULL));
    sf_scene_destroy(&plain);
    return scene;
}

static sf_model *fitted(sf_context *ctx, sf_scene *scene) {
    sf_fit_options options = sf_fit_options_default();
    options.steps = STEPS;
    options.init = SF_INIT_POINTS;
    sf_fitter *f;
    sf_model *model;
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &f));
    assert_ok(ctx, sf_fitter_run(f, NULL, NULL));
    assert_ok(ctx, sf_fitter_snapshot(f, &model));
    sf_fitter_destroy(&f);
    return model;
}

static void test_any_unit(void **state) {
    (void)state;
    static const int powers[] = {-20, -3, 1, 20};
    sf_context *ctx = test_context();
    sf_scene *scene = scaled_scene(ctx, 0, -1, 0);
    sf_model *model = fitted(ctx, scene);
    sf_scene_destroy(&scene);
    for (size_t p = 0; p < sizeof powers / sizeof *powers; p++) {
        int k = powers[p];
        scene = scaled_scene(ctx, k, -1, 0);
        sf_model *scaled = fitted(ctx, scene);
        scale_assert_same(model, scaled, k);
        sf_model_destroy(&scaled);
        sf_scene_destroy(&scene);
    }
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* One camera far away leaves the scene's size as it is. */
static void test_one_far_camera(void **state) {
    (void)state;
    static const double distances[] = {100, 500, 1e5};
    sf_context *ctx = test_context();
    sf_scene *scene = scaled_scene(ctx, 0, -1, 0);
    double size = test_scene_info(scene).extent;
    sf_scene_destroy(&scene);
    for (size_t i = 0; i < sizeof distances / sizeof *distances; i++) {
        scene = scaled_scene(ctx, 0, 4, distances[i]);
        sf_scene_info info = test_scene_info(scene);
        assert_true(info.extent > 0.7 * size && info.extent < 1.4 * size);
        for (int k = 0; k < 3; k++) assert_true(fabs(info.center[k]) < 10);
        sf_scene_destroy(&scene);
    }
    sf_context_destroy(&ctx);
}

/* Points far away are counted, and leave the scene's size and the order of the others as they are. */
static void test_far_points(void **state) {
    (void)state;
    static const float distances[] = {1e3f, 1e9f, 1e30f};
    enum { FAR = POINTS / 10 };
    static float far[3 * FAR], given[3 * (POINTS + FAR)], xyz[3 * (POINTS + FAR)];
    sf_context *ctx = test_context();
    sf_scene *scene = scaled_scene(ctx, 0, -1, 0);
    double size = test_scene_info(scene).extent;
    assert_int_equal(sf_scene_count_far_points(scene), 0);
    sf_scene_destroy(&scene);
    for (size_t d = 0; d < sizeof distances / sizeof *distances; d++) {
        for (int i = 0; i < 3 * FAR; i++) far[i] = (i % 2 ? 1 : -1) * distances[d];
        scene = scaled_scene(ctx, 0, -1, 0);
        assert_ok(ctx, sf_scene_add_points(scene, FAR, far, NULL));
        assert_int_equal(sf_scene_count_far_points(scene), FAR);
        double now = test_scene_info(scene).extent;
        assert_true(now > 0.9 * size && now < 1.1 * size);
        size_t n = sf_scene_get_points(scene, 0, POINTS + FAR, given, NULL);
        for (size_t i = 0; i < n; i++) memcpy(xyz + 3 * i, given + 3 * (i * 137 % n), 3 * sizeof *xyz);
        uint32_t *order;
        double way = 0;
        assert_ok(ctx, sf_curve_order(ctx, xyz, n, NULL, &order));
        for (size_t i = 1; i < n; i++) {
            double step = 0;
            for (int k = 0; k < 3; k++)
                step += pow(
                    (double)xyz[3 * order[i] + (uint32_t)k] - (double)xyz[3 * order[i - 1] + (uint32_t)k], 2);
            if (step < 100) way += sqrt(step);
        }
        assert_true(way < 0.4 * POINTS); /* a grid of 0.2, 0.33, 0.25; along its rows 0.3 */
        sf_free(ctx, order);
        sf_scene_destroy(&scene);
    }
    sf_context_destroy(&ctx);
}

/* A far view whose picture does not fit its pose is left out of later passes; where none is far, none is. */
static void test_misplaced_view(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    for (int is_far = 0; is_far < 2; is_far++) {
        sf_scene *scene = scaled_scene(ctx, 0, is_far ? 4 : -1, 100);
        uint32_t id = test_view_info(scene, 4).id;
        sf_far_view far[2];
        assert_int_equal(test_view_info(scene, 4).split, SF_SPLIT_TRAIN);
        assert_int_equal(sf_scene_far_views(scene, SF_SPLIT_TRAIN, far, 2), is_far);
        if (is_far) assert_true(far[0].id == id && far[0].times > 5 && far[0].points == 0);
        sf_fit_options options = sf_fit_options_default();
        options.steps = 300, options.validate = 0;
        options.init = SF_INIT_POINTS; /* the far view sees none of them */
        sf_fitter *f;
        test_log_clear();
        assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &f));
        assert_ok(ctx, sf_fitter_run(f, NULL, NULL));
        assert_int_equal(f->misplaced.count, is_far);
        assert_int_equal(strstr(test_log, "its picture does not fit") != NULL, is_far);
        int drawn = 0;
        for (size_t i = 0; i < f->sampler.count; i++) drawn |= f->sampler.ids[i] == id;
        assert_int_equal(drawn, !is_far);
        sf_fitter_destroy(&f);
        sf_scene_destroy(&scene);
    }
    sf_context_destroy(&ctx);
}

/* While views arrive, the newest ones do not fit yet: none is left out. */
static void test_views_that_arrive(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = scaled_scene(ctx, 0, 4, 100);
    sf_view_info view = test_view_info(scene, 1);
    static uint8_t gray[3 * WIDTH * HEIGHT];
    sf_pixels pixels = {.rgb = gray, .stride = 3 * WIDTH};
    sf_fit_options options = sf_fit_options_default();
    options.steps = 300, options.validate = 0;
    options.init = SF_INIT_POINTS;
    sf_fitter *f;
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &f));
    for (int step = 0; step < 60; step++) {
        assert_ok(ctx, sf_fitter_step(f));
        if (step == 30)
            assert_ok(ctx, sf_scene_add_view(scene, NULL, &view.camera, &pixels, view.split, NULL));
    }
    assert_ok(ctx, sf_fitter_run(f, NULL, NULL));
    assert_int_equal(f->misplaced.count, 0);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* The near plane is a part of the depths in the picture, whatever the unit; what lies outside the picture or
 * behind the camera does not count. */
static void test_near_plane(void **state) {
    (void)state;
    enum { COUNT = 64 };
    sf_context *ctx = test_context();
    sf_model *model;
    assert_ok(ctx, sf_model_create(ctx, COUNT, 0, &model));
    sf_eye eye = {.R = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .fx = 60, .fy = 60, .cx = 32, .cy = 24};
    eye.width = WIDTH, eye.height = HEIGHT;
    for (int k = -30; k <= 30; k += 30) {
        for (size_t i = 0; i < COUNT; i++) {
            float z = i % 2   ? 5
                      : i % 4 ? -1
                              : 0.5f,
                  x = i % 4 ? 0 : 100; /* half of them are not to be seen */
            *sf_value(&model->params, SF_FIELD_mean, i, 0) = ldexpf(x, k);
            *sf_value(&model->params, SF_FIELD_mean, i, 2) = ldexpf(z, k);
        }
        assert_true(fabsf(ldexpf(sf_near_plane_of(model, &eye, NULL), -k) - 0.5f) < 1e-6f);
    }
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* Another origin moves the means, and back. */
static void test_origin(void **state) {
    (void)state;
    static const double far[3] = {500000, 5000000, 128}, zero[3];
    double is[3];
    sf_context *ctx = test_context();
    sf_model *model;
    assert_ok(ctx, sf_model_create(ctx, 1, 0, &model));
    *sf_value(&model->params, SF_FIELD_mean, 0, 1) = 0.25f;
    memcpy(model->origin, far, sizeof far);
    sf_model_set_origin(model, zero);
    assert_true(*sf_value(&model->params, SF_FIELD_mean, 0, 0) == 500000);
    assert_true(*sf_value(&model->params, SF_FIELD_mean, 0, 1) == 5000000); /* rounded */
    sf_model_set_origin(model, far);
    sf_model_get_origin(model, is);
    assert_memory_equal(is, far, sizeof far);
    assert_true(*sf_value(&model->params, SF_FIELD_mean, 0, 2) == 0);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_any_unit),
        cmocka_unit_test(test_one_far_camera),
        cmocka_unit_test(test_far_points),
        cmocka_unit_test(test_misplaced_view),
        cmocka_unit_test(test_views_that_arrive),
        cmocka_unit_test(test_near_plane),
        cmocka_unit_test(test_origin),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
