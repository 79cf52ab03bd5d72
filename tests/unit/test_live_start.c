/* test_live_start.c - a live fit that starts from pictures alone. */
#include "../testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <splatfit/live.h>
#include <splatfit/source.h>

#include "base/statistics.h"
#include "live/live.h"

enum { FRAMES = 70, SHORT = 48, POSES = 200 };

typedef struct run {
    sf_context *ctx, *source_ctx;
    sf_source *source;
    sf_board *board;
    sf_live *live;
    sf_camera found[POSES], truth[POSES];
    size_t count;
} run;

static void open_run(run *r, const char *source, int threads, sf_live_options options) {
    *r = (run){.ctx = test_context_threads(threads), .source_ctx = test_context_threads(1)};
    options.steps_per_frame = 2;
    options.hold_out = 4;
    options.keyframe_gap = 0.2; /* few keyframes: the test is short */
    options.fit.max_gaussians = 8000;
    if (options.board) {
        assert_ok(r->ctx, sf_board_open(r->ctx, "a3-36h11", 0.08, &r->board));
        options.board = r->board;
    }
    assert_ok(r->source_ctx, sf_source_open(r->source_ctx, source, &r->source));
    assert_ok(r->ctx, sf_live_create(r->ctx, r->source, &options, &r->live));
}

static sf_status run_on(run *r, uint64_t frames) {
    uint64_t last = 0;
    sf_live_frame f;
    sf_status status;
    do {
        status = sf_live_step(r->live);
        sf_live_get_frame(r->live, &f);
        if (f.number == last || f.from == SF_POSE_NONE || !f.has_truth) continue;
        last = f.number;
        if (last >= frames) return SF_OK;
        if (r->count < POSES) r->found[r->count] = f.camera, r->truth[r->count++] = f.truth;
    } while (!status);
    return status;
}

static void close_run(run *r) {
    sf_live_destroy(&r->live);
    sf_source_close(&r->source);
    sf_board_close(&r->board);
    sf_context_destroy(&r->source_ctx);
    sf_context_destroy(&r->ctx);
}

/* The median error of poses, in degrees and in units of the truth, after the similarity. */
static void measure(const run *r, const sf_similarity *s, double *degrees, double *distance) {
    double turns[POSES], ways[POSES];
    for (size_t n = 0; n < r->count; n++) {
        sf_camera c = r->found[n];
        double a[3], b[3], trace = 0, square = 0;
        sf_camera_transform(&c, s);
        sf_camera_center(&c, a), sf_camera_center(&r->truth[n], b);
        for (int k = 0; k < 9; k++) trace += c.R_cw[k] * r->truth[n].R_cw[k];
        for (int k = 0; k < 3; k++) square += pow(a[k] - b[k], 2);
        turns[n] = acos(fmin((trace - 1) / 2, 1)) * 57.29577951308232, ways[n] = sqrt(square);
    }
    *degrees = sf_median(turns, r->count), *distance = sf_median(ways, r->count);
}

#define ORBIT "sim:studio?width=160&height=120&exact=0&frames=120"

static void no_board_and_no_lens_are_needed(void **state) {
    (void)state;
    test_skip_emulated();
    sf_live_options options = sf_live_options_default();
    sf_live_progress p;
    sf_similarity s;
    double degrees, distance;
    run r;
    options.find_lens = 1;
    options.scale = 2;
    open_run(&r, ORBIT, 2, options);
    assert_ok(r.ctx, run_on(&r, FRAMES));
    sf_live_get_progress(r.live, &p);
    print_message("%llu looked at, %llu with a pose, lost %llu times, %zu keyframes\n",
                  (unsigned long long)p.looked_at, (unsigned long long)p.tracked, (unsigned long long)p.lost,
                  p.keyframes);
    assert_true(p.own_world && p.has_fit && p.lost == 0);
    assert_true(r.count >= FRAMES / 2);
    assert_int_equal(sf_similarity_between(r.found, r.truth, r.count, &s), 1);
    measure(&r, &s, &degrees, &distance);
    print_message("focal length %.1f for %.1f px, %.2f degrees, %.3f units, scale %.2f\n", p.focal_length,
                  r.truth[0].fx, degrees, distance, s.scale);
    assert_true(fabs(p.focal_length / r.truth[0].fx - 1) < 0.04);
    assert_true(degrees < 2 && distance < 0.15);
    assert_int_equal(sf_live_get_world(r.live, &s), SF_ERR_EMPTY);
    close_run(&r);
}

static void threads_do_not_matter(void **state) {
    (void)state;
    test_skip_emulated();
    if (getenv("SPLATFIT_QUICK")) test_skip("SPLATFIT_QUICK is set");
    run runs[2];
    sf_live_options options = sf_live_options_default();
    for (int i = 0; i < 2; i++) {
        open_run(&runs[i], "sim:studio?width=160&height=120&exact=0&frames=120", i ? 4 : 1, options);
        assert_ok(runs[i].ctx, run_on(&runs[i], SHORT));
    }
    assert_true(runs[0].count > 10);
    assert_int_equal(runs[0].count, runs[1].count);
    assert_memory_equal(runs[0].found, runs[1].found, runs[0].count * sizeof *runs[0].found);
    for (int i = 0; i < 2; i++) close_run(&runs[i]);
}

/* Frames that show nothing: no map, no model, and the state says so. */
static void nothing_begins_in_the_dark(void **state) {
    (void)state;
    test_skip_emulated();
    sf_live_options options = sf_live_options_default();
    sf_live_progress p;
    run r;
    open_run(&r, "sim:studio-board?width=160&height=120&fps=0&frames=40&black=0:90", 1, options);
    assert_int_equal(run_on(&r, UINT64_MAX), SF_ERR_END);
    sf_live_get_progress(r.live, &p);
    assert_true(!p.has_fit && !p.own_world && p.keyframes == 0 && p.looked_at == 40);
    assert_int_equal(p.state, SF_LIVE_WAITING);
    close_run(&r);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(no_board_and_no_lens_are_needed),
                                       cmocka_unit_test(threads_do_not_matter),
                                       cmocka_unit_test(nothing_begins_in_the_dark)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
