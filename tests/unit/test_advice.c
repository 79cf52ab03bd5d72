/* test_advice.c - what a user is told to do: what comes first, and that it does not flicker. */
#include "../testing.h"

#include <math.h>

#include "live/advice.h"

#define FRAME 0.1 /* s */

static sf_advice_facts calm(void) {
    return (sf_advice_facts){.state = SF_LIVE_TRACKING, .speed = 0.3, .brightness = 1, .coverage = 0.9};
}

/* So many seconds of frames; what is shown in the end. */
static sf_live_advice pass(sf_adviser *a, sf_advice_facts facts, double *now, double seconds) {
    sf_live_advice shown = SF_ADVICE_NONE;
    for (double end = *now + seconds - 1e-9; *now < end; *now += FRAME) {
        facts.seconds = *now;
        shown = sf_advise(a, &facts);
    }
    return shown;
}

static void says_each(void **state) {
    (void)state;
    sf_advice_facts cases[SF_ADVICE_COUNT];
    for (int i = 0; i < SF_ADVICE_COUNT; i++) cases[i] = calm();
    cases[SF_ADVICE_SIDEWAYS].state = SF_LIVE_STARTING;
    cases[SF_ADVICE_SLOWER].speed = 1.6;
    cases[SF_ADVICE_DARKER].brightness = 0.5;
    cases[SF_ADVICE_BRIGHTER].brightness = 2;
    cases[SF_ADVICE_COME_BACK].state = SF_LIVE_LOST;
    cases[SF_ADVICE_MORE_VIEWS].coverage = 0.2;
    for (int i = 0; i < SF_ADVICE_COUNT; i++) {
        sf_adviser a = {0};
        double now = 5;
        assert_int_equal(pass(&a, cases[i], &now, 1), i);
        assert_int_equal(pass(&a, calm(), &now, 3), SF_ADVICE_NONE);
    }
    sf_adviser a = {0};
    sf_advice_facts unknown = {.state = SF_LIVE_TRACKING, .speed = NAN, .brightness = NAN, .coverage = NAN};
    double now = 0;
    assert_int_equal(pass(&a, unknown, &now, 3), SF_ADVICE_NONE);
    unknown.blurred = 1;
    assert_int_equal(pass(&a, unknown, &now, 3), SF_ADVICE_SLOWER);
}

static void the_most_urgent_comes_first(void **state) {
    (void)state;
    sf_adviser a = {0};
    double now = 0;
    sf_advice_facts facts = calm();
    facts.coverage = 0;
    assert_int_equal(pass(&a, facts, &now, 2), SF_ADVICE_MORE_VIEWS);
    facts.brightness = 3;
    assert_int_equal(pass(&a, facts, &now, 2), SF_ADVICE_BRIGHTER);
    facts.speed = 2;
    assert_int_equal(pass(&a, facts, &now, 2), SF_ADVICE_SLOWER);
    facts.state = SF_LIVE_LOST;
    assert_int_equal(pass(&a, facts, &now, 0.6), SF_ADVICE_COME_BACK); /* it does not wait, */
    assert_int_equal(pass(&a, calm(), &now, FRAME), SF_ADVICE_NONE);   /* and is over when it is done */
    facts = calm(), facts.state = SF_LIVE_STARTING;
    assert_int_equal(pass(&a, facts, &now, 0.6), SF_ADVICE_SIDEWAYS);
    assert_int_equal(pass(&a, calm(), &now, FRAME), SF_ADVICE_NONE);
}

/* A frame or two say nothing; what is shown stays, also where it is wanted in every other frame only. */
static void does_not_flicker(void **state) {
    (void)state;
    sf_adviser a = {0};
    double now = 0;
    sf_advice_facts fast = calm();
    fast.speed = 1.6;
    assert_int_equal(pass(&a, calm(), &now, 1), SF_ADVICE_NONE);
    assert_int_equal(pass(&a, fast, &now, 2 * FRAME), SF_ADVICE_NONE);
    for (int i = 0; i < 20; i++) {
        assert_int_equal(pass(&a, calm(), &now, FRAME), SF_ADVICE_NONE);
        assert_int_equal(pass(&a, fast, &now, FRAME), SF_ADVICE_NONE);
    }
    assert_int_equal(pass(&a, fast, &now, 0.5), SF_ADVICE_SLOWER);
    for (int i = 0; i < 20; i++) {
        assert_int_equal(pass(&a, calm(), &now, FRAME), SF_ADVICE_SLOWER);
        assert_int_equal(pass(&a, fast, &now, FRAME), SF_ADVICE_SLOWER);
    }
    assert_int_equal(pass(&a, calm(), &now, SF_ADVICE_CLEAR - FRAME), SF_ADVICE_SLOWER);
    assert_int_equal(pass(&a, calm(), &now, 3 * FRAME), SF_ADVICE_NONE);
    assert_int_equal(pass(&a, fast, &now, 0.5), SF_ADVICE_SLOWER); /* read for a while at least */
    assert_int_equal(pass(&a, calm(), &now, SF_ADVICE_KEEP - 0.5), SF_ADVICE_SLOWER);
    assert_int_equal(pass(&a, calm(), &now, 0.7), SF_ADVICE_NONE);
}

/* A value between the limits keeps what is shown, whatever that is. */
static void has_two_limits(void **state) {
    (void)state;
    sf_adviser a = {0};
    double now = 0;
    sf_advice_facts fast = calm(), between = calm();
    fast.speed = 1.6, between.speed = 1;
    assert_int_equal(pass(&a, between, &now, 3), SF_ADVICE_NONE);
    assert_int_equal(pass(&a, fast, &now, 1), SF_ADVICE_SLOWER);
    assert_int_equal(pass(&a, between, &now, 10), SF_ADVICE_SLOWER);
    assert_int_equal(pass(&a, calm(), &now, 3), SF_ADVICE_NONE);
    now = 0; /* a source that begins anew */
    assert_int_equal(pass(&a, fast, &now, 1), SF_ADVICE_SLOWER);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(says_each),
                                       cmocka_unit_test(the_most_urgent_comes_first),
                                       cmocka_unit_test(does_not_flicker), cmocka_unit_test(has_two_limits)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
