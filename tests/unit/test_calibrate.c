/* test_calibrate.c - lenses and poses from views of a board: exact and noisy corners, outliers, views that
 * cannot tell. */
#include "calibrate_fixture.h"

#include <math.h>
#include <string.h>
#include <sys/wait.h>

#include "base/rng.h"
#include "pose/edge_bias.h"
#include "pose/view.h"

static void add_stands(fixture *f, size_t count, double sigma) {
    for (size_t i = 0; i < count; i++) {
        size_t n = calibrate_see(f, &calibrate_stands[i], sigma);
        assert_ok(f->ctx, sf_observations_add(f->observations, f->corners, n));
    }
}

/* Corners. */

static void test_exact_corners(void **state) {
    (void)state;
    fixture f;
    sf_calibration c;
    calibrate_begin(&f, 1);
    add_stands(&f, STANDS, 0);
    assert_ok(f.ctx, sf_calibrate(f.observations, NULL, &c));
    calibrate_print_lens("exact corners", &c);
    assert_true(c.rms < 1e-6);
    assert_true(fabs(c.lens.fx - calibrate_truth.fx) < 1e-3 && fabs(c.lens.cy - calibrate_truth.cy) < 1e-3);
    assert_true(fabs(c.lens.k2 - calibrate_truth.k2) < 1e-5 && fabs(c.lens.p2 - calibrate_truth.p2) < 1e-6);
    assert_int_equal(c.views, STANDS);
    assert_int_equal(c.corners_rejected, 0);
    for (size_t i = 0; i < STANDS; i++) {
        sf_observation_info info;
        sf_rigid T = calibrate_pose_of(&calibrate_truth, &calibrate_stands[i]);
        assert_ok(f.ctx, sf_observations_get(f.observations, i, &info));
        for (int k = 0; k < 3; k++) assert_true(fabs(info.t_cb[k] - T.t[k]) < 1e-5);
        for (int k = 0; k < 9; k++) assert_true(fabs(info.R_cb[k] - T.R[k]) < 1e-5);
    }
    calibrate_end(&f);
}

/* Views that start the estimate badly must not keep it: noise of half a pixel, each parameter within four of
 * its standard deviations; over several seeds these are neither too small nor too large. */
static void test_standard_deviations(void **state) {
    (void)state;
    enum { SEEDS = 6 };
    double squares = 0, n = 0;
    for (uint64_t seed = 0; seed < (test_is_quick() ? 2 : SEEDS); seed++) {
        fixture f;
        sf_calibration c;
        calibrate_begin(&f, 100 + seed);
        add_stands(&f, STANDS, 0.5);
        assert_ok(f.ctx, sf_calibrate(f.observations, NULL, &c));
        const double *got = &c.lens.fx, *sigma = &c.sigma.fx, *want = &calibrate_truth.fx;
        for (int i = 0; i < SF_LENS_PARAMETERS; i++) {
            double z = (got[i] - want[i]) / sigma[i];
            assert_true(fabs(z) < 4.5);
            squares += z * z;
            n++;
        }
        assert_true(fabs(c.rms - 0.5 * sqrt(2)) < 0.05);
        calibrate_end(&f);
    }
    print_message("errors are %.2f of their standard deviations (rms of %.0f)\n", sqrt(squares / n), n);
    if (!test_is_quick()) assert_true(squares / n > 0.6 && squares / n < 1.5);
}

/* Outliers. */

static void assert_robust(fixture *f, size_t views, size_t views_rejected) {
    sf_calibration c;
    assert_ok(f->ctx, sf_calibrate(f->observations, NULL, &c));
    calibrate_print_lens("outliers", &c);
    calibrate_assert_as_told(&c);
    assert_int_equal(c.views, views);
    assert_int_equal(c.views_rejected, views_rejected);
    assert_true(c.rms < 0.2);
}

/* In each view another corner is wrong by many pixels. */
static void test_wrong_corners(void **state) {
    (void)state;
    fixture f;
    calibrate_begin(&f, 2);
    for (size_t i = 0; i < STANDS; i++) {
        size_t n = calibrate_see(&f, &calibrate_stands[i], 0.1), wrong = sf_rng_below(&f.rng, n);
        f.corners[wrong].pixel[0] += 12;
        f.corners[(wrong + 7) % n].pixel[1] -= 3;
        assert_ok(f.ctx, sf_observations_add(f.observations, f.corners, n));
    }
    assert_robust(&f, STANDS, 0);
    for (size_t i = 0; i < STANDS; i++) {
        sf_observation_info info;
        assert_ok(f.ctx, sf_observations_get(f.observations, i, &info));
        assert_true(info.corners_rejected >= 2 && info.corners_rejected <= 5);
    }
    sf_observation_info past;
    assert_int_equal(sf_observations_get(f.observations, STANDS, &past), SF_ERR_END);
    calibrate_end(&f);
}

/* A tag of the board lies 3 mm from where it should: all its corners go, in every view. */
static void test_moved_tag(void **state) {
    (void)state;
    fixture f;
    calibrate_begin(&f, 3);
    for (size_t i = 0; i < STANDS; i++) {
        size_t n = calibrate_see(&f, &calibrate_stands[i], 0.1);
        for (size_t k = 0; k < n; k++)
            if (f.corners[k].id == 6) f.corners[k].board[0] += 0.003;
        assert_ok(f.ctx, sf_observations_add(f.observations, f.corners, n));
    }
    assert_robust(&f, STANDS, 0);
    calibrate_end(&f);
}

/* A view taken while the board bent or moved: nothing in it fits. */
static void test_wrong_view(void **state) {
    (void)state;
    fixture f;
    calibrate_begin(&f, 4);
    for (size_t i = 0; i < STANDS; i++) {
        size_t n = calibrate_see(&f, &calibrate_stands[i], i == 5 ? 6 : 0.1);
        assert_ok(f.ctx, sf_observations_add(f.observations, f.corners, n));
    }
    assert_robust(&f, STANDS - 1, 1);
    sf_observation_info info;
    assert_ok(f.ctx, sf_observations_get(f.observations, 5, &info));
    assert_true(info.rejected);
    calibrate_end(&f);
}

/* Views that cannot tell. */

static void assert_refused(fixture *f, const stand *list, size_t count, const char *why) {
    sf_calibration c;
    for (size_t i = 0; i < count; i++) {
        size_t n = calibrate_see(f, &list[i], 0.1);
        assert_ok(f->ctx, sf_observations_add(f->observations, f->corners, n));
    }
    assert_status(f->ctx, sf_calibrate(f->observations, NULL, &c), SF_ERR_EMPTY);
    assert_error_names(f->ctx, why);
    assert_true(c.width == 0 && c.lens.fx == 0);
}

static void test_degenerate_sets(void **state) {
    (void)state;
    static const stand frontal[] = {{320, 240, 0.5, 0, 0, 0},  {220, 160, 0.6, 1, 0, 20},
                                    {420, 160, 0.7, 0, 2, 90}, {220, 320, 0.8, -1, 1, 0},
                                    {420, 320, 0.6, 0, 0, 45}, {320, 240, 0.9, 2, 0, 0}};
    static const stand alike[] = {{320, 240, 0.5, 30, 0, 0}, {300, 250, 0.55, 30, 0, 0},
                                  {340, 230, 0.6, 30, 0, 0}, {310, 220, 0.7, 31, 0, 0},
                                  {330, 260, 0.8, 30, 1, 0}, {320, 240, 0.9, 30, 0, 0}};
    fixture f;
    calibrate_begin(&f, 5);
    assert_refused(&f, calibrate_stands, 2, "2 of 2 fit, at least 3");
    calibrate_end(&f);
    calibrate_begin(&f, 6);
    assert_refused(&f, frontal, 6, "face the camera within");
    calibrate_end(&f);
    calibrate_begin(&f, 7);
    assert_refused(&f, alike, 6, "one tilt within");
    calibrate_end(&f);
    calibrate_begin(&f, 8);
    sf_calibration c;
    assert_status(f.ctx, sf_calibrate(f.observations, NULL, &c), SF_ERR_EMPTY);
    assert_error_names(f.ctx, "0 of 0");
    calibrate_end(&f);
}

/* Views that tell little are taken, with a warning. */
static void test_loose_set(void **state) {
    (void)state;
    static const stand weak[] = {{320, 240, 0.9, 10, 0, 0},
                                 {220, 200, 0.9, -10, 5, 0},
                                 {420, 280, 0.9, 0, 12, 0},
                                 {320, 200, 0.9, 3, -12, 0}};
    fixture f;
    sf_calibration c;
    calibrate_begin(&f, 9);
    test_log_clear();
    for (size_t i = 0; i < 4; i++) {
        size_t n = calibrate_see(&f, &weak[i], 0.1);
        assert_ok(f.ctx, sf_observations_add(f.observations, f.corners, n));
    }
    sf_calibrate_options o = {.radial = 0};
    assert_ok(f.ctx, sf_calibrate(f.observations, &o, &c));
    calibrate_print_lens("weak views", &c);
    assert_true(c.lens.k1 == 0 && c.sigma.k1 == 0 && c.lens.p2 == 0);
    assert_true(strstr(test_log, "the focal length is known to") != NULL);
    calibrate_end(&f);
}

static void test_options(void **state) {
    (void)state;
    fixture f;
    sf_calibration c;
    calibrate_begin(&f, 10);
    add_stands(&f, STANDS, 0.1);
    sf_calibrate_options o = {.fix_aspect = 1, .fix_center = 1, .radial = 1};
    assert_ok(f.ctx, sf_calibrate(f.observations, &o, &c));
    assert_true(c.lens.fx == c.lens.fy && c.sigma.fx == c.sigma.fy && c.sigma.fx > 0);
    assert_true(c.lens.cx == WIDTH / 2.0 && c.lens.cy == HEIGHT / 2.0 && c.sigma.cx == 0);
    assert_true(c.lens.k1 != 0 && c.sigma.k1 > 0 && c.lens.k2 == 0 && c.lens.p1 == 0 && c.sigma.p2 == 0);
    o = (sf_calibrate_options){.radial = 2};
    assert_ok(f.ctx, sf_calibrate(f.observations, &o, &c));
    assert_true(c.lens.k2 != 0 && c.lens.p1 == 0 && c.lens.fx != c.lens.fy);
    o.radial = 3;
    assert_status(f.ctx, sf_calibrate(f.observations, &o, &c), SF_ERR_ARGUMENT);
    assert_error_names(f.ctx, "radial: 3");
    calibrate_end(&f);
}

/* Lenses from long to wide, at other sizes of pictures, are found from the same start. */
static void test_other_lenses(void **state) {
    (void)state;
    static const sf_lens lenses[] = {{380, 382, 315, 245, -0.28, 0.07, 0, 0, 0},
                                     {1300, 1290, 330, 231, 0.05, 0, 0, 0, 0},
                                     {2400, 2400, 310, 250, 0, 0, 0, 0, 0}};
    for (size_t k = 0; k < sizeof lenses / sizeof *lenses; k++) {
        const sf_lens *lens = &lenses[k];
        fixture f;
        sf_calibration c;
        calibrate_begin(&f, 20 + k);
        for (size_t i = 0; i < STANDS; i++) {
            stand s = calibrate_stands[i];
            s.distance *= lens->fx / calibrate_truth.fx;
            sf_rigid T = calibrate_pose_of(lens, &s);
            size_t n = calibrate_project_board(f.board, lens, &T, 0.05, &f.rng, f.corners);
            assert_ok(f.ctx, sf_observations_add(f.observations, f.corners, n));
        }
        assert_ok(f.ctx, sf_calibrate(f.observations, NULL, &c));
        print_message("fx %.0f: %+.3f %% (+-%.3f), cx %+.2f px (+-%.2f)\n", lens->fx,
                      100 * (c.lens.fx / lens->fx - 1), 100 * c.sigma.fx / lens->fx, c.lens.cx - lens->cx,
                      c.sigma.cx);
        assert_true(fabs(c.lens.fx - lens->fx) < 4.5 * c.sigma.fx);
        assert_true(fabs(c.lens.fx / lens->fx - 1) < 0.01);
        calibrate_end(&f);
    }
}

/* Choosing views. */

static void test_offers_and_advice(void **state) {
    (void)state;
    fixture f;
    int taken;
    calibrate_begin(&f, 11);
    assert_string_equal(sf_observations_advice(f.observations), "show the board to the camera");
    size_t n = calibrate_see(&f, &calibrate_stands[0], 0);
    assert_ok(f.ctx, sf_observations_offer(f.observations, f.corners, 4, &taken));
    assert_false(taken); /* a single tag */
    assert_ok(f.ctx, sf_observations_offer(f.observations, f.corners, n, &taken));
    assert_true(taken);
    assert_ok(f.ctx, sf_observations_offer(f.observations, f.corners, n, &taken));
    assert_false(taken); /* the same again */
    assert_int_equal(sf_observations_count(f.observations), 1);
    assert_non_null(strstr(sf_observations_advice(f.observations), "right edge"));
    /* Doing as it says ends the advice. */
    const char *before = "";
    for (size_t i = 1; i < STANDS && sf_observations_advice(f.observations); i++) {
        before = sf_observations_advice(f.observations);
        n = calibrate_see(&f, &calibrate_stands[i], 0);
        assert_ok(f.ctx, sf_observations_offer(f.observations, f.corners, n, &taken));
        assert_true(taken);
    }
    if (sf_observations_advice(f.observations))
        print_message("%s; %s\n", before, sf_observations_advice(f.observations));
    assert_null(sf_observations_advice(f.observations));
    assert_true(sf_observations_coverage(f.observations) > 0.9);
    calibrate_end(&f);
}

/* The right edge is asked for while only the left one has been near. */
static void test_advice_has_the_right_side(void **state) {
    (void)state;
    fixture f;
    calibrate_begin(&f, 12);
    stand left_near = {320, 240, 0.5, 0, 30, 0}; /* about +y: what is at +x goes away from the camera */
    sf_rigid T = calibrate_pose_of(&calibrate_truth, &left_near);
    assert_true(T.R[6] < 0); /* the board's +x comes nearer: its right edge is near */
    size_t n = calibrate_see(&f, &left_near, 0);
    assert_ok(f.ctx, sf_observations_add(f.observations, f.corners, n));
    assert_non_null(strstr(sf_observations_advice(f.observations), "left edge"));
    calibrate_end(&f);
}

static void test_bad_observations(void **state) {
    (void)state;
    fixture f;
    sf_observations *none;
    calibrate_begin(&f, 13);
    assert_status(f.ctx, sf_observations_create(f.ctx, 15, 480, &none), SF_ERR_ARGUMENT);
    assert_error_names(f.ctx, "15 x 480");
    assert_null(none);
    size_t n = calibrate_see(&f, &calibrate_stands[0], 0);
    assert_status(f.ctx, sf_observations_add(f.observations, f.corners, 3), SF_ERR_ARGUMENT);
    assert_error_names(f.ctx, "3 is not in 4..");
    f.corners[2].pixel[1] = NAN;
    assert_status(f.ctx, sf_observations_add(f.observations, f.corners, n), SF_ERR_ARGUMENT);
    assert_error_names(f.ctx, "corner 2 of tag 0");
    f.corners[2].pixel[1] = 2000;
    assert_status(f.ctx, sf_observations_add(f.observations, f.corners, n), SF_ERR_ARGUMENT);
    assert_int_equal(sf_observations_count(f.observations), 0);
    calibrate_end(&f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_exact_corners),
        cmocka_unit_test(test_standard_deviations),
        cmocka_unit_test(test_wrong_corners),
        cmocka_unit_test(test_moved_tag),
        cmocka_unit_test(test_wrong_view),
        cmocka_unit_test(test_degenerate_sets),
        cmocka_unit_test(test_loose_set),
        cmocka_unit_test(test_options),
        cmocka_unit_test(test_other_lenses),
        cmocka_unit_test(test_offers_and_advice),
        cmocka_unit_test(test_advice_has_the_right_side),
        cmocka_unit_test(test_bad_observations),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
