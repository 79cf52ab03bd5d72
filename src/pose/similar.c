/* similar.c - similarities of a pose graph: chains, ways back, twists, residuals. */
#include "pose_graph.h"

#include <math.h>

#include "../base/linear.h"

void sf_similar_apply(const sf_similar *S, const double at[3], double to[3]) {
    double turned[3];
    sf_mat3_vec(S->rigid.R, at, turned);
    for (int k = 0; k < 3; k++) to[k] = S->scale * turned[k] + S->rigid.t[k];
}

void sf_similar_compose(const sf_similar *a, const sf_similar *b, sf_similar *c) {
    sf_similar result = {.scale = a->scale * b->scale};
    sf_mat3_mul(a->rigid.R, b->rigid.R, result.rigid.R);
    sf_similar_apply(a, b->rigid.t, result.rigid.t);
    *c = result;
}

void sf_similar_invert(const sf_similar *a, sf_similar *inverse) {
    sf_similar result = {.scale = 1 / a->scale};
    double back[3];
    sf_rigid_invert(&a->rigid, &result.rigid);
    sf_mat3_vec(result.rigid.R, a->rigid.t, back);
    for (int k = 0; k < 3; k++) result.rigid.t[k] = -result.scale * back[k];
    *inverse = result;
}

void sf_similar_move(sf_similar *S, const double twist[SF_SIMILAR_TWIST]) {
    double scale = exp(twist[SF_TWIST]);
    for (int k = 0; k < 3; k++) S->rigid.t[k] *= scale;
    sf_rigid_move(&S->rigid, twist);
    S->scale *= scale;
}

/* phi(exp(d) R) = phi(R) + B d: B = I - [phi] / 2 + c [phi]^2. */
static void turn_derivative(const double phi[3], double B[9]) {
    double angle2 = sf_dot3(phi, phi), angle = sqrt(angle2);
    double c = angle > 1e-3 ? 1 / angle2 - (1 + cos(angle)) / (2 * angle * sin(angle)) : 1.0 / 12;
    const double cross[9] = {0, -phi[2], phi[1], phi[2], 0, -phi[0], -phi[1], phi[0], 0};
    double square[9];
    sf_mat3_mul(cross, cross, square);
    for (int k = 0; k < 9; k++) B[k] = (k % 4 == 0) - cross[k] / 2 + c * square[k];
}

enum { N = SF_SIMILAR_TWIST };

/* Of the residual D by its own left twist. */
static void own_derivative(const sf_similar *D, const double phi[3], double J[N * N]) {
    const double *t = D->rigid.t;
    const double cross[9] = {0, t[2], -t[1], -t[2], 0, t[0], t[1], -t[0], 0}; /* phi x t */
    double B[9];
    turn_derivative(phi, B);
    for (int k = 0; k < N * N; k++) J[k] = 0;
    for (int i = 0; i < 3; i++) {
        J[N * i + i] = 1;
        J[N * i + 6] = t[i];
        for (int k = 0; k < 3; k++)
            J[N * i + 3 + k] = cross[3 * i + k], J[N * (3 + i) + 3 + k] = B[3 * i + k];
    }
    J[N * 6 + 6] = 1;
}

/* The left twist of A X^-1 for one of X: -A's adjoint. */
static void back_adjoint(const sf_similar *A, double M[N * N]) {
    const double *R = A->rigid.R, *t = A->rigid.t;
    for (int k = 0; k < N * N; k++) M[k] = 0;
    for (int k = 0; k < 3; k++) {
        const double column[3] = {R[k], R[3 + k], R[6 + k]};
        double moved[3];
        sf_cross3(column, t, moved);
        for (int i = 0; i < 3; i++) {
            M[N * i + k] = -A->scale * column[i];
            M[N * i + 3 + k] = moved[i];
            M[N * (3 + i) + 3 + k] = -column[i];
        }
        M[N * k + 6] = t[k];
    }
    M[N * 6 + 6] = -1;
}

void sf_graph_residual(const sf_similar *a, const sf_similar *b, const sf_similar *way, double r[N],
                       double *by_a, double *by_b) {
    sf_similar A, D, back;
    double own[N * N], M[N * N];
    sf_similar_invert(b, &back);
    sf_similar_compose(a, &back, &A);
    sf_similar_invert(way, &back);
    sf_similar_compose(&A, &back, &D);
    for (int k = 0; k < 3; k++) r[k] = D.rigid.t[k];
    sf_rotation_log(D.rigid.R, r + 3);
    r[6] = log(D.scale);
    if (!by_a && !by_b) return;
    own_derivative(&D, r + 3, own);
    for (int k = 0; by_a && k < N * N; k++) by_a[k] = own[k];
    if (!by_b) return;
    back_adjoint(&A, M);
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++) {
            double sum = 0;
            for (int k = 0; k < N; k++) sum += own[N * i + k] * M[N * k + j];
            by_b[N * i + j] = sum;
        }
}
