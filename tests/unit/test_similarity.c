/* test_similarity.c - the similarity between two worlds, from cameras that are known in both. */
#include "../testing.h"

#include <math.h>
#include <string.h>

#include <splatfit/model.h>

#include "base/linear.h"
#include "live/found_lens.h"
#include "live/world.h"

enum { CAMERAS = 20 };

static const sf_similarity truth = {
    .R = {0.36, 0.48, -0.8, -0.8, 0.6, 0, 0.48, 0.64, 0.6}, .scale = 2.5, .move = {3, -40, 7}};

static sf_camera camera_at(size_t n) {
    const double turn[3] = {0.1 * (double)n, 0.4, -0.05 * (double)n};
    sf_camera c = {.width = 8, .height = 8, .fx = 8, .fy = 8, .cx = 4, .cy = 4};
    sf_rotation_exp(turn, c.R_cw);
    c.t_cw[0] = 0.3 * (double)n, c.t_cw[1] = sin((double)n), c.t_cw[2] = 2;
    return c;
}

/* What a camera sees of a place, before and after all is moved: the same but for the scale. */
static void a_moved_camera_sees_the_same(void **state) {
    (void)state;
    const double at[3] = {0.4, -1.2, 5};
    double moved_at[3], turned[3], p[3], q[3];
    sf_camera c = camera_at(3), moved = c;
    sf_camera_transform(&moved, &truth);
    sf_mat3_vec(truth.R, at, turned);
    for (int k = 0; k < 3; k++) moved_at[k] = truth.scale * turned[k] + truth.move[k];
    sf_mat3_vec(c.R_cw, at, p), sf_mat3_vec(moved.R_cw, moved_at, q);
    for (int k = 0; k < 3; k++)
        assert_true(fabs(truth.scale * (p[k] + c.t_cw[k]) - (q[k] + moved.t_cw[k])) < 1e-12);
}

static void cameras_tell_the_similarity(void **state) {
    (void)state;
    sf_camera from[CAMERAS], to[CAMERAS];
    sf_similarity s;
    for (size_t n = 0; n < CAMERAS; n++) {
        from[n] = to[n] = camera_at(n);
        sf_camera_transform(&to[n], &truth);
    }
    assert_int_equal(sf_similarity_between(from, to, CAMERAS, &s), 1);
    assert_true(fabs(s.scale - truth.scale) < 1e-12);
    for (int k = 0; k < 9; k++) assert_true(fabs(s.R[k] - truth.R[k]) < 1e-12);
    for (int k = 0; k < 3; k++) assert_true(fabs(s.move[k] - truth.move[k]) < 1e-11);
    assert_int_equal(sf_similarity_between(from, to, 0, &s), 0);
    assert_int_equal(sf_similarity_between(from, to, 1, &s), 0);
}

/* A board that was seen wrongly a few times does not count. */
static void a_world_is_told_by_most_of_what_is_seen(void **state) {
    (void)state;
    sf_world w = {.count = 0};
    int told = 0;
    for (size_t n = 0; n < CAMERAS; n++) {
        sf_camera map = camera_at(n), seen = map;
        sf_rigid world;
        sf_camera_transform(&seen, &truth);
        memcpy(world.R, seen.R_cw, sizeof world.R), memcpy(world.t, seen.t_cw, sizeof world.t);
        if (n % 7 == 5) world.t[0] += 4;
        told += sf_world_note(&w, &map, &world, 5);
        (void)sf_world_note(&w, &map, &world, 5); /* from the same place: nothing new */
    }
    assert_int_equal(told, 1);
    assert_int_equal(w.count, CAMERAS);
    assert_true(w.is_known && fabs(w.similarity.scale - truth.scale) < 1e-3);
    for (int k = 0; k < 3; k++) assert_true(fabs(w.similarity.move[k] - truth.move[k]) < 0.02);
}

/* A longer focal length changes no pixel of a picture that is remapped. */
static void a_zoomed_lens_remaps_as_before(void **state) {
    (void)state;
    enum { SIDE = 32, PIXELS = SIDE * SIDE };
    static float planes[3 * PIXELS], first[3 * PIXELS];
    sf_context *ctx = test_context();
    sf_found_lens found = {.ctx = ctx};
    const sf_lens lens = {.fx = 30, .fy = 30, .cx = 16, .cy = 16, .k1 = -0.2, .k2 = 0.05};
    sf_picture p = {.camera = {.width = SIDE, .height = SIDE}, .is_lens_guessed = 1};
    const sf_picture *corrected;
    for (size_t i = 0; i < 3 * PIXELS; i++) planes[i] = (float)(i % 37) / 37;
    for (size_t c = 0; c < 3; c++) p.rgb[c] = planes + c * PIXELS;
    assert_ok(ctx, sf_found_lens_correct(&found, &p, &corrected));
    assert_ptr_equal(corrected, &p);
    assert_ok(ctx, sf_found_lens_set(&found, &lens, SIDE, SIDE));
    assert_ok(ctx, sf_found_lens_correct(&found, &p, &corrected));
    assert_true(!corrected->is_lens_guessed && corrected->camera.fx == 30);
    memcpy(first, found.planes, sizeof first);
    assert_memory_not_equal(first, planes, sizeof first);
    sf_found_lens_zoom(&found, 1.1);
    assert_true(fabs(found.camera.fx - 33) < 1e-12);
    sf_lens zoomed = found.lens;
    assert_ok(ctx, sf_found_lens_set(&found, &zoomed, SIDE, SIDE));
    assert_ok(ctx, sf_found_lens_correct(&found, &p, &corrected));
    for (size_t i = 0; i < 3 * PIXELS; i++) assert_true(fabsf(found.planes[i] - first[i]) < 1e-4f);
    sf_found_lens_free(&found);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(a_moved_camera_sees_the_same),
                                       cmocka_unit_test(cameras_tell_the_similarity),
                                       cmocka_unit_test(a_world_is_told_by_most_of_what_is_seen),
                                       cmocka_unit_test(a_zoomed_lens_remaps_as_before)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
