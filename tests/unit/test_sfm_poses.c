/* test_sfm_poses.c - poses of cameras from points, and points from cameras, against the truth. */
#include "../testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/linear.h"
#include "base/statistics.h"
#include "sfm/absolute_pose.h"
#include "sfm/triangulate.h"
#include "sfm_fixture.h"

enum { TRIALS = 3000 };

static const sf_lens lens = {
    .fx = 800, .fy = 810, .cx = 400, .cy = 300, .k1 = -0.1, .k2 = 0.02, .p1 = 1e-3, .p2 = -5e-4};

static double pose_error(const sf_rigid *a, const sf_rigid *b) {
    double off = 0;
    for (int k = 0; k < 3; k++) off += pow(a->t[k] - b->t[k], 2);
    return sqrt(off) + sfm_angle_between(a->R, b->R);
}

static void poses_from_three(void **state) {
    (void)state;
    static sfm_pair p;
    static double errors[TRIALS];
    const uint32_t sample[3] = {2, 0, 1};
    sf_rng rng;
    size_t solutions = 0, above = 0;
    sf_rng_seed(&rng, 1);
    for (int i = 0; i < TRIALS; i++) {
        sf_rigid poses[SF_P3P_MOST];
        sfm_make_pair(&p, &rng, i % 3 ? SFM_GENERAL : SFM_PLANE, 3, 0, 0);
        int count = sf_pose_from_3(p.points, p.b, sample, poses);
        errors[i] = INFINITY;
        for (int k = 0; k < count; k++) {
            errors[i] = fmin(errors[i], pose_error(&poses[k], &p.T));
            for (size_t m = 0; m < 3; m++) { /* each is a solution */
                double q[3];
                sf_rigid_apply(&poses[k], p.points + 3 * m, q);
                assert_true(q[2] > 0 && fabs(q[0] / q[2] - p.b[2 * m]) < 1e-6 &&
                            fabs(q[1] / q[2] - p.b[2 * m + 1]) < 1e-6);
            }
        }
        solutions += (size_t)count;
        above += !(errors[i] < 1e-6);
    }
    print_message("three points: median error %.1e, %zu of %d above 1e-6, %.2f solutions\n",
                  sf_median(errors, TRIALS), above, TRIALS, (double)solutions / TRIALS);
    assert_true(sf_median(errors, TRIALS) < 1e-12 && above <= TRIALS / 200);
    for (size_t k = 0; k < 3; k++)
        for (size_t m = 0; m < 3; m++) p.points[3 * k + m] = (double)k * (double)(m + 1); /* in a line */
    sf_rigid poses[SF_P3P_MOST];
    assert_int_equal(sf_pose_from_3(p.points, p.b, sample, poses), 0);
}

/* The pose and the focal length from pixels, from a start that is off; two wrong points in 40. */
static void poses_are_refined(void **state) {
    (void)state;
    static sfm_pair p;
    double pixels[80];
    uint32_t members[40];
    sf_rng rng;
    sf_rng_seed(&rng, 2);
    for (int i = 0; i < 100; i++) {
        const double twist[6] = {0.1, -0.05, 0.1, 0.02, -0.03, 0.02};
        sf_lens guess = lens;
        sfm_make_pair(&p, &rng, SFM_GENERAL, 40, 0, 0);
        for (uint32_t m = 0; m < 40; m++) {
            double q[3];
            members[m] = m;
            sf_rigid_apply(&p.T, p.points + 3 * (size_t)m, q);
            assert_true(sf_lens_project(&lens, q, pixels + 2 * (size_t)m, NULL, NULL));
        }
        for (int k = 0; k < 4; k++) pixels[k] += 50;
        sf_rigid T = p.T;
        sf_rigid_move(&T, twist);
        if (i % 2) guess.fx *= 1.1, guess.fy *= 1.1;
        const sf_correspondences s = {p.points, pixels, 40};
        sf_pose_refine(&s, members, 40, 20, 0, &guess, &T); /* first widely, */
        sf_pose_refine(&s, members, 40, 0.05, i % 2, &guess, &T);
        assert_true(pose_error(&T, &p.T) < 1e-4 && fabs(guess.fx / lens.fx - 1) < 1e-4);
        sf_pose_refine(&s, members + 2, 38, 1, i % 2, &guess, &T); /* and with all but these two */
        assert_true(pose_error(&T, &p.T) < 1e-9 && fabs(guess.fx / lens.fx - 1) < 1e-9);
        assert_true(isinf(sf_pose_refine(&s, members, 0, 1, 0, &guess, &T)));
    }
}

enum { EYES = 6 };

/* Cameras on an arc around a point, and what they see of it. */
static void look(sf_rng *rng, double noise, const double at[3], sf_rigid poses[EYES], sf_sight sights[EYES]) {
    for (int i = 0; i < EYES; i++) {
        double center[3] = {3 * sin(0.2 * i), 0.3 * sf_rng_normal(rng), -3 * cos(0.2 * i)}, p[3];
        const double target[3] = {0.3 * sf_rng_normal(rng), 0.3 * sf_rng_normal(rng), 0};
        sfm_look_at(center, target, &poses[i]);
        sights[i].lens = &lens, sights[i].pose = &poses[i], sights[i].unit = 1;
        sf_rigid_apply(&poses[i], at, p);
        assert_true(sf_lens_project(&lens, p, sights[i].pixel, NULL, NULL));
        for (int k = 0; k < 2; k++) sights[i].pixel[k] += noise * sf_rng_normal(rng);
        assert_true(sf_lens_ray(&lens, sights[i].pixel, sights[i].ray));
    }
}

static double distance(const double a[3], const double b[3]) {
    return sqrt(pow(a[0] - b[0], 2) + pow(a[1] - b[1], 2) + pow(a[2] - b[2], 2));
}

/* Without noise the truth; with it, 2 n - 3 residuals' degrees of freedom are left. */
static void points_are_triangulated(void **state) {
    (void)state;
    sf_rng rng;
    double squares = 0, freedom = 0;
    sf_rng_seed(&rng, 3);
    for (int i = 0; i < 2000; i++) {
        size_t count = 2 + (size_t)i % (EYES - 1);
        const double truth[3] = {0.5 * sf_rng_normal(&rng), 0.5 * sf_rng_normal(&rng),
                                 0.5 * sf_rng_normal(&rng)};
        double at[3], noise = i < 1000 ? 0 : 0.5;
        sf_rigid poses[EYES];
        sf_sight sights[EYES];
        look(&rng, noise, truth, poses, sights);
        assert_true(sf_triangulate_rays(sights, count, at));
        if (noise == 0) assert_true(distance(at, truth) < 1e-8);
        double mean = sf_triangulate_refine(sights, count, at);
        if (noise == 0) assert_true(distance(at, truth) < 1e-9);
        if (noise > 0) squares += mean * (double)count, freedom += 2 * (double)count - 3;
        double widest = 1;
        for (size_t k = 0; k < count; k++)
            for (size_t m = 0; m < k; m++) {
                double a[3], b[3];
                sf_rigid_center(&poses[k], a), sf_rigid_center(&poses[m], b);
                for (int l = 0; l < 3; l++) a[l] -= truth[l], b[l] -= truth[l];
                widest = fmin(widest, sf_dot3(a, b) / sqrt(sf_dot3(a, a) * sf_dot3(b, b)));
            }
        assert_true(sf_is_wide(sights, count, truth, widest + 1e-9));
        assert_false(sf_is_wide(sights, count, truth, widest - 1e-9));
        assert_float_equal(sf_sight_error(&sights[0], truth), 0, noise == 0 ? 1e-9 : 4);
    }
    print_message("noise of 0.5 px: %.3f px by the residuals\n", sqrt(squares / freedom));
    assert_true(fabs(sqrt(squares / freedom) / 0.5 - 1) < 0.04); /* 1 / sqrt(2 x 5000) is 0.01 */
}

/* Parallel rays, points behind a camera, angles of pairs. */
static void rays_that_do_not_meet(void **state) {
    (void)state;
    const sf_rigid first = {.R = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    sf_rigid beside = first;
    double at[3], behind[3] = {0, 0, -2};
    beside.t[0] = -1;
    sf_sight sights[2] = {{&lens, &first, {0}, {0.1, 0}, 1}, {&lens, &beside, {0}, {0.1, 0}, 1}};
    assert_false(sf_triangulate_rays(sights, 2, at));
    assert_true(isinf(sf_sight_error(&sights[0], behind)));
    assert_true(isinf(sf_triangulate_refine(sights, 2, behind)));
    const double a[2] = {0.25, 0}, b[2] = {-0.25, 0}, wide[2] = {0.3, 0};
    assert_float_equal(sf_pair_angle(&beside, a, b), 2 * atan(0.25), 1e-12); /* meet at (0.5, 0, 2) */
    assert_float_equal(sf_pair_angle(&beside, a, wide), 0, 0);               /* behind */
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(poses_from_three),
        cmocka_unit_test(poses_are_refined),
        cmocka_unit_test(points_are_triangulated),
        cmocka_unit_test(rays_that_do_not_meet),
    };
    return cmocka_run_group_tests_name("sfm_poses", tests, NULL, NULL);
}
