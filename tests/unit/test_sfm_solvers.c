/* test_sfm_solvers.c - the minimal solvers of src/sfm on thousands of random configurations. */
#include "../testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/linear.h"
#include "base/statistics.h"
#include "pose/homography.h"
#include "sfm/epipolar.h"
#include "sfm/essential.h"
#include "sfm/fundamental.h"
#include "sfm/null_space.h"
#include "sfm/plane.h"
#include "sfm/polynomial.h"
#include "sfm/relative_pose.h"
#include "sfm_fixture.h"

enum { TRIALS = 2000 };

static const uint32_t in_order[8] = {0, 1, 2, 3, 4, 5, 6, 7};

/* The share of the trials whose error is above `most`, and the median error. */
static double share_above(const double *errors, size_t count, double most) {
    size_t above = 0;
    for (size_t i = 0; i < count; i++) above += !(errors[i] <= most);
    return (double)above / (double)count;
}

static void say(const char *what, double *errors, size_t count) {
    double sorted[TRIALS];
    memcpy(sorted, errors, count * sizeof *errors);
    double middle = sf_median(sorted, count);
    print_message("%s: median error %.1e, %.1e of 99 %%, %.1e at most\n", what, middle,
                  sf_ranked(sorted, count, count * 99 / 100), sf_ranked(sorted, count, count - 1));
}

static void roots_of_polynomials(void **state) {
    (void)state;
    sf_rng rng;
    sf_rng_seed(&rng, 1);
    for (int trial = 0; trial < TRIALS; trial++) {
        int degree = 1 + trial % SF_DEGREE_MOST, complex = trial % 3 == 0 && degree > 2 ? 2 : 0;
        double c[SF_DEGREE_MOST + 1] = {1}, truth[SF_DEGREE_MOST], found[SF_DEGREE_MOST];
        for (int i = 0; i < degree - complex; i++) {
            truth[i] = -2 + (double)i / 2 + 0.3 * sf_rng_uniform(&rng);
            for (int k = i + 1; k >= 0; k--) c[k] = (k ? c[k - 1] : 0) - truth[i] * (k <= i ? c[k] : 0);
        }
        if (complex) { /* times x^2 + 0.5 */
            for (int k = degree; k >= 0; k--)
                c[k] = (k >= 2 ? c[k - 2] : 0) + (k <= degree - 2 ? 0.5 * c[k] : 0);
        }
        assert_int_equal(sf_polynomial_roots(c, degree, found), degree - complex);
        for (int i = 0; i < degree - complex; i++) assert_float_equal(found[i], truth[i], 1e-8);
    }
    double roots[SF_DEGREE_MOST];
    const double none[3] = {1, 0, 1}, nothing[3] = {0}, flat[1] = {3}, line[3] = {1, 2, 0};
    assert_int_equal(sf_polynomial_roots(none, 2, roots), 0);
    assert_int_equal(sf_polynomial_roots(nothing, 2, roots), 0);
    assert_int_equal(sf_polynomial_roots(flat, 0, roots), 0);
    assert_int_equal(sf_polynomial_roots(line, 2, roots), 1);
    assert_float_equal(roots[0], -0.5, 1e-15);
}

static void null_spaces(void **state) {
    (void)state;
    sf_rng rng;
    sf_rng_seed(&rng, 2);
    for (int trial = 0; trial < 200; trial++) {
        int m = 1 + trial % 8;
        double A[72], kept[72], N[72];
        for (int i = 0; i < 9 * m; i++) kept[i] = A[i] = sf_rng_normal(&rng);
        sf_null_space(m, A, N);
        for (int j = 0; j < 9 - m; j++) {
            for (int i = 0; i < m + 9 - m; i++) {
                const double *row = i < m ? kept + 9 * i : N + (size_t)(9 * (i - m));
                double sum = 0;
                for (int k = 0; k < 9; k++) sum += row[k] * N[9 * j + k];
                assert_float_equal(sum, i - m == j, 1e-13);
            }
        }
    }
}

/* The nearest of the matrices found. */
static double nearest(const double *found, int count, const double truth[9]) {
    double least = INFINITY;
    for (int i = 0; i < count; i++) least = fmin(least, sfm_matrix_error(found + (size_t)(9 * i), truth, 9));
    return least;
}

static void five_points(sfm_layout layout, const char *what) {
    static sfm_pair p;
    static double errors[TRIALS];
    sf_rng rng;
    sf_rng_seed(&rng, 3);
    for (int i = 0; i < TRIALS; i++) {
        double E[9 * SF_ESSENTIAL_MOST], truth[9];
        sfm_make_pair(&p, &rng, layout, 5, 0, 0);
        sf_essential_of_pose(&p.T, truth);
        int count = sf_essential_from_5(p.a, p.b, in_order, E);
        errors[i] = nearest(E, count, truth);
        for (int k = 0; k < count; k++)
            for (size_t m = 0; m < 5; m++) /* each is a solution */
                assert_true(sf_sampson(E + (size_t)(9 * k), p.a + 2 * m, p.b + 2 * m) < 1e-10);
    }
    say(what, errors, TRIALS);
    assert_true(share_above(errors, TRIALS, 1e-7) <= 0.005);
    assert_true(sf_median(errors, TRIALS) < 1e-12);
}

static void essential_from_five(void **state) {
    (void)state;
    five_points(SFM_GENERAL, "five points");
    five_points(SFM_PLANE, "five points of a plane");
}

static void fundamental_from_seven_and_eight(void **state) {
    (void)state;
    static sfm_pair p;
    static double seven[TRIALS], eight[TRIALS];
    sf_rng rng;
    sf_rng_seed(&rng, 4);
    for (int i = 0; i < TRIALS; i++) {
        double F[9 * SF_FUNDAMENTAL_MOST], truth[9], weights[20];
        sfm_make_pair(&p, &rng, SFM_GENERAL, 20, 0, 0);
        sf_essential_of_pose(&p.T, truth);
        seven[i] = nearest(F, sf_fundamental_from_7(p.a, p.b, in_order, F), truth);
        assert_true(sf_fundamental_from_8(p.a, p.b, NULL, 20, F));
        eight[i] = nearest(F, 1, truth);
        assert_false(sf_fundamental_from_8(p.a, p.b, NULL, 7, F));
        for (int k = 0; k < 20; k++) weights[k] = k < 12;
        p.b[30] += 1; /* where the weight is 0 */
        assert_true(sf_fundamental_refine(p.a, p.b, weights, 20, 2, F));
        eight[i] = fmax(eight[i], nearest(F, 1, truth));
    }
    say("seven points", seven, TRIALS);
    say("eight points and more", eight, TRIALS);
    assert_true(share_above(seven, TRIALS, 1e-7) <= 0.005 && sf_median(seven, TRIALS) < 1e-12);
    assert_true(share_above(eight, TRIALS, 1e-7) <= 0.005 && sf_median(eight, TRIALS) < 1e-11);
}

/* Also of rotations, where t is whatever it likes. */
static void poses_of_essentials(void **state) {
    (void)state;
    static sfm_pair p;
    sf_rng rng;
    sf_rng_seed(&rng, 5);
    for (int i = 0; i < TRIALS; i++) {
        double E[9];
        sf_rigid T;
        sfm_make_pair(&p, &rng, SFM_GENERAL, 10, 0, 0);
        sf_essential_of_pose(&p.T, E);
        for (int k = 0; k < 9; k++) E[k] *= i % 2 ? -3 : 0.01;
        assert_int_equal(sf_essential_pose(E, p.a, p.b, NULL, 10, &T), 10);
        assert_true(sfm_angle_between(T.R, p.T.R) < 1e-12 && sfm_direction_error(T.t, p.T.t) < 1e-12);
    }
    const double nothing[9] = {0};
    sf_rigid T;
    assert_int_equal(sf_essential_pose(nothing, p.a, p.b, NULL, 10, &T), 0);
}

static void homographies_of_planes(void **state) {
    (void)state;
    static sfm_pair p;
    static double errors[TRIALS];
    sf_rng rng;
    sf_rng_seed(&rng, 6);
    for (int i = 0; i < TRIALS; i++) {
        double H[9], normals[12], least = INFINITY;
        sf_rigid poses[4];
        sfm_make_pair(&p, &rng, SFM_PLANE, i % 2 ? 4 : 12, 0, 0);
        assert_true(sf_homography_fit(p.a, p.b, NULL, p.count, H));
        int count = sf_homography_poses(H, poses, normals);
        assert_int_equal(count, 4);
        for (int k = 0; k < count; k++) {
            double off = sfm_angle_between(poses[k].R, p.T.R) + sfm_direction_error(poses[k].t, p.T.t);
            assert_float_equal(sf_dot3(normals + 3 * k, normals + 3 * k), 1, 1e-9);
            least = fmin(least, off);
        }
        errors[i] = least;
    }
    say("poses of homographies", errors, TRIALS);
    assert_true(share_above(errors, TRIALS, 1e-6) <= 0.005 && sf_median(errors, TRIALS) < 1e-10);
}

static void rotations(void **state) {
    (void)state;
    static sfm_pair p;
    sf_rng rng;
    sf_rng_seed(&rng, 7);
    for (int i = 0; i < 300; i++) {
        double R[9], H[9];
        sf_rigid poses[4];
        sfm_make_pair(&p, &rng, SFM_ROTATION, 6, 0, 0);
        assert_true(sf_rotation_between(p.a, p.b, NULL, 6, R));
        assert_true(sfm_angle_between(R, p.T.R) < 1e-7); /* the eigenvector of a square */
        memcpy(H, p.T.R, sizeof H);
        for (int k = 0; k < 9; k++) H[k] *= -2;
        assert_int_equal(sf_homography_poses(H, poses, NULL), 1);
        assert_true(sfm_angle_between(poses[0].R, p.T.R) < 1e-12 && sf_dot3(poses[0].t, poses[0].t) == 0);
    }
    const double nothing[9] = {0}, one[2] = {0};
    double R[9];
    sf_rigid poses[4];
    assert_int_equal(sf_homography_poses(nothing, poses, NULL), 0);
    assert_false(sf_rotation_between(one, one, NULL, 1, R));
}

/* Four points of which three are in a line, all in a line, all at one place. */
static void degenerate_samples(void **state) {
    (void)state;
    static sfm_pair p;
    double H[9], F[27], E[9 * SF_ESSENTIAL_MOST];
    sf_rng rng;
    sf_rng_seed(&rng, 8);
    sfm_make_pair(&p, &rng, SFM_GENERAL, 8, 0, 0);
    for (size_t i = 0; i < 8; i++) p.a[2 * i + 1] = 2 * p.a[2 * i] + 0.1;
    assert_false(sf_homography_fit(p.a, p.b, NULL, 8, H));
    for (size_t i = 0; i < 16; i++) p.a[i] = p.b[i] = 0.25;
    assert_false(sf_fundamental_from_8(p.a, p.b, NULL, 8, F));
    int count = sf_essential_from_5(p.a, p.b, in_order, E);
    for (int k = 0; k < 9 * count; k++) assert_true(isfinite(E[k]));
    count = sf_fundamental_from_7(p.a, p.b, in_order, F);
    for (int k = 0; k < 9 * count; k++) assert_true(isfinite(F[k]));
}

/* With noise the refined pose's error is what the noise makes it: the mean of the squared residuals over the
 * degrees of freedom left is the noise's square (Sampson's distance has one of a's and b's four). */
static void relative_poses_are_refined(void **state) {
    (void)state;
    static sfm_pair p;
    sf_rng rng;
    double mean = 0, noise = 1e-3;
    sf_rng_seed(&rng, 9);
    for (int i = 0; i < 200; i++) {
        double twist[6] = {0.02, -0.02, 0.01, 0.01, 0.01, -0.02}, length;
        sfm_make_pair(&p, &rng, SFM_GENERAL, 105, i < 100 ? 0 : noise, 0);
        sf_rigid T = p.T;
        sf_rigid_move(&T, twist);
        length = sqrt(sf_dot3(T.t, T.t));
        for (int k = 0; k < 3; k++) T.t[k] /= length;
        double sum = sf_relative_pose_refine(p.a, p.b, NULL, p.count, 20, &T);
        if (i < 100) {
            assert_true(sfm_angle_between(T.R, p.T.R) < 1e-8 && sfm_direction_error(T.t, p.T.t) < 1e-7);
        } else {
            mean += sum / 100 / 100;
        }
    }
    print_message("noise of %g: %g by the residuals\n", noise, sqrt(mean));
    assert_true(fabs(sqrt(mean) / noise - 1) < 0.03); /* 1 / sqrt(2 x 10000) is 0.007 */
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(roots_of_polynomials),
        cmocka_unit_test(null_spaces),
        cmocka_unit_test(essential_from_five),
        cmocka_unit_test(fundamental_from_seven_and_eight),
        cmocka_unit_test(poses_of_essentials),
        cmocka_unit_test(homographies_of_planes),
        cmocka_unit_test(rotations),
        cmocka_unit_test(degenerate_samples),
        cmocka_unit_test(relative_poses_are_refined),
    };
    return cmocka_run_group_tests_name("sfm_solvers", tests, NULL, NULL);
}
