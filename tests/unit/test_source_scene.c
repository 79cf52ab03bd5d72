/* test_source_scene.c - scenes made from a simulation. */
#include "source_fixture.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "sim/sim.h"

/* Loads a simulated scene; the caller destroys it. */
static sf_scene *load(sf_context *ctx, const char *name, const sf_load_options *options) {
    sf_scene *scene;
    assert_ok(ctx, sf_scene_load(ctx, name, options, &scene));
    assert_non_null(scene);
    return scene;
}

static void test_scene(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = load(ctx, TINY "&frames=20", NULL);
    sf_scene_info info;
    sf_scene_get_info(scene, &info);
    assert_int_equal(info.views, 20);
    assert_int_equal(info.train_views, 17);
    assert_int_equal(info.test_views, 3);
    assert_int_equal(info.points, 8000);
    assert_int_equal(info.skipped_missing + info.skipped_pose + info.skipped_points, 0);
    assert_true(info.extent > 3 && info.extent < 8);
    sf_source *source = source_open_source(ctx, TINY "&frames=20");
    for (size_t i = 0; i < 20; i++) {
        char name[16];
        sf_view_info view;
        sf_frame frame;
        float rgb[3 * 32 * 24];
        snprintf(name, sizeof name, "frame_%04d", (int)i);
        assert_ok(ctx, sf_scene_get_view(scene, i, &view));
        assert_ok(ctx, sf_scene_get_pixels(scene, view.id, rgb, NULL));
        assert_ok(ctx, sf_source_next(source, -1, &frame));
        assert_string_equal(view.name, name);
        assert_int_equal(view.split, i % 8 == 0 ? SF_SPLIT_TEST : SF_SPLIT_TRAIN);
        assert_int_equal(view.camera.width, 32);
        assert_memory_equal(view.camera.t_cw, frame.camera.t_cw, sizeof view.camera.t_cw);
        assert_false(view.has_mask);
        for (size_t k = 0; k < 3 * 32 * 24; k++)
            assert_int_equal(lrintf(255 * rgb[k]), frame.plane[0][k / 96 * frame.stride[0] + k % 96]);
        sf_source_release(source, &frame);
    }
    sf_source_close(&source);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Pictures are averaged in boxes, and the camera goes along. */
static void test_downscale(void **state) {
    (void)state;
    const char *name = "sim:studio?width=50&height=35&frames=2";
    sf_context *ctx = test_context();
    sf_load_options options = sf_load_options_default();
    sf_scene *full = load(ctx, name, &options);
    options.downscale = 3;
    sf_scene *small = load(ctx, name, &options);
    sf_view_info big_view, view;
    static float big[3 * 50 * 35], rgb[3 * 16 * 11];
    assert_ok(ctx, sf_scene_get_view(full, 1, &big_view));
    assert_ok(ctx, sf_scene_get_view(small, 1, &view));
    sf_camera expected = sf_camera_downscaled(&big_view.camera, 3);
    assert_int_equal(view.camera.width, 16);
    assert_int_equal(view.camera.height, 11);
    assert_true(view.camera.fx == expected.fx && view.camera.cx == expected.cx &&
                view.camera.cy == expected.cy);
    assert_ok(ctx, sf_scene_get_pixels(full, big_view.id, big, NULL));
    assert_ok(ctx, sf_scene_get_pixels(small, view.id, rgb, NULL));
    for (int i = 0; i < 3 * 16 * 11; i++) {
        int channel = i % 3, x = i / 3 % 16, y = i / 48;
        double sum = 0;
        for (int k = 0; k < 9; k++) sum += (double)big[3 * ((3 * y + k / 3) * 50 + 3 * x + k % 3) + channel];
        assert_true(fabs(sum / 9 - (double)rgb[i]) < 0.51 / 255);
    }
    sf_scene_destroy(&full);
    sf_scene_destroy(&small);
    sf_context_destroy(&ctx);
}

static size_t held_out(sf_context *ctx, const char *name, const sf_load_options *options) {
    sf_scene *scene = load(ctx, name, options);
    sf_scene_info info;
    sf_scene_get_info(scene, &info);
    sf_scene_destroy(&scene);
    return info.test_views;
}

static void test_splits(void **state) {
    (void)state;
    const char *name = "sim:studio?width=16&height=16&frames=10", *list = test_path("list.txt");
    sf_context *ctx = test_context();
    sf_load_options options = sf_load_options_default();
    assert_int_equal(held_out(ctx, name, &options), 2);
    options.hold_out = 0;
    assert_int_equal(held_out(ctx, name, &options), 0);
    options.hold_out = 3;
    assert_int_equal(held_out(ctx, name, &options), 4);

    const char *text = "frame_0003\r\n\nframe_0009\nframe_0001";
    test_write(list, text, strlen(text));
    options.test_list = list;
    sf_scene *scene = load(ctx, name, &options);
    for (size_t i = 0; i < 10; i++) {
        sf_view_info view;
        assert_ok(ctx, sf_scene_get_view(scene, i, &view));
        assert_int_equal(view.split, i == 1 || i == 3 || i == 9 ? SF_SPLIT_TEST : SF_SPLIT_TRAIN);
    }
    sf_scene_destroy(&scene);

    test_write(list, "frame_0010\n", 11);
    assert_status(ctx, sf_scene_load(ctx, name, &options, &scene), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "frame_0010");
    assert_null(scene);
    options.test_list = test_path("absent.txt");
    assert_status(ctx, sf_scene_load(ctx, name, &options, &scene), SF_ERR_IO);
    assert_null(scene);
    sf_context_destroy(&ctx);
}

static void refuse(sf_context *ctx, const char *name, const sf_load_options *options, sf_status status,
                   const char *part) {
    sf_scene *scene;
    assert_status(ctx, sf_scene_load(ctx, name, options, &scene), status);
    assert_error_names(ctx, part);
    assert_null(scene);
}

static void test_bad_load_options(void **state) {
    (void)state;
    const char *name = "sim:studio?width=20&height=16&frames=6";
    sf_context *ctx = test_context();
    sf_load_options options = sf_load_options_default();
    options.max_views = 6;
    assert_int_equal(held_out(ctx, name, &options), 1);
    options.max_views = 5;
    refuse(ctx, name, &options, SF_ERR_ARGUMENT, "max_views");
    options.max_views = -1;
    refuse(ctx, name, &options, SF_ERR_ARGUMENT, "max_views: -1");
    options = sf_load_options_default();
    options.downscale = 16;
    assert_int_equal(held_out(ctx, name, &options), 1);
    options.downscale = 17;
    refuse(ctx, name, &options, SF_ERR_ARGUMENT, "downscale: 17");
    options.downscale = 0;
    refuse(ctx, name, &options, SF_ERR_ARGUMENT, "downscale: 0");
    options = sf_load_options_default();
    options.hold_out = -1;
    refuse(ctx, name, &options, SF_ERR_ARGUMENT, "hold_out: -1");
    options.hold_out = 1;
    refuse(ctx, name, &options, SF_ERR_EMPTY, "no training view");
    refuse(ctx, "sim:studio?frames=1", NULL, SF_ERR_EMPTY, "no training view");
    refuse(ctx, test_path("no-such-project"), NULL, SF_ERR_IO, "no-such-project");
    sf_context_destroy(&ctx);
}

/* Points lie on what the training view shows, to a few pixels, carry its colours, and say nothing that only a
 * held-out view shows. */
static void test_points(void **state) {
    (void)state;
    const char *name = "sim:studio?width=64&height=48&frames=2";
    enum { POINTS = 8000 };
    sf_context *ctx = test_context();
    sf_load_options options = sf_load_options_default();
    options.hold_out = 2; /* frame 0 is held out, frame 1, across the loop, is for training */
    sf_scene *scene = load(ctx, name, &options);
    sf_view_info view;
    static float xyz[3 * POINTS + 3], picture[3 * 64 * 48];
    static uint8_t rgb[3 * POINTS + 3];
    sf_sim sim;
    assert_ok(ctx, sf_sim_init(ctx, name, &sim));
    assert_ok(ctx, sf_scene_get_view(scene, 1, &view));
    assert_int_equal(view.split, SF_SPLIT_TRAIN);
    assert_ok(ctx, sf_scene_get_pixels(scene, view.id, picture, NULL));
    assert_int_equal(sf_scene_get_points(scene, 0, POINTS + 1, xyz, rgb), POINTS);
    const sf_camera *c = &view.camera;
    int on_surface = 0, like_picture = 0;
    double noise = 0;
    for (int i = 0; i < POINTS; i++) {
        double p[3];
        for (int k = 0; k < 3; k++)
            p[k] = c->R_cw[3 * k] * (double)xyz[3 * i] + c->R_cw[3 * k + 1] * (double)xyz[3 * i + 1] +
                   c->R_cw[3 * k + 2] * (double)xyz[3 * i + 2] + c->t_cw[k];
        assert_true(p[2] > 0);
        double x = c->fx * p[0] / p[2] + c->cx, y = c->fy * p[1] / p[2] + c->cy;
        assert_true(x > -6 && x < 64 + 6 && y > -6 && y < 48 + 6);
        if (x < 0 || x >= 64 || y < 0 || y >= 48) continue;
        sf_hit hit;
        sf_studio_look(&sim.studio, c, x, y, &hit);
        double distance = sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
        double off = fabs(hit.distance - distance) * c->fx / distance; /* px */
        if (off < 5) on_surface++, noise += off;
        const float *at = picture + 3 * ((int)y * 64 + (int)x);
        double difference = 0;
        for (int k = 0; k < 3; k++) difference += fabs((double)at[k] - rgb[3 * i + k] / 255.0) / 3;
        like_picture += difference < 0.15;
    }
    assert_true(on_surface > 0.85 * POINTS);
    assert_true(noise / on_surface > 0.2 && noise / on_surface < 2);
    assert_true(like_picture > 0.6 * POINTS);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* All training views give points: no single one sees three walls. */
static void test_points_come_from_all_views(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = load(ctx, TINY "&frames=12", NULL);
    static float xyz[3 * 8000];
    assert_int_equal(sf_scene_get_points(scene, 0, 8000, xyz, NULL), 8000);
    int right = 0, left = 0, front = 0;
    for (int i = 0; i < 8000; i++) {
        right += xyz[3 * i] > 5;
        left += xyz[3 * i] < -5;
        front += xyz[3 * i + 1] > 5;
    }
    assert_true(right > 200 && left > 200 && front > 200);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_points_are_repeatable(void **state) {
    (void)state;
    static const char *const names[3] = {TINY "&frames=3&seed=2", TINY "&frames=3&seed=2",
                                         TINY "&frames=3&seed=3"};
    static float xyz[3][3 * 8000];
    static uint8_t rgb[3][3 * 8000];
    for (int i = 0; i < 3; i++) {
        sf_context *ctx = test_context_threads(i + 1);
        sf_scene *scene = load(ctx, names[i], NULL);
        assert_int_equal(sf_scene_get_points(scene, 0, 8000, xyz[i], rgb[i]), 8000);
        sf_scene_destroy(&scene);
        sf_context_destroy(&ctx);
    }
    assert_memory_equal(xyz[0], xyz[1], sizeof xyz[0]);
    assert_memory_equal(rgb[0], rgb[1], sizeof rgb[0]);
    assert_memory_not_equal(xyz[0], xyz[2], sizeof xyz[0]);
}

/* An allocator that counts, and fails once `left` allocations are spent. */
typedef struct meter {
    int left, blocks;
} meter;

static void *metered_alloc(void *user, size_t size) {
    meter *m = user;
    if (m->left-- <= 0) return NULL;
    m->blocks++;
    return malloc(size);
}

static void metered_free(void *user, void *block) {
    meter *m = user;
    if (block) m->blocks--;
    free(block);
}

/* Wherever memory ends, the load says so and leaves nothing behind. */
static void test_memory_ends(void **state) {
    (void)state;
    meter m = {1 << 30, 0};
    sf_allocator allocator = {metered_alloc, metered_free, &m};
    sf_context_options options = {.allocator = &allocator, .threads = 1};
    sf_context *ctx;
    assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
    int before = m.blocks, failures = 0;
    for (sf_status status = SF_ERR_MEMORY; status != SF_OK; failures++) {
        sf_scene *scene;
        m.left = failures;
        status = sf_scene_load(ctx, "sim:studio?width=16&height=16&frames=2", NULL, &scene);
        if (status != SF_OK) assert_int_equal(status, SF_ERR_MEMORY);
        sf_scene_destroy(&scene);
        assert_int_equal(m.blocks, before);
    }
    assert_true(failures > 10);
    m.left = 1 << 30;
    sf_context_destroy(&ctx);
    assert_int_equal(m.blocks, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_scene),
        cmocka_unit_test(test_downscale),
        cmocka_unit_test(test_splits),
        cmocka_unit_test(test_bad_load_options),
        cmocka_unit_test(test_points),
        cmocka_unit_test(test_points_come_from_all_views),
        cmocka_unit_test(test_points_are_repeatable),
        cmocka_unit_test(test_memory_ends),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
