/* linear.h - small dense algebra, in float64. */
#ifndef SF_BASE_LINEAR_H
#define SF_BASE_LINEAR_H

/* Matrices are row-major. */

#include <stddef.h>

enum { SF_EIGEN_MOST = 9 };

/* A = L L^T in place: the lower triangle of A (n x n, symmetric) becomes L. 0 if A is not positive definite.
 */
int sf_cholesky(int n, double *A);
/* The same of a block of a larger matrix, whose rows are `stride` doubles apart. */
int sf_cholesky_within(size_t n, size_t stride, double *A);
/* x = A^-1 x, with L from above. */
void sf_cholesky_solve(int n, const double *L, double *x);
/* inverse = A^-1 (n x n, whole), with L from above. */
void sf_cholesky_invert(int n, const double *L, double *inverse);

/* A (symmetric, n x n, n <= SF_EIGEN_MOST) becomes V^T A V, diagonal: its eigenvalues; the columns of V are
 * their unit vectors. */
void sf_eigen(int n, double *A, double *V);
/* The unit vector x for which x^T A x is least (A symmetric, n x n, n <= SF_EIGEN_MOST; destroyed). */
void sf_least_eigenvector(int n, double *A, double *x);

static inline double sf_dot3(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline void sf_cross3(const double a[3], const double b[3], double out[3]) {
    double x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2], z = a[0] * b[1] - a[1] * b[0];
    out[0] = x;
    out[1] = y;
    out[2] = z;
}

/* y = M x for 3 x 3. */
static inline void sf_mat3_vec(const double M[9], const double x[3], double y[3]) {
    for (int i = 0; i < 3; i++) y[i] = sf_dot3(M + 3 * i, x);
}

/* C = A B for 3 x 3; C is neither. */
static inline void sf_mat3_mul(const double A[9], const double B[9], double C[9]) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            C[3 * i + j] = A[3 * i] * B[j] + A[3 * i + 1] * B[3 + j] + A[3 * i + 2] * B[6 + j];
}

/* The rotation by |phi| about phi. */
void sf_rotation_exp(const double phi[3], double R[9]);
/* phi for which exp(phi) = R, |phi| < pi. */
void sf_rotation_log(const double R[9], double phi[3]);

#endif
