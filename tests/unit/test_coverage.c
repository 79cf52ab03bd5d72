/* test_coverage.c - cells of a wall that known cameras look at; and those of a live fit. */
#include "../testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <splatfit/live.h>

#include "live/guidance.h"

enum { WIDTH = 64, HEIGHT = 48, PIXELS = WIDTH * HEIGHT };

#define WALL 2.0 /* z of the wall that all cameras look at */
#define SIDE 0.25

/* At (x, 0, 0), turned about y so that it looks at the middle of the wall. */
static sf_camera camera_at(double x) {
    double angle = atan2(-x, WALL), c = cos(angle), s = sin(angle);
    sf_camera camera = {.width = WIDTH, .height = HEIGHT, .fx = 64, .fy = 64, .cx = 32, .cy = 24};
    const double R[9] = {c, 0, -s, 0, 1, 0, s, 0, c};
    memcpy(camera.R_cw, R, sizeof R);
    for (int k = 0; k < 3; k++) camera.t_cw[k] = -R[3 * k] * x;
    return camera;
}

/* The wall as that camera sees it: depth along its axis. */
static void see(sf_coverage *c, uint32_t id, double x, float error) {
    static float depth[PIXELS], errors[PIXELS];
    sf_camera camera = camera_at(x);
    for (int i = 0; i < PIXELS; i++) {
        double u = (i % WIDTH + 0.5 - camera.cx) / camera.fx;
        double along = camera.R_cw[2] * u + camera.R_cw[8]; /* z of the world per depth */
        depth[i] = (float)(WALL / along), errors[i] = error;
    }
    assert_int_equal(sf_coverage_see(c, id, &(sf_depth_map){&camera, depth, errors}), SF_OK);
}

static sf_live_cell middle_of(const sf_coverage *c) {
    const sf_coverage_cell *cell = sf_coverage_at(c, (double[]){0.1, 0.1, WALL + 0.1});
    sf_live_cell told;
    if (!cell) cell = sf_coverage_at(c, (double[]){0.1, 0.1, WALL - 0.1});
    assert_non_null(cell);
    sf_coverage_tell(c, cell, &told);
    return told;
}

static size_t sectors_of(const sf_live_cell *cell) {
    size_t n = 0;
    for (int i = 0; i < SF_COVERAGE_SECTORS; i++) n += cell->sectors >> i & 1;
    return n;
}

/* What is told of a cell is what the cameras' places say. */
static void has_the_right_values(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_coverage c = {.ctx = ctx};
    sf_coverage_clear(&c, SIDE, 10);
    assert_null(sf_coverage_at(&c, (double[]){0, 0, WALL}));
    see(&c, 7, 0, 0.02F);
    sf_live_cell told = middle_of(&c);
    assert_int_equal(told.views, 1);
    assert_true(fabs((double)told.error - 0.02) < 1e-6);
    assert_true(told.spread < 1e-3F && told.coverage < 0.01F);
    assert_int_equal(told.sectors, 1 << 4); /* from -z */
    for (int k = 0; k < 2; k++) assert_true(fabs((double)told.center[k] - SIDE / 2) < 1e-6);
    assert_true(fabs((double)told.center[2] - WALL) < SIDE);

    see(&c, 8, 2 * WALL, 0.04F); /* from 63 degrees aside: halves of the way differ by 32 */
    told = middle_of(&c);
    assert_int_equal(told.views, 2);
    assert_int_equal(sectors_of(&told), 2);
    assert_true(fabs((double)told.error - 0.03) < 1e-6);
    double to[3] = {2 * WALL - SIDE / 2, -SIDE / 2, -(double)told.center[2]};
    double other[3] = {-SIDE / 2, -SIDE / 2, -(double)told.center[2]}, dot = 0, a = 0, b = 0;
    for (int k = 0; k < 3; k++) dot += to[k] * other[k], a += to[k] * to[k], b += other[k] * other[k];
    assert_true(fabs((double)told.spread - acos(dot / sqrt(a * b)) / 2) < 1e-3);
    assert_true(fabs((double)told.coverage - 2 / 5.0) < 1e-6); /* the number of keyframes is the least */

    for (uint32_t id = 9; id < 14; id++) see(&c, id, 0.3 * (id - 9), 0.02F);
    told = middle_of(&c);
    assert_int_equal(told.views, 7);
    assert_true(told.coverage > 0.999F);
    sf_coverage_free(&c);
    sf_context_destroy(&ctx);
}

/* A keyframe that is seen again replaces itself; one that goes leaves nothing; errors count. */
static void keeps_account(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_coverage c = {.ctx = ctx};
    sf_coverage_clear(&c, SIDE, 10);
    for (uint32_t id = 0; id < 6; id++) see(&c, id, 0.3 * id, 0.5F);
    assert_true(middle_of(&c).coverage < 1e-6F); /* the error */
    for (uint32_t id = 0; id < 6; id++) see(&c, id, 0.3 * id, 0.1F);
    sf_live_cell told = middle_of(&c);
    assert_int_equal(told.views, 6);
    assert_true(fabs((double)told.coverage - 0.5) < 1e-3); /* halfway between the limits 0.04 and 0.16 */
    see(&c, 3, 100, 0.1F);                                 /* moved away */
    assert_int_equal(c.view_count, 6);
    for (uint32_t id = 1; id < 6; id++) sf_coverage_drop(&c, id);
    sf_coverage_drop(&c, 99);
    told = middle_of(&c);
    assert_int_equal(told.views, 1);
    assert_int_equal(sectors_of(&told), 1);
    assert_true(fabs((double)told.error - 0.1) < 1e-6 && told.spread < 1e-3F);
    sf_coverage_drop(&c, 0);
    assert_null(sf_coverage_at(&c, (double[]){0.1, 0.1, WALL}));
    sf_coverage_free(&c);
    sf_context_destroy(&ctx);
}

/* What only one camera sees, at the side, is the worst; it stays while it is about as bad as any, and where
 * all is covered there is none. */
static void finds_the_worst(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_coverage c = {.ctx = ctx};
    sf_coverage_clear(&c, SIDE, 10);
    for (uint32_t id = 0; id < 6; id++) see(&c, id, 0.15 * id - 0.4, 0.01F);
    sf_coverage_choose_worst(&c);
    assert_true(c.has_worst);
    sf_live_cell worst, middle = middle_of(&c);
    sf_coverage_tell(&c, &c.cells[c.worst], &worst);
    assert_true(fabsf(worst.center[0]) > 0.7F); /* at the edge of what is seen, 1 away */
    assert_true(worst.coverage < middle.coverage);
    size_t before = c.worst;
    see(&c, 50, 0.05, 0.01F);
    sf_coverage_choose_worst(&c);
    assert_int_equal(c.worst, before);
    sf_coverage_clear(&c, SIDE, 10);
    sf_coverage_choose_worst(&c);
    assert_false(c.has_worst);
    sf_coverage_free(&c);
    sf_context_destroy(&ctx);
}

/* A place far off is not counted, nor a depth between two surfaces. */
static void leaves_out(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_coverage c = {.ctx = ctx};
    static float depth[PIXELS], error[PIXELS];
    sf_camera camera = camera_at(0);
    sf_coverage_clear(&c, SIDE, 5);
    for (int i = 0; i < PIXELS; i++) depth[i] = i % WIDTH < 32 ? 0 : 6; /* nothing, and too far */
    assert_ok(ctx, sf_coverage_see(&c, 1, &(sf_depth_map){&camera, depth, error}));
    assert_int_equal(c.count, 0);
    for (int i = 0; i < PIXELS; i++) depth[i] = i % WIDTH == 32 ? 2 : i % WIDTH < 32 ? 1 : 4;
    assert_ok(ctx, sf_coverage_see(&c, 1, &(sf_depth_map){&camera, depth, error}));
    assert_true(c.count > 10);
    assert_null(sf_coverage_at(&c, (double[]){0.02, 0, 1.99}));
    assert_null(sf_coverage_at(&c, (double[]){0.02, 0, 2.01}));
    sf_coverage_free(&c);
    sf_context_destroy(&ctx);
}

/* Every training keyframe is looked at, and none that is held out; what is drawn are the cells' values. */
static void belongs_to_a_live_fit(void **state) {
    (void)state;
    test_skip_emulated();
    sf_context *ctx = test_context(), *source_ctx = test_context_threads(1);
    sf_live_options o = sf_live_options_default();
    sf_source *source;
    sf_live *live;
    sf_live_coverage coverage;
    sf_live_frame frame;
    o.own_poses = 1, o.steps_per_frame = 4, o.hold_out = 4;
    o.fit.max_gaussians = 1500;
    assert_ok(source_ctx,
              sf_source_open(source_ctx, "sim:studio?width=64&height=48&fps=0&frames=30", &source));
    assert_ok(ctx, sf_live_create(ctx, source, &o, &live));
    sf_live_get_coverage(live, &coverage);
    assert_true(!coverage.cells && !coverage.has_worst && isnan(coverage.mean));
    while (!sf_live_step(live)) {
    }
    for (int i = 0; i < 200; i++) { /* as if each step took long */
        live->guidance.next = 0;
        assert_ok(ctx, sf_live_look_around(live));
    }
    size_t training = 0;
    for (size_t i = 0; i < live->keyframes.count; i++) {
        const sf_keyframe *k = &live->keyframes.list[i];
        assert_int_equal(sf_coverage_has(&live->guidance.coverage, k->id), !k->held_out);
        training += !k->held_out;
    }
    assert_int_equal(live->guidance.coverage.view_count, training);
    sf_live_get_coverage(live, &coverage);
    print_message("%zu cells, coverage %.2f in the mean, %.2f ms a look\n", coverage.cells, coverage.mean,
                  coverage.look_ms);
    assert_true(coverage.cells > 50 && coverage.mean > 0 && coverage.mean < 1 && coverage.look_ms > 0);
    sf_live_cell *cells = calloc(coverage.cells + 1, sizeof *cells);
    assert_int_equal(sf_live_get_cells(live, 0, coverage.cells + 1, cells), coverage.cells);
    assert_int_equal(sf_live_get_cells(live, 5, 3, cells), 3);
    for (size_t i = 0; i < coverage.cells; i++) assert_true(cells[i].views <= training);
    free(cells);
    uint8_t *values = malloc(PIXELS);
    size_t known = 0;
    sf_live_get_frame(live, &frame);
    assert_ok(ctx, sf_live_draw_coverage(live, &frame.camera, values));
    for (size_t i = 0; i < PIXELS; i++) known += values[i] != SF_COVERAGE_UNKNOWN;
    assert_true(known > PIXELS / 3);
    frame.camera.fx = -1;
    assert_int_equal(sf_live_draw_coverage(live, &frame.camera, values), SF_ERR_ARGUMENT);
    free(values);
    sf_live_reset(live);
    sf_live_get_coverage(live, &coverage);
    assert_int_equal(coverage.cells, 0);
    sf_live_destroy(&live);
    sf_source_close(&source);
    sf_context_destroy(&source_ctx);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(has_the_right_values),
                                       cmocka_unit_test(keeps_account), cmocka_unit_test(finds_the_worst),
                                       cmocka_unit_test(leaves_out), cmocka_unit_test(belongs_to_a_live_fit)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
