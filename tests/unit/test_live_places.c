/* test_live_places.c - a lost camera is found again from a picture alone, and never at a wrong place. */
#include "live_walk_fixture.h"

#include <math.h>
#include <stdlib.h>

/* Five frames a second of a walk of a minute. */
#define SOURCE "sim:studio-board?width=160&height=120&fps=0&frames=300"

enum { FRAMES = 50, STEPS = 4, TRIES = 3, EVERY = 7 };

#define DEGREE     0.017453292519943295
#define MOST_TURN  (1.5 * DEGREE)
#define MOST_APART 0.03 /* of the distance */

static live_walk walk;

static int open_walk(void **state) {
    (void)state;
    if (test_is_emulated()) return 0; /* all tests are skipped */
    live_walk_open(SOURCE, FRAMES, STEPS, &walk);
    return 0;
}

static int close_walk(void **state) {
    (void)state;
    live_walk_close(&walk);
    return 0;
}

/* Of views along the walk, swung aside by an angle: how many are found; none may be found elsewhere. */
static int count_found(double degrees, int *views) {
    int found = 0;
    double worst_turn = 0, worst_apart = 0, nearest = 0, turn, apart;
    *views = 0;
    for (int at = EVERY; at < FRAMES; at += EVERY, ++*views) {
        sf_camera camera = live_walk_camera(&walk, at, degrees * DEGREE, 0);
        int is_found = live_walk_find(&walk, &camera, TRIES) > 0;
        nearest = fmax(nearest, live_walk_nearest(&walk));
        if (!is_found) continue;
        live_walk_error(&walk, &turn, &apart);
        found++, worst_turn = fmax(worst_turn, turn), worst_apart = fmax(worst_apart, apart);
    }
    print_message("%.0f degrees aside, up to %.0f from all keyframes: %d of %d found, off by up to %.2f "
                  "degrees and %.2f %% of the distance\n",
                  degrees, nearest / DEGREE, found, *views, worst_turn / DEGREE, 100 * worst_apart);
    assert_true(worst_turn < MOST_TURN && worst_apart < MOST_APART);
    return found;
}

static void is_found_where_it_was_and_aside(void **state) {
    (void)state;
    test_skip_emulated();
    static const double angles[] = {0, 30, -30};
    for (size_t i = 0; i < sizeof angles / sizeof *angles; i++) {
        int views, found = count_found(angles[i], &views);
        assert_true(found >= views - (i > 0)); /* one from aside may show too little that is known */
    }
}

/* What lies behind the camera was never seen. */
static void is_not_found_where_it_never_was(void **state) {
    (void)state;
    test_skip_emulated();
    for (int at = EVERY; at < FRAMES; at += EVERY)
        for (int turn = 140; turn <= 220; turn += 40) {
            sf_camera camera = live_walk_camera(&walk, at, 0, turn * DEGREE);
            assert_int_equal(live_walk_find(&walk, &camera, TRIES), 0);
        }
}

/* Every second keyframe says that the same is elsewhere: neither is believed. */
static void is_not_found_in_a_doubtful_place(void **state) {
    (void)state;
    test_skip_emulated();
    sf_keyframes *keyframes = &walk.live->keyframes;
    double off = 3 * walk.live->localizer.distance;
    for (size_t i = 0; i < keyframes->count; i += 2) keyframes->list[i].pose.t[0] += off;
    for (int at = EVERY; at < FRAMES; at += EVERY) {
        sf_camera camera = live_walk_camera(&walk, at, 0, 0);
        assert_int_equal(live_walk_find(&walk, &camera, 1), 0);
    }
    for (size_t i = 0; i < keyframes->count; i += 2) keyframes->list[i].pose.t[0] -= off;
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(is_found_where_it_was_and_aside),
        cmocka_unit_test(is_not_found_where_it_never_was),
        cmocka_unit_test(is_not_found_in_a_doubtful_place),
    };
    return cmocka_run_group_tests(tests, open_walk, close_walk);
}
