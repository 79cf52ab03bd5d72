/* project.c - from raw parameters to a Gaussian on the screen, and the gradient of it, in plain C.
 *
 * In float64 between the float32 arrays: a needle under a long lens turns the rounding of its rotation, 6e-8,
 * into some 1e-5 px at its tips, and the pose's gradient adds up thousands of such. All of it is small beside
 * blending.
 */
#include "scalar.h"

#include "../../src/kernels/sh.h"

#include <float.h>
#include <math.h>
#include <string.h>

/* What projection works out and its gradient needs again. */
typedef struct projection {
    double p[3];              /* camera frame */
    double inv_z, X, Y;       /* X, Y: x/z and y/z, clamped */
    int in_x, in_y;           /* inside the clamp */
    double s[3];              /* standard deviations */
    double q[4], q_norm;      /* normalised quaternion w x y z */
    double R[9];              /* of the quaternion */
    double T0[3], T1[3];      /* J R_cw */
    double A0[3], A1[3];      /* J R_cw R diag(s) */
    double n[3];              /* A0 x A1 */
    double nn;                /* |n|^2 */
    double a, b, c, det;      /* 2D covariance with the low-pass */
    double opacity;           /* raw */
    double log2_compensation; /* of the opacity, M.3; 0 without */
    double direction[3], distance;
} projection;

static double dot3(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
/* With three floats of the camera's. */
static double dot3f(const double *a, const float *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void cross3(const double *a, const double *b, double *out) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static double clamp(double x, double limit) { return x < -limit ? -limit : x > limit ? limit : x; }

static void load(const sf_params *params, int field, int components, size_t i, double *out) {
    for (int c = 0; c < components; c++) out[c] = params->field[field][sf_at(i, components, c)];
}

static void rotation(const double *q, double *R) {
    double w = q[0], x = q[1], y = q[2], z = q[3];
    R[0] = 1 - 2 * (y * y + z * z), R[1] = 2 * (x * y - z * w), R[2] = 2 * (x * z + y * w);
    R[3] = 2 * (x * y + z * w), R[4] = 1 - 2 * (x * x + z * z), R[5] = 2 * (y * z - x * w);
    R[6] = 2 * (x * z - y * w), R[7] = 2 * (y * z + x * w), R[8] = 1 - 2 * (x * x + y * y);
}

/* 1. the mean in the camera's frame. The raw mean is left in `mean`. */
static void to_camera(const sf_project_args *a, size_t i, double *mean, projection *f) {
    const sf_eye *eye = a->eye;
    load(&a->params, SF_FIELD_mean, 3, i, mean);
    for (int k = 0; k < 3; k++) f->p[k] = dot3f(mean, eye->R + 3 * k) + eye->t[k];
}

/* 2. everything else but the colour. 0 if a value is not finite or the quaternion has no direction. */
static int project_shape(const sf_project_args *a, size_t i, const double *mean, projection *f) {
    const sf_eye *eye = a->eye;
    f->inv_z = 1.0 / f->p[2];
    double x = f->p[0] * f->inv_z, y = f->p[1] * f->inv_z;
    f->X = clamp(x, eye->clamp_x), f->Y = clamp(y, eye->clamp_y);
    f->in_x = f->X == x, f->in_y = f->Y == y;

    double log_scale[3], q[4], logit;
    load(&a->params, SF_FIELD_log_scale, 3, i, log_scale);
    load(&a->params, SF_FIELD_quat, 4, i, q);
    load(&a->params, SF_FIELD_logit_opacity, 1, i, &logit);
    f->q_norm = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    if (!(f->q_norm >= SF_QUAT_MIN) || !(f->q_norm <= FLT_MAX) || !(fabs(logit) <= FLT_MAX)) return 0;
    for (int k = 0; k < 4; k++) f->q[k] = q[k] / f->q_norm;
    rotation(f->q, f->R);
    for (int k = 0; k < 3; k++) {
        if (!(fabs(log_scale[k]) <= FLT_MAX)) return 0; /* exp(-inf) would pass for flat */
        f->s[k] = exp(log_scale[k]);
    }

    double fz = eye->fx * f->inv_z, gz = eye->fy * f->inv_z;
    for (int k = 0; k < 3; k++) {
        f->T0[k] = fz * (eye->R[k] - f->X * eye->R[6 + k]);
        f->T1[k] = gz * (eye->R[3 + k] - f->Y * eye->R[6 + k]);
    }
    for (int k = 0; k < 3; k++) {
        f->A0[k] = (f->T0[0] * f->R[k] + f->T0[1] * f->R[3 + k] + f->T0[2] * f->R[6 + k]) * f->s[k];
        f->A1[k] = (f->T1[0] * f->R[k] + f->T1[1] * f->R[3 + k] + f->T1[2] * f->R[6 + k]) * f->s[k];
    }
    /* Cauchy-Binet: the determinant as a sum of squares, which cannot cancel. Nor does n by components: with
     * T0 x T1 = J00 J11 R_cw^T (X, Y, 1), n_k is that times the product of the two other scales, along axis
     * k. */
    double normal[3];
    for (int k = 0; k < 3; k++)
        normal[k] = fz * gz * (f->X * eye->R[k] + f->Y * eye->R[3 + k] + eye->R[6 + k]);
    for (int k = 0; k < 3; k++)
        f->n[k] = f->s[(k + 1) % 3] * f->s[(k + 2) % 3] *
                  (f->R[k] * normal[0] + f->R[3 + k] * normal[1] + f->R[6 + k] * normal[2]);
    f->nn = dot3(f->n, f->n);
    double aa = dot3(f->A0, f->A0), cc = dot3(f->A1, f->A1);
    double low = eye->low_pass;
    f->a = aa + low, f->b = dot3(f->A0, f->A1), f->c = cc + low;
    f->det = f->nn + low * (aa + cc) + low * low;

    f->opacity = 1.0 / (1.0 + exp(-logit));
    f->log2_compensation = a->antialiased ? 0.5 * log2(fmax(2.5e-5, f->nn / f->det)) : 0.0;
    double v[3] = {mean[0] - eye->center[0], mean[1] - eye->center[1], mean[2] - eye->center[2]};
    f->distance = sqrt(dot3(v, v));
    for (int k = 0; k < 3; k++) f->direction[k] = v[k] / f->distance;
    return f->det <= FLT_MAX && f->distance <= FLT_MAX; /* false for NaN too */
}

/* Gradients of the basis functions, as polynomials of x, y, z. */
static void sh_gradients(int degree, const double *d, double (*G)[3]) {
    double x = d[0], y = d[1], z = d[2], xx = x * x, yy = y * y, zz = z * z;
    const double c1 = SF_SH_1, c2 = SF_SH_2, c20 = SF_SH_20, c22 = SF_SH_22;
    const double c30 = SF_SH_33, c31 = SF_SH_32, c32 = SF_SH_31, c33 = SF_SH_30, c34 = SF_SH_32C;
    const double first[4][3] = {{0, 0, 0}, {0, -c1, 0}, {0, 0, c1}, {-c1, 0, 0}};
    memcpy(G, first, sizeof first);
    if (degree > 1) {
        const double second[5][3] = {{c2 * y, c2 * x, 0},
                                     {0, -c2 * z, -c2 * y},
                                     {-2 * c20 * x, -2 * c20 * y, 4 * c20 * z},
                                     {-c2 * z, 0, -c2 * x},
                                     {2 * c22 * x, -2 * c22 * y, 0}};
        memcpy(G + 4, second, sizeof second);
    }
    if (degree > 2) {
        const double third[7][3] = {
            {-6 * c30 * x * y, -3 * c30 * (xx - yy), 0},
            {c31 * y * z, c31 * x * z, c31 * x * y},
            {2 * c32 * x * y, -c32 * (4 * zz - xx - 3 * yy), -8 * c32 * y * z},
            {-6 * c33 * x * z, -6 * c33 * y * z, c33 * (6 * zz - 3 * xx - 3 * yy)},
            {-c32 * (4 * zz - 3 * xx - yy), 2 * c32 * x * y, -8 * c32 * x * z},
            {2 * c34 * x * z, -2 * c34 * y * z, c34 * (xx - yy)},
            {-3 * c30 * (xx - yy), 6 * c30 * x * y, 0},
        };
        memcpy(G + 9, third, sizeof third);
    }
}

/* Band of coefficient k, and its place there. */
static const struct {
    uint8_t field, components, at;
} sh_place[16] = {
    {SF_FIELD_sh0, 3, 0},   {SF_FIELD_sh1, 9, 0},   {SF_FIELD_sh1, 9, 3},   {SF_FIELD_sh1, 9, 6},
    {SF_FIELD_sh2, 15, 0},  {SF_FIELD_sh2, 15, 3},  {SF_FIELD_sh2, 15, 6},  {SF_FIELD_sh2, 15, 9},
    {SF_FIELD_sh2, 15, 12}, {SF_FIELD_sh3, 21, 0},  {SF_FIELD_sh3, 21, 3},  {SF_FIELD_sh3, 21, 6},
    {SF_FIELD_sh3, 21, 9},  {SF_FIELD_sh3, 21, 12}, {SF_FIELD_sh3, 21, 15}, {SF_FIELD_sh3, 21, 18}};

static size_t sh_at(size_t i, int k, int channel) {
    return sf_at(i, sh_place[k].components, sh_place[k].at + channel);
}

static int tile_rows(const sf_eye *eye, sf_splat *s, uint16_t *first_row, uint16_t *rows) {
    /* a hundredth of a pixel more than the box: a rounding error must not lose a pixel */
    double top = s->v - s->half_height - 0.01, bottom = s->v + s->half_height + 0.01;
    double left = s->u - s->half_width - 0.01, right = s->u + s->half_width + 0.01;
    if (!(right >= 0.5 && left <= (double)eye->width - 0.5 && bottom >= 0.5 &&
          top <= (double)eye->height - 0.5))
        return 0;
    int y0 = (int)ceil(fmax(top - (SF_TILE - 0.5), 0.0) / SF_TILE);
    int y1 = (int)floor(fmin(bottom - 0.5, (double)eye->height - 1.0) / SF_TILE);
    *first_row = (uint16_t)y0;
    *rows = (uint16_t)(y1 - y0 + 1);
    return y1 >= y0;
}

static int project_one(const sf_project_args *a, size_t i) {
    projection f;
    double mean[3];
    to_camera(a, i, mean, &f);
    if (!(fabs(f.p[0]) <= FLT_MAX && fabs(f.p[1]) <= FLT_MAX && fabs(f.p[2]) <= FLT_MAX))
        return SF_NOT_FINITE;
    if (!(f.p[2] > a->eye->near_plane)) return SF_OUT_OF_VIEW;
    if (!project_shape(a, i, mean, &f)) return SF_NOT_FINITE;

    /* 3. whitening factors and extent: o g >= 1/255 exactly where t^2 + s^2 <= r2k (M.1) */
    sf_splat *s = &a->splats[i];
    double log2_opacity = log2(f.opacity) + f.log2_compensation;
    double r2k = log2_opacity + SF_LOG2_255, r2 = r2k * SF_WHITEN_UNDO;
    if (!(r2k > 0)) return SF_OUT_OF_VIEW;
    s->log2_opacity = (float)log2_opacity;
    s->u = (float)(a->eye->fx * f.p[0] * f.inv_z + a->eye->cx);
    s->v = (float)(a->eye->fy * f.p[1] * f.inv_z + a->eye->cy);
    s->l00 = (float)(SF_WHITEN * sqrt(f.c / f.det));
    s->l01 = (float)(-SF_WHITEN * f.b / sqrt(f.c * f.det));
    s->m = (float)(SF_WHITEN / sqrt(f.c));
    s->depth = (float)f.p[2];
    s->slope = (float)(f.b / f.c);
    s->reach = (float)(r2 * f.det / f.c);
    s->squeeze = (float)(f.det / (f.c * f.c));
    s->lean = (float)(f.b * sqrt(r2 / f.a));
    s->half_width = (float)sqrt(r2 * f.a);
    s->half_height = (float)sqrt(r2 * f.c);
    if (!(s->reach <= FLT_MAX && s->squeeze <= FLT_MAX && fabs(s->u) <= FLT_MAX && fabs(s->v) <= FLT_MAX))
        return SF_NOT_FINITE;
    if (!tile_rows(a->eye, s, &a->first_row[i], &a->rows[i])) return SF_OUT_OF_VIEW;

    /* 4. colour */
    double Y[16], rgb[3] = {0.5, 0.5, 0.5};
    sf_sh_basis(a->sh_degree, f.direction, Y);
    for (int k = 0; k < (a->sh_degree + 1) * (a->sh_degree + 1); k++)
        for (int ch = 0; ch < 3; ch++) rgb[ch] += Y[k] * a->params.field[sh_place[k].field][sh_at(i, k, ch)];
    for (int ch = 0; ch < 3; ch++) {
        if (!(fabs(rgb[ch]) <= FLT_MAX)) return SF_NOT_FINITE;
        s->rgb[ch] = (float)fmax(rgb[ch], 0.0);
    }
    return SF_SEEN;
}

void sf_project_scalar(const sf_project_args *a, size_t first, size_t end) {
    for (size_t i = first * SF_LANES; i < end * SF_LANES; i++) {
        a->state[i] = (uint8_t)project_one(a, i);
        if (a->state[i] != SF_SEEN) a->rows[i] = 0;
    }
}

/* The gradient of one Gaussian, before it is stored. */
typedef struct gradient {
    double mean[3], log_scale[3], quat[4], logit_opacity, sh[16][3];
    double screen;
    double camera[SF_CAMERA_SUMS];
} gradient;

/* Through the colour (M.4): dL/dSH, and dL/dmean by way of the direction, returned in d_mean. */
static void colour_bwd(const sf_project_args *a, size_t i, const projection *f, const double *d_rgb,
                       gradient *g, double *d_mean) {
    double Y[16], G[16][3], used[3], d_direction[3] = {0};
    sf_sh_basis(a->sh_degree, f->direction, Y);
    sh_gradients(a->sh_degree, f->direction, G);
    for (int ch = 0; ch < 3; ch++) used[ch] = a->splats[i].rgb[ch] > 0 ? d_rgb[ch] : 0.0;
    for (int k = 0; k < (a->sh_degree + 1) * (a->sh_degree + 1); k++)
        for (int ch = 0; ch < 3; ch++) {
            double h = a->params.field[sh_place[k].field][sh_at(i, k, ch)] * used[ch];
            g->sh[k][ch] = Y[k] * used[ch];
            for (int axis = 0; axis < 3; axis++) d_direction[axis] += h * G[k][axis];
        }
    double along = dot3(f->direction, d_direction);
    for (int axis = 0; axis < 3; axis++)
        d_mean[axis] = (d_direction[axis] - f->direction[axis] * along) / f->distance;
}

/* dL/dA from the whitened second moments: G_A = L^T S (L A), and through the opacity compensation. */
static void covariance_bwd(const sf_project_args *a, const sf_splat *s, const projection *f,
                           const double *sums, double *d_A0, double *d_A1) {
    double turn0[3], turn1[3]; /* A1 x n, n x A0 */
    cross3(f->A1, f->n, turn0);
    cross3(f->n, f->A0, turn1);
    double tt = sums[6], ts = sums[7], ss = sums[8], undo2 = SF_WHITEN_UNDO * SF_WHITEN_UNDO;
    double lead = SF_WHITEN / sqrt(f->c * f->det), low = a->eye->low_pass;
    for (int k = 0; k < 3; k++) {
        /* l00 A0 + l01 A1 = (c A0 - b A1) / sqrt(c det), and c A0 - b A1 = eps A0 + A1 x n without
         * cancellation */
        double B0 = lead * (low * f->A0[k] + turn0[k]), B1 = s->m * f->A1[k];
        double H0 = tt * B0 + ts * B1, H1 = ts * B0 + ss * B1;
        d_A0[k] = undo2 * s->l00 * H0;
        d_A1[k] = undo2 * (s->l01 * H0 + s->m * H1);
    }
    if (!a->antialiased || !(f->nn / f->det > 2.5e-5)) return;
    double p = sums[3], d_nn = 1 / f->nn - 1 / f->det, low_det = low / f->det;
    for (int k = 0; k < 3; k++) { /* ln k = (ln |n|^2 - ln det) / 2 */
        d_A0[k] += p * (d_nn * turn0[k] - low_det * f->A0[k]);
        d_A1[k] += p * (d_nn * turn1[k] - low_det * f->A1[k]);
    }
}

/* dL/dR to the quaternion as stored, through its normalisation (equation 3, with M.3's last term). */
static void quaternion_bwd(const projection *f, const double *G, double *d_quat) {
    double w = f->q[0], x = f->q[1], y = f->q[2], z = f->q[3], d[4];
    d[0] = 2 * (z * (G[3] - G[1]) + y * (G[2] - G[6]) + x * (G[7] - G[5]));
    d[1] = 2 * (y * (G[1] + G[3]) + z * (G[2] + G[6]) + w * (G[7] - G[5]) - 2 * x * (G[4] + G[8]));
    d[2] = 2 * (x * (G[1] + G[3]) + z * (G[5] + G[7]) + w * (G[2] - G[6]) - 2 * y * (G[0] + G[8]));
    d[3] = 2 * (x * (G[2] + G[6]) + y * (G[5] + G[7]) + w * (G[3] - G[1]) - 2 * z * (G[0] + G[4]));
    double along = d[0] * w + d[1] * x + d[2] * y + d[3] * z;
    for (int k = 0; k < 4; k++) d_quat[k] = (d[k] - along * f->q[k]) / f->q_norm;
}

/* Left twist and focal lengths (M.6), from d_p = dL/dp_c, the colour's part of dL/dmean, and the gradients of
 * the rows of T. */
static void camera_bwd(const sf_eye *eye, const projection *f, const double *d_p, const double *d_color,
                       const double *d_T0, const double *d_T1, double *camera) {
    double J00 = eye->fx * f->inv_z, J11 = eye->fy * f->inv_z, J02 = -J00 * f->X, J12 = -J11 * f->Y;
    double W[3][3], Q[3][3], turn[3];
    for (int k = 0; k < 3; k++) {
        W[0][k] = J00 * d_T0[k];
        W[1][k] = J11 * d_T1[k];
        W[2][k] = J02 * d_T0[k] + J12 * d_T1[k];
    }
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) Q[r][c] = dot3f(W[r], eye->R + 3 * c);
    cross3(f->p, d_p, turn);
    for (int k = 0; k < 3; k++) camera[k] = d_p[k] + dot3f(d_color, eye->R + 3 * k);
    camera[3] = turn[0] + Q[2][1] - Q[1][2];
    camera[4] = turn[1] + Q[0][2] - Q[2][0];
    camera[5] = turn[2] + Q[1][0] - Q[0][1];
    camera[6] = f->p[0] * d_p[0] + Q[0][0];
    camera[7] = f->p[1] * d_p[1] + Q[1][1];
}

static void gradient_one(const sf_project_args *a, size_t i, const double *sums, gradient *g) {
    const sf_eye *eye = a->eye;
    const sf_splat *s = &a->splats[i];
    projection f;
    double mean[3], d_color[3];
    to_camera(a, i, mean, &f);
    project_shape(a, i, mean, &f);

    /* 1. colour and opacity */
    colour_bwd(a, i, &f, sums, g, d_color);
    g->logit_opacity = sums[3] * (1.0 - f.opacity);

    /* 2. mean on the screen: dL/du = L^T (sum p t, sum p s) */
    double du = SF_WHITEN_UNDO * s->l00 * sums[4];
    double dv = SF_WHITEN_UNDO * (s->l01 * sums[4] + s->m * sums[5]);
    double nx = du * 0.5 * (double)eye->width, ny = dv * 0.5 * (double)eye->height;
    g->screen = sqrt(nx * nx + ny * ny);

    /* 3. covariance: to A, then to scales, rotation and T */
    double d_A0[3], d_A1[3], d_T0[3] = {0}, d_T1[3] = {0}, d_R[9];
    covariance_bwd(a, s, &f, sums, d_A0, d_A1);
    for (int k = 0; k < 3; k++) { /* column k of M = R diag(s) */
        g->log_scale[k] = d_A0[k] * f.A0[k] + d_A1[k] * f.A1[k];
        for (int r = 0; r < 3; r++) {
            d_R[3 * r + k] = (f.T0[r] * d_A0[k] + f.T1[r] * d_A1[k]) * f.s[k];
            d_T0[r] += d_A0[k] * f.R[3 * r + k] * f.s[k];
            d_T1[r] += d_A1[k] * f.R[3 * r + k] * f.s[k];
        }
    }
    quaternion_bwd(&f, d_R, g->quat);

    /* 4. T = J R_cw to J, and J to the mean in the camera's frame, with the clamp's exact derivative */
    double d_J00 = dot3f(d_T0, eye->R), d_J02 = dot3f(d_T0, eye->R + 6);
    double d_J11 = dot3f(d_T1, eye->R + 3), d_J12 = dot3f(d_T1, eye->R + 6);
    double fz = eye->fx * f.inv_z, gz = eye->fy * f.inv_z, d_p[3];
    d_p[0] = fz * (du - (f.in_x ? d_J02 * f.inv_z : 0.0));
    d_p[1] = gz * (dv - (f.in_y ? d_J12 * f.inv_z : 0.0));
    d_p[2] = -f.inv_z * (fz * (du * f.p[0] + d_J00 - (f.in_x ? 2.0 : 1.0) * f.X * d_J02) +
                         gz * (dv * f.p[1] + d_J11 - (f.in_y ? 2.0 : 1.0) * f.Y * d_J12));

    /* 5. to the world */
    for (int k = 0; k < 3; k++)
        g->mean[k] = eye->R[k] * d_p[0] + eye->R[3 + k] * d_p[1] + eye->R[6 + k] * d_p[2] + d_color[k];
    camera_bwd(eye, &f, d_p, d_color, d_T0, d_T1, g->camera);
}

static int finite_gradient(const gradient *g, int coefficients) {
    double sum = fabs(g->logit_opacity) + g->screen; /* one value that is not finite makes the sum so */
    for (int k = 0; k < 3; k++) sum += fabs(g->mean[k]) + fabs(g->log_scale[k]);
    for (int k = 0; k < 4; k++) sum += fabs(g->quat[k]);
    for (int k = 0; k < coefficients; k++) sum += fabs(g->sh[k][0]) + fabs(g->sh[k][1]) + fabs(g->sh[k][2]);
    return fabs(sum) <= FLT_MAX;
}

/* i counts from the first of the gradients' blocks. */
static void store(const sf_params *grads, size_t i, const gradient *g) {
    for (int k = 0; k < 3; k++) {
        grads->field[SF_FIELD_mean][sf_at(i, 3, k)] = (float)g->mean[k];
        grads->field[SF_FIELD_log_scale][sf_at(i, 3, k)] = (float)g->log_scale[k];
    }
    for (int k = 0; k < 4; k++) grads->field[SF_FIELD_quat][sf_at(i, 4, k)] = (float)g->quat[k];
    grads->field[SF_FIELD_logit_opacity][i] = (float)g->logit_opacity;
    for (int k = 0; k < 16; k++) {
        float *band = grads->field[sh_place[k].field];
        for (int ch = 0; band && ch < 3; ch++) band[sh_at(i, k, ch)] = (float)g->sh[k][ch];
    }
}

void sf_project_bwd_scalar(const sf_project_bwd_args *b, size_t first, size_t end) {
    const sf_project_args *a = &b->forward;
    for (size_t i = first * SF_LANES; i < end * SF_LANES; i++) {
        static const gradient zero;
        gradient g = zero;
        if (a->state[i] == SF_SEEN) {
            double sums[9] = {0};
            for (uint32_t slot = b->slot[i]; slot < b->slot[i + 1]; slot++)
                for (int k = 0; k < 9; k++) sums[k] += b->sums[(size_t)slot * SF_SUMS + k];
            gradient_one(a, i, sums, &g);
            if (!finite_gradient(&g, (a->sh_degree + 1) * (a->sh_degree + 1))) {
                g = zero;
                ++*b->not_finite;
            }
        }
        store(&b->grads, i - first * SF_LANES, &g);
        b->screen[i] = (float)g.screen;
        for (int k = 0; b->camera && k < SF_CAMERA_SUMS; k++) b->camera[k] += g.camera[k];
    }
}
