/* test_scene.c - cameras, points, and what a scene says about itself. */
#include "scene_fixture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "scene/scene.h"

/* Turned by an angle about each axis. */
static sf_camera turned_camera(void) {
    sf_camera c = scene_camera_at(0, 0, 0);
    double a = 0.3, b = -0.7, x[9] = {1, 0, 0, 0, cos(a), -sin(a), 0, sin(a), cos(a)},
           y[9] = {cos(b), 0, sin(b), 0, 1, 0, -sin(b), 0, cos(b)};
    for (int i = 0; i < 9; i++) {
        c.R_cw[i] = 0;
        for (int k = 0; k < 3; k++) c.R_cw[i] += x[i / 3 * 3 + k] * y[3 * k + i % 3];
    }
    c.t_cw[0] = 1, c.t_cw[1] = -2, c.t_cw[2] = 5;
    return c;
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
        scene_assert_near(seen, 0, 1e-14);
    }
    c = scene_camera_at(1, -2, 3);
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
    scene_assert_near(small.fx * point[0] + small.cx, (c.fx * point[0] + c.cx) / 2, 1e-14);
    scene_assert_near(small.fy * point[1] + small.cy, (c.fy * point[1] + c.cy) / 2, 1e-14);
    assert_memory_equal(small.R_cw, c.R_cw, sizeof c.R_cw);
    assert_memory_equal(small.t_cw, c.t_cw, sizeof c.t_cw);
}

/* Extent and centre. */

static void test_info_counts(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = scene_new(ctx);
    sf_scene_info info = test_scene_info(scene);
    assert_int_equal(info.views + info.train_views + info.test_views + info.points, 0);
    scene_assert_near(info.extent, 1, 0);
    for (int i = 0; i < 5; i++) scene_add_view(ctx, scene, NULL, i, i % 2 ? SF_SPLIT_TEST : SF_SPLIT_TRAIN);
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
    sf_scene *scene = scene_new(ctx);
    uint32_t left = scene_add_view(ctx, scene, NULL, -1, SF_SPLIT_TRAIN);
    uint32_t right = scene_add_view(ctx, scene, NULL, 5, SF_SPLIT_TRAIN);
    scene_add_view(ctx, scene, NULL, 40, SF_SPLIT_TEST); /* not counted */
    sf_scene_info info = test_scene_info(scene);
    scene_assert_near(info.center[0], 2, 1e-12);
    scene_assert_near(info.center[1], 0, 1e-12);
    scene_assert_near(info.extent, 3.3, 1e-12);

    assert_ok(ctx, sf_scene_remove_view(scene, right)); /* one camera: no points, then the median of five */
    scene_assert_near(test_scene_info(scene).extent, 1, 0);
    assert_ok(ctx, sf_scene_remove_view(scene, left));
    scene_add_view(ctx, scene, NULL, 0, SF_SPLIT_TRAIN);
    assert_ok(ctx, sf_scene_add_points(scene, 5, &points[0][0], NULL));
    scene_assert_near(test_scene_info(scene).extent, 3, 1e-6);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Cameras in one place, whose mean is off by rounding: that is no extent. */
static void test_extent_of_one_place(void **state) {
    (void)state;
    static const float point[3] = {0.1f, 0, 7};
    sf_context *ctx = test_context();
    sf_scene *scene = scene_new(ctx);
    for (int i = 0; i < 7; i++) scene_add_view(ctx, scene, NULL, 0.1, SF_SPLIT_TRAIN);
    scene_assert_near(test_scene_info(scene).extent, 1, 0);
    assert_ok(ctx, sf_scene_add_points(scene, 1, point, NULL));
    scene_assert_near(test_scene_info(scene).extent, 7, 1e-6);
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
    sf_scene *scene = scene_new(ctx);
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
    sf_scene *scene = scene_new(ctx);
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
    sf_camera camera = scene_camera_at(0, 0, 0);
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

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_camera_check),        cmocka_unit_test(test_camera_check_refuses),
        cmocka_unit_test(test_camera_center),       cmocka_unit_test(test_camera_downscaled),
        cmocka_unit_test(test_info_counts),         cmocka_unit_test(test_extent),
        cmocka_unit_test(test_extent_of_one_place), cmocka_unit_test(test_points),
        cmocka_unit_test(test_too_many_points),     cmocka_unit_test(test_out_of_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
