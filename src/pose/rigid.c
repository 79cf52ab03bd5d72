/* rigid.c - see rigid.h. */
#include "rigid.h"

#include <math.h>
#include <string.h>

#include "../base/linear.h"

/* One step of Newton towards the nearest rotation: R (3 I - R^T R) / 2. */
static void polish(double R[9]) {
    double square[9], result[9];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            square[3 * i + j] =
                (i == j) * 1.5 - 0.5 * (R[i] * R[j] + R[3 + i] * R[3 + j] + R[6 + i] * R[6 + j]);
    sf_mat3_mul(R, square, result);
    memcpy(R, result, sizeof result);
}

void sf_rigid_move(sf_rigid *T, const double twist[SF_TWIST]) {
    double turn[9], R[9], t[3];
    sf_rotation_exp(twist + 3, turn);
    sf_mat3_mul(turn, T->R, R);
    sf_mat3_vec(turn, T->t, t);
    polish(R);
    memcpy(T->R, R, sizeof R);
    for (int i = 0; i < 3; i++) T->t[i] = t[i] + twist[i];
}

void sf_rigid_apply(const sf_rigid *T, const double at[3], double to[3]) {
    sf_mat3_vec(T->R, at, to);
    for (int k = 0; k < 3; k++) to[k] += T->t[k];
}

void sf_rigid_apply_back(const sf_rigid *T, const double at[3], double to[3]) {
    double d[3];
    for (int k = 0; k < 3; k++) d[k] = at[k] - T->t[k];
    for (int k = 0; k < 3; k++) to[k] = T->R[k] * d[0] + T->R[3 + k] * d[1] + T->R[6 + k] * d[2];
}

void sf_rigid_compose(const sf_rigid *a, const sf_rigid *b, sf_rigid *c) {
    sf_rigid result;
    sf_mat3_mul(a->R, b->R, result.R);
    sf_mat3_vec(a->R, b->t, result.t);
    for (int k = 0; k < 3; k++) result.t[k] += a->t[k];
    *c = result;
}

void sf_rigid_invert(const sf_rigid *a, sf_rigid *inverse) {
    sf_rigid result;
    double moved[3];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) result.R[3 * i + j] = a->R[3 * j + i];
    sf_mat3_vec(result.R, a->t, moved);
    for (int k = 0; k < 3; k++) result.t[k] = -moved[k];
    *inverse = result;
}

void sf_rigid_twist(const sf_rigid *from, const sf_rigid *to, double twist[SF_TWIST]) {
    sf_rigid way;
    sf_rigid_invert(from, &way);
    sf_rigid_compose(to, &way, &way);
    for (int k = 0; k < 3; k++) twist[k] = way.t[k];
    sf_rotation_log(way.R, twist + 3);
}

void sf_rigid_center(const sf_rigid *T, double center[3]) {
    sf_rigid_apply_back(T, (const double[3]){0, 0, 0}, center);
}

void sf_rigid_gap(const sf_rigid *a, const sf_rigid *b, double *angle, double *apart) {
    double twist[SF_TWIST], here[3], there[3];
    sf_rigid_twist(a, b, twist);
    sf_rigid_center(a, here), sf_rigid_center(b, there);
    for (int k = 0; k < 3; k++) there[k] -= here[k];
    *angle = sqrt(sf_dot3(twist + 3, twist + 3)), *apart = sqrt(sf_dot3(there, there));
}
