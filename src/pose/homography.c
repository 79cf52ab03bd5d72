/* homography.c - see homography.h. */
#include "homography.h"

#include <math.h>
#include <string.h>

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

/* A pair's two equations of the direct linear transformation are (X, 0, -x X) and (0, X, -y X). What their
 * squares sum up to has blocks of X X^T alone, times 1, x, y and x^2 + y^2: */
enum { PRODUCTS = 6, TIMES_1 = 0, TIMES_X = 6, TIMES_Y = 12, TIMES_SQUARE = 18, SUMS = 24 };

static void add_pair(const double X[2], const double x[2], double w, double sums[SUMS]) {
    const double products[PRODUCTS] = {w * X[0] * X[0], w * X[0] * X[1], w * X[1] * X[1],
                                       w * X[0],        w * X[1],        w};
    double square = x[0] * x[0] + x[1] * x[1];
    for (int k = 0; k < PRODUCTS; k++) {
        sums[TIMES_1 + k] += products[k];
        sums[TIMES_X + k] += products[k] * x[0];
        sums[TIMES_Y + k] += products[k] * x[1];
        sums[TIMES_SQUARE + k] += products[k] * square;
    }
}

static void put_block(const double products[PRODUCTS], double sign, int row, int column, double A[81]) {
    static const int which[9] = {0, 1, 3, 1, 2, 4, 3, 4, 5};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) A[(3 * row + i) * 9 + 3 * column + j] = sign * products[which[3 * i + j]];
}

static void make_equations(const double sums[SUMS], double A[81]) {
    memset(A, 0, 81 * sizeof *A);
    for (int k = 0; k < 2; k++) {
        const double *off = sums + (k ? TIMES_Y : TIMES_X);
        put_block(sums + TIMES_1, 1, k, k, A);
        put_block(off, -1, k, 2, A);
        put_block(off, -1, 2, k, A);
    }
    put_block(sums + TIMES_SQUARE, 1, 2, 2, A);
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
    double sums[SUMS] = {0}, A[81], G[9];
    if (!isfinite(X.scale) || !isfinite(x.scale) || in_a_line(from, count, &X)) return 0;
    for (size_t i = 0; i < count; i++) {
        double a[2], b[2], w = weights ? weights[i] : 1;
        if (w == 0) continue;
        sf_normalizer_apply(&X, from + 2 * i, a);
        sf_normalizer_apply(&x, to + 2 * i, b);
        add_pair(a, b, w, sums);
    }
    make_equations(sums, A);
    sf_least_eigenvector(9, A, G);
    restore(G, &X, &x, H);
    return 1;
}
