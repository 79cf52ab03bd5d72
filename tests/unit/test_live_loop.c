/* test_live_loop.c - a loop that closes takes the drift of its keyframes away, with landmarks and model. */
#include "live_walk_fixture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "live/loop_closure.h"
#include "pose/landmark_map.h"

#define SOURCE "sim:corridor?width=160&height=120&fps=0&frames=300"

#define TURN 0.03 /* rad */
#define MOVE 0.05 /* of the distance */
#define GROW 0.03

enum { FRAMES = 60, STEPS = 4, MOST = 200 };

static live_walk walk;
static sf_rigid truth[MOST];

static int open_walk(void **state) {
    (void)state;
    if (test_is_emulated()) return 0; /* all tests are skipped */
    live_walk_open(SOURCE, FRAMES, STEPS, &walk);
    sf_landmarks *l = walk.live->localizer.landmarks; /* the first pose alone is known from outside */
    for (size_t i = 1; i < l->keyframe_count; i++) l->keyframes[i].view.is_known = 0;
    walk.live->localizer.fix.from = SF_POSE_NONE;
    return 0;
}

static int close_walk(void **state) {
    (void)state;
    live_walk_close(&walk);
    return 0;
}

static double held_out_psnr(void) {
    sf_live_progress p;
    assert_ok(walk.ctx, sf_evaluate_all(&walk.live->evaluation, &walk.live->keyframes, walk.live->scene,
                                        walk.live->fitter));
    sf_live_get_progress(walk.live, &p);
    return p.held_out_psnr_corrected;
}

/* Root mean squares over the keyframes: rad, parts of the distance. */
static void measure(double *turned, double *moved) {
    const sf_keyframes *keyframes = &walk.live->keyframes;
    *turned = *moved = 0;
    for (size_t i = 0; i < keyframes->count; i++) {
        double angle, apart;
        sf_rigid_gap(&truth[i], &keyframes->list[i].pose, &angle, &apart);
        *turned += angle * angle, *moved += pow(apart / walk.live->localizer.distance, 2);
    }
    *turned = sqrt(*turned / (double)keyframes->count), *moved = sqrt(*moved / (double)keyframes->count);
}

/* Evenly from the first keyframe to the last: turned by `turn` rad about its own place, moved by `move` to
 * the side, all lengths about it longer by `grow`. */
static void drift(double turn, double move, double grow) {
    sf_keyframes *keyframes = &walk.live->keyframes;
    sf_rigid to[MOST];
    double scales[MOST];
    assert_true(keyframes->count < MOST);
    for (size_t i = 0; i < keyframes->count; i++) {
        double part = (double)i / (double)(keyframes->count - 1);
        const double twist[SF_TWIST] = {move * part, 0, 0, 0, turn * part, 0};
        to[i] = truth[i] = keyframes->list[i].pose;
        sf_rigid_move(&to[i], twist);
        scales[i] = 1 + grow * part;
    }
    walk.live->localizer.pose = to[keyframes->count - 1];
    /* A drift that landmarks do not contradict: only what is between one keyframe and the next is known. */
    walk.live->localizer.landmarks->match_count = walk.live->localizer.landmarks->observation_count = 0;
    walk.live->localizer.found_again = keyframes->list[keyframes->count - 1].found_again;
    assert_ok(walk.ctx, sf_live_move_keyframes(walk.live, to, scales, keyframes->count, 0));
}

static void drift_is_taken_away(void **state) {
    (void)state;
    test_skip_emulated();
    double distance = walk.live->localizer.distance, turned[2], moved[2], scale, first = held_out_psnr();
    drift(TURN, MOVE * distance, GROW);
    measure(&turned[0], &moved[0]);
    double drifted = held_out_psnr();
    size_t last = walk.live->keyframes.count - 1;
    const sf_loop_link links[2] = {{last, 1, truth[last], 1 + GROW, 1},
                                   {last + 1, 0, truth[last], 1 + GROW, 1}};
    const sf_loop_back back = {last - 1, 2};
    sf_rigid pose;
    assert_ok(walk.ctx, sf_live_correct_loop(walk.live, links, 2, &back, &pose, &scale));
    walk.live->localizer.pose = pose;
    measure(&turned[1], &moved[1]);
    double closed = held_out_psnr(), angle, apart;
    sf_rigid_gap(&truth[last], &pose, &angle, &apart);
    print_message(
        "keyframes off by %.2f degrees and %.2f %% of the distance, then %.2f and %.2f; the picture "
        "by %.2f and %.2f; held out %.2f dB, drifted %.2f, closed %.2f; scale %.3f\n",
        turned[0] * 57.3, 100 * moved[0], turned[1] * 57.3, 100 * moved[1], angle * 57.3,
        100 * apart / distance, first, drifted, closed, scale);
    assert_true(turned[1] < 0.3 * turned[0] && moved[1] < 0.5 * moved[0]);
    assert_true(angle < 0.1 * TURN && apart < 0.1 * MOVE * distance);
    assert_true(fabs(scale * (1 + GROW) - 1) < 0.003);
    assert_true(closed > first - 1);
}

/* The walls to the front and the back are alike, but not what stands before them. */
static void a_twin_is_not_taken_for_it(void **state) {
    (void)state;
    test_skip_emulated();
    int known = 0, views = 0;
    for (int at = 3; at < FRAMES; at += 4, views++) {
        sf_camera camera = live_walk_camera(&walk, at, 0, 0);
        sf_camera opposite = live_walk_camera(&walk, at + 150, 0, 0);
        known += live_walk_find(&walk, &camera, 2) > 0;
        assert_int_equal(live_walk_find(&walk, &opposite, 2), 0);
    }
    print_message("%d of %d views of the way are found\n", known, views);
    assert_true(4 * known >= 3 * views);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(a_twin_is_not_taken_for_it),
                                       cmocka_unit_test(drift_is_taken_away)};
    return cmocka_run_group_tests(tests, open_walk, close_walk);
}
