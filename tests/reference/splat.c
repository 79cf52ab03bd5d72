/* splat.c - a Gaussian to the screen and its gradient back, with bounds (M.1, M.3, M.4, M.6). */

/* Between float32 arrays a kernel works in float64, or so near to it that the difference does not show. */
#define BOUNDED_UNIT     0x1p-40
#define BOUNDED_LEAST    0.0
#define BOUNDED_QUOTIENT 1

#include "bounds.h"

#include "reference.h"

/* Colours may be made in float32: as many roundings of the sum of all magnitudes. */
static const double COLOUR_ROUNDINGS = 8;

/* Margin of the rows of tiles, px. */
static const double MARGIN = 0.01;

/* As src/render/README.md has them. */
static const double LEAST_NORM = 1e-12, LEAST_COMPENSATION = 2.5e-5;
/* sqrt(log2(e) / 2), log2(255), 2 ln 2 */
static const double WHITEN = 0.84932180028801904, LOG2_255 = 7.9943534368588575, UNDO = 1.3862943611198906;

static const int components[SF_FIELD_COUNT] = {3, 3, 4, 1, 3, 9, 15, 21};

/* Field and place of SH coefficient k. */
static int band_of(int k) {
    return k == 0 ? SF_FIELD_sh0 : k < 4 ? SF_FIELD_sh1 : k < 9 ? SF_FIELD_sh2 : SF_FIELD_sh3;
}
static int place_of(int k) { return 3 * (k - (k == 0 ? 0 : k < 4 ? 1 : k < 9 ? 4 : 9)); }

static double param(const sf_project_args *a, int field, size_t i, int c) {
    return (double)a->params.field[field][sf_at(i, components[field], c)];
}

static double coefficient(const sf_project_args *a, size_t i, int k, int channel) {
    return param(a, band_of(k), i, place_of(k) + channel);
}

typedef struct shape {
    bounded p[3], x, y, X, Y; /* X, Y: clamped */
    int in_x, in_y, at_clamp;
    bounded norm, q[4], s[3], R[3][3];
    bounded J00, J02, J11, J12, T[2][3], A[2][3], n[3], nn, a, b, c, det;
    bounded o, compensation; /* log2 of the latter */
    int compensated, at_floor;
    bounded direction[3], distance;
} shape;

static bounded clamped(bounded x, double limit, int *inside, int *at_clamp) {
    *inside = fabs(x.v) <= limit;
    *at_clamp |= b_near(x, limit) || b_near(x, -limit);
    return *inside ? x : (bounded){copysign(limit, x.v), b_near(x, copysign(limit, x.v)) ? x.e : 0};
}

static void to_camera(const sf_project_args *a, size_t i, shape *s) {
    const sf_eye *eye = a->eye;
    bounded mean[3], row[3];
    for (int k = 0; k < 3; k++) mean[k] = b_of(param(a, SF_FIELD_mean, i, k));
    for (int r = 0; r < 3; r++) {
        for (int k = 0; k < 3; k++) row[k] = b_of((double)eye->R[3 * r + k]);
        s->p[r] = b_add(b_dot3(row, mean), b_of((double)eye->t[r]));
    }
}

/* F.2.1 */
static void rotate(shape *s) {
    bounded w = s->q[0], x = s->q[1], y = s->q[2], z = s->q[3], one = b_of(1);
    bounded xx = b_square(x), yy = b_square(y), zz = b_square(z), xy = b_mul(x, y), xz = b_mul(x, z);
    bounded yz = b_mul(y, z), wx = b_mul(w, x), wy = b_mul(w, y), wz = b_mul(w, z);
    s->R[0][0] = b_sub(one, b_twice(b_add(yy, zz)));
    s->R[1][1] = b_sub(one, b_twice(b_add(xx, zz)));
    s->R[2][2] = b_sub(one, b_twice(b_add(xx, yy)));
    s->R[0][1] = b_twice(b_sub(xy, wz)), s->R[1][0] = b_twice(b_add(xy, wz));
    s->R[0][2] = b_twice(b_add(xz, wy)), s->R[2][0] = b_twice(b_sub(xz, wy));
    s->R[1][2] = b_twice(b_sub(yz, wx)), s->R[2][1] = b_twice(b_add(yz, wx));
}

static void column(const shape *s, int k, bounded out[3]) {
    for (int r = 0; r < 3; r++) out[r] = s->R[r][k];
}

/* M.1 to the covariance and its determinant, a sum of squares. */
static void flatten(const sf_eye *eye, shape *s) {
    bounded inv_z = b_div(b_of(1), s->p[2]), R_cw[3][3], normal[3], axis[3], low = b_of(eye->low_pass);
    for (int k = 0; k < 9; k++) R_cw[k / 3][k % 3] = b_of((double)eye->R[k]);
    s->J00 = b_scale((double)eye->fx, inv_z), s->J11 = b_scale((double)eye->fy, inv_z);
    s->J02 = b_negative(b_mul(s->J00, s->X)), s->J12 = b_negative(b_mul(s->J11, s->Y));
    for (int k = 0; k < 3; k++) {
        s->T[0][k] = b_fma(s->J00, R_cw[0][k], b_mul(s->J02, R_cw[2][k]));
        s->T[1][k] = b_fma(s->J11, R_cw[1][k], b_mul(s->J12, R_cw[2][k]));
        bounded down = b_fma(s->X, R_cw[0][k], b_fma(s->Y, R_cw[1][k], R_cw[2][k]));
        normal[k] = b_mul(b_mul(s->J00, s->J11), down);
    }
    for (int k = 0; k < 3; k++) {
        column(s, k, axis);
        for (int r = 0; r < 2; r++) s->A[r][k] = b_mul(b_dot3(s->T[r], axis), s->s[k]);
        s->n[k] = b_mul(b_mul(s->s[(k + 1) % 3], s->s[(k + 2) % 3]), b_dot3(axis, normal));
    }
    bounded aa = b_dot3(s->A[0], s->A[0]), cc = b_dot3(s->A[1], s->A[1]);
    s->nn = b_dot3(s->n, s->n);
    s->a = b_add(aa, low), s->b = b_dot3(s->A[0], s->A[1]), s->c = b_add(cc, low);
    s->det = b_add(s->nn, b_add(b_mul(low, b_add(aa, cc)), b_of(eye->low_pass * eye->low_pass)));
}

/* 0: not a parameter. */
static int shape_of(const sf_project_args *a, size_t i, shape *s) {
    double logit = param(a, SF_FIELD_logit_opacity, i, 0), square = 0;
    for (int k = 0; k < 4; k++) square += pow(param(a, SF_FIELD_quat, i, k), 2);
    if (!(sqrt(square) >= LEAST_NORM && sqrt(square) <= (double)FLT_MAX && fabs(logit) <= (double)FLT_MAX))
        return 0;
    s->norm = b_round(sqrt(square), 0);
    for (int k = 0; k < 4; k++) s->q[k] = b_div(b_of(param(a, SF_FIELD_quat, i, k)), s->norm);
    for (int k = 0; k < 3; k++) {
        double log_scale = param(a, SF_FIELD_log_scale, i, k);
        if (!(fabs(log_scale) <= (double)FLT_MAX)) return 0;
        s->s[k] = b_exp(b_of(log_scale));
    }
    s->x = b_div(s->p[0], s->p[2]), s->y = b_div(s->p[1], s->p[2]);
    s->at_clamp = 0;
    s->X = clamped(s->x, (double)a->eye->clamp_x, &s->in_x, &s->at_clamp);
    s->Y = clamped(s->y, (double)a->eye->clamp_y, &s->in_y, &s->at_clamp);
    rotate(s);
    flatten(a->eye, s);

    s->o = b_div(b_of(1), b_add(b_of(1), b_exp(b_of(-logit))));
    bounded ratio = b_div(s->nn, s->det);
    s->compensated = a->antialiased && ratio.v > LEAST_COMPENSATION;
    s->at_floor = a->antialiased && b_near(ratio, LEAST_COMPENSATION);
    s->compensation = b_of(0);
    if (a->antialiased)
        s->compensation = b_scale(0.5, b_log2(s->compensated ? ratio : b_of(LEAST_COMPENSATION)));
    bounded v[3];
    for (int k = 0; k < 3; k++)
        v[k] = b_sub(b_of(param(a, SF_FIELD_mean, i, k)), b_of((double)a->eye->center[k]));
    s->distance = b_sqrt(b_dot3(v, v));
    for (int k = 0; k < 3; k++) s->direction[k] = b_div(v[k], s->distance);
    return s->det.v <= (double)FLT_MAX && s->distance.v <= (double)FLT_MAX;
}

/* M.4; the clamp at 0 is the caller's. */
static void color(const sf_project_args *a, size_t i, const shape *s, bounded rgb[3]) {
    double d[3], Y[16], G[16][3];
    for (int k = 0; k < 3; k++) d[k] = s->direction[k].v;
    test_ref_sh_basis(a->sh_degree, d, Y);
    test_ref_sh_basis_backward(a->sh_degree, d, G);
    for (int ch = 0; ch < 3; ch++) {
        double v = 0.5, e = 0, magnitude = 0.5;
        for (int k = 0; k < (a->sh_degree + 1) * (a->sh_degree + 1); k++) {
            double h = coefficient(a, i, k, ch);
            v += Y[k] * h;
            magnitude += fabs(Y[k] * h);
            for (int axis = 0; axis < 3; axis++) {
                magnitude += fabs(G[k][axis] * h * d[axis]);
                e += fabs(G[k][axis] * h) * s->direction[axis].e;
            }
        }
        rgb[ch] = (bounded){v, e + COLOUR_ROUNDINGS * FLOAT_UNIT * magnitude};
    }
}

/* The tiles of [from, to] along one side of the picture. */
typedef struct interval {
    int first, end;
} interval;

static interval with_centers(double from, double to, int pixels) {
    double first = fmax(ceil(from - 0.5), 0), last = fmin(floor(to - 0.5), pixels - 1);
    if (!(first <= last)) return (interval){0, 0};
    return (interval){(int)first / SF_TILE, (int)last / SF_TILE + 1};
}

static interval reached(double from, double to, int pixels) {
    double first = fmax(ceil((from - (SF_TILE - 0.5)) / SF_TILE), 0);
    double last = fmin(floor((to - 0.5) / SF_TILE), (pixels - 1) / SF_TILE);
    if (!(first <= last) || from > pixels - 0.5) return (interval){0, 0};
    return (interval){(int)first, (int)last + 1};
}

/* The rows, and whether the box meets the picture. */
static void place(const sf_eye *eye, test_ref_seen *seen) {
    bounded u = seen->splat[0], v = seen->splat[1], w = seen->splat[14], h = seen->splat[15];
    double du = u.e + w.e, dv = v.e + h.e;
    interval x = with_centers(u.v - w.v + du, u.v + w.v - du, eye->width);
    interval y = with_centers(v.v - h.v + dv, v.v + h.v - dv, eye->height);
    interval high = reached(v.v - h.v - MARGIN - dv, v.v + h.v + MARGIN + dv, eye->height);
    seen->needed_first = y.first, seen->needed_end = y.end;
    seen->allowed_first = high.first, seen->allowed_end = high.end;
    int beside = u.v + w.v + MARGIN + du < 0.5 || u.v - w.v - MARGIN - du > eye->width - 0.5;
    if (beside || high.end <= high.first)
        seen->state = SF_OUT_OF_VIEW;
    else if (x.end <= x.first || y.end <= y.first)
        seen->open = 1;
}

/* The values of the splat; 0: one of them is beyond a float. */
static int keep_splat(const sf_eye *eye, const shape *s, const bounded rgb[3], test_ref_seen *seen,
                      bounded r2, bounded log2_opacity) {
    bounded whiten = b_of(WHITEN), c_det = b_sqrt(b_mul(s->c, s->det));
    const bounded splat[16] = {
        b_fma(b_of((double)eye->fx), s->x, b_of((double)eye->cx)),
        b_fma(b_of((double)eye->fy), s->y, b_of((double)eye->cy)),
        b_mul(whiten, b_sqrt(b_div(s->c, s->det))),
        b_negative(b_div(b_mul(whiten, s->b), c_det)),
        b_div(whiten, b_sqrt(s->c)),
        log2_opacity,
        rgb[0],
        rgb[1],
        rgb[2],
        s->p[2],
        b_div(s->b, s->c),
        b_div(b_mul(r2, s->det), s->c),
        b_div(s->det, b_square(s->c)),
        b_mul(s->b, b_sqrt(b_div(r2, s->a))),
        b_sqrt(b_mul(r2, s->a)),
        b_sqrt(b_mul(r2, s->c)),
    };
    int fits = 1;
    for (int k = 0; k < 16; k++) {
        seen->splat[k] = b_stored(splat[k]);
        if (k < 6 || k > 8) fits &= fabs(splat[k].v) <= (double)FLT_MAX;
    }
    for (int ch = 0; ch < 3; ch++)
        if (rgb[ch].v < 0) seen->splat[6 + ch] = (bounded){0, fmax(rgb[ch].v + rgb[ch].e, 0)};
    return fits;
}

void test_ref_see(const sf_project_args *a, size_t i, test_ref_seen *seen) {
    const sf_eye *eye = a->eye;
    shape s;
    int sound, finite = 1;
    bounded rgb[3] = {{0, 0}};
    *seen = (test_ref_seen){.state = SF_NOT_FINITE};
    to_camera(a, i, &s);
    for (int k = 0; k < 3; k++)
        if (!(fabs(s.p[k].v) <= (double)FLT_MAX)) return;
    sound = shape_of(a, i, &s);
    if (sound) color(a, i, &s, rgb);
    for (int ch = 0; ch < 3; ch++) finite &= fabs(rgb[ch].v) <= (double)FLT_MAX;
    seen->open = b_near(s.p[2], (double)eye->near_plane);
    if (s.p[2].v <= (double)eye->near_plane) {
        seen->state = SF_OUT_OF_VIEW;
        seen->open |= !sound || !finite;
        return;
    }
    if (!sound) return;

    bounded log2_opacity = b_add(b_log2(s.o), s.compensation);
    bounded r2k = b_add(log2_opacity, b_of(LOG2_255)), r2 = b_scale(UNDO, r2k);
    seen->state = SF_SEEN;
    seen->open |= b_near(r2k, 0);
    if (r2k.v <= 0) {
        seen->state = SF_OUT_OF_VIEW;
        seen->open |= !finite;
        return;
    }
    if (!keep_splat(eye, &s, rgb, seen, r2, log2_opacity)) {
        seen->state = SF_NOT_FINITE;
        return;
    }
    place(eye, seen);
    if (finite) return;
    seen->open |= seen->state != SF_SEEN || seen->open;
    seen->state = SF_NOT_FINITE;
}

/* ---- backwards ------------------------------------------------------------------------------------------
 */

/* M.4: the colour's part of dL/dmean is returned in d_mean. */
static void color_backward(const sf_project_args *a, size_t i, const shape *s, const double *d_rgb,
                           test_ref_raw_gradient *g, bounded d_mean[3]) {
    double d[3], Y[16], G[16][3], magnitude = 0;
    bounded rgb[3], turn[3] = {{0, 0}};
    for (int k = 0; k < 3; k++) d[k] = s->direction[k].v;
    test_ref_sh_basis(a->sh_degree, d, Y);
    test_ref_sh_basis_backward(a->sh_degree, d, G);
    color(a, i, s, rgb);
    for (int ch = 0; ch < 3; ch++) {
        g->open |= d_rgb[ch] != 0 && b_near(rgb[ch], 0);
        if (rgb[ch].v <= 0) continue;
        for (int k = 0; k < (a->sh_degree + 1) * (a->sh_degree + 1); k++) {
            double h = coefficient(a, i, k, ch) * d_rgb[ch], slope = 0;
            for (int axis = 0; axis < 3; axis++) {
                turn[axis] = b_add(turn[axis], b_scale(h, b_round(G[k][axis], 1e-9 * FLOAT_UNIT)));
                slope += fabs(G[k][axis]);
            }
            magnitude += fabs(h) * slope;
            g->field[band_of(k)][place_of(k) + ch] =
                b_widen(b_scale(d_rgb[ch], b_of(Y[k])),
                        COLOUR_ROUNDINGS * FLOAT_UNIT * fabs(d_rgb[ch]) * (fabs(Y[k]) + (k ? slope : 0)));
        }
    }
    bounded along = b_dot3(s->direction, turn);
    for (int k = 0; k < 3; k++) {
        bounded across = b_sub(turn[k], b_mul(s->direction[k], along));
        d_mean[k] = b_div(b_widen(across, COLOUR_ROUNDINGS * FLOAT_UNIT * magnitude), s->distance);
    }
}

/* dL/dA: G_A = L^T S (L A), and through the compensation. */
static void covariance_backward(const sf_eye *eye, const shape *s, const bounded *splat, const double *sums,
                                bounded d_A[2][3]) {
    bounded turn[2][3], l00 = splat[2], l01 = splat[3], m = splat[4];
    b_cross3(s->A[1], s->n, turn[0]);
    b_cross3(s->n, s->A[0], turn[1]);
    bounded tt = b_of(sums[6]), ts = b_of(sums[7]), ss = b_of(sums[8]);
    bounded lead = b_div(b_of(WHITEN), b_sqrt(b_mul(s->c, s->det)));
    for (int k = 0; k < 3; k++) {
        bounded B0 = b_mul(lead, b_fma(b_of(eye->low_pass), s->A[0][k], turn[0][k])),
                B1 = b_mul(m, s->A[1][k]);
        bounded H0 = b_fma(tt, B0, b_mul(ts, B1)), H1 = b_fma(ts, B0, b_mul(ss, B1));
        d_A[0][k] = b_scale(UNDO * UNDO, b_mul(l00, H0));
        d_A[1][k] = b_scale(UNDO * UNDO, b_fma(l01, H0, b_mul(m, H1)));
    }
    if (!s->compensated) return;
    bounded p = b_of(sums[3]), low = b_div(b_of(eye->low_pass), s->det);
    bounded d_nn = b_sub(b_div(b_of(1), s->nn), b_div(b_of(1), s->det));
    for (int r = 0; r < 2; r++)
        for (int k = 0; k < 3; k++) {
            bounded d = b_sub(b_mul(d_nn, turn[r][k]), b_mul(low, s->A[r][k]));
            d_A[r][k] = b_fma(p, d, d_A[r][k]);
        }
}

/* Equation 3 with the table of M.1, then through the normalisation. */
static void quaternion_backward(const shape *s, bounded G[3][3], bounded *d_quat) {
    bounded w = s->q[0], x = s->q[1], y = s->q[2], z = s->q[3], nil = b_of(0);
    const bounded half[4][3][3] = {
        {{nil, b_negative(z), y}, {z, nil, b_negative(x)}, {b_negative(y), x, nil}},
        {{nil, y, z}, {y, b_negative(b_twice(x)), b_negative(w)}, {z, w, b_negative(b_twice(x))}},
        {{b_negative(b_twice(y)), x, w}, {x, nil, z}, {b_negative(w), z, b_negative(b_twice(y))}},
        {{b_negative(b_twice(z)), b_negative(w), x}, {w, b_negative(b_twice(z)), y}, {x, y, nil}}};
    bounded d[4], along = nil;
    for (int j = 0; j < 4; j++) {
        d[j] = nil;
        for (int r = 0; r < 3; r++)
            for (int k = 0; k < 3; k++) d[j] = b_fma(b_twice(half[j][r][k]), G[r][k], d[j]);
        along = b_fma(d[j], s->q[j], along);
    }
    for (int j = 0; j < 4; j++) d_quat[j] = b_div(b_sub(d[j], b_mul(along, s->q[j])), s->norm);
}

/* The gradients of J's four entries, and from there and the mean on the screen to the mean's in the camera.
 */
static void point_backward(const sf_eye *eye, const shape *s, bounded du, bounded dv, bounded d_T[2][3],
                           bounded d_p[3]) {
    bounded R_cw[3][3];
    for (int k = 0; k < 9; k++) R_cw[k / 3][k % 3] = b_of((double)eye->R[k]);
    bounded d_J00 = b_dot3(d_T[0], R_cw[0]), d_J02 = b_dot3(d_T[0], R_cw[2]);
    bounded d_J11 = b_dot3(d_T[1], R_cw[1]), d_J12 = b_dot3(d_T[1], R_cw[2]);
    bounded inv_z = b_div(b_of(1), s->p[2]), zero = b_of(0);
    d_p[0] = b_mul(s->J00, b_sub(du, s->in_x ? b_mul(d_J02, inv_z) : zero));
    d_p[1] = b_mul(s->J11, b_sub(dv, s->in_y ? b_mul(d_J12, inv_z) : zero));
    bounded x = b_add(b_fma(du, s->p[0], d_J00), b_scale(s->in_x ? -2 : -1, b_mul(s->X, d_J02)));
    bounded y = b_add(b_fma(dv, s->p[1], d_J11), b_scale(s->in_y ? -2 : -1, b_mul(s->Y, d_J12)));
    d_p[2] = b_negative(b_mul(inv_z, b_fma(s->J00, x, b_mul(s->J11, y))));
}

/* M.6 */
static void camera_backward(const sf_eye *eye, const shape *s, const bounded *d_p, const bounded *d_color,
                            bounded d_T[2][3], bounded *camera) {
    bounded W[3][3], Q[3][3], R_cw[3][3], turn[3];
    for (int k = 0; k < 9; k++) R_cw[k / 3][k % 3] = b_of((double)eye->R[k]);
    for (int k = 0; k < 3; k++) {
        W[0][k] = b_mul(s->J00, d_T[0][k]);
        W[1][k] = b_mul(s->J11, d_T[1][k]);
        W[2][k] = b_fma(s->J02, d_T[0][k], b_mul(s->J12, d_T[1][k]));
    }
    for (int r = 0; r < 3; r++)
        for (int k = 0; k < 3; k++) Q[r][k] = b_dot3(W[r], R_cw[k]);
    b_cross3(s->p, d_p, turn);
    for (int k = 0; k < 3; k++) {
        int i = (k + 1) % 3, j = (k + 2) % 3;
        camera[k] = b_add(d_p[k], b_dot3(d_color, R_cw[k]));
        camera[3 + k] = b_add(turn[k], b_sub(Q[j][i], Q[i][j]));
    }
    for (int k = 0; k < 2; k++) camera[6 + k] = b_fma(s->p[k], d_p[k], Q[k][k]);
}

/* As it is stored; a gradient that does not fit into float32 is left out as a whole. Whether one is that
 * fits, but has an intermediate result in float32 that does not, or a sum that is not finite of a channel at
 * 0, is open. */
static void store(const double *sums, test_ref_raw_gradient *g) {
    double size = fabs(g->screen.v), inputs = 0;
    for (int field = 0; field < SF_FIELD_COUNT; field++)
        for (int k = 0; k < components[field]; k++) size += fabs(g->field[field][k].v);
    for (int k = 0; k < 9; k++) inputs += fabs(sums[k]);
    g->not_finite = !(size <= (double)FLT_MAX);
    g->open |= isfinite(size) && !(size + inputs <= 1e-4 * (double)FLT_MAX);
    static const test_ref_raw_gradient zero;
    if (g->not_finite) {
        int open = g->open;
        *g = zero;
        g->open = open, g->not_finite = 1;
        return;
    }
    for (int field = 0; field < SF_FIELD_COUNT; field++)
        for (int k = 0; k < components[field]; k++) g->field[field][k] = b_stored(g->field[field][k]);
    g->screen = b_stored(g->screen);
}

void test_ref_unsee(const sf_project_args *a, size_t i, const double sums[9], test_ref_raw_gradient *g) {
    const sf_eye *eye = a->eye;
    shape s;
    test_ref_seen seen;
    bounded d_color[3], d_A[2][3], d_T[2][3], d_R[3][3], d_p[3], m[2], axis[3], zero = b_of(0);
    *g = (test_ref_raw_gradient){.open = 0};
    test_ref_see(a, i, &seen);
    to_camera(a, i, &s);
    shape_of(a, i, &s);
    g->open = s.at_clamp || s.at_floor;

    color_backward(a, i, &s, sums, g, d_color);
    g->field[SF_FIELD_logit_opacity][0] = b_scale(sums[3], b_sub(b_of(1), s.o));

    bounded l00 = seen.splat[2], l01 = seen.splat[3], l11 = seen.splat[4];
    bounded du = b_scale(UNDO, b_mul(l00, b_of(sums[4])));
    bounded dv = b_scale(UNDO, b_fma(l01, b_of(sums[4]), b_mul(l11, b_of(sums[5]))));
    bounded nx = b_scale(0.5 * eye->width, du), ny = b_scale(0.5 * eye->height, dv);
    g->screen = b_sqrt(b_fma(nx, nx, b_square(ny)));

    covariance_backward(a->eye, &s, seen.splat, sums, d_A);
    for (int k = 0; k < 3; k++) d_T[0][k] = d_T[1][k] = zero;
    for (int k = 0; k < 3; k++) {
        column(&s, k, axis);
        g->field[SF_FIELD_log_scale][k] = b_fma(d_A[0][k], s.A[0][k], b_mul(d_A[1][k], s.A[1][k]));
        m[0] = b_mul(d_A[0][k], s.s[k]), m[1] = b_mul(d_A[1][k], s.s[k]);
        for (int r = 0; r < 3; r++) {
            d_R[r][k] = b_fma(s.T[0][r], m[0], b_mul(s.T[1][r], m[1]));
            d_T[0][r] = b_fma(m[0], axis[r], d_T[0][r]);
            d_T[1][r] = b_fma(m[1], axis[r], d_T[1][r]);
        }
    }
    quaternion_backward(&s, d_R, g->field[SF_FIELD_quat]);
    point_backward(eye, &s, du, dv, d_T, d_p);
    for (int k = 0; k < 3; k++) {
        bounded column_of_R[3];
        for (int r = 0; r < 3; r++) column_of_R[r] = b_of((double)eye->R[3 * r + k]);
        g->field[SF_FIELD_mean][k] = b_add(b_dot3(column_of_R, d_p), d_color[k]);
    }
    camera_backward(eye, &s, d_p, d_color, d_T, g->camera);
    store(sums, g);
}
