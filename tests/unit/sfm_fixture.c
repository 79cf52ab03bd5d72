/* sfm_fixture.c - see sfm_fixture.h. */
#include "sfm_fixture.h"

#include <math.h>
#include <string.h>

#include "../../src/base/linear.h"

void sfm_direction(sf_rng *rng, double d[3]) {
    double length;
    do {
        for (int k = 0; k < 3; k++) d[k] = sf_rng_normal(rng);
        length = sqrt(sf_dot3(d, d));
    } while (length < 1e-3);
    for (int k = 0; k < 3; k++) d[k] /= length;
}

void sfm_rotation(sf_rng *rng, double most, double R[9]) {
    double phi[3];
    sfm_direction(rng, phi);
    double angle = most * sf_rng_uniform(rng);
    for (int k = 0; k < 3; k++) phi[k] *= angle;
    sf_rotation_exp(phi, R);
}

/* A point that both cameras see. */
static void make_point(sfm_pair *pair, sf_rng *rng, sfm_layout layout, const double plane[3], size_t i) {
    double p[3], q[3];
    do {
        double x = 1.2 * (sf_rng_uniform(rng) - 0.5), y = 1.2 * (sf_rng_uniform(rng) - 0.5);
        double z =
            layout == SFM_PLANE ? 1 / (plane[0] * x + plane[1] * y + plane[2]) : 2 + 4 * sf_rng_uniform(rng);
        p[0] = x * z, p[1] = y * z, p[2] = z;
        sf_rigid_apply(&pair->T, p, q);
    } while (!(q[2] > 0.3 && p[2] > 0 && p[2] < 20));
    memcpy(pair->points + 3 * i, p, sizeof p);
    for (size_t k = 0; k < 2; k++) pair->a[2 * i + k] = p[k] / p[2], pair->b[2 * i + k] = q[k] / q[2];
}

void sfm_make_pair(sfm_pair *pair, sf_rng *rng, sfm_layout layout, size_t count, double noise, double wrong) {
    double plane[3] = {0.15 * sf_rng_normal(rng), 0.15 * sf_rng_normal(rng), 0.3};
    pair->count = count;
    sfm_rotation(rng, 0.5, pair->T.R);
    sfm_direction(rng, pair->T.t);
    for (int k = 0; k < 3 && layout == SFM_ROTATION; k++) pair->T.t[k] = 0;
    for (size_t i = 0; i < count; i++) {
        make_point(pair, rng, layout, plane, i);
        pair->is_true[i] = !(sf_rng_uniform(rng) < wrong);
        for (size_t k = 0; k < 2; k++) {
            pair->a[2 * i + k] += noise * sf_rng_normal(rng);
            pair->b[2 * i + k] += noise * sf_rng_normal(rng);
            if (!pair->is_true[i]) pair->b[2 * i + k] = 1.2 * (sf_rng_uniform(rng) - 0.5);
        }
    }
}

double sfm_angle_between(const double R[9], const double Q[9]) {
    double squares = 0; /* |R - Q| = 2 sqrt(2) sin(angle / 2) */
    for (int i = 0; i < 9; i++) squares += pow(R[i] - Q[i], 2);
    return 2 * asin(fmin(sqrt(squares / 8), 1));
}

double sfm_direction_error(const double a[3], const double b[3]) {
    double cross[3];
    sf_cross3(a, b, cross);
    return atan2(sqrt(sf_dot3(cross, cross)), sf_dot3(a, b));
}

double sfm_matrix_error(const double *A, const double *B, size_t n) {
    double aa = 0, bb = 0, ab = 0, squares = 0;
    for (size_t i = 0; i < n; i++) aa += A[i] * A[i], bb += B[i] * B[i], ab += A[i] * B[i];
    for (size_t i = 0; i < n; i++) squares += pow(A[i] / sqrt(aa) - (ab < 0 ? -1 : 1) * B[i] / sqrt(bb), 2);
    return sqrt(squares);
}

void sfm_look_at(const double center[3], const double target[3], sf_rigid *T) {
    double ahead[3], right[3], length, down[3] = {0, 1, 0};
    for (int k = 0; k < 3; k++) ahead[k] = target[k] - center[k];
    length = sqrt(sf_dot3(ahead, ahead));
    for (int k = 0; k < 3; k++) T->R[6 + k] = ahead[k] /= length;
    sf_cross3(down, ahead, right);
    length = sqrt(sf_dot3(right, right));
    for (int k = 0; k < 3; k++) T->R[k] = right[k] /= length;
    sf_cross3(ahead, right, T->R + 3);
    for (int k = 0; k < 3; k++) T->t[k] = -sf_dot3(T->R + 3 * k, center);
}
