/* test_scene_views.c - the views of a scene: added, moved, removed, held. */
#include "scene_fixture.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "scene/scene.h"

/* Views. */

static void test_pixels_round_trip(void **state) {
    (void)state;
    enum { WIDTH = 8, HEIGHT = 6, STRIDE = 3 * WIDTH + 5 };
    sf_context *ctx = test_context();
    sf_scene *scene = scene_new(ctx);
    sf_camera camera = scene_camera_at(0, 0, 0);
    uint8_t *rgb = malloc(STRIDE * (HEIGHT - 1) + 3 * WIDTH); /* nothing after the last row */
    uint8_t *mask = malloc(WIDTH * HEIGHT);
    float got[3 * WIDTH * HEIGHT], weight[WIDTH * HEIGHT];
    assert_true(rgb && mask);
    for (size_t i = 0; i < STRIDE * (HEIGHT - 1) + 3 * WIDTH; i++) rgb[i] = scene_shade(1, i);
    for (size_t i = 0; i < WIDTH * HEIGHT; i++)
        mask[i] = i % 3 == 0 ? 0 : i % 3 == 1 ? 255 : scene_shade(2, i);
    sf_pixels pixels = {.rgb = rgb, .stride = STRIDE, .mask = mask};
    uint32_t id;
    assert_ok(ctx, sf_scene_add_view(scene, "a", &camera, &pixels, SF_SPLIT_TRAIN, &id));
    memset(rgb, 0, 64); /* the scene has its own copy */
    memset(mask, 0, WIDTH * HEIGHT);
    assert_ok(ctx, sf_scene_get_pixels(scene, id, got, weight));
    for (size_t i = 0; i < WIDTH * HEIGHT; i++) {
        for (size_t c = 0; c < 3; c++)
            assert_true(got[3 * i + c] ==
                        (float)scene_shade(1, i / WIDTH * STRIDE + 3 * (i % WIDTH) + c) / 255);
        assert_true(weight[i] == (float)(i % 3 == 0 ? 0 : i % 3 == 1 ? 255 : scene_shade(2, i)) / 255);
    }
    pixels.mask = NULL;
    assert_ok(ctx, sf_scene_add_view(scene, "b", &camera, &pixels, SF_SPLIT_TRAIN, &id));
    assert_ok(ctx, sf_scene_get_pixels(scene, id, NULL, weight));
    for (size_t i = 0; i < WIDTH * HEIGHT; i++) assert_true(weight[i] == 1);
    assert_ok(ctx, sf_scene_get_pixels(scene, id, NULL, NULL));
    free(rgb);
    free(mask);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void assert_view(sf_context *ctx, sf_scene *scene, size_t index, uint32_t id, const char *name) {
    sf_view_info view;
    assert_ok(ctx, sf_scene_get_view(scene, index, &view));
    assert_int_equal(view.id, id);
    assert_string_equal(view.name, name);
}

/* A view in another place is the same view. */
static void test_views_are_moved(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = scene_new(ctx);
    uint32_t ids[2] = {scene_add_view(ctx, scene, "one", 0, SF_SPLIT_TRAIN),
                       scene_add_view(ctx, scene, "two", 1, SF_SPLIT_TEST)};
    sf_view_info before, after;
    const double none[9] = {0};
    assert_ok(ctx, sf_scene_get_view(scene, 1, &before));
    size_t pixels = (size_t)before.camera.width * (size_t)before.camera.height;
    float *rgb = calloc(2 * 4 * pixels, sizeof *rgb), *again = rgb + 4 * pixels;
    assert_non_null(rgb);
    assert_ok(ctx, sf_scene_get_pixels(scene, ids[1], rgb, rgb + 3 * pixels));
    sf_view *held = sf_scene_retain_id(scene, ids[1]);
    const double turned[9] = {0, -1, 0, 1, 0, 0, 0, 0, 1}, t[3] = {1, 2, 3};
    assert_ok(ctx, sf_scene_set_pose(scene, ids[1], turned, t));
    assert_memory_equal(&held->camera, &before.camera, sizeof held->camera); /* who holds it keeps it */
    sf_view_release(held);
    assert_ok(ctx, sf_scene_get_view(scene, 1, &after));
    assert_memory_equal(after.camera.R_cw, turned, sizeof turned);
    assert_memory_equal(after.camera.t_cw, t, sizeof t);
    assert_true(after.id == ids[1] && after.split == SF_SPLIT_TEST && after.camera.fx == before.camera.fx);
    assert_string_equal(after.name, "two");
    assert_ok(ctx, sf_scene_get_pixels(scene, ids[1], again, again + 3 * pixels));
    assert_memory_equal(rgb, again, 4 * pixels * sizeof *rgb);
    assert_int_equal(sf_scene_set_pose(scene, ids[0], none, t), SF_ERR_ARGUMENT);
    assert_int_equal(sf_scene_set_pose(scene, 99, turned, t), SF_ERR_ARGUMENT);
    assert_int_equal(test_scene_info(scene).views, 2);
    free(rgb);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_views_come_and_go(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = scene_new(ctx);
    uint32_t ids[5];
    char name[] = "first", made_up[32];
    ids[0] = scene_add_view(ctx, scene, name, 0, SF_SPLIT_TRAIN);
    memset(name, '?', 5); /* the name was copied */
    ids[1] = scene_add_view(ctx, scene, NULL, 1, SF_SPLIT_TEST);
    ids[2] = scene_add_view(ctx, scene, "third", 2, SF_SPLIT_TRAIN);
    snprintf(made_up, sizeof made_up, "view-%u", (unsigned)ids[1]);
    assert_view(ctx, scene, 0, ids[0], "first");
    assert_view(ctx, scene, 1, ids[1], made_up);
    assert_view(ctx, scene, 2, ids[2], "third");

    assert_ok(ctx, sf_scene_remove_view(scene, ids[1]));
    assert_view(ctx, scene, 1, ids[2], "third");
    assert_ok(ctx, sf_scene_remove_view(scene, ids[2])); /* the last one given: not given again */
    ids[3] = scene_add_view(ctx, scene, "fourth", 3, SF_SPLIT_TRAIN);
    ids[4] = scene_add_view(ctx, scene, "first", 4, SF_SPLIT_TRAIN); /* names may repeat */
    for (int i = 0; i < 5; i++)
        for (int k = 0; k < i; k++) assert_int_not_equal(ids[i], ids[k]);
    assert_view(ctx, scene, 0, ids[0], "first");
    assert_view(ctx, scene, 1, ids[3], "fourth");
    assert_view(ctx, scene, 2, ids[4], "first");
    assert_int_equal(test_scene_info(scene).views, 3);
    sf_scene_destroy(&scene);
    assert_null(scene);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_unknown_views(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = scene_new(ctx);
    sf_view_info view;
    float rgb[3 * 48];
    assert_status(ctx, sf_scene_get_view(scene, 0, &view), SF_ERR_ARGUMENT);
    uint32_t id = scene_add_view(ctx, scene, "a", 0, SF_SPLIT_TRAIN);
    assert_status(ctx, sf_scene_get_view(scene, 1, &view), SF_ERR_ARGUMENT);
    assert_status(ctx, sf_scene_get_view(scene, SIZE_MAX, &view), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "of 1");
    assert_status(ctx, sf_scene_remove_view(scene, id + 77), SF_ERR_ARGUMENT);
    char text[16];
    snprintf(text, sizeof text, "%u", (unsigned)id + 77);
    assert_error_names(ctx, text);
    assert_ok(ctx, sf_scene_remove_view(scene, id));
    assert_status(ctx, sf_scene_remove_view(scene, id), SF_ERR_ARGUMENT);
    assert_status(ctx, sf_scene_get_pixels(scene, id, rgb, NULL), SF_ERR_ARGUMENT);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_views_refused(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = scene_new(ctx);
    uint8_t rgb[6 * 24] = {0};
    sf_camera camera = scene_camera_at(0, 0, 0), bad = camera;
    sf_pixels pixels = {.rgb = rgb, .stride = 23}, none = {.stride = 24};
    uint32_t id = 99;
    bad.fx = NAN;
    assert_status(ctx, sf_scene_add_view(scene, "short", &camera, &pixels, SF_SPLIT_TRAIN, &id),
                  SF_ERR_ARGUMENT);
    assert_error_names(ctx, "short: pixels");
    assert_status(ctx, sf_scene_add_view(scene, "none", &camera, &none, SF_SPLIT_TRAIN, &id),
                  SF_ERR_ARGUMENT);
    assert_error_names(ctx, "none: pixels");
    assert_status(ctx, sf_scene_add_view(scene, "null", &camera, NULL, SF_SPLIT_TRAIN, &id), SF_ERR_ARGUMENT);
    pixels.stride = 24;
    assert_status(ctx, sf_scene_add_view(scene, "lens", &bad, &pixels, SF_SPLIT_TRAIN, &id), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "lens: camera");
    assert_int_equal(id, 99);
    assert_int_equal(test_scene_info(scene).views, 0);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* A file of another size than the camera's: the camera is scaled to it. */
static void test_add_file(void **state) {
    (void)state;
    enum { WIDTH = 4, HEIGHT = 9 };
    sf_context *ctx = test_context();
    sf_scene *scene = scene_new(ctx);
    sf_camera camera = scene_camera_at(1, 2, 3);
    float rgb[3 * WIDTH * HEIGHT], got[3 * WIDTH * HEIGHT];
    for (size_t i = 0; i < 3 * WIDTH * HEIGHT; i++) rgb[i] = (float)scene_shade(3, i) / 255;
    assert_ok(ctx, sf_write_png(ctx, test_path("file.png"), WIDTH, HEIGHT, rgb));
    uint32_t id;
    assert_ok(ctx, sf_scene_add_file(scene, test_path("file.png"), &camera, SF_SPLIT_TEST, &id));
    sf_view_info view;
    assert_ok(ctx, sf_scene_get_view(scene, 0, &view));
    assert_int_equal(view.id, id);
    assert_string_equal(view.name, "file.png");
    assert_int_equal(view.split, SF_SPLIT_TEST);
    assert_int_equal(view.camera.width, WIDTH);
    assert_int_equal(view.camera.height, HEIGHT);
    scene_assert_near(view.camera.fx, 5, 1e-12);
    scene_assert_near(view.camera.cy, 4.5, 1e-12);
    assert_ok(ctx, sf_scene_get_pixels(scene, id, got, NULL));
    for (size_t i = 0; i < 3 * WIDTH * HEIGHT; i++) scene_assert_near((double)got[i], (double)rgb[i], 1e-6);
    assert_status(ctx, sf_scene_add_file(scene, test_path("no.png"), &camera, SF_SPLIT_TEST, &id), SF_ERR_IO);
    assert_error_names(ctx, "no.png");
    camera.fy = 0;
    assert_status(ctx, sf_scene_add_file(scene, test_path("file.png"), &camera, SF_SPLIT_TEST, &id),
                  SF_ERR_ARGUMENT);
    assert_error_names(ctx, "file.png");
    assert_int_equal(test_scene_info(scene).views, 1);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* What someone still holds outlives the removal, and the scene. */
static void test_held_view_stays(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = scene_new(ctx);
    uint32_t id = scene_add_view(ctx, scene, "kept", 0, SF_SPLIT_TRAIN);
    sf_view *view = sf_scene_retain_id(scene, id);
    assert_non_null(view);
    assert_ok(ctx, sf_scene_remove_view(scene, id));
    assert_null(sf_scene_retain_id(scene, id));
    sf_scene_destroy(&scene);
    assert_string_equal(view->name, "kept");
    for (size_t i = 0; i < 48; i++) assert_int_equal(view->rgb[i], scene_shade(50, 3 * i));
    sf_view_release(view);
    sf_context_destroy(&ctx);
}

/* Threads. */

typedef struct traffic {
    sf_scene *scene;
    atomic_int stop, turns, failures;
} traffic;

/* Adds a view, looks around, removes it again. */
static void *come_and_go(void *user) {
    traffic *t = user;
    uint8_t rgb[6 * 24] = {200};
    sf_pixels pixels = {.rgb = rgb, .stride = 24};
    while (!atomic_load(&t->stop)) {
        sf_camera camera = scene_camera_at(0.1 * (atomic_load(&t->turns) % 7), 0, 0);
        uint32_t id;
        float got[3 * 48];
        sf_scene_info info;
        if (sf_scene_add_view(t->scene, NULL, &camera, &pixels, SF_SPLIT_TRAIN, &id) ||
            sf_scene_get_pixels(t->scene, id, got, NULL) || got[0] != 200.0f / 255)
            atomic_fetch_add(&t->failures, 1);
        sf_scene_get_info(t->scene, &info);
        if (info.views < 2) atomic_fetch_add(&t->failures, 1);
        if (sf_scene_remove_view(t->scene, id)) atomic_fetch_add(&t->failures, 1);
        atomic_fetch_add(&t->turns, 1);
    }
    return NULL;
}

/* Views come and go while a fitter steps; what is written here is read best under a thread sanitizer. */
static void test_views_change_under_a_fitter(void **state) {
    (void)state;
    static const float points[3][3] = {{0, 0, 5}, {1, 0, 6}, {0, 1, 4}};
    sf_context *ctx = test_context();
    sf_scene *scene = scene_new(ctx);
    scene_add_view(ctx, scene, "stays", 0, SF_SPLIT_TRAIN);
    assert_ok(ctx, sf_scene_add_points(scene, 3, &points[0][0], NULL));
    sf_fit_options options = sf_fit_options_default();
    options.steps = 100000000;
    sf_fitter *fitter;
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &fitter));
    traffic t = {.scene = scene};
    pthread_t threads[2];
    for (int i = 0; i < 2; i++) assert_int_equal(pthread_create(&threads[i], NULL, come_and_go, &t), 0);
    for (int step = 0; step < 50 || atomic_load(&t.turns) < 50; step++)
        assert_ok(ctx, sf_fitter_step(fitter));
    atomic_store(&t.stop, 1);
    for (int i = 0; i < 2; i++) assert_int_equal(pthread_join(threads[i], NULL), 0);
    assert_int_equal(atomic_load(&t.failures), 0);
    assert_int_equal(test_scene_info(scene).views, 1);
    assert_view(ctx, scene, 0, 1, "stays");
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_pixels_round_trip), cmocka_unit_test(test_views_come_and_go),
        cmocka_unit_test(test_views_are_moved),   cmocka_unit_test(test_unknown_views),
        cmocka_unit_test(test_views_refused),     cmocka_unit_test(test_add_file),
        cmocka_unit_test(test_held_view_stays),   cmocka_unit_test(test_views_change_under_a_fitter),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
