/* test_scene.c - cameras, views, points, and what a scene says about itself. */
#include "testing.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "scene/scene.h"

/* Looks along +z of the world from `x, y, z`. */
static sf_camera camera_at(double x, double y, double z) {
    return (sf_camera){.width = 8,
                       .height = 6,
                       .fx = 10,
                       .fy = 11,
                       .cx = 4,
                       .cy = 3,
                       .R_cw = {1, 0, 0, 0, 1, 0, 0, 0, 1},
                       .t_cw = {-x, -y, -z}};
}

/* Turned by an angle about each axis. */
static sf_camera turned_camera(void) {
    sf_camera c = camera_at(0, 0, 0);
    double a = 0.3, b = -0.7, x[9] = {1, 0, 0, 0, cos(a), -sin(a), 0, sin(a), cos(a)},
           y[9] = {cos(b), 0, sin(b), 0, 1, 0, -sin(b), 0, cos(b)};
    for (int i = 0; i < 9; i++) {
        c.R_cw[i] = 0;
        for (int k = 0; k < 3; k++) c.R_cw[i] += x[i / 3 * 3 + k] * y[3 * k + i % 3];
    }
    c.t_cw[0] = 1, c.t_cw[1] = -2, c.t_cw[2] = 5;
    return c;
}

static uint8_t shade(size_t seed, size_t i) { return (uint8_t)(53 * seed + 7 * i + i * i / 5); }

/* A view of camera_at(x, 0, 0), 8x6, with a picture of its own. */
static uint32_t add_view(sf_context *ctx, sf_scene *scene, const char *name, double x, sf_split split) {
    sf_camera camera = camera_at(x, 0, 0);
    uint8_t rgb[6 * 24];
    for (size_t i = 0; i < sizeof rgb; i++) rgb[i] = shade((size_t)(x + 50), i);
    sf_pixels pixels = {.rgb = rgb, .stride = 24};
    uint32_t id = 0;
    assert_ok(ctx, sf_scene_add_view(scene, name, &camera, &pixels, split, &id));
    return id;
}

static sf_scene *new_scene(sf_context *ctx) {
    sf_scene *scene;
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    return scene;
}

static void assert_near(double got, double expected, double tolerance) {
    if (!(fabs(got - expected) <= tolerance)) fail_msg("%.17g is not %.17g", got, expected);
}

/* Cameras. */

static void test_camera_check(void **state) {
    (void)state;
    sf_camera good = turned_camera();
    assert_int_equal(sf_camera_check(&good), SF_OK);
    for (int i = 0; i < 9; i++) good.R_cw[i] *= 1.0003; /* written with few digits */
    assert_int_equal(sf_camera_check(&good), SF_OK);
    good.width = 65535, good.height = 1, good.cx = -1e6, good.fx = 1e-6;
    assert_int_equal(sf_camera_check(&good), SF_OK);
}

static void test_camera_check_refuses(void **state) {
    (void)state;
    sf_camera c;
#define REFUSED(change)                                                                                      \
    c = turned_camera();                                                                                     \
    change;                                                                                                  \
    if (sf_camera_check(&c) != SF_ERR_ARGUMENT) fail_msg("accepted: %s", #change);
    REFUSED(c.width = 0)
    REFUSED(c.width = -8)
    REFUSED(c.width = 65536)
    REFUSED(c.height = 0)
    REFUSED(c.height = 65536)
    REFUSED(c.fx = 0)
    REFUSED(c.fx = -10)
    REFUSED(c.fx = NAN)
    REFUSED(c.fy = INFINITY)
    REFUSED(c.fy = 0)
    REFUSED(c.cx = NAN)
    REFUSED(c.cy = -INFINITY)
    REFUSED(c.R_cw[4] = NAN)
    REFUSED(c.R_cw[0] += 0.01)
    REFUSED(for (int i = 0; i < 9; i++) c.R_cw[i] *= 1.01)
    REFUSED(for (int i = 0; i < 9; i++) c.R_cw[i] = 0)
    REFUSED(for (int i = 0; i < 3; i++) c.R_cw[i] = -c.R_cw[i]) /* a mirror */
    REFUSED(for (int i = 0; i < 9; i++) c.R_cw[i] = -c.R_cw[i])
    REFUSED(memcpy(c.R_cw + 3, c.R_cw, 3 * sizeof(double))) /* flat */
    REFUSED(c.t_cw[1] = NAN)
    REFUSED(c.t_cw[2] = INFINITY)
#undef REFUSED
}

static void test_camera_center(void **state) {
    (void)state;
    sf_camera c = turned_camera();
    double center[3];
    sf_camera_center(&c, center);
    for (int i = 0; i < 3; i++) {
        double seen = c.t_cw[i];
        for (int k = 0; k < 3; k++) seen += c.R_cw[3 * i + k] * center[k];
        assert_near(seen, 0, 1e-14);
    }
    c = camera_at(1, -2, 3);
    sf_camera_center(&c, center);
    assert_true(center[0] == 1 && center[1] == -2 && center[2] == 3);
}

/* A point lands at the same place of the smaller picture; a rest is cut. */
static void test_camera_downscaled(void **state) {
    (void)state;
    sf_camera c = turned_camera();
    c.width = 13, c.height = 7, c.cx = 6.25;
    sf_camera same = sf_camera_downscaled(&c, 1), small = sf_camera_downscaled(&c, 2);
    assert_memory_equal(&same, &c, sizeof c);
    assert_int_equal(small.width, 6);
    assert_int_equal(small.height, 3);
    double point[2] = {0.37, -0.2};
    assert_near(small.fx * point[0] + small.cx, (c.fx * point[0] + c.cx) / 2, 1e-14);
    assert_near(small.fy * point[1] + small.cy, (c.fy * point[1] + c.cy) / 2, 1e-14);
    assert_memory_equal(small.R_cw, c.R_cw, sizeof c.R_cw);
    assert_memory_equal(small.t_cw, c.t_cw, sizeof c.t_cw);
}

/* Views. */

static void test_pixels_round_trip(void **state) {
    (void)state;
    enum { WIDTH = 8, HEIGHT = 6, STRIDE = 3 * WIDTH + 5 };
    sf_context *ctx = test_context();
    sf_scene *scene = new_scene(ctx);
    sf_camera camera = camera_at(0, 0, 0);
    uint8_t *rgb = malloc(STRIDE * (HEIGHT - 1) + 3 * WIDTH); /* nothing after the last row */
    uint8_t *mask = malloc(WIDTH * HEIGHT);
    float got[3 * WIDTH * HEIGHT], weight[WIDTH * HEIGHT];
    assert_true(rgb && mask);
    for (size_t i = 0; i < STRIDE * (HEIGHT - 1) + 3 * WIDTH; i++) rgb[i] = shade(1, i);
    for (size_t i = 0; i < WIDTH * HEIGHT; i++) mask[i] = i % 3 == 0 ? 0 : i % 3 == 1 ? 255 : shade(2, i);
    sf_pixels pixels = {.rgb = rgb, .stride = STRIDE, .mask = mask};
    uint32_t id;
    assert_ok(ctx, sf_scene_add_view(scene, "a", &camera, &pixels, SF_SPLIT_TRAIN, &id));
    memset(rgb, 0, 64); /* the scene has its own copy */
    memset(mask, 0, WIDTH * HEIGHT);
    assert_ok(ctx, sf_scene_get_pixels(scene, id, got, weight));
    for (size_t i = 0; i < WIDTH * HEIGHT; i++) {
        for (size_t c = 0; c < 3; c++)
            assert_true(got[3 * i + c] == (float)shade(1, i / WIDTH * STRIDE + 3 * (i % WIDTH) + c) / 255);
        assert_true(weight[i] == (float)(i % 3 == 0 ? 0 : i % 3 == 1 ? 255 : shade(2, i)) / 255);
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
    sf_scene *scene = new_scene(ctx);
    uint32_t ids[2] = {add_view(ctx, scene, "one", 0, SF_SPLIT_TRAIN),
                       add_view(ctx, scene, "two", 1, SF_SPLIT_TEST)};
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
    sf_scene *scene = new_scene(ctx);
    uint32_t ids[5];
    char name[] = "first", made_up[32];
    ids[0] = add_view(ctx, scene, name, 0, SF_SPLIT_TRAIN);
    memset(name, '?', 5); /* the name was copied */
    ids[1] = add_view(ctx, scene, NULL, 1, SF_SPLIT_TEST);
    ids[2] = add_view(ctx, scene, "third", 2, SF_SPLIT_TRAIN);
    snprintf(made_up, sizeof made_up, "view-%u", (unsigned)ids[1]);
    assert_view(ctx, scene, 0, ids[0], "first");
    assert_view(ctx, scene, 1, ids[1], made_up);
    assert_view(ctx, scene, 2, ids[2], "third");

    assert_ok(ctx, sf_scene_remove_view(scene, ids[1]));
    assert_view(ctx, scene, 1, ids[2], "third");
    assert_ok(ctx, sf_scene_remove_view(scene, ids[2])); /* the last one given: not given again */
    ids[3] = add_view(ctx, scene, "fourth", 3, SF_SPLIT_TRAIN);
    ids[4] = add_view(ctx, scene, "first", 4, SF_SPLIT_TRAIN); /* names may repeat */
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
    sf_scene *scene = new_scene(ctx);
    sf_view_info view;
    float rgb[3 * 48];
    assert_status(ctx, sf_scene_get_view(scene, 0, &view), SF_ERR_ARGUMENT);
    uint32_t id = add_view(ctx, scene, "a", 0, SF_SPLIT_TRAIN);
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
    sf_scene *scene = new_scene(ctx);
    uint8_t rgb[6 * 24] = {0};
    sf_camera camera = camera_at(0, 0, 0), bad = camera;
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
    sf_scene *scene = new_scene(ctx);
    sf_camera camera = camera_at(1, 2, 3);
    float rgb[3 * WIDTH * HEIGHT], got[3 * WIDTH * HEIGHT];
    for (size_t i = 0; i < 3 * WIDTH * HEIGHT; i++) rgb[i] = (float)shade(3, i) / 255;
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
    assert_near(view.camera.fx, 5, 1e-12);
    assert_near(view.camera.cy, 4.5, 1e-12);
    assert_ok(ctx, sf_scene_get_pixels(scene, id, got, NULL));
    for (size_t i = 0; i < 3 * WIDTH * HEIGHT; i++) assert_near((double)got[i], (double)rgb[i], 1e-6);
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
    sf_scene *scene = new_scene(ctx);
    uint32_t id = add_view(ctx, scene, "kept", 0, SF_SPLIT_TRAIN);
    sf_view *view = sf_scene_retain_id(scene, id);
    assert_non_null(view);
    assert_ok(ctx, sf_scene_remove_view(scene, id));
    assert_null(sf_scene_retain_id(scene, id));
    sf_scene_destroy(&scene);
    assert_string_equal(view->name, "kept");
    for (size_t i = 0; i < 48; i++) assert_int_equal(view->rgb[i], shade(50, 3 * i));
    sf_view_release(view);
    sf_context_destroy(&ctx);
}

/* Extent and centre. */

static void test_info_counts(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = new_scene(ctx);
    sf_scene_info info = test_scene_info(scene);
    assert_int_equal(info.views + info.train_views + info.test_views + info.points, 0);
    assert_near(info.extent, 1, 0);
    for (int i = 0; i < 5; i++) add_view(ctx, scene, NULL, i, i % 2 ? SF_SPLIT_TEST : SF_SPLIT_TRAIN);
    info = test_scene_info(scene);
    assert_int_equal(info.views, 5);
    assert_int_equal(info.train_views, 3);
    assert_int_equal(info.test_views, 2);
    uint32_t *ids;
    size_t count;
    assert_ok(ctx, sf_scene_training_ids(scene, &ids, &count));
    assert_int_equal(count, 3);
    for (size_t i = 0; i < count; i++) {
        sf_view_info view;
        assert_ok(ctx, sf_scene_get_view(scene, 2 * i, &view));
        assert_int_equal(view.id, ids[i]);
        assert_int_equal(view.split, SF_SPLIT_TRAIN);
    }
    sf_view **held;
    size_t training;
    assert_ok(ctx, sf_scene_retain_training(scene, &held, &training));
    assert_int_equal(training, count);
    assert_ok(ctx, sf_scene_remove_view(scene, ids[1])); /* what is held stays whole */
    for (size_t i = 0; i < training; i++) {
        assert_int_equal(held[i]->id, ids[i]);
        assert_int_equal(held[i]->split, SF_SPLIT_TRAIN);
    }
    sf_scene_release_all(scene, held, training);
    sf_free(ctx, ids);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_extent(void **state) {
    (void)state;
    static const float points[5][3] = {{4, 0, 0}, {0, 3, 0}, {0, 0, -2}, {1, 0, 0}, {0, 90, 0}};
    sf_context *ctx = test_context();
    sf_scene *scene = new_scene(ctx);
    uint32_t left = add_view(ctx, scene, NULL, -1, SF_SPLIT_TRAIN);
    uint32_t right = add_view(ctx, scene, NULL, 5, SF_SPLIT_TRAIN);
    add_view(ctx, scene, NULL, 40, SF_SPLIT_TEST); /* not counted */
    sf_scene_info info = test_scene_info(scene);
    assert_near(info.center[0], 2, 1e-12);
    assert_near(info.center[1], 0, 1e-12);
    assert_near(info.extent, 3.3, 1e-12);

    assert_ok(ctx, sf_scene_remove_view(scene, right)); /* one camera: no points, then the median of five */
    assert_near(test_scene_info(scene).extent, 1, 0);
    assert_ok(ctx, sf_scene_remove_view(scene, left));
    add_view(ctx, scene, NULL, 0, SF_SPLIT_TRAIN);
    assert_ok(ctx, sf_scene_add_points(scene, 5, &points[0][0], NULL));
    assert_near(test_scene_info(scene).extent, 3, 1e-6);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Cameras in one place, whose mean is off by rounding: that is no extent. */
static void test_extent_of_one_place(void **state) {
    (void)state;
    static const float point[3] = {0.1f, 0, 7};
    sf_context *ctx = test_context();
    sf_scene *scene = new_scene(ctx);
    for (int i = 0; i < 7; i++) add_view(ctx, scene, NULL, 0.1, SF_SPLIT_TRAIN);
    assert_near(test_scene_info(scene).extent, 1, 0);
    assert_ok(ctx, sf_scene_add_points(scene, 1, point, NULL));
    assert_near(test_scene_info(scene).extent, 7, 1e-6);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Points. */

static void test_points(void **state) {
    (void)state;
    static const float xyz[6][3] = {{1, 2, 3},        {NAN, 0, 0}, {4, 5, 6},
                                    {0, INFINITY, 0}, {7, 8, 9},   {0, 0, -INFINITY}};
    static const uint8_t rgb[6][3] = {{1, 2, 3}, {9, 9, 9}, {4, 5, 6}, {9, 9, 9}, {255, 0, 128}, {9, 9, 9}};
    sf_context *ctx = test_context();
    sf_scene *scene = new_scene(ctx);
    assert_ok(ctx, sf_scene_add_points(scene, 6, &xyz[0][0], &rgb[0][0]));
    assert_ok(ctx, sf_scene_add_points(scene, 0, NULL, NULL));
    assert_ok(ctx, sf_scene_add_points(scene, 1, xyz[0], NULL));
    assert_int_equal(test_scene_info(scene).points, 4);
    assert_int_equal(test_scene_info(scene).skipped_points, 3);
    float got[5][3] = {{0}};
    uint8_t colors[5][3] = {{0}};
    assert_int_equal(sf_scene_get_points(scene, 0, 5, &got[0][0], &colors[0][0]), 4);
    for (int i = 0; i < 3; i++) {
        assert_memory_equal(got[i], xyz[2 * i], sizeof got[i]);
        assert_memory_equal(colors[i], rgb[2 * i], 3);
    }
    assert_memory_equal(got[3], xyz[0], sizeof got[3]);
    assert_memory_equal(colors[3], ((uint8_t[]){128, 128, 128}), 3); /* no colour: grey */

    assert_int_equal(sf_scene_get_points(scene, 2, 1, got[0], NULL), 1);
    assert_true(got[0][0] == 7);
    assert_int_equal(sf_scene_get_points(scene, 3, 5, NULL, colors[0]), 1);
    assert_int_equal(colors[0][0], 128);
    assert_int_equal(sf_scene_get_points(scene, 4, 5, got[0], NULL), 0);
    assert_int_equal(sf_scene_get_points(scene, SIZE_MAX, SIZE_MAX, got[0], NULL), 0);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* A count that no memory holds is refused before anything is read. */
static void test_too_many_points(void **state) {
    (void)state;
    static const float xyz[3] = {0};
    sf_context *ctx = test_context();
    sf_scene *scene = new_scene(ctx);
    assert_ok(ctx, sf_scene_add_points(scene, 1, xyz, NULL));
    assert_status(ctx, sf_scene_add_points(scene, SIZE_MAX, xyz, NULL), SF_ERR_ARGUMENT);
    assert_status(ctx, sf_scene_add_points(scene, SIZE_MAX / 12 + 1, xyz, NULL), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "count");
    assert_int_equal(test_scene_info(scene).points, 1);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Memory that runs out. */

typedef struct ration {
    int left; /* allocations that still succeed */
    int held;
} ration;

static void *ration_alloc(void *user, size_t size) {
    ration *r = user;
    void *block = r->left-- > 0 ? malloc(size) : NULL;
    r->held += block != NULL;
    return block;
}

static void ration_free(void *user, void *block) {
    ration *r = user;
    r->held--;
    free(block);
}

/* A view and a point are added, or nothing is; then they are, once there is memory again. */
static void test_out_of_memory(void **state) {
    (void)state;
    test_skip_emulated();
    static const float point[3] = {1, 2, 3};
    ration r = {.left = 1000};
    sf_allocator allocator = {ration_alloc, ration_free, &r};
    sf_context_options options = {.allocator = &allocator, .threads = 1};
    sf_context *ctx;
    assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
    int idle = r.held, refused = 0;
    sf_camera camera = camera_at(0, 0, 0);
    uint8_t rgb[6 * 24] = {0}, mask[48] = {0};
    sf_pixels pixels = {.rgb = rgb, .stride = 24, .mask = mask};
    for (int allowed = 0, done = 0; !done; allowed++) {
        r.left = allowed;
        sf_scene *scene;
        sf_status status = sf_scene_create(ctx, &scene);
        if (!status) {
            status = sf_scene_add_view(scene, NULL, &camera, &pixels, SF_SPLIT_TRAIN, NULL);
            assert_int_equal(test_scene_info(scene).views, !status);
            if (!status) status = sf_scene_add_points(scene, 1, point, NULL);
            assert_int_equal(test_scene_info(scene).points, !status);
        }
        if (status) assert_status(ctx, status, SF_ERR_MEMORY);
        done = !status;
        refused += !done;
        sf_scene_destroy(&scene);
        assert_int_equal(r.held, idle);
    }
    assert_true(refused >= 7); /* scene; view, name, pixels, mask; list; points and their colours */
    r.left = 0;
    sf_context_destroy(&ctx);
    assert_int_equal(r.held, 0);
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
        sf_camera camera = camera_at(0.1 * (atomic_load(&t->turns) % 7), 0, 0);
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
    sf_scene *scene = new_scene(ctx);
    add_view(ctx, scene, "stays", 0, SF_SPLIT_TRAIN);
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
        cmocka_unit_test(test_camera_check),
        cmocka_unit_test(test_camera_check_refuses),
        cmocka_unit_test(test_camera_center),
        cmocka_unit_test(test_camera_downscaled),
        cmocka_unit_test(test_pixels_round_trip),
        cmocka_unit_test(test_views_come_and_go),
        cmocka_unit_test(test_views_are_moved),
        cmocka_unit_test(test_unknown_views),
        cmocka_unit_test(test_views_refused),
        cmocka_unit_test(test_add_file),
        cmocka_unit_test(test_held_view_stays),
        cmocka_unit_test(test_info_counts),
        cmocka_unit_test(test_extent),
        cmocka_unit_test(test_extent_of_one_place),
        cmocka_unit_test(test_points),
        cmocka_unit_test(test_too_many_points),
        cmocka_unit_test(test_out_of_memory),
        cmocka_unit_test(test_views_change_under_a_fitter),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
