/* relative_pose.c - see relative_pose.h. */
#include "relative_pose.h"

#include <math.h>
#include <string.h>

#include "../base/linear.h"
#include "epipolar.h"
#include "essential.h"

/* Three turns, and two ways of the translation on the unit sphere. */
enum { FREE = 5 };

typedef struct tangent {
    double E[9], d[FREE][9]; /* E, and its derivatives */
    double ways[2][3];       /* at right angles to t and to each other */
} tangent;

static void cross_matrix(const double t[3], double M[9]) {
    const double rows[9] = {0, -t[2], t[1], t[2], 0, -t[0], -t[1], t[0], 0};
    memcpy(M, rows, sizeof rows);
}

static void make_tangent(const sf_rigid *T, tangent *g) {
    const double *t = T->t;
    int least = 0;
    double axis[3] = {0}, M[9], turned[9];
    sf_essential_of_pose(T, g->E);
    for (int k = 1; k < 3; k++)
        if (fabs(t[k]) < fabs(t[least])) least = k;
    axis[least] = 1;
    sf_cross3(t, axis, g->ways[0]);
    double length = sqrt(sf_dot3(g->ways[0], g->ways[0]));
    for (int k = 0; k < 3; k++) g->ways[0][k] /= length;
    sf_cross3(t, g->ways[0], g->ways[1]);
    for (int k = 0; k < 2; k++) {
        cross_matrix(g->ways[k], M);
        sf_mat3_mul(M, T->R, g->d[3 + k]);
    }
    for (int k = 0; k < 3; k++) { /* [t]x [e_k]x R */
        const double turn[3] = {k == 0, k == 1, k == 2};
        cross_matrix(turn, M);
        sf_mat3_mul(M, T->R, turned);
        cross_matrix(t, M);
        sf_mat3_mul(M, turned, g->d[k]);
    }
}

/* The signed distance e / sqrt(s), and its derivative by E. */
static double distance(const double E[9], const double a[2], const double b[2], double by_E[9]) {
    const double p[3] = {a[0], a[1], 1}, q[3] = {b[0], b[1], 1};
    double x = sf_dot3(E, p), y = sf_dot3(E + 3, p), z = sf_dot3(E + 6, p);
    double u = E[0] * q[0] + E[3] * q[1] + E[6], v = E[1] * q[0] + E[4] * q[1] + E[7];
    double e = q[0] * x + q[1] * y + z, s = x * x + y * y + u * u + v * v;
    if (!(s > 0)) {
        memset(by_E, 0, 9 * sizeof *by_E);
        return 0;
    }
    double root = 1 / sqrt(s), r = e * root, c = r / s;
    const double left[3] = {x, y, 0}, right[3] = {u, v, 0};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            by_E[3 * i + j] = root * q[i] * p[j] - c * (left[i] * p[j] + q[i] * right[j]);
    return r;
}

static double add_all(const double *a, const double *b, const double *weights, size_t count, const tangent *g,
                      double A[FREE * FREE], double h[FREE]) {
    double sum = 0;
    memset(A, 0, FREE * FREE * sizeof *A), memset(h, 0, FREE * sizeof *h);
    for (size_t i = 0; i < count; i++) {
        double w = weights ? weights[i] : 1, by_E[9], J[FREE];
        if (w == 0) continue;
        double r = distance(g->E, a + 2 * i, b + 2 * i, by_E);
        sum += w * r * r;
        for (int k = 0; k < FREE; k++) {
            J[k] = 0;
            for (int l = 0; l < 9; l++) J[k] += by_E[l] * g->d[k][l];
            h[k] += w * J[k] * r;
            for (int l = 0; l <= k; l++) A[FREE * k + l] += w * J[k] * J[l];
        }
    }
    return sum;
}

static double cost_of(const double *a, const double *b, const double *weights, size_t count,
                      const sf_rigid *T) {
    double E[9], sum = 0;
    sf_essential_of_pose(T, E);
    for (size_t i = 0; i < count; i++)
        if (!weights || weights[i] != 0)
            sum += (weights ? weights[i] : 1) * sf_sampson(E, a + 2 * i, b + 2 * i);
    return sum;
}

static void move(const tangent *g, const double step[FREE], sf_rigid *T) {
    const double turn[SF_TWIST] = {0, 0, 0, step[0], step[1], step[2]};
    double t[3], length;
    for (int k = 0; k < 3; k++) t[k] = T->t[k] + step[3] * g->ways[0][k] + step[4] * g->ways[1][k];
    sf_rigid_move(T, turn);
    length = sqrt(sf_dot3(t, t));
    for (int k = 0; k < 3; k++) T->t[k] = t[k] / length;
}

double sf_relative_pose_refine(const double *a, const double *b, const double *weights, size_t count,
                               int steps, sf_rigid *T) {
    double A[FREE * FREE], h[FREE], damping = 1e-6, cost = 0;
    tangent g;
    int fresh = 1;
    for (int i = 0; i < steps && damping < 1e3; i++) {
        sf_rigid next = *T;
        double B[FREE * FREE], step[FREE];
        if (fresh) {
            make_tangent(T, &g);
            cost = add_all(a, b, weights, count, &g, A, h);
        }
        fresh = 0;
        memcpy(B, A, sizeof B);
        for (int k = 0; k < FREE; k++) B[(FREE + 1) * k] *= 1 + damping, step[k] = -h[k];
        damping *= 10;
        if (!sf_cholesky(FREE, B)) continue;
        sf_cholesky_solve(FREE, B, step);
        move(&g, step, &next);
        double moved = cost_of(a, b, weights, count, &next);
        if (!(moved < cost)) continue;
        int done = cost - moved < 1e-6 * cost;
        *T = next, cost = moved, damping /= 100, fresh = 1;
        if (done) break;
    }
    return cost;
}
