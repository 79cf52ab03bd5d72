/* test_pose_graph.c - derivatives of a pose graph against differences, and drift that a closed loop takes
 * away. */
#include "../testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/linear.h"
#include "base/rng.h"
#include "pose/pose_graph.h"

enum { N = SF_SIMILAR_TWIST, POSES = 120, MOST_EDGES = 3 * POSES };

static const double pi = 3.141592653589793;

static sf_similar random_pose(sf_rng *rng, double turn) {
    sf_similar S = {exp(0.2 * sf_rng_normal(rng)), {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0}}};
    double twist[N] = {0};
    for (int k = 0; k < 6; k++) twist[k] = (k < 3 ? 2 : turn) * sf_rng_normal(rng);
    sf_similar_move(&S, twist);
    return S;
}

static void similarities_chain(void **state) {
    (void)state;
    sf_rng rng;
    sf_rng_seed(&rng, 1);
    for (int trial = 0; trial < 20; trial++) {
        sf_similar a = random_pose(&rng, 1), b = random_pose(&rng, 1), c, back;
        const double p[3] = {sf_rng_normal(&rng), sf_rng_normal(&rng), sf_rng_normal(&rng)};
        double q[3], r[3], s[3];
        sf_similar_compose(&a, &b, &c);
        sf_similar_apply(&b, p, q), sf_similar_apply(&a, q, r), sf_similar_apply(&c, p, s);
        for (int k = 0; k < 3; k++) assert_float_equal(r[k], s[k], 1e-12);
        sf_similar_invert(&c, &back);
        sf_similar_apply(&back, s, q);
        for (int k = 0; k < 3; k++) assert_float_equal(q[k], p[k], 1e-12);
    }
}

/* Central differences with a step h err by the third derivative times h^2 / 6, some 1e-10 here, and by
 * rounding, 1e-16 / h. */
static void derivatives_are_those_of_the_residual(void **state) {
    (void)state;
    const double h = 1e-5;
    sf_rng rng;
    sf_rng_seed(&rng, 2);
    for (int trial = 0; trial < 20; trial++) {
        sf_similar both[2] = {random_pose(&rng, 1), random_pose(&rng, 1)}, way = random_pose(&rng, 0.1), off;
        sf_similar_invert(&both[1], &off);
        sf_similar_compose(&both[0], &off, &off); /* a residual of a turn far from half a turn */
        sf_similar_compose(&way, &off, &way);
        double r[N], J[2][N * N];
        sf_graph_residual(&both[0], &both[1], &way, r, J[0], J[1]);
        for (int which = 0; which < 2; which++)
            for (int k = 0; k < N; k++) {
                double ends[2][N], twist[N] = {0};
                for (int sign = 0; sign < 2; sign++) {
                    sf_similar moved[2] = {both[0], both[1]};
                    twist[k] = sign ? h : -h;
                    sf_similar_move(&moved[which], twist);
                    sf_graph_residual(&moved[0], &moved[1], &way, ends[sign], NULL, NULL);
                }
                for (int i = 0; i < N; i++)
                    assert_float_equal(J[which][N * i + k], (ends[1][i] - ends[0][i]) / (2 * h), 1e-7);
            }
    }
}

/* Cameras on a circle of radius 3 that look outwards, and what is measured from each to the two before it. */
typedef struct circle {
    sf_similar truth[POSES];
    sf_graph_pose poses[POSES];
    sf_graph_edge edges[MOST_EDGES];
    size_t count;
} circle;

static void measure(circle *c, size_t a, size_t b, double turn, double move, double scale, sf_rng *rng) {
    sf_graph_edge *edge = &c->edges[c->count++];
    double twist[N];
    *edge = (sf_graph_edge){.a = (uint32_t)a, .b = (uint32_t)b};
    edge->turn = 1 / (turn * turn), edge->move = 1 / (move * move);
    edge->scale = scale > 0 ? 1 / (scale * scale) : 1;
    sf_similar_invert(&c->truth[b], &edge->way);
    sf_similar_compose(&c->truth[a], &edge->way, &edge->way);
    for (int k = 0; k < N; k++) twist[k] = (k < 3 ? move : k < 6 ? turn : scale) * sf_rng_normal(rng);
    sf_similar_move(&edge->way, twist);
}

static circle make_circle(uint64_t seed, double turn, double move, double scale) {
    circle c = {.count = 0};
    sf_rng rng;
    sf_rng_seed(&rng, seed);
    for (size_t i = 0; i < POSES; i++) {
        double angle = 2 * pi * (double)i / POSES, s = sin(angle), co = cos(angle);
        const double R[9] = {-s, co, 0, 0, 0, -1, co, s, 0}, center[3] = {3 * co, 3 * s, 1.5};
        c.truth[i] = (sf_similar){1, {{0}, {0}}};
        memcpy(c.truth[i].rigid.R, R, sizeof R);
        for (int k = 0; k < 3; k++) c.truth[i].rigid.t[k] = -sf_dot3(R + 3 * k, center);
        if (i) measure(&c, i, i - 1, turn, move, scale, &rng);
        if (i > 1) measure(&c, i, i - 2, turn, move, scale, &rng);
    }
    c.poses[0] = (sf_graph_pose){.at = c.truth[0], .is_fixed = 1};
    for (size_t i = 1; i < POSES; i++) { /* as tracked: each from the one before */
        const sf_graph_edge *edge = &c.edges[i == 1 ? 0 : 2 * i - 3];
        assert_true(edge->a == i && edge->b == i - 1);
        sf_similar_compose(&edge->way, &c.poses[i - 1].at, &c.poses[i].at);
    }
    return c;
}

/* Root mean square of the distances between the cameras' places and the truth. */
static double drift(const circle *c) {
    double sum = 0;
    for (size_t i = 0; i < POSES; i++) {
        double at[3], truth[3];
        sf_rigid_center(&c->truth[i].rigid, truth);
        sf_similar back;
        sf_similar_invert(&c->poses[i].at, &back);
        memcpy(at, back.rigid.t, sizeof at);
        for (int k = 0; k < 3; k++) sum += pow(at[k] - truth[k], 2) / POSES;
    }
    return sqrt(sum);
}

static sf_pose_graph graph_of(circle *c, int with_scale) {
    return (sf_pose_graph){c->poses, POSES, c->edges, c->count, with_scale};
}

static void drift_goes_where_a_circle_closes(void **state) {
    (void)state;
    sf_context *ctx = test_context_threads(1);
    for (int with_scale = 0; with_scale < 2; with_scale++)
        for (uint64_t seed = 1; seed <= 5; seed++) {
            circle c = make_circle(seed, 0.005, 0.01, with_scale ? 0.01 : 0);
            sf_rng rng;
            double before = drift(&c), cost[2];
            const sf_pose_graph open = graph_of(&c, with_scale);
            assert_ok(ctx, sf_pose_graph_adjust(ctx, &open, 20, &cost[0]));
            double along = drift(&c);
            sf_rng_seed(&rng, 100 + seed);
            measure(&c, POSES - 1, 0, 0.005, 0.01, with_scale ? 0.01 : 0, &rng);
            const sf_pose_graph closed = graph_of(&c, with_scale);
            assert_ok(ctx, sf_pose_graph_adjust(ctx, &closed, 20, &cost[1]));
            double after = drift(&c);
            print_message(
                "%s scales: %.3f off as tracked, %.3f in the graph, %.3f closed; costs %.1f, %.1f\n",
                with_scale ? "with" : "without", before, along, after, cost[0], cost[1]);
            assert_true(after < 0.5 * before);
            /* Half the sum of squares has half the mean of chi squared with as many degrees of freedom as
             * residuals are more than unknowns, and a standard deviation of half sqrt(2 n). */
            double n = (with_scale ? 7.0 : 6.0) * ((double)c.count - POSES + 1);
            assert_true(fabs(cost[1] - n / 2) < 5 * sqrt(n / 2));
            for (size_t i = 0; i < POSES && !with_scale; i++)
                assert_float_equal(c.poses[i].at.scale, 1, 1e-12);
        }
    sf_context_destroy(&ctx);
}

/* Where nothing is measured wrongly, the truth is found from far off. */
static void exact_measurements_give_the_truth(void **state) {
    (void)state;
    sf_context *ctx = test_context_threads(1);
    circle c = make_circle(1, 1e-9, 1e-9, 1e-9);
    sf_rng rng;
    sf_rng_seed(&rng, 3);
    measure(&c, POSES - 1, 0, 1e-9, 1e-9, 1e-9, &rng);
    for (size_t i = 1; i < POSES; i++) {
        double twist[N];
        for (int k = 0; k < N; k++) twist[k] = 0.05 * sf_rng_normal(&rng);
        sf_similar_move(&c.poses[i].at, twist);
    }
    const sf_pose_graph graph = graph_of(&c, 1);
    assert_ok(ctx, sf_pose_graph_adjust(ctx, &graph, 50, NULL));
    assert_true(drift(&c) < 1e-6);
    sf_context_destroy(&ctx);
}

/* A pose that is known holds its part of the graph as one that is fixed does. */
static void known_poses_hold_the_others(void **state) {
    (void)state;
    sf_context *ctx = test_context_threads(1);
    circle c = make_circle(4, 0.005, 0.01, 0.01);
    double before = drift(&c);
    c.poses[0].is_fixed = 0;
    for (size_t i = 0; i < POSES; i += POSES / 4) {
        c.poses[i].is_known = 1;
        c.poses[i].prior.pose = c.truth[i].rigid;
        for (int k = 0; k < 6; k++) c.poses[i].prior.information[7 * k] = 1e6;
    }
    const sf_pose_graph graph = graph_of(&c, 1);
    assert_ok(ctx, sf_pose_graph_adjust(ctx, &graph, 20, NULL));
    assert_true(drift(&c) < 0.25 * before);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(similarities_chain),
        cmocka_unit_test(derivatives_are_those_of_the_residual),
        cmocka_unit_test(drift_goes_where_a_circle_closes),
        cmocka_unit_test(exact_measurements_give_the_truth),
        cmocka_unit_test(known_poses_hold_the_others),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
