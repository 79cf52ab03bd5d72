/* calibrate_fixture.c - see the header. */
#include "calibrate_fixture.h"

#include <math.h>
#include <sys/wait.h>

#include "base/rng.h"
#include "base/linear.h"
#include "pose/edge_bias.h"
#include "pose/view.h"

const double calibrate_pi = 3.141592653589793;
const sf_lens calibrate_truth = {613.4, 610.9, 327.3, 235.8, -0.21, 0.06, 0.0012, -0.0008, 0};

sf_rigid calibrate_pose_of(const sf_lens *lens, const stand *s) {
    double ray[2], X[9], Y[9], Z[9], YX[9];
    sf_rigid T;
    assert_true(sf_lens_ray(lens, (double[]){s->u, s->v}, ray));
    sf_rotation_exp((double[]){s->x * calibrate_pi / 180, 0, 0}, X);
    sf_rotation_exp((double[]){0, s->y * calibrate_pi / 180, 0}, Y);
    sf_rotation_exp((double[]){0, 0, s->z * calibrate_pi / 180}, Z);
    sf_mat3_mul(Y, X, YX);
    sf_mat3_mul(Z, YX, T.R);
    T.t[0] = ray[0] * s->distance;
    T.t[1] = ray[1] * s->distance;
    T.t[2] = s->distance;
    return T;
}

const stand calibrate_stands[STANDS] = {
    {320, 240, 0.45, 0, 0, 0},      {200, 160, 0.55, 30, 0, 5},   {440, 160, 0.55, -30, 5, -8},
    {200, 320, 0.55, 5, 32, 90},    {440, 320, 0.55, -5, -32, 0}, {320, 240, 0.42, 25, 25, 40},
    {300, 250, 0.8, -35, 20, 0},    {120, 110, 0.6, 20, -25, 10}, {530, 110, 0.6, 25, 20, -20},
    {120, 380, 0.6, -20, -30, 180}, {530, 370, 0.6, -25, 28, 0},  {330, 240, 0.5, 40, -10, 75},
    {320, 120, 0.5, -15, 35, 0},    {320, 380, 0.5, 30, -20, 0},  {250, 240, 0.7, 10, 40, 30},
    {420, 260, 0.65, -40, -15, 0},
};

size_t calibrate_project_board(const sf_board *board, const sf_lens *lens, const sf_rigid *T, double sigma,
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

void calibrate_begin(fixture *f, uint64_t seed) {
    f->ctx = test_context();
    assert_ok(f->ctx, sf_board_open(f->ctx, "a4-36h11", 0, &f->board));
    assert_ok(f->ctx, sf_observations_create(f->ctx, WIDTH, HEIGHT, &f->observations));
    sf_rng_seed(&f->rng, seed);
}

void calibrate_end(fixture *f) {
    sf_observations_destroy(&f->observations);
    sf_board_close(&f->board);
    sf_context_destroy(&f->ctx);
}

size_t calibrate_see(fixture *f, const stand *s, double sigma) {
    sf_rigid T = calibrate_pose_of(&calibrate_truth, s);
    return calibrate_project_board(f->board, &calibrate_truth, &T, sigma, &f->rng, f->corners);
}

void calibrate_print_lens(const char *what, const sf_calibration *c) {
    const sf_lens *l = &c->lens, *s = &c->sigma;
    print_message(
        "%s: fx %+.3f %% (+-%.3f), fy %+.3f %%, cx %+.3f px (+-%.3f), cy %+.3f px, k1 %+.5f (+-%.5f), k2 "
        "%+.5f (+-%.5f), p1 %+.6f, p2 %+.6f; rms %.4f px, %zu views, %zu corners, coverage %.2f\n",
        what, 100 * (l->fx / calibrate_truth.fx - 1), 100 * s->fx / calibrate_truth.fx,
        100 * (l->fy / calibrate_truth.fy - 1), l->cx - calibrate_truth.cx, s->cx, l->cy - calibrate_truth.cy,
        l->k1 - calibrate_truth.k1, s->k1, l->k2 - calibrate_truth.k2, s->k2, l->p1 - calibrate_truth.p1,
        l->p2 - calibrate_truth.p2, c->rms, c->views, c->corners, c->coverage);
}

void calibrate_assert_as_told(const sf_calibration *c) {
    const double *got = &c->lens.fx, *sigma = &c->sigma.fx, *want = &calibrate_truth.fx;
    for (int i = 0; i < SF_LENS_PARAMETERS; i++) assert_true(fabs(got[i] - want[i]) < 4.5 * sigma[i]);
    assert_true(fabs(c->lens.fx / calibrate_truth.fx - 1) < 0.003 &&
                fabs(c->lens.k1 - calibrate_truth.k1) < 0.01);
}
