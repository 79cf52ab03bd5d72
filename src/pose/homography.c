/* homography.c - see homography.h. */
#include "homography.h"

#include <math.h>

#include "../base/linear.h"

sf_normalizer sf_normalizer_make(const double *points, size_t count) {
    sf_normalizer n = {{0, 0}, 0};
    for (size_t i = 0; i < count; i++)
        for (size_t k = 0; k < 2; k++) n.middle[k] += points[2 * i + k] / (double)count;
    double squares = 0;
    for (size_t i = 0; i < count; i++)
        for (size_t k = 0; k < 2; k++) squares += pow(points[2 * i + k] - n.middle[k], 2);
    n.scale = sqrt(2 * (double)count / squares);
    return n;
}

void sf_normalizer_apply(const sf_normalizer *n, const double in[2], double out[2]) {
    for (int k = 0; k < 2; k++) out[k] = n->scale * (in[k] - n->middle[k]);
}

void sf_homography_map(const double H[9], const double from[2], double to[2]) {
    double w = H[6] * from[0] + H[7] * from[1] + H[8];
    to[0] = (H[0] * from[0] + H[1] * from[1] + H[2]) / w;
    to[1] = (H[3] * from[0] + H[4] * from[1] + H[5]) / w;
}

/* Adds a pair's two equations of the direct linear transformation. */
static void add_pair(const double X[2], const double x[2], double w, double A[81]) {
    double rows[18] = {X[0], X[1], 1, 0,    0,    0, -x[0] * X[0], -x[0] * X[1], -x[0],
                       0,    0,    0, X[0], X[1], 1, -x[1] * X[0], -x[1] * X[1], -x[1]};
    for (int i = 0; i < 9; i++)
        for (int j = 0; j < 9; j++) A[i * 9 + j] += w * (rows[i] * rows[j] + rows[9 + i] * rows[9 + j]);
}

/* H = from normalized to plain: N_x^-1 G N_X. */
static void restore(const double G[9], const sf_normalizer *X, const sf_normalizer *x, double H[9]) {
    double right[9] = {X->scale, 0, -X->scale * X->middle[0], 0, X->scale, -X->scale * X->middle[1], 0, 0, 1};
    double left[9] = {1 / x->scale, 0, x->middle[0], 0, 1 / x->scale, x->middle[1], 0, 0, 1};
    double middle[9];
    sf_mat3_mul(G, right, middle);
    sf_mat3_mul(left, middle, H);
}

/* Points on a line leave a second direction undetermined: the spread across is then nothing. */
static int in_a_line(const double *points, size_t count, const sf_normalizer *n) {
    double xx = 0, xy = 0, yy = 0;
    for (size_t i = 0; i < count; i++) {
        double p[2];
        sf_normalizer_apply(n, points + 2 * i, p);
        xx += p[0] * p[0];
        xy += p[0] * p[1];
        yy += p[1] * p[1];
    }
    return !(xx * yy - xy * xy > 1e-6 * (xx + yy) * (xx + yy));
}

int sf_homography_fit(const double *from, const double *to, const double *weights, size_t count,
                      double H[9]) {
    if (count < 4) return 0;
    sf_normalizer X = sf_normalizer_make(from, count), x = sf_normalizer_make(to, count);
    double A[81] = {0}, G[9];
    if (!isfinite(X.scale) || !isfinite(x.scale) || in_a_line(from, count, &X)) return 0;
    for (size_t i = 0; i < count; i++) {
        double a[2], b[2];
        sf_normalizer_apply(&X, from + 2 * i, a);
        sf_normalizer_apply(&x, to + 2 * i, b);
        add_pair(a, b, weights ? weights[i] : 1, A);
    }
    sf_least_eigenvector(9, A, G);
    restore(G, &X, &x, H);
    return 1;
}
