/* test_live_waits.c - a live fit from pictures alone does not begin where pictures tell no depth: on the
 * spot, before a wall, where something large moves. It says why it waits, and begins when it can. */
#include "../testing.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include <splatfit/live.h>
#include <splatfit/source.h>

#include "base/statistics.h"
#include "live/live.h"

/* 30 frames a second of an orbit. */
#define ORBIT "sim:studio?width=160&height=120&exact=0&frames=400&noise=1&rounds=0.25"

enum { POSES = 100 };

typedef struct run {
    sf_context *ctx, *source_ctx;
    sf_source *source;
    sf_live *live;
    sf_live_frame frame;
    sf_camera found[POSES], truth[POSES];
    size_t count;
    int waits;      /* frames looked at before there was a map */
    char log[1024]; /* its lines */
} run;

static void note_line(void *user, sf_log_level level, const char *line) {
    run *r = user;
    size_t length = strlen(r->log);
    (void)level;
    snprintf(r->log + length, sizeof r->log - length, "%s\n", line);
}

static void open_run(const char *option, run *r) {
    char name[200];
    sf_live_options o = sf_live_options_default();
    *r = (run){.source_ctx = test_context_threads(1)};
    sf_context_options own = {.threads = 2, .log = note_line, .log_user = r};
    assert_int_equal(sf_context_create(&r->ctx, &own), SF_OK);
    o.find_lens = 1;
    o.steps_per_frame = 1;
    o.keyframe_gap = 0.2;
    o.fit.max_gaussians = 5000;
    snprintf(name, sizeof name, ORBIT "%s", option);
    assert_ok(r->source_ctx, sf_source_open(r->source_ctx, name, &r->source));
    assert_ok(r->ctx, sf_live_create(r->ctx, r->source, &o, &r->live));
}

static void close_run(run *r) {
    sf_live_destroy(&r->live);
    sf_source_close(&r->source);
    sf_context_destroy(&r->source_ctx);
    sf_context_destroy(&r->ctx);
}

/* To the frame `last`, or the end. */
static void play(run *r, uint64_t last) {
    sf_live_progress p;
    sf_status status = SF_OK;
    uint64_t before = 0;
    while (!status && r->frame.number < last) {
        status = sf_live_step(r->live);
        if (status != SF_ERR_END) assert_ok(r->ctx, status);
        sf_live_get_frame(r->live, &r->frame);
        sf_live_get_progress(r->live, &p);
        r->waits += r->frame.number != before && !p.has_fit && !p.own_world;
        if (r->frame.number != before && r->frame.from != SF_POSE_NONE && r->count < POSES)
            r->found[r->count] = r->frame.camera, r->truth[r->count++] = r->frame.truth;
        before = r->frame.number;
    }
}

/* Poses agree with the truth after a similarity: medians. */
static void assert_right(const run *r) {
    double turns[POSES], ways[POSES];
    sf_similarity s;
    assert_true(r->count > 10);
    assert_int_equal(sf_similarity_between(r->found, r->truth, r->count, &s), 1);
    for (size_t n = 0; n < r->count; n++) {
        sf_camera c = r->found[n];
        double a[3], b[3], trace = 0, square = 0;
        sf_camera_transform(&c, &s);
        sf_camera_center(&c, a), sf_camera_center(&r->truth[n], b);
        for (int k = 0; k < 9; k++) trace += c.R_cw[k] * r->truth[n].R_cw[k];
        for (int k = 0; k < 3; k++) square += pow(a[k] - b[k], 2);
        turns[n] = acos(fmin((trace - 1) / 2, 1)) * 57.29577951308232, ways[n] = sqrt(square);
    }
    double turn = sf_median(turns, r->count), way = sf_median(ways, r->count);
    print_message("%zu poses, %.2f degrees and %.3f units off, after %d frames; focal length %.1f for %.1f\n",
                  r->count, turn, way, r->waits, r->frame.camera.fx, r->truth[0].fx);
    assert_true(turn < 2 && way < 0.2); /* of some 4 units to what is seen */
}

/* Quick tests see one start to its end, and of the others that they wait. */
static void waits(const char *option, uint64_t frames, const char *said, int begins, int to_the_end) {
    run r;
    sf_live_progress p;
    test_skip_emulated();
    open_run(option, &r);
    play(&r, frames);
    sf_live_get_progress(r.live, &p);
    assert_true(!p.has_fit && !p.own_world && p.keyframes == 0);
    if (!strstr(r.log, said)) print_message("%s", r.log);
    assert_non_null(strstr(r.log, said));
    if (to_the_end) {
        play(&r, UINT64_MAX);
        sf_live_get_progress(r.live, &p);
        print_message("%s: %s", option, p.own_world ? "" : "no map to the end\n");
        if (begins) assert_true(p.own_world);
        if (p.own_world) assert_right(&r);
    }
    close_run(&r);
}

static void a_camera_that_turns_waits(void **state) {
    (void)state;
    waits("&spin=0:1.3", 38, "only turned", 1, 1);
}

static void a_wall_waits(void **state) {
    (void)state;
    waits("&wall=0:1", 29, "nothing is to be seen", 1, !test_is_quick());
}

/* A ball covers half of the picture and swings: there is a map of what is behind it, or none. */
static void a_large_mover_gives_no_wrong_map(void **state) {
    (void)state;
    waits("&mover=1&mover_part=0.5", 12, "the start waits", 0, !test_is_quick());
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(a_camera_that_turns_waits),
                                       cmocka_unit_test(a_wall_waits),
                                       cmocka_unit_test(a_large_mover_gives_no_wrong_map)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
