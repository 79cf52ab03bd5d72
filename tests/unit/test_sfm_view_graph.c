/* test_sfm_view_graph.c - pairs whose rotation contradicts stronger ones are dropped, and no others. */
#include "../testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/linear.h"
#include "sfm/view_graph.h"

enum { PICTURES = 40, NEIGHBOURS = 6, MOST = PICTURES * (NEIGHBOURS + 1) };

#define TURN 6.283185307179586

static sf_matched_pair pairs[MOST];
static size_t pair_count;

static void add_pair(size_t first, size_t second, size_t count, double angle) {
    const double phi[3] = {0, angle, 0};
    sf_matched_pair *p = &pairs[pair_count++];
    *p = (sf_matched_pair){.first = (uint32_t)first, .second = (uint32_t)second, .count = count};
    p->geometry.kind = SF_PAIR_GENERAL, p->geometry.has_pose = 1;
    sf_rotation_exp(phi, p->geometry.T.R);
}

/* Cameras on a ring that look outwards; of neighbours, the nearest have most matches. All turns are `stretch`
 * times the true ones, as with a wrong focal length. */
static void make_ring(double stretch) {
    pair_count = 0;
    for (size_t i = 0; i < PICTURES; i++)
        for (size_t k = 1; k <= NEIGHBOURS; k++) {
            size_t other = (i + k) % PICTURES;
            double turn = stretch * TURN * (double)k / PICTURES;
            add_pair(i < other ? i : other, i < other ? other : i, 400 / k, i < other ? turn : -turn);
        }
}

static size_t drop_some(void) {
    sf_context *ctx = test_context();
    size_t dropped;
    assert_ok(ctx, sf_view_graph_filter(ctx, PICTURES, pairs, pair_count, &dropped));
    sf_context_destroy(&ctx);
    return dropped;
}

/* Each of half of the pictures also matches the one opposite, and those beside that, whose pattern is the
 * same. */
static void opposite_walls_are_told_apart(void **state) {
    (void)state;
    make_ring(1);
    size_t right = pair_count;
    for (size_t i = 0; i < PICTURES / 2; i++) add_pair(i, i + PICTURES / 2, 180, 0.02);
    size_t wrong = pair_count - right;
    assert_int_equal(drop_some(), wrong);
    for (size_t i = 0; i < pair_count; i++) assert_int_equal(pairs[i].count > 0, i < right);
}

/* What adds up around the ring is no contradiction. */
static void a_wrong_focal_length_drops_none(void **state) {
    (void)state;
    static const double stretches[] = {1, 0.85, 1.2};
    for (size_t i = 0; i < sizeof stretches / sizeof *stretches; i++) {
        make_ring(stretches[i]);
        assert_int_equal(drop_some(), 0);
    }
}

/* Pairs without a pose, pictures without pairs, and no pairs at all. */
static void what_says_nothing_stays(void **state) {
    (void)state;
    make_ring(1);
    for (size_t i = 0; i < pair_count; i++)
        if (pairs[i].first == 7 || pairs[i].second == 7) pairs[i].count = 0;
    size_t at = pair_count;
    add_pair(0, PICTURES / 2, 90, 0);
    pairs[at].geometry.has_pose = 0;
    assert_int_equal(drop_some(), 0);
    assert_int_equal(pairs[at].count, 90);
    pair_count = 0;
    assert_int_equal(drop_some(), 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(opposite_walls_are_told_apart),
        cmocka_unit_test(a_wrong_focal_length_drops_none),
        cmocka_unit_test(what_says_nothing_stays),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
