/* plane.c - see plane.h. */
#include "plane.h"

#include <math.h>
#include <string.h>

#include <splatfit/camera.h>

#include "../base/linear.h"

/* H scaled so that the middle one of its singular values is 1 and its determinant is positive; their squares
 * and directions, greatest first: V [3][3], rows. */
static int scale_homography(const double H[9], double scaled[9], double squares[3], double V[9]) {
    double A[9], W[9], cofactors[3];
    int order[3] = {0, 1, 2};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) A[3 * i + j] = H[i] * H[j] + H[3 + i] * H[3 + j] + H[6 + i] * H[6 + j];
    sf_eigen(3, A, W);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 2 - i; j++)
            if (A[4 * order[j]] < A[4 * order[j + 1]]) {
                int other = order[j];
                order[j] = order[j + 1], order[j + 1] = other;
            }
    double middle = A[4 * order[1]];
    sf_cross3(H + 3, H + 6, cofactors);
    double det = sf_dot3(H, cofactors);
    if (!(middle > 0) || det == 0 || !isfinite(middle)) return 0;
    for (int i = 0; i < 9; i++) scaled[i] = H[i] * (det < 0 ? -1 : 1) / sqrt(middle);
    for (int k = 0; k < 3; k++) {
        squares[k] = A[4 * order[k]] / middle;
        for (int i = 0; i < 3; i++) V[3 * k + i] = W[3 * i + order[k]];
    }
    return 1;
}

/* M = [x y z]^T or its transpose, of unit vectors with z = x cross y. */
static void frame(const double x[3], const double y[3], double M[9]) {
    memcpy(M, x, 3 * sizeof *x);
    memcpy(M + 3, y, 3 * sizeof *y);
    sf_cross3(x, y, M + 6);
}

/* The rotation that turns the directions v and u of the plane at right angles to n = v cross u as H maps
 * them. */
static void pose_of_plane(const double H[9], const double v[3], const double u[3], sf_rigid *T, double n[3]) {
    double from[9], to[9], x[3], y[3], off[9];
    const double still[6] = {0};
    frame(v, u, from);
    sf_mat3_vec(H, v, x);
    sf_mat3_vec(H, u, y);
    frame(x, y, to);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            T->R[3 * i + j] = to[i] * from[j] + to[3 + i] * from[3 + j] + to[6 + i] * from[6 + j];
    memset(T->t, 0, sizeof T->t);
    for (int i = 0; i < 2; i++) sf_rigid_move(T, still);
    for (int i = 0; i < 9; i++) off[i] = H[i] - T->R[i];
    memcpy(n, from + 6, 3 * sizeof *n);
    sf_mat3_vec(off, n, T->t);
}

int sf_homography_poses(const double H[9], sf_rigid poses[4], double normals[12]) {
    double G[9], s[3], V[9], n[12];
    if (!scale_homography(H, G, s, V)) return 0;
    double spread = s[0] - s[2];
    if (!(spread > 1e-9)) { /* all singular values are 1 */
        const double still[6] = {0};
        memcpy(poses[0].R, G, sizeof G);
        memset(poses[0].t, 0, sizeof poses[0].t);
        for (int i = 0; i < 3; i++) sf_rigid_move(&poses[0], still);
        if (normals) memset(normals, 0, 3 * sizeof *normals);
        return 1;
    }
    double first = sqrt(fmax(1 - s[2], 0) / spread), third = sqrt(fmax(s[0] - 1, 0) / spread);
    for (int k = 0; k < 2; k++) {
        double u[3];
        for (int i = 0; i < 3; i++) u[i] = first * V[i] + (k ? -third : third) * V[6 + i];
        pose_of_plane(G, V + 3, u, &poses[2 * k], n + 6 * k);
        poses[2 * k + 1] = poses[2 * k];
        for (int i = 0; i < 3; i++) {
            poses[2 * k + 1].t[i] = -poses[2 * k].t[i];
            n[6 * k + 3 + i] = -n[6 * k + i];
        }
    }
    if (normals) memcpy(normals, n, sizeof n);
    return 4;
}

/* Horn: the quaternion is the greatest eigenvector of a matrix made from the sums of products. */
int sf_rotation_between(const double *a, const double *b, const uint8_t *members, size_t count, double R[9]) {
    double S[9] = {0}, q[4];
    size_t used = 0;
    for (size_t i = 0; i < count; i++) {
        if (members && !members[i]) continue;
        const double p[3] = {a[2 * i], a[2 * i + 1], 1}, r[3] = {b[2 * i], b[2 * i + 1], 1};
        double w = 1 / sqrt(sf_dot3(p, p) * sf_dot3(r, r));
        for (int k = 0; k < 9; k++) S[k] += w * p[k / 3] * r[k % 3];
        used++;
    }
    if (used < 2) return 0;
    /* Its negative, whose least eigenvector is that. */
    double N[16] = {-(S[0] + S[4] + S[8]),  -(S[5] - S[7]), -(S[6] - S[2]), -(S[1] - S[3]), -(S[5] - S[7]),
                    -(S[0] - S[4] - S[8]),  -(S[1] + S[3]), -(S[6] + S[2]), -(S[6] - S[2]), -(S[1] + S[3]),
                    -(-S[0] + S[4] - S[8]), -(S[5] + S[7]), -(S[1] - S[3]), -(S[6] + S[2]), -(S[5] + S[7]),
                    -(-S[0] - S[4] + S[8])};
    sf_least_eigenvector(4, N, q);
    sf_rotation_from_quat(q, R);
    return 1;
}
