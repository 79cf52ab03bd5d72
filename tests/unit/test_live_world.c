/* test_live_world.c - a live fit does not depend on the world's unit, nor on where its origin is. */
#include "scale_fixture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <splatfit/live.h>
#include <splatfit/source.h>

#include "base/linear.h"
#include "base/statistics.h"
#include "live/live.h"
#include "scene/gaussians.h"

enum { LOOKS = 20 };

/* Another world than the frames' own: lengths are times 2^power, and then all is moved to another place. */
typedef struct other_world {
    sf_live *live;
    int power, untold; /* whether the accuracy of poses is not told */
    double at[3];
} other_world;

static sf_status pose_in_world(void *world, int64_t time_ns, double R_cw[9], double t_cw[3],
                               double information[36]) {
    (void)time_ns;
    const other_world *w = world;
    const sf_camera *truth = &w->live->input.picture->truth;
    memcpy(R_cw, truth->R_cw, sizeof truth->R_cw);
    for (int k = 0; k < 3; k++) t_cw[k] = ldexp(truth->t_cw[k], w->power) - sf_dot3(R_cw + 3 * k, w->at);
    for (int k = 0; k < 36; k++)
        information[k] = k % 7 || w->untold ? 0 : k < 18 ? ldexp(1e6, -2 * w->power) : 1e6;
    return SF_OK;
}

/* A run in another world, by poses from outside or by a board of another size. */
typedef struct world_run {
    sf_context *ctx, *source_ctx;
    sf_source *source;
    sf_live *live;
    other_world world;
    sf_board *board;
    sf_model *model;
} world_run;

static void run_in_a_world(other_world world, int by_board, world_run *w) {
    static const char *const names[] = {"sim:studio?width=64&height=48&fps=0&frames=40",
                                        "sim:studio-board?width=160&height=120&fps=0&frames=150"};
    sf_live_options options = sf_live_options_default();
    sf_live_progress p;
    *w = (world_run){.ctx = test_context_threads(1), .source_ctx = test_context_threads(1), .world = world};
    options.steps_per_frame = 1;
    options.hold_out = 4;
    options.fit.max_gaussians = 1500;
    if (by_board) {
        assert_ok(w->ctx, sf_board_open(w->ctx, "a3-36h11", ldexp(0.08, world.power), &w->board));
        options.board = w->board;
    } else {
        options.pose = pose_in_world, options.pose_user = &w->world;
    }
    assert_ok(w->source_ctx, sf_source_open(w->source_ctx, names[by_board], &w->source));
    assert_ok(w->ctx, sf_live_create(w->ctx, w->source, &options, &w->live));
    w->world.live = w->live;
    do {
        assert_ok(w->ctx, sf_live_step(w->live));
        sf_live_get_progress(w->live, &p);
    } while (p.looked_at < LOOKS);
    assert_true(p.fit.step > 5 && p.lost == 0);
    assert_ok(w->ctx, sf_live_snapshot(w->live, &w->model));
}

static void close_world(world_run *w) {
    sf_model_destroy(&w->model);
    sf_live_destroy(&w->live);
    sf_source_close(&w->source);
    sf_board_close(&w->board);
    sf_context_destroy(&w->source_ctx);
    sf_context_destroy(&w->ctx);
}

/* A board of 1 mm or of 10 m, and poses in any unit, give the same model but for its unit. */
static void any_unit_gives_the_same_model(void **state) {
    (void)state;
    test_skip_emulated();
    if (test_is_quick()) test_skip("SPLATFIT_QUICK is set, and poses_may_be_far_from_0 goes the same way");
    static const int powers[2][2] = {{-20, 20}, {-6, 6}}; /* of boards: tags of 1.25 mm to 5 m */
    world_run plain, scaled;
    for (int by_board = 0; by_board < 2; by_board++) {
        run_in_a_world((other_world){.untold = 1}, by_board, &plain);
        for (int i = 0; i < 2; i++) {
            run_in_a_world((other_world){.power = powers[by_board][i], .untold = 1}, by_board, &scaled);
            scale_assert_same(plain.model, scaled.model, powers[by_board][i]);
            close_world(&scaled);
        }
        close_world(&plain);
    }
}

/* How far two models are apart: the median distance of the n-th Gaussians. */
static double distance_between(const sf_model *a, const sf_model *b) {
    size_t n = a->count < b->count ? a->count : b->count;
    double *distances = malloc(n * sizeof *distances);
    assert_non_null(distances);
    for (size_t i = 0; i < n; i++) {
        double square = 0;
        for (int k = 0; k < 3; k++)
            square += pow((double)*sf_value(&a->params, SF_FIELD_mean, i, k) -
                              (double)*sf_value(&b->params, SF_FIELD_mean, i, k),
                          2);
        distances[i] = sqrt(square);
    }
    double median = sf_median(distances, n);
    free(distances);
    return median;
}

/* Poses in UTM coordinates: relative to an origin near them, the fit is the same. */
static void poses_may_be_far_from_0(void **state) {
    (void)state;
    test_skip_emulated();
    static const double utm[3] = {500000, 5000000, 128}, zero[3] = {0, 0, 0};
    world_run plain, far;
    double origin[3];
    run_in_a_world((other_world){.power = 0}, 0, &plain);
    sf_scene_get_origin(sf_live_scene(plain.live), origin);
    assert_memory_equal(origin, zero, sizeof zero);
    test_log_clear();
    run_in_a_world((other_world){.at = {utm[0], utm[1], utm[2]}}, 0, &far);
    assert_non_null(strstr(test_log, "relative to the origin 5000"));
    sf_scene_get_origin(sf_live_scene(far.live), origin);
    for (int k = 0; k < 3; k++) assert_true(fabs(origin[k] - utm[k]) < 16);
    sf_live_frame a, b;
    sf_live_get_frame(plain.live, &a);
    sf_live_get_frame(far.live, &b);
    for (int k = 0; k < 3; k++) {
        double ca[3], cb[3];
        sf_camera_center(&a.camera, ca);
        sf_camera_center(&b.camera, cb);
        assert_true(fabs(cb[k] + origin[k] - utm[k] - ca[k]) < 1e-3);
    }
    sf_model_get_origin(far.model, origin);
    for (int k = 0; k < 3; k++) origin[k] -= utm[k];
    sf_model_set_origin(plain.model, origin); /* now the same numbers mean the same place */
    assert_int_equal(far.model->count, plain.model->count);
    assert_true(distance_between(far.model, plain.model) < 1e-3);
    close_world(&far);
    close_world(&plain);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(any_unit_gives_the_same_model),
        cmocka_unit_test(poses_may_be_far_from_0),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
