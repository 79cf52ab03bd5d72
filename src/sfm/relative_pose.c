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

/* Two matches at a time: an eighth of the time of a reconstruction was spent here, and compilers do not pair
 * them.
 */
typedef double pair __attribute__((vector_size(16)));

typedef struct matches {
    pair p[2], q[2]; /* where the two views see them */
    pair weight;
} matches;

/* The next two matches whose weight is not 0, from `i` on; a missing second one has weight 0. 0: there is
 * none. */
static int next_two(const double *a, const double *b, const double *weights, size_t count, size_t *i,
                    matches *m) {
    int found = 0;
    for (; *i < count && found < 2; ++*i) {
        double w = weights ? weights[*i] : 1;
        if (w == 0) continue;
        for (int lane = found; lane < 2; lane++)
            for (int k = 0; k < 2; k++)
                m->p[k][lane] = a[2 * *i + (size_t)k], m->q[k][lane] = b[2 * *i + (size_t)k];
        m->weight[found++] = w;
    }
    if (found == 1) m->weight[1] = 0;
    return found;
}

/* The signed distance e / sqrt(s), and its derivative by E. */
static pair distance(const double E[9], const matches *m, pair by_E[9]) {
    const pair one = {1, 1}, p[3] = {m->p[0], m->p[1], one}, q[3] = {m->q[0], m->q[1], one};
    pair x = E[0] * p[0] + E[1] * p[1] + E[2], y = E[3] * p[0] + E[4] * p[1] + E[5];
    pair z = E[6] * p[0] + E[7] * p[1] + E[8];
    pair u = E[0] * q[0] + E[3] * q[1] + E[6], v = E[1] * q[0] + E[4] * q[1] + E[7];
    pair e = q[0] * x + q[1] * y + z, s = x * x + y * y + u * u + v * v, root;
    for (int lane = 0; lane < 2; lane++) root[lane] = s[lane] > 0 ? 1 / sqrt(s[lane]) : 0;
    pair r = e * root, c = r * root * root;
    const pair left[2] = {c * x, c * y}, right[2] = {c * u, c * v};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            by_E[3 * i + j] = root * q[i] * p[j];
            if (i < 2) by_E[3 * i + j] -= left[i] * p[j];
            if (j < 2) by_E[3 * i + j] -= q[i] * right[j];
        }
    return r;
}

static double add_all(const double *a, const double *b, const double *weights, size_t count, const tangent *g,
                      double A[FREE * FREE], double h[FREE]) {
    pair sums[FREE * FREE] = {{0}}, by_pose[FREE] = {{0}}, cost = {0};
    matches m;
    for (size_t i = 0; next_two(a, b, weights, count, &i, &m);) {
        pair by_E[9], J[FREE], r = distance(g->E, &m, by_E);
        cost += m.weight * r * r;
        for (int k = 0; k < FREE; k++) {
            J[k] = by_E[0] * g->d[k][0];
            for (int l = 1; l < 9; l++) J[k] += by_E[l] * g->d[k][l];
            pair weighted = m.weight * J[k];
            by_pose[k] += weighted * r;
            for (int l = 0; l <= k; l++) sums[FREE * k + l] += weighted * J[l];
        }
    }
    for (int k = 0; k < FREE * FREE; k++) A[k] = sums[k][0] + sums[k][1];
    for (int k = 0; k < FREE; k++) h[k] = by_pose[k][0] + by_pose[k][1];
    return cost[0] + cost[1];
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
