/* test_sfm_focal.c - the focal length of a camera from pairs of its pictures. */
#include "../testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/linear.h"
#include "base/statistics.h"
#include "sfm/essential.h"
#include "sfm/focal.h"
#include "sfm/two_view.h"
#include "sfm_fixture.h"

enum { VIEWS = 12, POINTS = 150, MOST = 3 * VIEWS };

/* Of focal length `focal` in units of the picture's longer side; px are of 1000 a side. */
typedef struct capture {
    sf_rigid poses[VIEWS];
    double seen[VIEWS][2 * POINTS];
} capture;

/* Views around points of unit size; uneven: their distances and targets differ. */
static void take(capture *c, sf_rng *rng, double focal, double uneven, double noise) {
    double points[3 * POINTS];
    for (int i = 0; i < 3 * POINTS; i++) points[i] = sf_rng_uniform(rng) - 0.5;
    for (int v = 0; v < VIEWS; v++) {
        double turn = 6.2831853 * v / VIEWS, far = 2.2 * focal * (1 + uneven * sf_rng_normal(rng));
        const double center[3] = {far * cos(turn), -0.3 * far + uneven * sf_rng_normal(rng), far * sin(turn)};
        const double target[3] = {uneven * sf_rng_normal(rng), uneven * sf_rng_normal(rng), 0};
        sfm_look_at(center, target, &c->poses[v]);
        for (size_t i = 0; i < POINTS; i++) {
            double p[3];
            sf_rigid_apply(&c->poses[v], points + 3 * i, p);
            for (size_t k = 0; k < 2; k++)
                c->seen[v][2 * i + k] = focal * p[k] / p[2] + noise * sf_rng_normal(rng);
        }
    }
}

/* Fundamental matrices of neighbours, up to three apart. */
static size_t make_pairs(const capture *c, sf_focal_pair pairs[MOST], double wrong, sf_rng *rng) {
    static double scratch[SF_TWO_VIEW_SCRATCH * POINTS], b[2 * POINTS];
    uint8_t inliers[POINTS];
    size_t count = 0;
    sf_two_view_options o = sf_two_view_options_default();
    o.threshold = 2.0 / 1000;
    for (int v = 0; v < VIEWS; v++)
        for (int w = v + 1; w < v + 4; w++) {
            sf_two_view found;
            memcpy(b, c->seen[w % VIEWS], sizeof b);
            for (size_t i = 0; i < 2 * POINTS; i += 2)
                if (sf_rng_uniform(rng) < wrong) b[i] = sf_rng_uniform(rng) - 0.5, b[i + 1] = b[i] / 2;
            sf_two_view_find(&o, c->seen[v], b, POINTS, scratch, inliers, &found);
            if (found.kind != SF_PAIR_GENERAL) continue;
            memcpy(pairs[count].F, found.F, sizeof found.F);
            pairs[count++].weight = (double)found.count;
        }
    return count;
}

/* Truth has a misfit of 0, and a wrong focal length has one. */
static void misfits(void **state) {
    (void)state;
    static sfm_pair p;
    sf_rng rng;
    sf_rng_seed(&rng, 1);
    for (int i = 0; i < 200; i++) {
        double F[9];
        sfm_make_pair(&p, &rng, SFM_GENERAL, 0, 0, 0);
        sf_essential_of_pose(&p.T, F);
        for (int k = 0; k < 9; k++) F[k] /= (k / 3 < 2 ? 1.3 : 1) * (k % 3 < 2 ? 1.3 : 1);
        assert_true(sf_focal_misfit(F, 1.3) < 1e-7);
        assert_true(sf_focal_misfit(F, 0.4) <= 1 && sf_focal_misfit(F, 4) >= 0);
    }
    const double nothing[9] = {0};
    assert_float_equal(sf_focal_misfit(nothing, 1), 1, 0);
}

static void focal_lengths_are_found(void **state) {
    (void)state;
    static capture c;
    static sf_focal_pair pairs[MOST];
    static const double truth[] = {0.6, 0.85, 1.2, 2, 3};
    sf_rng rng;
    sf_rng_seed(&rng, 2);
    for (size_t i = 0; i < sizeof truth / sizeof *truth; i++)
        for (int wrong = 0; wrong < 2; wrong++) {
            double contrast;
            take(&c, &rng, truth[i], 0.12, 0.5 / 1000);
            size_t count = make_pairs(&c, pairs, 0.25 * wrong, &rng);
            double focal = sf_focal_vote(pairs, count, 0.3, 6, 1.2, &contrast);
            print_message("%.2f: %.3f from %zu pairs, contrast %.2f\n", truth[i], focal, count, contrast);
            assert_true(fabs(focal / truth[i] - 1) < 0.1);
        }
}

/* On an even ring no pair says anything of the focal length: the guess decides. */
static void rings_leave_it_open(void **state) {
    (void)state;
    static capture c;
    static sf_focal_pair pairs[MOST];
    double contrast;
    sf_rng rng;
    sf_rng_seed(&rng, 3);
    take(&c, &rng, 0.9, 0, 0.5 / 1000);
    size_t count = make_pairs(&c, pairs, 0, &rng);
    double focal = sf_focal_vote(pairs, count, 0.3, 6, 1.2, &contrast);
    print_message("ring: %.3f for 0.9, guess 1.2, contrast %.2f\n", focal, contrast);
    assert_true(focal > 0.6 && focal < 1.8);
    assert_float_equal(sf_focal_vote(pairs, 0, 0.3, 6, 1.2, &contrast), 1.2, 0);
    assert_float_equal(contrast, 0, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(misfits),
        cmocka_unit_test(focal_lengths_are_found),
        cmocka_unit_test(rings_leave_it_open),
    };
    return cmocka_run_group_tests_name("sfm_focal", tests, NULL, NULL);
}
