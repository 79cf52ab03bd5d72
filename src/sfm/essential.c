/* essential.c - see essential.h. */
#include "essential.h"

#include <math.h>
#include <string.h>

#include "../base/linear.h"
#include "null_space.h"
#include "polynomial.h"

/* 1. Polynomials in x, y, z. Of degree 1: x, y, z, 1. Of degree 2: x^2, xy, xz, x, y^2, yz, y, z^2, z, 1.
 * Of degree 3, as Nister orders them: x^3, y^3, x^2y, xy^2, x^2z, x^2, y^2z, y^2, xyz, xy, | xz^2, xz, x,
 * yz^2, yz, y, z^3, z^2, z, 1. */

enum { LINEAR = 4, SQUARES = 10, CUBES = 20, EQUATIONS = 10 };

/* to += w p q */
static void add_square(const double *p, const double *q, double w, double *to) {
    to[0] += w * (p[0] * q[0]);
    to[1] += w * (p[0] * q[1] + p[1] * q[0]);
    to[2] += w * (p[0] * q[2] + p[2] * q[0]);
    to[3] += w * (p[0] * q[3] + p[3] * q[0]);
    to[4] += w * (p[1] * q[1]);
    to[5] += w * (p[1] * q[2] + p[2] * q[1]);
    to[6] += w * (p[1] * q[3] + p[3] * q[1]);
    to[7] += w * (p[2] * q[2]);
    to[8] += w * (p[2] * q[3] + p[3] * q[2]);
    to[9] += w * (p[3] * q[3]);
}

/* to += p q, for p of degree 2 and q of degree 1. */
static void add_cube(const double *p, const double *q, double *to) {
    to[0] += p[0] * q[0];
    to[1] += p[4] * q[1];
    to[2] += p[0] * q[1] + p[1] * q[0];
    to[3] += p[1] * q[1] + p[4] * q[0];
    to[4] += p[0] * q[2] + p[2] * q[0];
    to[5] += p[0] * q[3] + p[3] * q[0];
    to[6] += p[4] * q[2] + p[5] * q[1];
    to[7] += p[4] * q[3] + p[6] * q[1];
    to[8] += p[1] * q[2] + p[2] * q[1] + p[5] * q[0];
    to[9] += p[1] * q[3] + p[3] * q[1] + p[6] * q[0];
    to[10] += p[2] * q[2] + p[7] * q[0];
    to[11] += p[2] * q[3] + p[3] * q[2] + p[8] * q[0];
    to[12] += p[3] * q[3] + p[9] * q[0];
    to[13] += p[5] * q[2] + p[7] * q[1];
    to[14] += p[5] * q[3] + p[6] * q[2] + p[8] * q[1];
    to[15] += p[6] * q[3] + p[9] * q[1];
    to[16] += p[7] * q[2];
    to[17] += p[7] * q[3] + p[8] * q[2];
    to[18] += p[8] * q[3] + p[9] * q[2];
    to[19] += p[9] * q[3];
}

/* 2. The ten equations: det E = 0, and E E^T E - tr(E E^T) E / 2 = 0, of entries e[9][4] */

static void make_equations(double e[9][LINEAR], double to[EQUATIONS][CUBES]) {
    double S[9][SQUARES] = {{0}}, trace[SQUARES]; /* E E^T - tr(E E^T) I / 2 */
    memset(to, 0, EQUATIONS * sizeof *to);
    for (int i = 0; i < 3; i++)
        for (int j = i; j < 3; j++)
            for (int k = 0; k < 3; k++) add_square(e[3 * i + k], e[3 * j + k], 1, S[3 * i + j]);
    for (int k = 0; k < SQUARES; k++) trace[k] = S[0][k] + S[4][k] + S[8][k];
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < SQUARES; k++) S[4 * i][k] -= trace[k] / 2;
    memcpy(S[3], S[1], sizeof *S), memcpy(S[6], S[2], sizeof *S), memcpy(S[7], S[5], sizeof *S);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            for (int k = 0; k < 3; k++) add_cube(S[3 * i + k], e[3 * k + j], to[3 * i + j]);
    for (int i = 0; i < 3; i++) {
        double minor[SQUARES] = {0};
        int j = (i + 1) % 3, k = (i + 2) % 3;
        add_square(e[3 + j], e[6 + k], 1, minor);
        add_square(e[3 + k], e[6 + j], -1, minor);
        add_cube(minor, e[i], to[9]);
    }
}

/* The first ten columns become the unit matrix in rows 4 to 9, all that is needed. 0: they depend on each
 * other. */
static int eliminate(double A[EQUATIONS][CUBES]) {
    for (int k = 0; k < EQUATIONS; k++) {
        int best = k;
        for (int i = k + 1; i < EQUATIONS; i++)
            if (fabs(A[i][k]) > fabs(A[best][k])) best = i;
        double pivot = A[best][k];
        if (!(fabs(pivot) > 1e-14)) return 0;
        for (int j = k; j < CUBES; j++) {
            double other = A[k][j];
            A[k][j] = A[best][j] / pivot;
            A[best][j] = best == k ? A[k][j] : other;
        }
        for (int i = k + 1; i < EQUATIONS; i++) {
            double factor = A[i][k];
            for (int j = k; j < CUBES; j++) A[i][j] -= factor * A[k][j];
        }
    }
    for (int k = EQUATIONS; k-- > 4;)
        for (int i = 4; i < k; i++) {
            double factor = A[i][k];
            for (int j = k; j < CUBES; j++) A[i][j] -= factor * A[k][j];
        }
    return 1;
}

/* 3. B(z) (x, y, 1) = 0 */

/* p - z q, p and q of the coefficients z^(n-1) .. 1: ascending, [n + 1]. */
static void shift_and_subtract(const double *p, const double *q, int n, double *to) {
    to[0] = p[n - 1];
    for (int i = 1; i < n; i++) to[i] = p[n - 1 - i] - q[n - i];
    to[n] = -q[0];
}

typedef struct hidden {
    double x[3][4], y[3][4], one[3][5]; /* the entries of B: three rows, polynomials of z, ascending */
} hidden;

static void make_hidden(double A[EQUATIONS][CUBES], hidden *B) {
    for (int i = 0; i < 3; i++) {
        const double *p = A[4 + 2 * i], *q = A[5 + 2 * i];
        shift_and_subtract(p + 10, q + 10, 3, B->x[i]);
        shift_and_subtract(p + 13, q + 13, 3, B->y[i]);
        shift_and_subtract(p + 16, q + 16, 4, B->one[i]);
    }
}

/* det B(z), of degree 10. */
static void determinant(const hidden *B, double c[11]) {
    memset(c, 0, 11 * sizeof *c);
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        double minor[7] = {0};
        for (int m = 0; m < 4; m++)
            for (int n = 0; n < 4; n++) minor[m + n] += B->x[j][m] * B->y[k][n] - B->x[k][m] * B->y[j][n];
        for (int m = 0; m < 7; m++)
            for (int n = 0; n < 5; n++) c[m + n] += minor[m] * B->one[i][n];
    }
}

/* x and y for a root z: the row space of B(z) has rank 2. */
static int solve_hidden(const hidden *B, double z, double at[3]) {
    double rows[3][3], best[3] = {0}, most = 0;
    for (int i = 0; i < 3; i++) {
        rows[i][0] = sf_polynomial_at(B->x[i], 3, z);
        rows[i][1] = sf_polynomial_at(B->y[i], 3, z);
        rows[i][2] = sf_polynomial_at(B->one[i], 4, z);
    }
    for (int i = 0; i < 3; i++) {
        double v[3];
        sf_cross3(rows[i], rows[(i + 1) % 3], v);
        if (sf_dot3(v, v) <= most) continue;
        most = sf_dot3(v, v);
        memcpy(best, v, sizeof best);
    }
    at[0] = best[0] / best[2], at[1] = best[1] / best[2], at[2] = z;
    return isfinite(at[0]) && isfinite(at[1]);
}

/* 4. A step of Gauss and Newton on the ten equations takes the elimination's rounding away. */

/* The twenty products at (x, y, z), and their derivatives. */
static void products(const double at[3], double v[CUBES], double d[3][CUBES]) {
    double x = at[0], y = at[1], z = at[2];
    const double values[CUBES] = {x * x * x, y * y * y, x * x * y, x * y * y, x * x * z, x * x, y * y * z,
                                  y * y,     x * y * z, x * y,     x * z * z, x * z,     x,     y * z * z,
                                  y * z,     y,         z * z * z, z * z,     z,         1};
    const double by_x[CUBES] = {3 * x * x, 0,     2 * x * y, y * y, 2 * x * z, 2 * x, 0,
                                0,         y * z, y,         z * z, z,         1};
    const double by_y[CUBES] = {0,     3 * y * y, x * x, 2 * x * y, 0, 0,     2 * y * z, 2 * y,
                                x * z, x,         0,     0,         0, z * z, z,         1};
    const double by_z[CUBES] = {0,         0, 0, 0,         x * x, 0, y * y,     0,     x * y, 0,
                                2 * x * z, x, 0, 2 * y * z, y,     0, 3 * z * z, 2 * z, 1};
    memcpy(v, values, sizeof values);
    memcpy(d[0], by_x, sizeof by_x), memcpy(d[1], by_y, sizeof by_y), memcpy(d[2], by_z, sizeof by_z);
}

static void polish(double A[EQUATIONS][CUBES], double at[3]) {
    double v[CUBES], d[3][CUBES], N[9] = {0}, step[3] = {0}, r[EQUATIONS] = {0}, off = 0;
    products(at, v, d);
    for (int i = 0; i < EQUATIONS; i++) {
        for (int k = 0; k < CUBES; k++) r[i] += A[i][k] * v[k];
        off = fmax(off, fabs(r[i]));
    }
    if (off <= 1e-12 * pow(1 + sf_dot3(at, at), 1.5)) return; /* of E of norm 1: the rounding of a good one */
    for (int i = 0; i < EQUATIONS; i++) {
        double J[3] = {0};
        for (int k = 0; k < CUBES; k++)
            for (int l = 0; l < 3; l++) J[l] += A[i][k] * d[l][k];
        for (int k = 0; k < 3; k++) {
            step[k] -= J[k] * r[i];
            for (int l = 0; l < 3; l++) N[3 * k + l] += J[k] * J[l];
        }
    }
    if (!sf_cholesky(3, N)) return;
    sf_cholesky_solve(3, N, step);
    for (int k = 0; k < 3; k++) at[k] += step[k];
}

int sf_essential_from_5(const double *a, const double *b, const uint32_t sample[5],
                        double E[9 * SF_ESSENTIAL_MOST]) {
    double rows[45], N[36], e[9][LINEAR], A[EQUATIONS][CUBES], reduced[EQUATIONS][CUBES], c[11];
    double roots[SF_DEGREE_MOST];
    hidden B;
    int count = 0;
    for (int i = 0; i < 5; i++) {
        const double *p = a + 2 * sample[i], *q = b + 2 * sample[i];
        const double row[9] = {q[0] * p[0], q[0] * p[1], q[0], q[1] * p[0], q[1] * p[1], q[1], p[0], p[1], 1};
        memcpy(rows + 9 * i, row, sizeof row);
    }
    sf_null_space(5, rows, N);
    for (int i = 0; i < 9; i++)
        for (int k = 0; k < LINEAR; k++) e[i][k] = N[9 * k + i];
    make_equations(e, A);
    memcpy(reduced, A, sizeof A);
    if (!eliminate(reduced)) return 0;
    make_hidden(reduced, &B);
    determinant(&B, c);
    int found = sf_polynomial_roots(c, 10, roots);
    for (int i = 0; i < found; i++) {
        double at[3], *to = E + 9 * count;
        if (!solve_hidden(&B, roots[i], at)) continue;
        polish(A, at);
        double norm = 1 / sqrt(1 + sf_dot3(at, at)); /* the null space is orthonormal */
        if (!(norm > 0)) continue;
        for (int k = 0; k < 9; k++)
            to[k] = norm * (at[0] * e[k][0] + at[1] * e[k][1] + at[2] * e[k][2] + e[k][3]);
        count++;
    }
    return count;
}

/* 5. Poses */

void sf_essential_of_pose(const sf_rigid *T, double E[9]) {
    const double *t = T->t;
    const double cross[9] = {0, -t[2], t[1], t[2], 0, -t[0], -t[1], t[0], 0};
    sf_mat3_mul(cross, T->R, E);
}

/* Horn: with |t| = 1, R = cof(E) - [t]x E; t is at right angles to the columns of E. */
int sf_essential_poses(const double E[9], sf_rigid poses[4]) {
    double columns[3][3], t[3] = {0}, most = 0, cofactors[9], squares = 0, e[9], product[9];
    for (int i = 0; i < 9; i++) squares += E[i] * E[i];
    if (!(squares > 0) || !isfinite(squares)) return 0;
    for (int i = 0; i < 9; i++) e[i] = E[i] * sqrt(2 / squares);
    for (int j = 0; j < 3; j++)
        for (int i = 0; i < 3; i++) columns[j][i] = e[3 * i + j];
    for (int j = 0; j < 3; j++) {
        double v[3];
        sf_cross3(columns[(j + 1) % 3], columns[(j + 2) % 3], v);
        for (int i = 0; i < 3; i++) cofactors[3 * i + j] = v[i];
        if (sf_dot3(v, v) <= most) continue;
        most = sf_dot3(v, v);
        for (int i = 0; i < 3; i++) t[i] = v[i] / sqrt(most);
    }
    const double cross[9] = {0, -t[2], t[1], t[2], 0, -t[0], -t[1], t[0], 0};
    sf_mat3_mul(cross, e, product);
    for (int k = 0; k < 4; k++) {
        const double still[6] = {0};
        for (int i = 0; i < 9; i++) poses[k].R[i] = cofactors[i] + (k < 2 ? -product[i] : product[i]);
        for (int i = 0; i < 3; i++) poses[k].t[i] = 0;
        for (int i = 0; i < 3; i++) sf_rigid_move(&poses[k], still); /* to the nearest rotation */
        for (int i = 0; i < 3; i++) poses[k].t[i] = k % 2 ? -t[i] : t[i];
    }
    return 1;
}

/* With d = R a, z2 b = z1 d + t: both depths from the cross products have the signs of these. */
static int is_in_front(const sf_rigid *T, const double a[2], const double b[2]) {
    const double ray[3] = {a[0], a[1], 1}, seen[3] = {b[0], b[1], 1};
    double d[3], n[3], by_t[3], by_d[3];
    sf_mat3_vec(T->R, ray, d);
    sf_cross3(d, seen, n);
    sf_cross3(seen, T->t, by_t); /* z1 (d x b) = b x t */
    sf_cross3(d, T->t, by_d);    /* z2 (d x b) = d x t */
    return sf_dot3(n, by_t) > 0 && sf_dot3(n, by_d) > 0;
}

size_t sf_count_in_front(const sf_rigid *T, const double *a, const double *b, const uint8_t *members,
                         size_t count) {
    size_t found = 0;
    for (size_t i = 0; i < count; i++)
        if (!members || members[i]) found += (size_t)is_in_front(T, a + 2 * i, b + 2 * i);
    return found;
}

size_t sf_essential_pose(const double E[9], const double *a, const double *b, const uint8_t *members,
                         size_t count, sf_rigid *T) {
    sf_rigid poses[4];
    size_t most = 0;
    if (!sf_essential_poses(E, poses)) return 0;
    *T = poses[0];
    for (int k = 0; k < 4; k++) {
        size_t found = sf_count_in_front(&poses[k], a, b, members, count);
        if (found > most) most = found, *T = poses[k];
    }
    return most;
}
