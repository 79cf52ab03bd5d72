/* project.c - a Gaussian to the screen and its gradients back to the raw parameters and the pose (M.1, M.3,
 * M.4). */
#include "linear.h"
#include "reference.h"

#include <math.h>

static const double LOW_PASS = 0.3, JACOBIAN_REACH = 1.3, LEAST_NORM = 1e-12, LEAST_COMPENSATION = 2.5e-5;

/* The quantities of M.1 under its names, of one Gaussian: what both directions need. */
typedef struct geometry {
    double p[3];        /* p_c */
    double qn[4], norm; /* q/|q|, |q| */
    double s[3], R[9], M[9];
    double x_ratio, y_ratio; /* X, Y: clamped x/z, y/z */
    int x_clamped, y_clamped;
    double J[6], T[6], A[6];
    double cross[3], cross2; /* A0 x A1 and its square */
    double low_pass, det;
    double o;            /* sigmoid of the logit */
    double compensation; /* k; 1 unless anti-aliased */
    int floored;
} geometry;

/* F.2.1 */
static void rotation(const double q[4], double R[9]) {
    double w = q[0], x = q[1], y = q[2], z = q[3];
    R[0] = 1 - 2 * (y * y + z * z), R[1] = 2 * (x * y - z * w), R[2] = 2 * (x * z + y * w);
    R[3] = 2 * (x * y + z * w), R[4] = 1 - 2 * (x * x + z * z), R[5] = 2 * (y * z - x * w);
    R[6] = 2 * (x * z - y * w), R[7] = 2 * (y * z + x * w), R[8] = 1 - 2 * (x * x + y * y);
}

/* dR/dw, dR/dx, dR/dy, dR/dz (B.2) */
static void rotation_backward(const double q[4], double d_R[4][9]) {
    double w = q[0], x = q[1], y = q[2], z = q[3];
    const double half[4][9] = {{0, -z, y, z, 0, -x, -y, x, 0},
                               {0, y, z, y, -2 * x, -w, z, w, -2 * x},
                               {-2 * y, x, w, x, 0, z, -w, z, -2 * y},
                               {-2 * z, -w, x, w, -2 * z, y, x, y, 0}};
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 9; k++) d_R[i][k] = 2 * half[i][k];
}

static double clamped(double value, double reach, int *was_clamped) {
    *was_clamped = fabs(value) > reach;
    return fmin(fmax(value, -reach), reach);
}

/* F.2: the Gaussian's own axes, M = R diag(s). */
static void shape(geometry *g, const double *log_scale) {
    rotation(g->qn, g->R);
    for (int k = 0; k < 3; k++) {
        g->s[k] = exp(log_scale[k]);
        for (int i = 0; i < 3; i++) g->M[3 * i + k] = g->R[3 * i + k] * g->s[k];
    }
}

/* F.3.6: J at the clamped point, T = J R_cw, A = T M; the determinant as a sum of squares (M.1). */
static void flatten(geometry *g, const sf_camera *c) {
    double z = g->p[2];
    g->x_ratio = clamped(g->p[0] / z, JACOBIAN_REACH * c->width / (2 * c->fx), &g->x_clamped);
    g->y_ratio = clamped(g->p[1] / z, JACOBIAN_REACH * c->height / (2 * c->fy), &g->y_clamped);
    g->J[0] = c->fx / z, g->J[1] = 0, g->J[2] = -c->fx * g->x_ratio / z;
    g->J[3] = 0, g->J[4] = c->fy / z, g->J[5] = -c->fy * g->y_ratio / z;
    multiply(plain(g->J, 2, 3), plain(c->R_cw, 3, 3), g->T);
    multiply(plain(g->T, 2, 3), plain(g->M, 3, 3), g->A);
    const double *a0 = g->A, *a1 = g->A + 3;
    cross3(a0, a1, g->cross);
    g->cross2 = dot3(g->cross, g->cross);
    g->det = g->cross2 + g->low_pass * (dot3(a0, a0) + dot3(a1, a1)) + g->low_pass * g->low_pass;
}

/* 0: culled. */
static int geometry_of(const test_ref_scene *scene, size_t i, geometry *g) {
    const sf_camera *c = &scene->camera;
    const double *q = scene->gaussians.quats + 4 * i;
    multiply(plain(c->R_cw, 3, 3), plain(scene->gaussians.means + 3 * i, 3, 1), g->p);
    for (int k = 0; k < 3; k++) g->p[k] += c->t_cw[k];
    g->norm = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    if (g->p[2] <= scene->near_plane || g->norm < LEAST_NORM) return 0;

    for (int k = 0; k < 4; k++) g->qn[k] = q[k] / g->norm;
    shape(g, scene->gaussians.log_scales + 3 * i);
    g->low_pass = scene->low_pass > 0 ? scene->low_pass : LOW_PASS;
    flatten(g, c);
    g->o = 1 / (1 + exp(-scene->gaussians.logit_opacities[i]));
    g->floored = scene->antialiased && g->cross2 / g->det < LEAST_COMPENSATION;
    g->compensation = scene->antialiased ? sqrt(fmax(LEAST_COMPENSATION, g->cross2 / g->det)) : 1;
    return 1;
}

/* v/|v| from the camera's centre to the mean; returns |v|. */
static double direction(const test_ref_scene *scene, size_t i, double d[3]) {
    double centre[3];
    multiply(transposed(scene->camera.R_cw, 3, 3), plain(scene->camera.t_cw, 3, 1), centre);
    for (int k = 0; k < 3; k++) d[k] = scene->gaussians.means[3 * i + (size_t)k] + centre[k];
    double length = sqrt(dot3(d, d));
    for (int k = 0; k < 3; k++) d[k] /= length;
    return length;
}

static size_t coefficients(const test_ref_scene *scene) {
    return (size_t)(scene->sh_degree + 1) * (size_t)(scene->sh_degree + 1);
}

/* M.4 */
static void color(const test_ref_scene *scene, size_t i, test_ref_splat *splat) {
    double d[3], basis[16];
    direction(scene, i, d);
    test_ref_sh_basis(scene->sh_degree, d, basis);
    const double *sh = scene->gaussians.sh + 3 * coefficients(scene) * i;
    for (int channel = 0; channel < 3; channel++) {
        double sum = 0.5;
        for (size_t k = 0; k < coefficients(scene); k++) sum += basis[k] * sh[3 * k + (size_t)channel];
        splat->rgb[channel] = fmax(0, sum);
        if (sum <= 0) splat->rgb_clamped |= 1 << channel;
    }
}

void test_ref_project(const test_ref_scene *scene, size_t i, test_ref_splat *splat) {
    geometry g;
    *splat = (test_ref_splat){0};
    if (!geometry_of(scene, i, &g)) return;
    const double *a0 = g.A, *a1 = g.A + 3;
    splat->visible = 1;
    for (int k = 0; k < 3; k++) splat->camera_point[k] = g.p[k];
    splat->mean2d[0] = scene->camera.fx * g.p[0] / g.p[2] + scene->camera.cx; /* F.1.2 */
    splat->mean2d[1] = scene->camera.fy * g.p[1] / g.p[2] + scene->camera.cy;
    for (int k = 0; k < 6; k++) splat->factor[k] = g.A[k];
    splat->cov2d[0] = dot3(a0, a0) + g.low_pass;
    splat->cov2d[1] = dot3(a0, a1);
    splat->cov2d[2] = dot3(a1, a1) + g.low_pass;
    splat->det = g.det;
    splat->conic[0] = splat->cov2d[2] / g.det;
    splat->conic[1] = -splat->cov2d[1] / g.det;
    splat->conic[2] = splat->cov2d[0] / g.det;
    splat->opacity = g.o * g.compensation;
    splat->jacobian_clamped = g.x_clamped | g.y_clamped << 1;
    splat->compensation_floored = g.floored;
    color(scene, i, splat);
}

/* M.4: adds to dL/dh; gives the colour's part of dL/dp_w. */
static void color_backward(const test_ref_scene *scene, size_t i, const double d_rgb[3], double *d_sh,
                           double d_mean[3]) {
    test_ref_splat splat = {0};
    color(scene, i, &splat);
    double d[3], basis[16], d_basis[16][3], d_direction[3] = {0};
    double length = direction(scene, i, d);
    test_ref_sh_basis(scene->sh_degree, d, basis);
    test_ref_sh_basis_backward(scene->sh_degree, d, d_basis);
    const double *sh = scene->gaussians.sh + 3 * coefficients(scene) * i;
    for (int channel = 0; channel < 3; channel++) {
        if (splat.rgb_clamped & 1 << channel) continue;
        for (size_t k = 0; k < coefficients(scene); k++) {
            size_t at = 3 * k + (size_t)channel;
            d_sh[at] += basis[k] * d_rgb[channel];
            for (int j = 0; j < 3; j++) d_direction[j] += sh[at] * d_basis[k][j] * d_rgb[channel];
        }
    }
    /* (I - d d^T)/|v|: only what turns the direction counts */
    double along = dot3(d, d_direction);
    for (int k = 0; k < 3; k++) d_mean[k] = (d_direction[k] - along * d[k]) / length;
}

/* G_A = 2 G_cov A with G_cov = -Omega G_Omega Omega. */
static void cov2d_backward(const geometry *g, const test_ref_splat *splat, const double d_conic[3],
                           double G_A[6]) {
    const double *w = splat->conic;
    const double omega[4] = {w[0], w[1], w[1], w[2]};
    const double G_omega[4] = {d_conic[0], d_conic[1] / 2, d_conic[1] / 2, d_conic[2]};
    double product[4], G_cov[4];
    multiply(plain(omega, 2, 2), plain(G_omega, 2, 2), product);
    multiply(plain(product, 2, 2), plain(omega, 2, 2), G_cov);
    multiply(plain(G_cov, 2, 2), plain(g->A, 2, 3), G_A);
    for (int k = 0; k < 6; k++) G_A[k] *= -2;
}

/* Anti-aliased mode: k^2 = |A0 x A1|^2/det; adds to G_A. */
static void compensation_backward(const geometry *g, double d_compensation, double G_A[6]) {
    const double *a[2] = {g->A, g->A + 3};
    double d_cross2[2][3]; /* d|A0 x A1|^2: 2 A1 x n by A0, 2 n x A0 by A1 */
    cross3(a[1], g->cross, d_cross2[0]);
    cross3(g->cross, a[0], d_cross2[1]);
    double d_ratio = d_compensation / (2 * g->compensation);
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 3; k++) {
            double dn = 2 * d_cross2[i][k], d_det = dn + 2 * g->low_pass * a[i][k];
            G_A[3 * i + k] += d_ratio * (dn * g->det - g->cross2 * d_det) / (g->det * g->det);
        }
}

/* Equations 3 and 4: from M to log-scales and to q, through its normalisation. */
static void shape_backward(const geometry *g, const double G_M[9], double *d_log_scale, double *d_quat) {
    double d_R[4][9], d_qn[4] = {0}, along = 0;
    rotation_backward(g->qn, d_R);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) {
            d_log_scale[k] += g->R[3 * i + k] * G_M[3 * i + k] * g->s[k];
            for (int j = 0; j < 4; j++) d_qn[j] += G_M[3 * i + k] * g->s[k] * d_R[j][3 * i + k];
        }
    for (int j = 0; j < 4; j++) along += d_qn[j] * g->qn[j];
    for (int j = 0; j < 4; j++) d_quat[j] += (d_qn[j] - along * g->qn[j]) / g->norm;
}

/* dL/dp_c through the mean (B.1.2) and through J. */
static void point_backward(const geometry *g, const sf_camera *c, const double d_mean2d[2],
                           const double G_J[6], double d_p[3]) {
    double x = g->p[0], y = g->p[1], z = g->p[2], zz = z * z;
    d_p[0] = c->fx / z * d_mean2d[0];
    d_p[1] = c->fy / z * d_mean2d[1];
    d_p[2] = -c->fx * x / zz * d_mean2d[0] - c->fy * y / zz * d_mean2d[1];

    d_p[2] += -c->fx / zz * G_J[0] - c->fy / zz * G_J[4];
    if (!g->x_clamped) d_p[0] += -c->fx / zz * G_J[2];
    if (!g->y_clamped) d_p[1] += -c->fy / zz * G_J[5];
    /* J02 = -fx X/z: within the clamp X = x/z depends on z as well */
    d_p[2] += (g->x_clamped ? 1 : 2) * c->fx * g->x_ratio / zz * G_J[2];
    d_p[2] += (g->y_clamped ? 1 : 2) * c->fy * g->y_ratio / zz * G_J[5];
}

/* M.6. d_p: dL/dp_c; d_color: the colour's part of dL/dp_w; G_W: dL/dR_cw through the covariance. */
static void pose_backward(const geometry *g, const sf_camera *c, const double d_p[3], const double d_color[3],
                          const double G_W[9], double d_pose[6]) {
    double turned[3], torque[3], Q[9];
    multiply(plain(c->R_cw, 3, 3), plain(d_color, 3, 1), turned);
    cross3(g->p, d_p, torque);
    multiply(plain(G_W, 3, 3), transposed(c->R_cw, 3, 3), Q);
    const double axial[3] = {Q[7] - Q[5], Q[2] - Q[6], Q[3] - Q[1]};
    for (int k = 0; k < 3; k++) {
        d_pose[k] += d_p[k] + turned[k];
        d_pose[3 + k] += torque[k] + axial[k];
    }
}

/* Straight from F.1.2 and J: what fx stands before, but for J02 on the clamp, where fx X is constant. */
static void focal_backward(const geometry *g, const sf_camera *c, const double d_mean2d[2],
                           const double G_J[6], double d_focal[2]) {
    const double *p = g->p;
    d_focal[0] += c->fx * p[0] / p[2] * d_mean2d[0] + g->J[0] * G_J[0];
    d_focal[1] += c->fy * p[1] / p[2] * d_mean2d[1] + g->J[4] * G_J[4];
    if (!g->x_clamped) d_focal[0] += g->J[2] * G_J[2];
    if (!g->y_clamped) d_focal[1] += g->J[5] * G_J[5];
}

void test_ref_project_backward(const test_ref_scene *scene, size_t i, const test_ref_splat_grads *d_splat,
                               test_ref_grads *grads) {
    geometry g;
    test_ref_splat splat;
    test_ref_project(scene, i, &splat);
    if (!geometry_of(scene, i, &g)) return;
    const sf_camera *c = &scene->camera;
    test_ref_gaussians *d = &grads->gaussians;

    double G_A[6], G_M[9], G_T[6], G_J[6], G_W[9];
    cov2d_backward(&g, &splat, d_splat->conic, G_A);
    if (scene->antialiased && !g.floored) compensation_backward(&g, d_splat->opacity * g.o, G_A);
    multiply(transposed(g.T, 2, 3), plain(G_A, 2, 3), G_M);
    multiply(plain(G_A, 2, 3), transposed(g.M, 3, 3), G_T);
    multiply(plain(G_T, 2, 3), transposed(c->R_cw, 3, 3), G_J);
    multiply(transposed(g.J, 2, 3), plain(G_T, 2, 3), G_W);

    shape_backward(&g, G_M, d->log_scales + 3 * i, d->quats + 4 * i);
    d->logit_opacities[i] += d_splat->opacity * g.compensation * g.o * (1 - g.o);

    double d_p[3], d_color[3], d_mean[3];
    point_backward(&g, c, d_splat->mean2d, G_J, d_p);
    color_backward(scene, i, d_splat->rgb, d->sh + 3 * coefficients(scene) * i, d_color);
    multiply(transposed(c->R_cw, 3, 3), plain(d_p, 3, 1), d_mean);
    for (size_t k = 0; k < 3; k++) d->means[3 * i + k] += d_mean[k] + d_color[k];
    pose_backward(&g, c, d_p, d_color, G_W, grads->pose);
    focal_backward(&g, c, d_splat->mean2d, G_J, grads->focal);
}
