/* fundamental.c - see fundamental.h. */
#include "fundamental.h"

#include <math.h>
#include <string.h>

#include "../base/linear.h"
#include "../pose/homography.h"
#include "epipolar.h"
#include "null_space.h"
#include "polynomial.h"

/* The coefficients of F in b^T F a. */
static void equation(const double a[2], const double b[2], double row[9]) {
    row[0] = b[0] * a[0], row[1] = b[0] * a[1], row[2] = b[0];
    row[3] = b[1] * a[0], row[4] = b[1] * a[1], row[5] = b[1];
    row[6] = a[0], row[7] = a[1], row[8] = 1;
}

static void cofactors(const double F[9], double to[9]) {
    for (int i = 0; i < 3; i++) sf_cross3(F + 3 * ((i + 1) % 3), F + 3 * ((i + 2) % 3), to + 3 * i);
}

static double dot9(const double *a, const double *b) {
    double sum = 0;
    for (int i = 0; i < 9; i++) sum += a[i] * b[i];
    return sum;
}

int sf_fundamental_from_7(const double *a, const double *b, const uint32_t sample[7],
                          double F[9 * SF_FUNDAMENTAL_MOST]) {
    double rows[63], N[18], first[9], second[9], roots[SF_DEGREE_MOST];
    for (int i = 0; i < 7; i++) equation(a + 2 * sample[i], b + 2 * sample[i], rows + 9 * i);
    sf_null_space(7, rows, N);
    cofactors(N, first);
    cofactors(N + 9, second);
    /* det(x N0 + N1) */
    const double c[4] = {dot9(second, N + 9) / 3, dot9(second, N), dot9(first, N + 9), dot9(first, N) / 3};
    int count = sf_polynomial_roots(c, 3, roots);
    if (count > SF_FUNDAMENTAL_MOST) count = SF_FUNDAMENTAL_MOST;
    for (int k = 0; k < count; k++) {
        double norm = 1 / sqrt(1 + roots[k] * roots[k]);
        for (int i = 0; i < 9; i++) F[9 * k + i] = norm * (roots[k] * N[i] + N[9 + i]);
    }
    return count;
}

/* The nearest matrix of rank 2: F - F v v^T, with v the right singular vector of the least value. */
static void make_singular(double F[9]) {
    double A[9], v[3], along[3];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) A[3 * i + j] = F[i] * F[j] + F[3 + i] * F[3 + j] + F[6 + i] * F[6 + j];
    sf_least_eigenvector(3, A, v);
    sf_mat3_vec(F, v, along);
    for (int i = 0; i < 9; i++) F[i] -= along[i / 3] * v[i % 3];
}

/* F = N_b^T G N_a, of norm 1 */
static void restore(const double G[9], const sf_normalizer *a, const sf_normalizer *b, double F[9]) {
    double right[9] = {a->scale, 0, -a->scale * a->middle[0], 0, a->scale, -a->scale * a->middle[1], 0, 0, 1};
    double left[9] = {b->scale, 0, 0, 0, b->scale, 0, -b->scale * b->middle[0], -b->scale * b->middle[1], 1};
    double middle[9];
    sf_mat3_mul(G, right, middle);
    sf_mat3_mul(left, middle, F);
    double norm = sqrt(dot9(F, F));
    for (int i = 0; i < 9; i++) F[i] /= norm;
}

static int is_usable(const sf_normalizer *n) { return isfinite(n->scale) && n->scale > 0; }

int sf_fundamental_from_8(const double *a, const double *b, const double *weights, size_t count,
                          double F[9]) {
    size_t used = 0;
    for (size_t i = 0; i < count; i++) used += !weights || weights[i] != 0;
    if (used < 8) return 0;
    sf_normalizer na = sf_normalizer_make(a, count), nb = sf_normalizer_make(b, count);
    double A[81] = {0}, G[9];
    if (!is_usable(&na) || !is_usable(&nb)) return 0;
    for (size_t i = 0; i < count; i++) {
        double p[2], q[2], row[9], w = weights ? weights[i] : 1;
        if (w == 0) continue;
        sf_normalizer_apply(&na, a + 2 * i, p);
        sf_normalizer_apply(&nb, b + 2 * i, q);
        equation(p, q, row);
        for (int k = 0; k < 9; k++)
            for (int l = 0; l <= k; l++) A[9 * k + l] += w * row[k] * row[l];
    }
    for (int k = 0; k < 9; k++)
        for (int l = k + 1; l < 9; l++) A[9 * k + l] = A[9 * l + k];
    sf_least_eigenvector(9, A, G);
    make_singular(G);
    restore(G, &na, &nb, F);
    return 1;
}

int sf_fundamental_refine(const double *a, const double *b, double *weights, size_t count, int rounds,
                          double F[9]) {
    for (int round = 0; round < rounds; round++) {
        for (size_t i = 0; i < count; i++) {
            if (weights[i] == 0) continue;
            double slope = sf_epipolar_slope(F, a + 2 * i, b + 2 * i);
            if (slope > 0) weights[i] = 1 / slope;
        }
        if (!sf_fundamental_from_8(a, b, weights, count, F)) return 0;
    }
    return 1;
}
