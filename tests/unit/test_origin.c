/* test_origin.c - coordinates far from 0: a local origin, and every file that states it. */
#include "colmap_fixture.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/linear.h"
#include "scene/gaussians.h"
#include "scene/scene.h"

static const double utm[3] = {500000, 5000000, 100}, zero[3];

static void write_text(const char *project, const char *name, const char *text) {
    char path[1024];
    snprintf(path, sizeof path, "%s/%s", test_path_in(project, "sparse/0"), name);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fputs(text, file);
    assert_int_equal(fclose(file), 0);
}

/* Views on a ring around `at`, a quarter turn apart, and two points there, as a COLMAP project of texts. */
static const char *write_ring(sf_context *ctx, const char *project, const double at[3]) {
    char text[8192];
    size_t used = 0;
    colmap_write_pictures(ctx, project, "images", 1);
    colmap_make_folder(test_path_in(project, "sparse"));
    colmap_make_folder(test_path_in(project, "sparse/0"));
    write_text(project, "cameras.txt", "1 PINHOLE 24 16 20 20 12 8\n");
    for (int i = 0; i < IMAGES; i++) {
        sf_camera eye = test_camera_around(i, IMAGES, WIDTH, HEIGHT);
        double q[4], t[3];
        sf_rotation_to_quat(eye.R_cw, q);
        for (int k = 0; k < 3; k++) t[k] = eye.t_cw[k] - sf_dot3(eye.R_cw + 3 * k, at);
        used += (size_t)snprintf(text + used, sizeof text - used,
                                 "%d %.17g %.17g %.17g %.17g %.17g %.17g %.17g 1 %s\n\n", i + 1, q[0], q[1],
                                 q[2], q[3], t[0], t[1], t[2], colmap_images[i].name);
    }
    write_text(project, "images.txt", text);
    snprintf(text, sizeof text, "1 %.17g %.17g %.17g 9 8 7 0.1\n2 %.17g %.17g %.17g 9 8 7 0.1\n", at[0],
             at[1], at[2], at[0] + 0.5, at[1], at[2] + 0.25);
    write_text(project, "points3D.txt", text);
    return test_path(project);
}

static void test_project_far_away(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *plain = test_load_scene(ctx, write_ring(ctx, "plain", zero), NULL);
    double origin[3], near[3], far[3];
    sf_scene_get_origin(plain, origin);
    assert_memory_equal(origin, zero, sizeof zero);
    test_log_clear();
    sf_scene *scene = test_load_scene(ctx, write_ring(ctx, "utm", utm), NULL);
    colmap_assert_log("relative to the origin 500000 5000000 ");
    sf_scene_get_origin(scene, origin);
    for (size_t i = 0; i < IMAGES; i++) {
        sf_view_info a = test_view_info(plain, i), b = test_view_info(scene, i);
        sf_camera_center(&a.camera, near);
        sf_camera_center(&b.camera, far);
        for (int k = 0; k < 3; k++) {
            assert_true(fabs(far[k]) < 16);
            assert_true(fabs(far[k] + origin[k] - utm[k] - near[k]) < 1e-8);
        }
    }
    float xyz[6];
    assert_int_equal(sf_scene_get_points(scene, 0, 2, xyz, NULL), 2);
    assert_true((double)xyz[3] + origin[0] == 500000.5);
    assert_true((double)xyz[5] + origin[2] == 100.25);
    sf_scene_destroy(&scene);
    sf_scene_destroy(&plain);
    sf_context_destroy(&ctx);
}

static void test_cameras_json(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = test_load_scene(ctx, write_ring(ctx, "cameras", utm), NULL);
    double origin[3], center[3];
    sf_view_info view = test_view_info(scene, 0);
    sf_camera_center(&view.camera, center);
    sf_scene_get_origin(scene, origin);
    for (int world = 0; world < 2; world++) {
        const char *path = test_path("cameras.json");
        assert_ok(ctx, sf_scene_save_cameras(scene, path, world));
        json_t *list = json_load_file(path, 0, NULL), *first = json_array_get(list, 0);
        json_t *position = json_object_get(first, "position"), *said = json_object_get(first, "origin");
        assert_int_equal(json_array_size(position), 3);
        assert_int_equal(json_array_size(said), world ? 0 : 3);
        for (int in_world = 0; in_world < 2; in_world++) {
            sf_camera *read;
            size_t count;
            double stated[3] = {1, 1, 1}, at[3];
            assert_ok(ctx, sf_cameras_load(ctx, path, &read, &count, in_world ? NULL : stated));
            sf_camera_center(&read[0], at);
            for (int k = 0; k < 3; k++) {
                if (!in_world) assert_true(stated[k] == (world ? 0 : origin[k]));
                double there = at[k] + (in_world ? 0 : stated[k]);
                assert_true(fabs(there - center[k] - origin[k]) < 1e-8);
            }
            sf_cameras_free(ctx, &read);
        }
        for (size_t k = 0; k < 3; k++) {
            double expected = center[k] + (world ? origin[k] : 0);
            assert_true(fabs(json_real_value(json_array_get(position, k)) - expected) < 1e-8);
            assert_true(world || json_real_value(json_array_get(said, k)) == origin[k]);
        }
        json_decref(list);
    }
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Two Gaussians near a far origin. */
static sf_model *far_model(sf_context *ctx) {
    static const float means[6] = {1, 2, 3, -0.5f, 0.25f, 0.125f}, quats[8] = {1, 0, 0, 0, 1, 0, 0, 0};
    static const float scales[6] = {-3, -3, -3, -2, -2, -2}, logits[2] = {0, 1},
                       sh[6] = {0, 0.5f, 1, 1, 0, 0};
    sf_gaussians from = {(float *)means, (float *)quats, (float *)scales, (float *)logits, (float *)sh};
    sf_model *model;
    assert_ok(ctx, sf_model_create(ctx, 2, 0, &model));
    assert_ok(ctx, sf_model_set(model, 0, 2, &from));
    memcpy(model->origin, utm, sizeof utm);
    return model;
}

static void assert_means(const sf_model *model, const double expected[6], const double origin[3]) {
    double is[3];
    sf_model_get_origin(model, is);
    for (int k = 0; k < 3; k++) assert_true(is[k] == origin[k]);
    for (size_t i = 0; i < 2; i++)
        for (int k = 0; k < 3; k++)
            assert_true(fabs((double)*sf_value(&model->params, SF_FIELD_mean, i, k) -
                             expected[3 * i + (size_t)k]) < 1e-6);
}

static void test_model_files(void **state) {
    (void)state;
    static const double means[6] = {1, 2, 3, -0.5, 0.25, 0.125};
    static const double in_world[6] = {500001, 5000002, 103, 499999.5, 5000000, 100.125};
    static const char *const names[] = {"far.ply", "far.glb"};
    sf_context *ctx = test_context();
    sf_model *model = far_model(ctx), *again;
    for (int i = 0; i < 2; i++) {
        test_log_clear();
        assert_ok(ctx, sf_model_save(model, test_path(names[i])));
        assert_null(strstr(test_log, "origin"));
        assert_ok(ctx, sf_model_load(ctx, test_path(names[i]), &again));
        assert_means(again, means, utm);
        sf_model_destroy(&again);
        sf_model_file_options options = sf_model_file_options_default();
        options.world = 1;
        assert_ok(ctx, sf_model_save_as(model, test_path(names[i]), &options));
        colmap_assert_log("floats near the origin 500000 5000000 100 are 0.5 apart");
        assert_ok(ctx, sf_model_load(ctx, test_path(names[i]), &again));
        assert_means(again, in_world, zero);
        sf_model_destroy(&again);
    }
    sf_model_file_options beyond = sf_model_file_options_default();
    beyond.world = 1;
    model->origin[0] = 1e300;
    assert_status(ctx, sf_model_save_as(model, test_path("beyond.ply"), &beyond), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "Gaussian #0: x is inf");
    model->origin[0] = utm[0];
    test_log_clear();
    assert_ok(ctx, sf_model_save(model, test_path("far.spz")));
    colmap_assert_log("cannot state the origin 500000 5000000 100");
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* The Gaussians move in the world as the motion says; the means take the shift, as without an origin. */
static void test_motion(void **state) {
    (void)state;
    static const sf_similarity motion = {.R = {0, -1, 0, 1, 0, 0, 0, 0, 1}, .scale = 2, .move = {10, 0, 0}};
    static const double means[6] = {6, 2, 6, 9.5, -1, 0.25}, origin[3] = {-10000000, 1000000, 200};
    sf_context *ctx = test_context();
    sf_model *model = far_model(ctx);
    assert_ok(ctx, sf_model_transform(model, &motion));
    assert_means(model, means, origin);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* A model of the project's coordinates, of the scene's own, and one that states another origin. */
static void test_placed_in_a_scene(void **state) {
    (void)state;
    static const double means[6] = {1, 2, 3, -0.5, 0.25, 0.125};
    double origin[3], moved[6];
    sf_context *ctx = test_context();
    sf_scene *scene = test_load_scene(ctx, write_ring(ctx, "place", utm), NULL);
    sf_scene_get_origin(scene, origin);
    sf_model *model = far_model(ctx);
    for (int k = 0; k < 6; k++) moved[k] = means[k] + utm[k % 3] - origin[k % 3];
    sf_scene_place_model(scene, model);
    assert_means(model, moved, origin);
    memcpy(model->origin, zero, sizeof zero); /* states none, lies near 0 */
    sf_scene_place_model(scene, model);
    assert_means(model, moved, origin);
    static const double nowhere[3] = {0, INFINITY, 0};
    assert_status(ctx, sf_scene_set_origin(scene, nowhere), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "origin: y: inf");
    sf_model_set_origin(model, zero);
    assert_true(*sf_value(&model->params, SF_FIELD_mean, 0, 1) == 5000002);
    sf_scene_place_model(scene, model); /* states none, lies in the world */
    assert_true(fabs((double)*sf_value(&model->params, SF_FIELD_mean, 0, 1) - moved[1]) <= 0.5);
    sf_model_destroy(&model);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_project_far_away),  cmocka_unit_test(test_cameras_json),
        cmocka_unit_test(test_model_files),       cmocka_unit_test(test_motion),
        cmocka_unit_test(test_placed_in_a_scene),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
