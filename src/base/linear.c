/* linear.c - see linear.h. */
#include "linear.h"

#include <math.h>

int sf_cholesky_within(size_t n, size_t stride, double *A) {
    for (size_t j = 0; j < n; j++) {
        double d = A[j * stride + j];
        for (size_t k = 0; k < j; k++) d -= A[j * stride + k] * A[j * stride + k];
        if (!(d > 0) || isinf(d)) return 0;
        double root = sqrt(d);
        A[j * stride + j] = root;
        for (size_t i = j + 1; i < n; i++) {
            double s = A[i * stride + j];
            for (size_t k = 0; k < j; k++) s -= A[i * stride + k] * A[j * stride + k];
            A[i * stride + j] = s / root;
        }
    }
    return 1;
}

int sf_cholesky(int n, double *A) { return sf_cholesky_within((size_t)n, (size_t)n, A); }

void sf_cholesky_solve(int n, const double *L, double *x) {
    for (int i = 0; i < n; i++) {
        for (int k = 0; k < i; k++) x[i] -= L[i * n + k] * x[k];
        x[i] /= L[i * n + i];
    }
    for (int i = n - 1; i >= 0; i--) {
        for (int k = i + 1; k < n; k++) x[i] -= L[k * n + i] * x[k];
        x[i] /= L[i * n + i];
    }
}

void sf_cholesky_invert(int n, const double *L, double *inverse) {
    double column[SF_EIGEN_MOST];
    for (int j = 0; j < n; j++) {
        for (int i = 0; i < n; i++) column[i] = i == j;
        sf_cholesky_solve(n, L, column);
        for (int i = 0; i < n; i++) inverse[i * n + j] = column[i];
    }
}

/* Turns rows and columns p, q of A, and columns p, q of V, so that A_pq becomes 0 (Golub and Van Loan, 8.5).
 */
static void jacobi_turn(int n, double *A, double *V, int p, int q) {
    double apq = A[p * n + q];
    if (apq == 0) return;
    double theta = (A[q * n + q] - A[p * n + p]) / (2 * apq);
    double t = (theta < 0 ? -1 : 1) / (fabs(theta) + sqrt(1 + theta * theta));
    double c = 1 / sqrt(1 + t * t), s = t * c;
    for (int k = 0; k < n; k++) {
        double akp = A[k * n + p], akq = A[k * n + q];
        A[k * n + p] = c * akp - s * akq;
        A[k * n + q] = s * akp + c * akq;
    }
    for (int k = 0; k < n; k++) {
        double apk = A[p * n + k], aqk = A[q * n + k];
        A[p * n + k] = c * apk - s * aqk;
        A[q * n + k] = s * apk + c * aqk;
        double vkp = V[k * n + p], vkq = V[k * n + q];
        V[k * n + p] = c * vkp - s * vkq;
        V[k * n + q] = s * vkp + c * vkq;
    }
}

/* Whether what is off the diagonal no longer matters. */
static int is_diagonal(int n, const double *A) {
    double off = 0, on = 0;
    for (int i = 0; i < n * n; i++) *(i / n == i % n ? &on : &off) += A[i] * A[i];
    return off <= 1e-32 * on;
}

void sf_eigen(int n, double *A, double *V) {
    enum { SWEEPS = 16 }; /* quadratic: six or so do */
    for (int i = 0; i < n * n; i++) V[i] = i / n == i % n;
    for (int sweep = 0; sweep < SWEEPS && !is_diagonal(n, A); sweep++)
        for (int p = 0; p < n; p++)
            for (int q = p + 1; q < n; q++) jacobi_turn(n, A, V, p, q);
}

/* Inverse iteration, from any start. 0: the two least eigenvalues are too close for it. */
static int iterate_inversely(int n, const double *A, double *x) {
    enum { STEPS = 40 };
    double L[SF_EIGEN_MOST * SF_EIGEN_MOST], y[SF_EIGEN_MOST], trace = 0;
    for (int i = 0; i < n; i++) trace += A[i * n + i];
    for (int i = 0; i < n * n; i++) L[i] = A[i] + (i / n == i % n ? 1e-13 * trace : 0);
    if (!sf_cholesky(n, L)) return 0;
    for (int i = 0; i < n; i++) x[i] = 1 / sqrt(n + i);
    for (int step = 0; step < STEPS; step++) {
        double squares = 0, moved = 0;
        for (int i = 0; i < n; i++) y[i] = x[i];
        sf_cholesky_solve(n, L, y);
        for (int i = 0; i < n; i++) squares += y[i] * y[i];
        for (int i = 0; i < n; i++) {
            y[i] /= sqrt(squares);
            moved += (y[i] - x[i]) * (y[i] - x[i]);
            x[i] = y[i];
        }
        if (moved <= 1e-28) return 1;
    }
    return 0;
}

void sf_least_eigenvector(int n, double *A, double *x) {
    double V[SF_EIGEN_MOST * SF_EIGEN_MOST];
    if (iterate_inversely(n, A, x)) return;
    sf_eigen(n, A, V);
    int least = 0;
    for (int i = 1; i < n; i++)
        if (A[i * n + i] < A[least * n + least]) least = i;
    for (int i = 0; i < n; i++) x[i] = V[i * n + least];
}

void sf_rotation_exp(const double phi[3], double R[9]) {
    double angle2 = sf_dot3(phi, phi), angle = sqrt(angle2);
    /* sin(a)/a and (1 - cos(a))/a^2, by their series where they would be 0/0 */
    double a = angle < 1e-4 ? 1 - angle2 / 6 : sin(angle) / angle;
    double half = angle < 1e-4 ? 1 - angle2 / 24 : sin(angle / 2) / (angle / 2);
    double b = half * half / 2;
    double x = phi[0], y = phi[1], z = phi[2];
    double rows[9] = {1 - b * (y * y + z * z), b * x * y - a * z,       b * x * z + a * y,
                      b * x * y + a * z,       1 - b * (x * x + z * z), b * y * z - a * x,
                      b * x * z - a * y,       b * y * z + a * x,       1 - b * (x * x + y * y)};
    for (int i = 0; i < 9; i++) R[i] = rows[i];
}

void sf_rotation_log(const double R[9], double phi[3]) {
    double sine[3] = {(R[7] - R[5]) / 2, (R[2] - R[6]) / 2, (R[3] - R[1]) / 2};
    double length = sqrt(sf_dot3(sine, sine)), cosine = (R[0] + R[4] + R[8] - 1) / 2;
    double angle = atan2(length, cosine);
    for (int k = 0; k < 3; k++) phi[k] = length > 1e-12 ? sine[k] * angle / length : sine[k];
}
