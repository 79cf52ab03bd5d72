/* test_calibrate.c - lenses and poses from views of a board: exact and noisy corners, rendered pictures,
 * outliers, views that cannot tell, files of calibrations, photographs. */
#include "testing.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>

#include "../../src/base/rng.h"
#include "../../src/io/picture.h"
#include "../../src/base/linear.h"
#include "../../src/pose/swelling.h"
#include "../../src/pose/tags.h"
#include "../../src/pose/view.h"

enum { WIDTH = 640, HEIGHT = 480, MOST_CORNERS = 80 };

static const double pi = 3.141592653589793;
static const sf_lens truth = {613.4, 610.9, 327.3, 235.8, -0.21, 0.06, 0.0012, -0.0008, 0};

/* Views of the board "a4-36h11". */

/* The board's middle seen at pixel (u, v) from `distance` metres, turned by x, y, z degrees. */
typedef struct stand {
    double u, v, distance, x, y, z;
} stand;

static sf_rigid pose_of(const sf_lens *lens, const stand *s) {
    double ray[2], X[9], Y[9], Z[9], YX[9];
    sf_rigid T;
    assert_true(sf_lens_ray(lens, (double[]){s->u, s->v}, ray));
    sf_rotation_exp((double[]){s->x * pi / 180, 0, 0}, X);
    sf_rotation_exp((double[]){0, s->y * pi / 180, 0}, Y);
    sf_rotation_exp((double[]){0, 0, s->z * pi / 180}, Z);
    sf_mat3_mul(Y, X, YX);
    sf_mat3_mul(Z, YX, T.R);
    T.t[0] = ray[0] * s->distance;
    T.t[1] = ray[1] * s->distance;
    T.t[2] = s->distance;
    return T;
}

static const stand stands[] = {
    {320, 240, 0.45, 0, 0, 0},      {200, 160, 0.55, 30, 0, 5},   {440, 160, 0.55, -30, 5, -8},
    {200, 320, 0.55, 5, 32, 90},    {440, 320, 0.55, -5, -32, 0}, {320, 240, 0.42, 25, 25, 40},
    {300, 250, 0.8, -35, 20, 0},    {120, 110, 0.6, 20, -25, 10}, {530, 110, 0.6, 25, 20, -20},
    {120, 380, 0.6, -20, -30, 180}, {530, 370, 0.6, -25, 28, 0},  {330, 240, 0.5, 40, -10, 75},
    {320, 120, 0.5, -15, 35, 0},    {320, 380, 0.5, 30, -20, 0},  {250, 240, 0.7, 10, 40, 30},
    {420, 260, 0.65, -40, -15, 0},
};
enum { STANDS = sizeof stands / sizeof *stands };

/* The corners that lie in the picture, with noise of `sigma` px. */
static size_t project_board(const sf_board *board, const sf_lens *lens, const sf_rigid *T, double sigma,
                            sf_rng *rng, sf_board_corner *corners) {
    size_t n = 0;
    for (size_t t = 0; t < board->count; t++) {
        size_t first = n;
        for (int c = 0; c < 4; c++) {
            const double *b = board->tags[t].corner[c];
            double p[3], pixel[2];
            for (int i = 0; i < 3; i++) p[i] = T->R[3 * i] * b[0] + T->R[3 * i + 1] * b[1] + T->t[i];
            if (!sf_lens_project(lens, p, pixel, NULL, NULL)) break;
            if (!(pixel[0] > 2 && pixel[1] > 2 && pixel[0] < WIDTH - 2 && pixel[1] < HEIGHT - 2)) break;
            for (int k = 0; sigma > 0 && k < 2; k++) pixel[k] += sigma * sf_rng_normal(rng);
            corners[n++] = (sf_board_corner){board->tags[t].id, c, {b[0], b[1]}, {pixel[0], pixel[1]}};
        }
        if (n - first < 4) n = first;
    }
    return n;
}

typedef struct fixture {
    sf_context *ctx;
    sf_board *board;
    sf_sightings *sightings;
    sf_rng rng;
    sf_board_corner corners[MOST_CORNERS];
} fixture;

static void begin(fixture *f, uint64_t seed) {
    f->ctx = test_context();
    assert_ok(f->ctx, sf_board_open(f->ctx, "a4-36h11", 0, &f->board));
    assert_ok(f->ctx, sf_sightings_create(f->ctx, WIDTH, HEIGHT, &f->sightings));
    sf_rng_seed(&f->rng, seed);
}

static void end(fixture *f) {
    sf_sightings_destroy(&f->sightings);
    sf_board_close(&f->board);
    sf_context_destroy(&f->ctx);
}

static size_t see(fixture *f, const stand *s, double sigma) {
    sf_rigid T = pose_of(&truth, s);
    return project_board(f->board, &truth, &T, sigma, &f->rng, f->corners);
}

static void add_stands(fixture *f, size_t count, double sigma) {
    for (size_t i = 0; i < count; i++) {
        size_t n = see(f, &stands[i], sigma);
        assert_ok(f->ctx, sf_sightings_add(f->sightings, f->corners, n));
    }
}

static void print_lens(const char *what, const sf_calibration *c) {
    const sf_lens *l = &c->lens, *s = &c->sigma;
    print_message(
        "%s: fx %+.3f %% (+-%.3f), fy %+.3f %%, cx %+.3f px (+-%.3f), cy %+.3f px, k1 %+.5f (+-%.5f), k2 "
        "%+.5f (+-%.5f), p1 %+.6f, p2 %+.6f; rms %.4f px, %zu views, %zu corners, coverage %.2f\n",
        what, 100 * (l->fx / truth.fx - 1), 100 * s->fx / truth.fx, 100 * (l->fy / truth.fy - 1),
        l->cx - truth.cx, s->cx, l->cy - truth.cy, l->k1 - truth.k1, s->k1, l->k2 - truth.k2, s->k2,
        l->p1 - truth.p1, l->p2 - truth.p2, c->rms, c->views, c->corners, c->coverage);
}

/* The bar: focal length within 0.3 %, principal point within 1 px, k1 within 0.01. */
static void assert_within_bar(const sf_calibration *c) {
    assert_true(fabs(c->lens.fx / truth.fx - 1) < 0.003);
    assert_true(fabs(c->lens.fy / truth.fy - 1) < 0.003);
    assert_true(fabs(c->lens.cx - truth.cx) < 1);
    assert_true(fabs(c->lens.cy - truth.cy) < 1);
    assert_true(fabs(c->lens.k1 - truth.k1) < 0.01);
}

/* Corners. */

static void test_exact_corners(void **state) {
    (void)state;
    fixture f;
    sf_calibration c;
    begin(&f, 1);
    add_stands(&f, STANDS, 0);
    assert_ok(f.ctx, sf_calibrate(f.sightings, NULL, &c));
    print_lens("exact corners", &c);
    assert_true(c.rms < 1e-6);
    assert_true(fabs(c.lens.fx - truth.fx) < 1e-3 && fabs(c.lens.cy - truth.cy) < 1e-3);
    assert_true(fabs(c.lens.k2 - truth.k2) < 1e-5 && fabs(c.lens.p2 - truth.p2) < 1e-6);
    assert_int_equal(c.views, STANDS);
    assert_int_equal(c.corners_rejected, 0);
    for (size_t i = 0; i < STANDS; i++) {
        sf_sighting_info info;
        sf_rigid T = pose_of(&truth, &stands[i]);
        assert_ok(f.ctx, sf_sightings_get(f.sightings, i, &info));
        for (int k = 0; k < 3; k++) assert_true(fabs(info.t_cb[k] - T.t[k]) < 1e-5);
        for (int k = 0; k < 9; k++) assert_true(fabs(info.R_cb[k] - T.R[k]) < 1e-5);
    }
    end(&f);
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
        begin(&f, 100 + seed);
        add_stands(&f, STANDS, 0.5);
        assert_ok(f.ctx, sf_calibrate(f.sightings, NULL, &c));
        const double *got = &c.lens.fx, *sigma = &c.sigma.fx, *want = &truth.fx;
        for (int i = 0; i < SF_LENS_PARAMETERS; i++) {
            double z = (got[i] - want[i]) / sigma[i];
            assert_true(fabs(z) < 4.5);
            squares += z * z;
            n++;
        }
        assert_true(fabs(c.rms - 0.5 * sqrt(2)) < 0.05);
        end(&f);
    }
    print_message("errors are %.2f of their standard deviations (rms of %.0f)\n", sqrt(squares / n), n);
    if (!test_is_quick()) assert_true(squares / n > 0.6 && squares / n < 1.5);
}

/* Outliers. */

/* Within the bar for the focal length and k1, and within what the views tell for the rest. */
static void assert_as_told(const sf_calibration *c) {
    const double *got = &c->lens.fx, *sigma = &c->sigma.fx, *want = &truth.fx;
    for (int i = 0; i < SF_LENS_PARAMETERS; i++) assert_true(fabs(got[i] - want[i]) < 4.5 * sigma[i]);
    assert_true(fabs(c->lens.fx / truth.fx - 1) < 0.003 && fabs(c->lens.k1 - truth.k1) < 0.01);
}

static void assert_robust(fixture *f, size_t views, size_t views_rejected) {
    sf_calibration c;
    assert_ok(f->ctx, sf_calibrate(f->sightings, NULL, &c));
    print_lens("outliers", &c);
    assert_as_told(&c);
    assert_int_equal(c.views, views);
    assert_int_equal(c.views_rejected, views_rejected);
    assert_true(c.rms < 0.2);
}

/* In each view another corner is wrong by many pixels. */
static void test_wrong_corners(void **state) {
    (void)state;
    fixture f;
    begin(&f, 2);
    for (size_t i = 0; i < STANDS; i++) {
        size_t n = see(&f, &stands[i], 0.1), wrong = sf_rng_below(&f.rng, n);
        f.corners[wrong].pixel[0] += 12;
        f.corners[(wrong + 7) % n].pixel[1] -= 3;
        assert_ok(f.ctx, sf_sightings_add(f.sightings, f.corners, n));
    }
    assert_robust(&f, STANDS, 0);
    for (size_t i = 0; i < STANDS; i++) {
        sf_sighting_info info;
        assert_ok(f.ctx, sf_sightings_get(f.sightings, i, &info));
        assert_true(info.corners_rejected >= 2 && info.corners_rejected <= 5);
    }
    sf_sighting_info past;
    assert_int_equal(sf_sightings_get(f.sightings, STANDS, &past), SF_ERR_END);
    end(&f);
}

/* A tag of the board lies 3 mm from where it should: all its corners go, in every view. */
static void test_moved_tag(void **state) {
    (void)state;
    fixture f;
    begin(&f, 3);
    for (size_t i = 0; i < STANDS; i++) {
        size_t n = see(&f, &stands[i], 0.1);
        for (size_t k = 0; k < n; k++)
            if (f.corners[k].id == 6) f.corners[k].board[0] += 0.003;
        assert_ok(f.ctx, sf_sightings_add(f.sightings, f.corners, n));
    }
    assert_robust(&f, STANDS, 0);
    end(&f);
}

/* A view taken while the board bent or moved: nothing in it fits. */
static void test_wrong_view(void **state) {
    (void)state;
    fixture f;
    begin(&f, 4);
    for (size_t i = 0; i < STANDS; i++) {
        size_t n = see(&f, &stands[i], i == 5 ? 6 : 0.1);
        assert_ok(f.ctx, sf_sightings_add(f.sightings, f.corners, n));
    }
    assert_robust(&f, STANDS - 1, 1);
    sf_sighting_info info;
    assert_ok(f.ctx, sf_sightings_get(f.sightings, 5, &info));
    assert_true(info.rejected);
    end(&f);
}

/* Views that cannot tell. */

static void assert_refused(fixture *f, const stand *list, size_t count, const char *why) {
    sf_calibration c;
    for (size_t i = 0; i < count; i++) {
        size_t n = see(f, &list[i], 0.1);
        assert_ok(f->ctx, sf_sightings_add(f->sightings, f->corners, n));
    }
    assert_status(f->ctx, sf_calibrate(f->sightings, NULL, &c), SF_ERR_EMPTY);
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
    begin(&f, 5);
    assert_refused(&f, stands, 2, "2 of 2 fit, at least 3");
    end(&f);
    begin(&f, 6);
    assert_refused(&f, frontal, 6, "face the camera within");
    end(&f);
    begin(&f, 7);
    assert_refused(&f, alike, 6, "one tilt within");
    end(&f);
    begin(&f, 8);
    sf_calibration c;
    assert_status(f.ctx, sf_calibrate(f.sightings, NULL, &c), SF_ERR_EMPTY);
    assert_error_names(f.ctx, "0 of 0");
    end(&f);
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
    begin(&f, 9);
    test_log_clear();
    for (size_t i = 0; i < 4; i++) {
        size_t n = see(&f, &weak[i], 0.1);
        assert_ok(f.ctx, sf_sightings_add(f.sightings, f.corners, n));
    }
    sf_calibrate_options o = {.radial = 0};
    assert_ok(f.ctx, sf_calibrate(f.sightings, &o, &c));
    print_lens("weak views", &c);
    assert_true(c.lens.k1 == 0 && c.sigma.k1 == 0 && c.lens.p2 == 0);
    assert_true(strstr(test_log, "the focal length is known to") != NULL);
    end(&f);
}

static void test_options(void **state) {
    (void)state;
    fixture f;
    sf_calibration c;
    begin(&f, 10);
    add_stands(&f, STANDS, 0.1);
    sf_calibrate_options o = {.fix_aspect = 1, .fix_center = 1, .radial = 1};
    assert_ok(f.ctx, sf_calibrate(f.sightings, &o, &c));
    assert_true(c.lens.fx == c.lens.fy && c.sigma.fx == c.sigma.fy && c.sigma.fx > 0);
    assert_true(c.lens.cx == WIDTH / 2.0 && c.lens.cy == HEIGHT / 2.0 && c.sigma.cx == 0);
    assert_true(c.lens.k1 != 0 && c.sigma.k1 > 0 && c.lens.k2 == 0 && c.lens.p1 == 0 && c.sigma.p2 == 0);
    o = (sf_calibrate_options){.radial = 2};
    assert_ok(f.ctx, sf_calibrate(f.sightings, &o, &c));
    assert_true(c.lens.k2 != 0 && c.lens.p1 == 0 && c.lens.fx != c.lens.fy);
    o.radial = 3;
    assert_status(f.ctx, sf_calibrate(f.sightings, &o, &c), SF_ERR_ARGUMENT);
    assert_error_names(f.ctx, "radial: 3");
    end(&f);
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
        begin(&f, 20 + k);
        for (size_t i = 0; i < STANDS; i++) {
            stand s = stands[i];
            s.distance *= lens->fx / truth.fx;
            sf_rigid T = pose_of(lens, &s);
            size_t n = project_board(f.board, lens, &T, 0.05, &f.rng, f.corners);
            assert_ok(f.ctx, sf_sightings_add(f.sightings, f.corners, n));
        }
        assert_ok(f.ctx, sf_calibrate(f.sightings, NULL, &c));
        print_message("fx %.0f: %+.3f %% (+-%.3f), cx %+.2f px (+-%.2f)\n", lens->fx,
                      100 * (c.lens.fx / lens->fx - 1), 100 * c.sigma.fx / lens->fx, c.lens.cx - lens->cx,
                      c.sigma.cx);
        assert_true(fabs(c.lens.fx - lens->fx) < 4.5 * c.sigma.fx);
        assert_true(fabs(c.lens.fx / lens->fx - 1) < 0.01);
        end(&f);
    }
}

/* Choosing views. */

static void test_offers_and_advice(void **state) {
    (void)state;
    fixture f;
    int taken;
    begin(&f, 11);
    assert_string_equal(sf_sightings_advice(f.sightings), "show the board to the camera");
    size_t n = see(&f, &stands[0], 0);
    assert_ok(f.ctx, sf_sightings_offer(f.sightings, f.corners, 4, &taken));
    assert_false(taken); /* a single tag */
    assert_ok(f.ctx, sf_sightings_offer(f.sightings, f.corners, n, &taken));
    assert_true(taken);
    assert_ok(f.ctx, sf_sightings_offer(f.sightings, f.corners, n, &taken));
    assert_false(taken); /* the same again */
    assert_int_equal(sf_sightings_count(f.sightings), 1);
    assert_non_null(strstr(sf_sightings_advice(f.sightings), "right edge"));
    /* Doing as it says ends the advice. */
    const char *before = "";
    for (size_t i = 1; i < STANDS && sf_sightings_advice(f.sightings); i++) {
        before = sf_sightings_advice(f.sightings);
        n = see(&f, &stands[i], 0);
        assert_ok(f.ctx, sf_sightings_offer(f.sightings, f.corners, n, &taken));
        assert_true(taken);
    }
    if (sf_sightings_advice(f.sightings)) print_message("%s; %s\n", before, sf_sightings_advice(f.sightings));
    assert_null(sf_sightings_advice(f.sightings));
    assert_true(sf_sightings_coverage(f.sightings) > 0.9);
    end(&f);
}

/* The right edge is asked for while only the left one has been near. */
static void test_advice_has_the_right_side(void **state) {
    (void)state;
    fixture f;
    begin(&f, 12);
    stand left_near = {320, 240, 0.5, 0, 30, 0}; /* about +y: what is at +x goes away from the camera */
    sf_rigid T = pose_of(&truth, &left_near);
    assert_true(T.R[6] < 0); /* the board's +x comes nearer: its right edge is near */
    size_t n = see(&f, &left_near, 0);
    assert_ok(f.ctx, sf_sightings_add(f.sightings, f.corners, n));
    assert_non_null(strstr(sf_sightings_advice(f.sightings), "left edge"));
    end(&f);
}

static void test_bad_sightings(void **state) {
    (void)state;
    fixture f;
    sf_sightings *none;
    begin(&f, 13);
    assert_status(f.ctx, sf_sightings_create(f.ctx, 15, 480, &none), SF_ERR_ARGUMENT);
    assert_error_names(f.ctx, "15 x 480");
    assert_null(none);
    size_t n = see(&f, &stands[0], 0);
    assert_status(f.ctx, sf_sightings_add(f.sightings, f.corners, 3), SF_ERR_ARGUMENT);
    assert_error_names(f.ctx, "3 is not in 4..");
    f.corners[2].pixel[1] = NAN;
    assert_status(f.ctx, sf_sightings_add(f.sightings, f.corners, n), SF_ERR_ARGUMENT);
    assert_error_names(f.ctx, "corner 2 of tag 0");
    f.corners[2].pixel[1] = 2000;
    assert_status(f.ctx, sf_sightings_add(f.sightings, f.corners, n), SF_ERR_ARGUMENT);
    assert_int_equal(sf_sightings_count(f.sightings), 0);
    end(&f);
}

/* Derivatives. */

/* Against central differences: of the pixel by point and lens, and of the sums by pose and lens. */
static void test_projection_derivatives(void **state) {
    (void)state;
    const double h = 1e-6;
    sf_lens bent = truth;
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
    assert_false(sf_lens_project(&truth, point_behind, pixel, NULL, NULL));
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
    begin(&f, 15);
    for (int which = 0; which < 4; which++) {
        sf_rigid T = pose_of(&truth, &stands[3 * which]);
        size_t n = see(&f, &stands[3 * which], 2);
        sf_corner_list list = {f.corners, NULL, n};
        double scale = which & 1 ? 3 : 0;
        sf_view_sums sums, part;
        sf_view_sum(&truth, &T, &list, scale, SF_VIEW_ALL, &sums);
        sf_view_sum(&truth, &T, &list, scale, SF_VIEW_TWIST, &part);
        assert_true(part.cost == sums.cost && part.d_twist[4] == sums.d_twist[4]);
        for (int k = 0; k < SF_TWIST + SF_LENS_PARAMETERS; k++) {
            double h = 1e-6, analytic = k < SF_TWIST ? sums.d_twist[k] : sums.d_lens[k - SF_TWIST];
            double numeric =
                (cost_at(&truth, &T, &list, scale, k, h) - cost_at(&truth, &T, &list, scale, k, -h)) /
                (2 * h);
            assert_true(fabs(numeric - analytic) < 1e-5 * fabs(analytic) + 1e-3);
        }
    }
    end(&f);
}

static void test_rays(void **state) {
    (void)state;
    sf_rng rng;
    sf_rng_seed(&rng, 16);
    for (int i = 0; i < 200; i++) {
        double pixel[2] = {WIDTH * sf_rng_uniform(&rng), HEIGHT * sf_rng_uniform(&rng)}, ray[2], seen[2];
        assert_true(sf_lens_ray(&truth, pixel, ray));
        assert_true(sf_lens_project(&truth, (double[]){ray[0], ray[1], 1}, seen, NULL, NULL));
        assert_true(fabs(seen[0] - pixel[0]) + fabs(seen[1] - pixel[1]) < 1e-8);
    }
    sf_lens bent = truth;
    bent.k1 = -3; /* turns back before the picture's corner */
    assert_false(sf_lens_ray(&bent, (double[]){0, 0}, (double[2]){0}));
}

/* Poses. */

static double angle_of(const double A[9], const double B[9]) {
    double squares = 0;
    for (int i = 0; i < 9; i++) squares += (A[i] - B[i]) * (A[i] - B[i]);
    return 2 * asin(fmin(1, sqrt(squares / 8))) * 180 / pi;
}

static void test_pose(void **state) {
    (void)state;
    fixture f;
    begin(&f, 17);
    double worst_mm = 0, worst_degrees = 0, z2 = 0, n_z = 0;
    for (size_t i = 0; i < STANDS; i++) {
        sf_rigid T = pose_of(&truth, &stands[i]);
        sf_pose pose;
        size_t n = see(&f, &stands[i], 0.2);
        assert_ok(f.ctx, sf_board_pose(f.ctx, &truth, f.corners, n, &pose));
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
    end(&f);
}

static void test_pose_outliers(void **state) {
    (void)state;
    fixture f;
    sf_pose pose;
    begin(&f, 18);
    sf_rigid T = pose_of(&truth, &stands[5]);
    size_t n = see(&f, &stands[5], 0.1);
    for (size_t i = 0; i < 8; i++) f.corners[10 + i].pixel[0] += 20; /* two tags elsewhere */
    assert_ok(f.ctx, sf_board_pose(f.ctx, &truth, f.corners, n, &pose));
    assert_int_equal(pose.rejected, 8);
    assert_true(angle_of(pose.R_cb, T.R) < 0.3);
    end(&f);
}

/* A single tag from afar may be seen two ways; the whole board near by may not. */
static void test_pose_ambiguity(void **state) {
    (void)state;
    fixture f;
    sf_pose pose;
    begin(&f, 19);
    stand far = {320, 240, 1.6, 12, 8, 0}, near = {320, 240, 0.45, 25, 20, 0};
    size_t n = see(&f, &far, 0.3);
    assert_true(n >= 4);
    assert_ok(f.ctx, sf_board_pose(f.ctx, &truth, f.corners, 4, &pose));
    print_message("ambiguity of a tag at 1.6 m: %.3f\n", pose.ambiguity);
    assert_true(pose.ambiguity > 0.5 && pose.ambiguity <= 1);
    n = see(&f, &near, 0.3);
    assert_ok(f.ctx, sf_board_pose(f.ctx, &truth, f.corners, n, &pose));
    print_message("ambiguity of a board at 0.45 m: %.3f\n", pose.ambiguity);
    assert_true(pose.ambiguity < 0.3);
    /* Refusals. */
    assert_status(f.ctx, sf_board_pose(f.ctx, &truth, f.corners, 3, &pose), SF_ERR_EMPTY);
    for (size_t i = 0; i < 8; i++) f.corners[i].board[1] = f.corners[i].pixel[1] = 100;
    assert_status(f.ctx, sf_board_pose(f.ctx, &truth, f.corners, 8, &pose), SF_ERR_EMPTY);
    assert_error_names(f.ctx, "no pose explains the 8 corners");
    sf_lens bad = truth;
    bad.fx = -1;
    assert_status(f.ctx, sf_board_pose(f.ctx, &bad, f.corners, n, &pose), SF_ERR_ARGUMENT);
    end(&f);
}

/* Rendered pictures: the board's cells looked up through the lens, sensor noise and blur. */

enum { SAMPLES = 2, CELL_COLUMNS = 4 * 10 - 2, CELL_ROWS = 5 * 10 - 2, QUIET = 4 };

typedef struct studio {
    float *rays; /* [HEIGHT * SAMPLES][WIDTH * SAMPLES][2] */
    uint8_t cells[CELL_ROWS][CELL_COLUMNS];
    double cell; /* m */
    uint8_t grey[HEIGHT][WIDTH];
} studio;

static studio *make_studio(const fixture *f) {
    studio *s = calloc(1, sizeof *s);
    assert_non_null(s);
    s->rays = malloc(sizeof *s->rays * 2 * WIDTH * HEIGHT * SAMPLES * SAMPLES);
    assert_non_null(s->rays);
    s->cell = f->board->tag_size / 8;
    for (size_t t = 0; t < f->board->count; t++) {
        uint8_t cells[SF_TAG_MOST_CELLS * SF_TAG_MOST_CELLS];
        int side;
        assert_ok(f->ctx, sf_tags_cells(f->ctx, "tag36h11", (int)t, &side, cells));
        assert_int_equal(side, 8);
        for (int i = 0; i < 64; i++)
            s->cells[t / 4 * 10 + (size_t)i / 8][t % 4 * 10 + (size_t)i % 8] = cells[i];
    }
    for (int y = 0; y < HEIGHT * SAMPLES; y++)
        for (int x = 0; x < WIDTH * SAMPLES; x++) {
            double ray[2], pixel[2] = {(x + 0.5) / SAMPLES, (y + 0.5) / SAMPLES};
            assert_true(sf_lens_ray(&truth, pixel, ray));
            float *at = s->rays + 2 * ((size_t)y * WIDTH * SAMPLES + (size_t)x);
            at[0] = (float)ray[0];
            at[1] = (float)ray[1];
        }
    return s;
}

static void free_studio(studio *s) {
    free(s->rays);
    free(s);
}

/* Cameras blur light, and encode it after that. */
#define GAMMA 2.2

/* Bytes of the background, of white and of black. */
enum { AROUND, WHITE, BLACK };
static const double bytes[] = {105, 215, 30};

/* Which is at a point of the board's plane, in cells from its upper left. */
static int shade(const studio *s, double x, double y) {
    if (x < -QUIET || y < -QUIET || x >= CELL_COLUMNS + QUIET || y >= CELL_ROWS + QUIET) return AROUND;
    if (x < 0 || y < 0 || x >= CELL_COLUMNS || y >= CELL_ROWS) return WHITE;
    return s->cells[(int)y][(int)x] ? BLACK : WHITE;
}

/* Gauss' blur along one axis, for a standard deviation of `sigma` px. */
static void blur_along(float *picture, size_t count, size_t length, size_t step, size_t line_step,
                       double sigma) {
    enum { REACH = 3 };
    float weights[REACH + 1], sum = 0, line[WIDTH + 2 * REACH];
    for (int i = 0; i <= REACH; i++) {
        weights[i] = (float)exp(-i * i / (2 * sigma * sigma));
        sum += (i ? 2 : 1) * weights[i];
    }
    for (size_t l = 0; l < count; l++) {
        float *at = picture + l * line_step;
        for (size_t i = 0; i < length + 2 * REACH; i++) {
            size_t from = i < REACH ? 0 : i - REACH;
            line[i] = at[(from < length ? from : length - 1) * step];
        }
        for (size_t i = 0; i < length; i++) {
            const float *m = line + i + REACH;
            float mean = weights[0] * m[0];
            for (int k = 1; k <= REACH; k++) mean += weights[k] * (m[k] + m[-k]);
            at[i * step] = mean / sum;
        }
    }
}

/* A table of the sensor's noise, read from another place in each row: normal numbers are slow. */
enum { NOISE = 1 << 14 };

static void make_noise(float table[NOISE], double sigma, sf_rng *rng) {
    for (int i = 0; i < NOISE; i++) table[i] = (float)(sigma * sf_rng_normal(rng));
}

static void render(studio *s, const sf_rigid *T, double blur, double noise, sf_rng *rng) {
    static float picture[HEIGHT * WIDTH], table[NOISE];
    /* A ray d meets the plane where n . (l d - t) = 0; its place is x . (l d - t), y . (l d - t). */
    double n[3], a[3], b[3];
    for (int i = 0; i < 3; i++) {
        a[i] = T->R[3 * i];
        b[i] = T->R[3 * i + 1];
        n[i] = T->R[3 * i + 2];
    }
    double nt = sf_dot3(n, T->t), at = sf_dot3(a, T->t), bt = sf_dot3(b, T->t), light[3];
    for (int i = 0; i < 3; i++) light[i] = pow(bytes[i] / 255, GAMMA) / (SAMPLES * SAMPLES);
    memset(picture, 0, sizeof picture);
    for (size_t y = 0; y < HEIGHT * SAMPLES; y++)
        for (size_t x = 0; x < WIDTH * SAMPLES; x++) {
            const float *ray = s->rays + 2 * (y * WIDTH * SAMPLES + x);
            double d[3] = {(double)ray[0], (double)ray[1], 1}, l = nt / sf_dot3(n, d);
            double u = (l * sf_dot3(a, d) - at) / s->cell + CELL_COLUMNS / 2.0;
            double v = (l * sf_dot3(b, d) - bt) / s->cell + CELL_ROWS / 2.0;
            picture[y / SAMPLES * WIDTH + x / SAMPLES] += (float)light[shade(s, u, v)];
        }
    if (blur > 0) {
        blur_along(picture, HEIGHT, WIDTH, 1, WIDTH, blur);
        blur_along(picture, WIDTH, HEIGHT, WIDTH, 1, blur);
    }
    make_noise(table, noise, rng);
    for (size_t y = 0; y < HEIGHT; y++) {
        size_t from = sf_rng_below(rng, NOISE - WIDTH);
        for (size_t x = 0; x < WIDTH; x++) {
            float value = 255 * powf(picture[y * WIDTH + x], (float)(1 / GAMMA)) + table[from + x] + 0.5f;
            s->grey[y][x] = value > 0 ? value < 255 ? (uint8_t)value : 255 : 0;
        }
    }
}

/* How far the detector's corners are from where the lens puts them. */
typedef struct offsets {
    double mean[2], squares, along; /* `along`: away from the tag's middle */
    size_t count;
} offsets;

static void measure_offsets(const sf_rigid *T, const sf_board_corner *corners, size_t count, offsets *o) {
    for (size_t i = 0; i < count; i++) {
        const double *b = corners[i].board;
        double p[3], pixel[2], d[2], out[2] = {0}, length;
        for (int k = 0; k < 3; k++) p[k] = T->R[3 * k] * b[0] + T->R[3 * k + 1] * b[1] + T->t[k];
        assert_true(sf_lens_project(&truth, p, pixel, NULL, NULL));
        for (int k = 0; k < 2; k++) {
            d[k] = corners[i].pixel[k] - pixel[k];
            o->mean[k] += d[k];
            o->squares += d[k] * d[k];
            out[k] =
                corners[i].pixel[k] - (corners[i - i % 4].pixel[k] + corners[i - i % 4 + 2].pixel[k]) / 2;
        }
        length = hypot(out[0], out[1]);
        o->along += (d[0] * out[0] + d[1] * out[1]) / length;
        o->count++;
    }
}

/* Edges that are seen outwards of where they are, or inwards, make nothing of the pose, nor of the lens:
 * boards of six tags and more, which stand apart. A tag alone does not tell it from its distance. */
static void test_swollen_edges(void **state) {
    (void)state;
    static const double swellings[] = {-0.4, -0.1, 0.2, 0.5};
    fixture f;
    sf_calibration c;
    begin(&f, 5);
    for (size_t k = 0; k < sizeof swellings / sizeof *swellings; k++) {
        double worst = 0, without = 0;
        sf_sightings_destroy(&f.sightings);
        assert_ok(f.ctx, sf_sightings_create(f.ctx, WIDTH, HEIGHT, &f.sightings));
        for (size_t i = 0; i < STANDS; i++) {
            sf_rigid T = pose_of(&truth, &stands[i]);
            sf_pose pose;
            size_t n = project_board(f.board, &truth, &T, 0.05, &f.rng, f.corners);
            if (n < 24) continue;
            sf_swell(f.corners, n, swellings[k]);
            assert_ok(f.ctx, sf_sightings_add(f.sightings, f.corners, n));
            assert_ok(f.ctx, sf_board_pose(f.ctx, &truth, f.corners, n, &pose));
            double off[3];
            for (int d = 0; d < 3; d++) off[d] = pose.t_cb[d] - T.t[d];
            worst = fmax(worst, sqrt(sf_dot3(off, off) / sf_dot3(T.t, T.t)));
            assert_ok(f.ctx, sf_board_pose(f.ctx, &truth, f.corners, 4, &pose)); /* a tag alone */
            for (int d = 0; d < 3; d++) off[d] = pose.t_cb[d] - T.t[d];
            without = fmax(without, sqrt(sf_dot3(off, off) / sf_dot3(T.t, T.t)));
        }
        assert_ok(f.ctx, sf_calibrate(f.sightings, NULL, &c));
        print_message(
            "edges %+.1f px outwards: poses off by %.4f of the distance at most, %.4f by a tag alone; fx "
            "by %+.3f %%, rms %.3f px\n",
            swellings[k], worst, without, 100 * (c.lens.fx / truth.fx - 1), c.rms);
        assert_true(worst < 0.002);
        assert_true(without > fabs(swellings[k]) / 100);
        assert_true(fabs(c.lens.fx / truth.fx - 1) < 0.002);
        assert_true(c.rms < 0.1);
    }
    end(&f);
}

static int have_tags(sf_context *ctx) {
    int side;
    uint8_t cells[SF_TAG_MOST_CELLS * SF_TAG_MOST_CELLS];
    return sf_tags_cells(ctx, "tag36h11", 0, &side, cells) != SF_ERR_UNSUPPORTED;
}

static void need_tags(fixture *f) {
    if (have_tags(f->ctx)) return;
    end(f);
    test_skip("not built with libapriltag");
}

/* Runs the program; returns its exit code. What it said is in *said, free()d by the caller. */
static int run_program(const char *arguments, char **said) {
    char command[4096];
    const char *program = getenv("SPLATFIT_PROGRAM"), *run = getenv("RUN");
    size_t size;
    snprintf(command, sizeof command, "%s %s %s >%s 2>&1", run ? run : "",
             program ? program : "build/splatfit", arguments, test_path("said.txt"));
    int status = system(command);
    *said = (char *)test_read(test_path("said.txt"), &size);
    assert_true(WIFEXITED(status));
    return WEXITSTATUS(status);
}

/* The program on the same frames, as a pipe gives them. */
static void run_command(sf_context *ctx) {
    char arguments[2048], *said;
    sf_calibration c;
    snprintf(arguments, sizeof arguments, "calibrate 'pipe:%s?size=640x480&format=GREY' --decimate 2 -o %s",
             test_path("frames.grey"), test_path("camera.json"));
    int code = run_program(arguments, &said);
    if (code) print_error("%s: %s\n", arguments, said);
    assert_int_equal(code, 0);
    test_assert_contains(said, "reprojection error 0.", __FILE__, __LINE__);
    test_assert_contains(said, " % of 8 x 6 cells", __FILE__, __LINE__);
    free(said);
    assert_ok(ctx, sf_calibration_load(ctx, test_path("camera.json"), &c));
    print_lens("splatfit calibrate", &c);
    assert_within_bar(&c);
    assert_true(c.width == WIDTH && c.height == HEIGHT && c.views >= 12);
}

static void test_rendered_boards(void **state) {
    (void)state;
    fixture f;
    sf_detector *detector;
    sf_calibration c;
    offsets o = {0};
    begin(&f, 30);
    need_tags(&f);
    studio *s = make_studio(&f);
    FILE *frames = fopen(test_path("frames.grey"), "wb");
    assert_non_null(frames);
    assert_ok(f.ctx, sf_detector_create(f.ctx, f.board, 1, &detector));
    for (size_t i = 0; i < (test_is_quick() ? 4 : STANDS); i++) {
        const sf_board_corner *corners;
        size_t count;
        sf_rigid T = pose_of(&truth, &stands[i]);
        render(s, &T, 0.5 + 0.1 * (double)(i % 6), 4, &f.rng);
        assert_ok(f.ctx, sf_detector_find(detector, s->grey[0], WIDTH, WIDTH, HEIGHT, &corners, &count));
        assert_true(count >= 40);
        assert_int_equal(fwrite(s->grey, sizeof s->grey, 1, frames), 1);
        measure_offsets(&T, corners, count, &o);
        assert_ok(f.ctx, sf_sightings_add(f.sightings, corners, count));
    }
    assert_int_equal(fclose(frames), 0);
    double n = (double)o.count;
    print_message("corners found: off by %+.3f, %+.3f px in the mean, %+.3f px outwards, %.3f px rms\n",
                  o.mean[0] / n, o.mean[1] / n, o.along / n, sqrt(o.squares / n));
    assert_true(fabs(o.mean[0] / n) < 0.05 && fabs(o.mean[1] / n) < 0.05);
    assert_true(sqrt(o.squares / n) < 0.3);
    assert_ok(f.ctx, sf_calibrate(f.sightings, NULL, &c));
    print_lens("rendered boards", &c);
    assert_true(c.rms < 0.3);
    if (test_is_quick())
        assert_as_told(&c);
    else {
        assert_within_bar(&c);
        run_command(f.ctx);
    }
    sf_detector_destroy(&detector);
    free_studio(s);
    end(&f);
}

static void test_commands(void **state) {
    (void)state;
    static const struct {
        int code, needs_tags;
        const char *arguments, *says;
    } cases[] = {
        {2, 0, "board", "--output FILE: is needed"},
        {2, 0, "board -o x.bmp", "x.bmp: ending"},
        {2, 0, "board -o x.pdf --board a5", "\"a5\" is none of"},
        {2, 0, "calibrate", "one of the two is needed"},
        {2, 0, "calibrate sim:studio --convert x.yaml", "one of the two is needed"},
        {2, 0, "calibrate sim:studio --tag-size 0", "--tag-size: \"0\" is not a number"},
        {2, 0, "calibrate sim:studio --radial 3", "--radial"},
        {2, 1, "calibrate nothing:", "unknown source"},
        {1, 0, "calibrate --convert no-such-file", "no-such-file"},
        {1, 1, "calibrate 'sim:studio?frames=2&width=64&height=48'", "no frame shows a tag"},
        {1, 0, "calibrate sim:studio -o no/such/folder/camera.json", "no/such/folder"},
        {0, 0, "calibrate --help", "--no-tangential"},
    };
    sf_context *ctx = test_context();
    int tags = have_tags(ctx);
    sf_context_destroy(&ctx);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char *said;
        if (cases[i].needs_tags && !tags) continue;
        int code = run_program(cases[i].arguments, &said);
        test_assert_contains(said, cases[i].says, __FILE__, __LINE__);
        assert_int_equal(code, cases[i].code);
        free(said);
    }
}

static void test_convert_command(void **state) {
    (void)state;
    static const char camera[] = "1 RADIAL 640 480 600.5 320 240 0.1 -0.02\n";
    sf_context *ctx = test_context();
    sf_calibration c;
    char arguments[2048], *said;
    test_write(test_path("cameras.txt"), camera, sizeof camera - 1);
    snprintf(arguments, sizeof arguments, "calibrate --convert %s -o %s", test_path("cameras.txt"),
             test_path("converted.json"));
    assert_int_equal(run_program(arguments, &said), 0);
    test_assert_contains(said, "600.500 px", __FILE__, __LINE__);
    free(said);
    assert_ok(ctx, sf_calibration_load(ctx, test_path("converted.json"), &c));
    assert_true(c.lens.fy == 600.5 && c.lens.k2 == -0.02 && c.width == 640);
    snprintf(arguments, sizeof arguments, "calibrate --convert %s -o -", test_path("cameras.txt"));
    assert_int_equal(run_program(arguments, &said), 0);
    test_write(test_path("said.json"), said, strlen(said)); /* nothing but the calibration */
    assert_ok(ctx, sf_calibration_load(ctx, test_path("said.json"), &c));
    free(said);
    sf_context_destroy(&ctx);
}

/* Each allocation in turn gives nothing: SF_ERR_MEMORY, and nothing is left behind. */
static sf_status whole_calibration(sf_context *ctx) {
    sf_board *board = NULL;
    sf_sightings *sightings = NULL;
    sf_calibration c;
    sf_pose pose;
    sf_board_corner corners[MOST_CORNERS];
    sf_status status = sf_board_open(ctx, "a4-36h11", 0, &board);
    if (!status) status = sf_sightings_create(ctx, WIDTH, HEIGHT, &sightings);
    for (int i = 0; i < 5 && !status; i++) {
        sf_rigid T = pose_of(&truth, &stands[i]);
        size_t n = project_board(board, &truth, &T, 0, NULL, corners);
        status = sf_sightings_add(sightings, corners, n);
        if (!status && i == 4) status = sf_board_pose(ctx, &truth, corners, n, &pose);
    }
    if (!status) status = sf_calibrate(sightings, NULL, &c);
    if (!status) status = sf_calibration_save(ctx, &c, test_path("memory.json"));
    if (!status) status = sf_calibration_load(ctx, test_path("memory.json"), &c);
    sf_sightings_destroy(&sightings);
    sf_board_close(&board);
    return status;
}

static void test_each_allocation_may_fail(void **state) {
    (void)state;
    sf_status status = SF_ERR_MEMORY;
    long failed = 0;
    for (long at = 1; status == SF_ERR_MEMORY && at < 200; at++) {
        test_allocations memory = {0};
        sf_allocator allocator = {test_count_alloc, test_count_free, &memory};
        sf_context_options options = {.allocator = &allocator, .threads = 1};
        sf_context *ctx = NULL;
        assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
        memory.fail_at = atomic_load(&memory.calls) + at;
        status = whole_calibration(ctx);
        failed += status == SF_ERR_MEMORY;
        sf_context_destroy(&ctx);
        assert_int_equal(atomic_load(&memory.live), 0);
    }
    assert_int_equal(status, SF_OK);
    assert_true(failed > 8);
}

/* Photographs: 99 frames of a camera held over a board of 4 x 3 tags, of which the eighth is hidden. */

/* The board as it lies there: sides of 95.5 mm, 120.4 mm apart. */
static sf_board *real_board(sf_context *ctx) {
    char text[2048] = "{\"name\": \"tagboard\", \"tag_size_m\": 0.0955, \"tags\": [";
    sf_board *board;
    for (int id = 0; id < 12; id++) {
        size_t used = strlen(text);
        snprintf(text + used, sizeof text - used, "%s{\"id\": %d, \"x_m\": %.4f, \"y_m\": %.4f}",
                 id ? ", " : "", id, id % 4 * 0.1204, id / 4 * 0.1204);
    }
    strcat(text, "]}");
    test_write(test_path("tagboard.json"), text, strlen(text));
    assert_ok(ctx, sf_board_open(ctx, test_path("tagboard.json"), 0, &board));
    assert_int_equal(board->count, 12);
    return board;
}

static void print_real(const char *what, const sf_calibration *c) {
    print_message(
        "%s: reprojection error %.3f px rms, worst view %.3f px; %zu views (%zu rejected), %zu corners (%zu "
        "rejected), tilts of up to %.1f degrees, %.1f apart; fx %.2f (+-%.2f) fy %.2f cx %.2f cy %.2f k1 "
        "%.4f (+-%.4f)\n",
        what, c->rms, c->worst_rms, c->views, c->views_rejected, c->corners, c->corners_rejected,
        c->tilt_most, c->tilt_spread, c->lens.fx, c->sigma.fx, c->lens.fy, c->lens.cx, c->lens.cy, c->lens.k1,
        c->sigma.k1);
}

static size_t see_photograph(sf_context *ctx, sf_detector *detector, const char *path,
                             const sf_board_corner **corners) {
    sf_picture picture;
    size_t count;
    assert_ok(ctx, sf_picture_load(ctx, path, &picture));
    size_t pixels = (size_t)picture.width * (size_t)picture.height;
    for (size_t i = 0; i < pixels; i++)
        picture.rgb[i] =
            (uint8_t)((picture.rgb[i] + 2 * picture.rgb[i + pixels] + picture.rgb[i + 2 * pixels] + 2) / 4);
    assert_int_equal(picture.width, WIDTH);
    assert_int_equal(picture.height, HEIGHT);
    assert_ok(ctx, sf_detector_find(detector, picture.rgb, WIDTH, WIDTH, HEIGHT, corners, &count));
    sf_picture_free(ctx, &picture);
    return count;
}

static void test_photographs(void **state) {
    (void)state;
    char path[1024];
    const char *data = test_data();
    sf_context *ctx = test_context();
    if (!have_tags(ctx)) {
        sf_context_destroy(&ctx);
        test_skip("not built with libapriltag");
    }
    sf_board *board = real_board(ctx);
    sf_detector *detector;
    sf_sightings *sightings;
    sf_calibration c;
    const sf_lens factory = {607.178, 607.234, 321.391, 241.918, 0, 0, 0, 0, 0};
    double squares = 0, poses = 0;
    assert_ok(ctx, sf_detector_create(ctx, board, 1, &detector));
    assert_ok(ctx, sf_sightings_create(ctx, WIDTH, HEIGHT, &sightings));
    for (int i = 0; i < 99; i++) {
        const sf_board_corner *corners;
        sf_pose pose;
        snprintf(path, sizeof path, "%s/rbt-tagboard/images/frame_%04d.jpg", data, i);
        size_t n = see_photograph(ctx, detector, path, &corners);
        if (n < 16) continue;
        assert_ok(ctx, sf_sightings_add(sightings, corners, n));
        assert_ok(ctx, sf_board_pose(ctx, &factory, corners, n, &pose));
        squares += pose.rms * pose.rms;
        poses++;
    }
    print_message("%.0f photographs: poses through the factory's lens: %.3f px rms\n", poses,
                  sqrt(squares / poses));
    assert_int_equal(poses, 99);
    assert_true(sqrt(squares / poses) < 0.8);
    /* One focal length and k1: more cannot be told by tilts within nine degrees, as is said. */
    sf_calibrate_options o = {.fix_aspect = 1, .fix_center = 1, .radial = 1};
    test_log_clear();
    assert_ok(ctx, sf_calibrate(sightings, &o, &c));
    print_real("focal length and k1", &c);
    assert_non_null(strstr(test_log, "the tilts of the views differ by"));
    assert_true(c.rms < 0.45 && c.worst_rms < 0.9);
    assert_true(fabs(c.lens.fx / factory.fx - 1) < 0.05);
    assert_true(c.views >= 90 && c.corners_rejected < c.corners / 10);
    assert_true(c.rms < 0.3);
    assert_status(ctx, sf_calibrate(sightings, NULL, &c), SF_ERR_EMPTY);
    test_assert_contains(sf_last_error(ctx), "leave the lens open", __FILE__, __LINE__);
    sf_sightings_destroy(&sightings);
    sf_detector_destroy(&detector);
    sf_board_close(&board);
    sf_context_destroy(&ctx);
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
        cmocka_unit_test(test_bad_sightings),
        cmocka_unit_test(test_projection_derivatives),
        cmocka_unit_test(test_sums_derivatives),
        cmocka_unit_test(test_rays),
        cmocka_unit_test(test_pose),
        cmocka_unit_test(test_pose_outliers),
        cmocka_unit_test(test_pose_ambiguity),
        cmocka_unit_test(test_swollen_edges),
        cmocka_unit_test(test_rendered_boards),
        cmocka_unit_test(test_commands),
        cmocka_unit_test(test_convert_command),
        cmocka_unit_test(test_each_allocation_may_fail),
        cmocka_unit_test(test_photographs),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
