/* test_calibrate_pose.c - derivatives of the calibration's sums, rays of a lens, and the pose of one view. */
#include "calibrate_fixture.h"

#include <math.h>
#include <string.h>
#include <sys/wait.h>

#include "base/rng.h"
#include "base/linear.h"
#include "pose/edge_bias.h"
#include "pose/view.h"

/* Derivatives. */

/* Against central differences: of the pixel by point and lens, and of the sums by pose and lens. */
static void test_projection_derivatives(void **state) {
    (void)state;
    const double h = 1e-6;
    sf_lens bent = calibrate_truth;
    sf_rng rng;
    bent.k3 = -0.11;
    sf_rng_seed(&rng, 14);
    for (int round = 0; round < 50; round++) {
        double p[3] = {sf_rng_uniform(&rng) - 0.5, sf_rng_uniform(&rng) - 0.5, 0.7 + sf_rng_uniform(&rng)};
        double pixel[2], d_point[6], d_lens[16], low[2], high[2];
        assert_true(sf_lens_project(&bent, p, pixel, d_point, d_lens));
        for (int k = 0; k < 3 + SF_LENS_PARAMETERS; k++) {
            double q[2][3];
            sf_lens lens[2] = {bent, bent};
            for (int side = 0; side < 2; side++) {
                memcpy(q[side], p, sizeof p);
                if (k < 3) q[side][k] += side ? h : -h;
                if (k >= 3) (&lens[side].fx)[k - 3] += side ? h : -h;
            }
            sf_lens_project(&lens[0], q[0], low, NULL, NULL);
            sf_lens_project(&lens[1], q[1], high, NULL, NULL);
            for (int i = 0; i < 2; i++) {
                double numeric = (high[i] - low[i]) / (2 * h);
                double analytic = k < 3 ? d_point[3 * i + k] : d_lens[SF_LENS_PARAMETERS * i + k - 3];
                assert_true(fabs(numeric - analytic) < 1e-6 * (100 + fabs(analytic)));
            }
        }
    }
    double point_behind[3] = {0, 0, -1}, pixel[2];
    assert_false(sf_lens_project(&calibrate_truth, point_behind, pixel, NULL, NULL));
}

static double cost_at(const sf_lens *lens, const sf_rigid *T, const sf_corner_list *list, double scale, int k,
                      double h) {
    sf_lens moved = *lens;
    sf_rigid pose = *T;
    double twist[SF_TWIST] = {0};
    sf_view_sums sums;
    if (k < SF_TWIST)
        twist[k] = h;
    else
        (&moved.fx)[k - SF_TWIST] += h;
    sf_rigid_move(&pose, twist);
    sf_view_sum(&moved, &pose, list, scale, SF_VIEW_COST, &sums);
    return sums.cost;
}

/* The gradient of the robust cost is its derivative; the sums of both calls agree. */
static void test_sums_derivatives(void **state) {
    (void)state;
    fixture f;
    calibrate_begin(&f, 15);
    for (int which = 0; which < 4; which++) {
        sf_rigid T = calibrate_pose_of(&calibrate_truth, &calibrate_stands[3 * which]);
        size_t n = calibrate_see(&f, &calibrate_stands[3 * which], 2);
        sf_corner_list list = {f.corners, NULL, n};
        double scale = which & 1 ? 3 : 0;
        sf_view_sums sums, part;
        sf_view_sum(&calibrate_truth, &T, &list, scale, SF_VIEW_ALL, &sums);
        sf_view_sum(&calibrate_truth, &T, &list, scale, SF_VIEW_TWIST, &part);
        assert_true(part.cost == sums.cost && part.d_twist[4] == sums.d_twist[4]);
        for (int k = 0; k < SF_TWIST + SF_LENS_PARAMETERS; k++) {
            double h = 1e-6, analytic = k < SF_TWIST ? sums.d_twist[k] : sums.d_lens[k - SF_TWIST];
            double numeric = (cost_at(&calibrate_truth, &T, &list, scale, k, h) -
                              cost_at(&calibrate_truth, &T, &list, scale, k, -h)) /
                             (2 * h);
            assert_true(fabs(numeric - analytic) < 1e-5 * fabs(analytic) + 1e-3);
        }
    }
    calibrate_end(&f);
}

static void test_rays(void **state) {
    (void)state;
    sf_rng rng;
    sf_rng_seed(&rng, 16);
    for (int i = 0; i < 200; i++) {
        double pixel[2] = {WIDTH * sf_rng_uniform(&rng), HEIGHT * sf_rng_uniform(&rng)}, ray[2], seen[2];
        assert_true(sf_lens_ray(&calibrate_truth, pixel, ray));
        assert_true(sf_lens_project(&calibrate_truth, (double[]){ray[0], ray[1], 1}, seen, NULL, NULL));
        assert_true(fabs(seen[0] - pixel[0]) + fabs(seen[1] - pixel[1]) < 1e-8);
    }
    sf_lens bent = calibrate_truth;
    bent.k1 = -3; /* turns back before the picture's corner */
    assert_false(sf_lens_ray(&bent, (double[]){0, 0}, (double[2]){0}));
}

/* Poses. */

static double angle_of(const double A[9], const double B[9]) {
    double squares = 0;
    for (int i = 0; i < 9; i++) squares += (A[i] - B[i]) * (A[i] - B[i]);
    return 2 * asin(fmin(1, sqrt(squares / 8))) * 180 / calibrate_pi;
}

static void test_pose(void **state) {
    (void)state;
    fixture f;
    calibrate_begin(&f, 17);
    double worst_mm = 0, worst_degrees = 0, z2 = 0, n_z = 0;
    for (size_t i = 0; i < STANDS; i++) {
        sf_rigid T = calibrate_pose_of(&calibrate_truth, &calibrate_stands[i]);
        sf_pose pose;
        size_t n = calibrate_see(&f, &calibrate_stands[i], 0.2);
        assert_ok(f.ctx, sf_board_pose(f.ctx, &calibrate_truth, f.corners, n, &pose));
        double mm = 0, degrees = angle_of(pose.R_cb, T.R);
        for (int k = 0; k < 3; k++) {
            double d = pose.t_cb[k] - T.t[k];
            mm += 1e6 * d * d;
        }
        worst_mm = fmax(worst_mm, sqrt(mm));
        worst_degrees = fmax(worst_degrees, degrees);
        assert_int_equal(pose.used + pose.rejected, n);
        assert_true(pose.rejected <= 2);
        assert_true(pose.ambiguity >= 0 && pose.ambiguity < 0.9);
        /* The left twist from truth to estimate, to first order: phi from R_e R^T, rho = t_e - R_e R^T t. */
        double D[9], Rt[9], moved[3];
        for (int k = 0; k < 9; k++) Rt[k] = T.R[k % 3 * 3 + k / 3];
        sf_mat3_mul(pose.R_cb, Rt, D);
        sf_mat3_vec(D, T.t, moved);
        double twist[6] = {pose.t_cb[0] - moved[0], pose.t_cb[1] - moved[1], pose.t_cb[2] - moved[2],
                           (D[7] - D[5]) / 2,       (D[2] - D[6]) / 2,       (D[3] - D[1]) / 2};
        for (int k = 0; k < 6; k++) {
            z2 += twist[k] * twist[k] / pose.covariance[7 * k];
            n_z++;
        }
    }
    print_message(
        "poses, corners off by 0.2 px: worst %.2f mm, %.3f degrees; %.2f of the standard deviations\n",
        worst_mm, worst_degrees, sqrt(z2 / n_z));
    assert_true(worst_mm < 2 && worst_degrees < 0.5);
    assert_true(z2 / n_z > 0.4 && z2 / n_z < 2.2);
    calibrate_end(&f);
}

static void test_pose_outliers(void **state) {
    (void)state;
    fixture f;
    sf_pose pose;
    calibrate_begin(&f, 18);
    sf_rigid T = calibrate_pose_of(&calibrate_truth, &calibrate_stands[5]);
    size_t n = calibrate_see(&f, &calibrate_stands[5], 0.1);
    for (size_t i = 0; i < 8; i++) f.corners[10 + i].pixel[0] += 20; /* two tags elsewhere */
    assert_ok(f.ctx, sf_board_pose(f.ctx, &calibrate_truth, f.corners, n, &pose));
    assert_int_equal(pose.rejected, 8);
    assert_true(angle_of(pose.R_cb, T.R) < 0.3);
    calibrate_end(&f);
}

/* A single tag from afar may be seen two ways; the whole board near by may not. */
static void test_pose_ambiguity(void **state) {
    (void)state;
    fixture f;
    sf_pose pose;
    calibrate_begin(&f, 19);
    stand far = {320, 240, 1.6, 12, 8, 0}, near = {320, 240, 0.45, 25, 20, 0};
    size_t n = calibrate_see(&f, &far, 0.3);
    assert_true(n >= 4);
    assert_ok(f.ctx, sf_board_pose(f.ctx, &calibrate_truth, f.corners, 4, &pose));
    print_message("ambiguity of a tag at 1.6 m: %.3f\n", pose.ambiguity);
    assert_true(pose.ambiguity > 0.5 && pose.ambiguity <= 1);
    n = calibrate_see(&f, &near, 0.3);
    assert_ok(f.ctx, sf_board_pose(f.ctx, &calibrate_truth, f.corners, n, &pose));
    print_message("ambiguity of a board at 0.45 m: %.3f\n", pose.ambiguity);
    assert_true(pose.ambiguity < 0.3);
    /* Refusals. */
    assert_status(f.ctx, sf_board_pose(f.ctx, &calibrate_truth, f.corners, 3, &pose), SF_ERR_EMPTY);
    for (size_t i = 0; i < 8; i++) f.corners[i].board[1] = f.corners[i].pixel[1] = 100;
    assert_status(f.ctx, sf_board_pose(f.ctx, &calibrate_truth, f.corners, 8, &pose), SF_ERR_EMPTY);
    assert_error_names(f.ctx, "no pose explains the 8 corners");
    sf_lens bad = calibrate_truth;
    bad.fx = -1;
    assert_status(f.ctx, sf_board_pose(f.ctx, &bad, f.corners, n, &pose), SF_ERR_ARGUMENT);
    calibrate_end(&f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_projection_derivatives),
        cmocka_unit_test(test_sums_derivatives),
        cmocka_unit_test(test_rays),
        cmocka_unit_test(test_pose),
        cmocka_unit_test(test_pose_outliers),
        cmocka_unit_test(test_pose_ambiguity),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
