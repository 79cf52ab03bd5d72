/* project.c - from raw parameters to Gaussians on the screen, and the gradient of it, in vectors of
 * Gaussians.
 *
 * Geometry is in float64 between the float32 arrays, as in arch/scalar/project.c and for its reason; colours
 * are in float32. A block of SF_LANES Gaussians is taken at a time, in parts of VD lanes or VW lanes; what
 * passes from one to the other does so in arrays of SF_LANES.
 */
#include "kernels.h"

#include <float.h>

#include "sh.h"
#include "vec.h"

typedef float lanes[SF_LANES] __attribute__((aligned(64)));

/* What projection works out and its gradient needs again: VD Gaussians. */
typedef struct projection {
    vd p[3];              /* camera frame */
    vd inv_z, X, Y;       /* X, Y: x/z and y/z, clamped */
    vdm in_x, in_y;       /* inside the clamp */
    vd s[3];              /* standard deviations */
    vd q[4], inv_norm;    /* normalised quaternion w x y z, and 1 over its norm */
    vd R[9];              /* of the quaternion */
    vd T0[3], T1[3];      /* J R_cw */
    vd A0[3], A1[3];      /* J R_cw R diag(s) */
    vd n[3];              /* A0 x A1 */
    vd nn;                /* |n|^2 */
    vd a, b, c, det;      /* 2D covariance with the low-pass */
    vd opacity;           /* raw */
    vd log2_compensation; /* of the opacity, M.3; 0 without */
    vdm finite;
} projection;

VEC vd vd_neg(vd a) { return vd_sub(vd_set(0), a); }
VEC vd vd_times(double a, vd b) { return vd_mul(vd_set(a), b); }
VEC vdm within(vd a, double limit) { return vdm_and(vd_le(a, vd_set(limit)), vd_le(vd_set(-limit), a)); }
VEC vd magnitude(vd a) { return vd_max(a, vd_neg(a)); }

VEC vd dot3(const vd *a, const vd *b) { return vd_fma(a[0], b[0], vd_fma(a[1], b[1], vd_mul(a[2], b[2]))); }
/* With three floats of the camera's, `apart` apart. */
VEC vd dot3f(const vd *a, const float *b, int apart) {
    return vd_fma(a[0], vd_set((double)b[0]),
                  vd_fma(a[1], vd_set((double)b[apart]), vd_mul(a[2], vd_set((double)b[2 * apart]))));
}

VEC void cross3(const vd *a, const vd *b, vd *out) {
    out[0] = vd_fnma(a[2], b[1], vd_mul(a[1], b[2]));
    out[1] = vd_fnma(a[0], b[2], vd_mul(a[2], b[0]));
    out[2] = vd_fnma(a[1], b[0], vd_mul(a[0], b[1]));
}

/* Component c of the Gaussians from `at` on; `at` lies within one block. */
VEC const float *component(const sf_params *params, int field, int components, int c, size_t at) {
    return params->field[field] + sf_at(at, components, c);
}

VEC void load(const sf_params *params, int field, int components, size_t at, vd *out) {
    for (int c = 0; c < components; c++) out[c] = vd_widen(component(params, field, components, c, at));
}

VEC void rotation(const vd *q, vd *R) {
    vd w = q[0], x = q[1], y = q[2], z = q[3], one = vd_set(1), two = vd_set(2);
    R[0] = vd_fnma(two, vd_fma(y, y, vd_mul(z, z)), one);
    R[1] = vd_mul(two, vd_fnma(z, w, vd_mul(x, y)));
    R[2] = vd_mul(two, vd_fma(x, z, vd_mul(y, w)));
    R[3] = vd_mul(two, vd_fma(x, y, vd_mul(z, w)));
    R[4] = vd_fnma(two, vd_fma(x, x, vd_mul(z, z)), one);
    R[5] = vd_mul(two, vd_fnma(x, w, vd_mul(y, z)));
    R[6] = vd_mul(two, vd_fnma(y, w, vd_mul(x, z)));
    R[7] = vd_mul(two, vd_fma(y, z, vd_mul(x, w)));
    R[8] = vd_fnma(two, vd_fma(x, x, vd_mul(y, y)), one);
}

/* The viewing directions and 1 over the distances. */
VEC vd look(const sf_project_args *a, size_t at, vd *direction) {
    load(&a->params, SF_FIELD_mean, 3, at, direction);
    for (int k = 0; k < 3; k++) direction[k] = vd_sub(direction[k], vd_set((double)a->eye->center[k]));
    vd inv_distance = vd_rsqrt(dot3(direction, direction));
    for (int k = 0; k < 3; k++) direction[k] = vd_mul(direction[k], inv_distance);
    return inv_distance;
}

VEC void project_shape(const sf_project_args *a, size_t at, projection *f) {
    /* 1. the mean in the camera's frame */
    const sf_eye *eye = a->eye;
    vd mean[3], one = vd_set(1);
    load(&a->params, SF_FIELD_mean, 3, at, mean);
    for (int k = 0; k < 3; k++) f->p[k] = vd_add(dot3f(mean, eye->R + 3 * k, 1), vd_set((double)eye->t[k]));
    f->inv_z = vd_reciprocal(f->p[2]);
    vd x = vd_mul(f->p[0], f->inv_z), y = vd_mul(f->p[1], f->inv_z);
    vd limit_x = vd_set((double)eye->clamp_x), limit_y = vd_set((double)eye->clamp_y);
    f->X = vd_max(vd_min(x, limit_x), vd_neg(limit_x));
    f->Y = vd_max(vd_min(y, limit_y), vd_neg(limit_y));
    f->in_x = within(x, (double)eye->clamp_x), f->in_y = within(y, (double)eye->clamp_y);

    /* 2. everything else but the colour */
    vd log_scale[3], q[4], logit;
    load(&a->params, SF_FIELD_log_scale, 3, at, log_scale);
    load(&a->params, SF_FIELD_quat, 4, at, q);
    load(&a->params, SF_FIELD_logit_opacity, 1, at, &logit);
    vd square = vd_fma(q[3], q[3], vd_fma(q[2], q[2], vd_fma(q[1], q[1], vd_mul(q[0], q[0]))));
    const double most = (double)FLT_MAX * (double)FLT_MAX;
    f->finite = vdm_and(vd_le(vd_set(SF_QUAT_MIN * SF_QUAT_MIN), square), vd_le(square, vd_set(most)));
    f->finite = vdm_and(f->finite, within(logit, (double)FLT_MAX));
    f->inv_norm = vd_rsqrt(square);
    for (int k = 0; k < 4; k++) f->q[k] = vd_mul(q[k], f->inv_norm);
    rotation(f->q, f->R);
    for (int k = 0; k < 3; k++) {
        f->finite = vdm_and(f->finite, within(log_scale[k], (double)FLT_MAX));
        f->s[k] = vd_exp2(vd_times(1.4426950408889634, log_scale[k]));
    }

    vd fz = vd_times((double)eye->fx, f->inv_z), gz = vd_times((double)eye->fy, f->inv_z);
    for (int k = 0; k < 3; k++) {
        vd forward = vd_set((double)eye->R[6 + k]);
        f->T0[k] = vd_mul(fz, vd_fnma(f->X, forward, vd_set((double)eye->R[k])));
        f->T1[k] = vd_mul(gz, vd_fnma(f->Y, forward, vd_set((double)eye->R[3 + k])));
    }
    for (int k = 0; k < 3; k++) {
        vd axis[3] = {f->R[k], f->R[3 + k], f->R[6 + k]};
        f->A0[k] = vd_mul(dot3(f->T0, axis), f->s[k]);
        f->A1[k] = vd_mul(dot3(f->T1, axis), f->s[k]);
    }
    /* Cauchy-Binet: the determinant as a sum of squares, which cannot cancel. Nor does n by components: with
     * T0 x T1 = J00 J11 R_cw^T (X, Y, 1), n_k is that times the product of the two other scales, along axis
     * k. */
    vd normal[3], fg = vd_mul(fz, gz);
    for (int k = 0; k < 3; k++)
        normal[k] =
            vd_mul(fg, vd_fma(f->X, vd_set((double)eye->R[k]),
                              vd_fma(f->Y, vd_set((double)eye->R[3 + k]), vd_set((double)eye->R[6 + k]))));
    for (int k = 0; k < 3; k++) {
        vd axis[3] = {f->R[k], f->R[3 + k], f->R[6 + k]};
        f->n[k] = vd_mul(vd_mul(f->s[(k + 1) % 3], f->s[(k + 2) % 3]), dot3(axis, normal));
    }
    f->nn = dot3(f->n, f->n);
    vd aa = dot3(f->A0, f->A0), cc = dot3(f->A1, f->A1), low = vd_set(eye->low_pass);
    f->a = vd_add(aa, low), f->b = dot3(f->A0, f->A1), f->c = vd_add(cc, low);
    f->det = vd_add(f->nn, vd_fma(low, vd_add(aa, cc), vd_mul(low, low)));
    f->finite = vdm_and(f->finite, vd_le(f->det, vd_set((double)FLT_MAX)));

    f->opacity = vd_reciprocal(vd_add(one, vd_exp2(vd_times(-1.4426950408889634, logit))));
    f->log2_compensation = vd_set(0);
    if (a->antialiased)
        f->log2_compensation =
            vd_times(0.5, vd_log2(vd_max(vd_set(2.5e-5), vd_mul(f->nn, vd_reciprocal(f->det)))));
}

/* Fields of sf_splat, in order. */
enum {
    U,
    V,
    L00,
    L01,
    M,
    POWER,
    RED,
    GREEN,
    BLUE,
    DEPTH,
    SLOPE,
    REACH,
    SQUEEZE,
    LEAN,
    HALF_WIDTH,
    HALF_HEIGHT,
    FIELDS
};
_Static_assert(sizeof(sf_splat) == FIELDS * sizeof(float), "a splat is sixteen floats");

/* A block on its way to its splats. */
typedef struct block {
    lanes field[FIELDS], direction[3], first_row, rows;
    unsigned not_finite, out_of_view; /* a bit a lane; the first that is found holds */
} block;

/* Rows of tiles within the box, a hundredth of a pixel beyond it included: a rounding error must not lose a
 * pixel. Returns which have any. */
VEC vdm tile_rows(const sf_eye *eye, vd u, vd v, vd half_width, vd half_height, float *first_row,
                  float *rows) {
    vd pad = vd_set(0.01), half = vd_set(0.5), zero = vd_set(0), one = vd_set(1);
    vd bottom_center = vd_set((double)eye->height - 0.5), right_center = vd_set((double)eye->width - 0.5);
    vd top = vd_sub(v, vd_add(half_height, pad)), bottom = vd_add(v, vd_add(half_height, pad));
    vd left = vd_sub(u, vd_add(half_width, pad)), right = vd_add(u, vd_add(half_width, pad));
    vdm in = vdm_and(vdm_and(vd_le(half, right), vd_le(left, right_center)),
                     vdm_and(vd_le(half, bottom), vd_le(top, bottom_center)));
    vd inv = vd_set(1.0 / SF_TILE);
    vd y0 = vd_mul(vd_max(vd_sub(top, vd_set(SF_TILE - 0.5)), zero), inv);
    y0 = vd_neg(vd_floor(vd_neg(y0)));
    vd y1 = vd_floor(vd_mul(vd_min(vd_sub(bottom, half), vd_set((double)eye->height - 1)), inv));
    in = vdm_and(in, vd_le(y0, y1));
    vd_narrow(first_row, vd_keep(in, y0));
    vd_narrow(rows, vd_keep(in, vd_add(vd_sub(y1, y0), one)));
    return in;
}

/* Lanes part .. part+VD-1 of a block, all but the colour. */
VEC void project_part(const sf_project_args *a, size_t first, int part, block *b) {
    const sf_eye *eye = a->eye;
    projection f;
    vd direction[3];
    project_shape(a, first + (size_t)part, &f);
    vd inv_distance = look(a, first + (size_t)part, direction);

    /* 3. whitening factors and extent: o g >= 1/255 exactly where t^2 + s^2 <= r2k (M.1) */
    vd power = vd_add(vd_log2(f.opacity), f.log2_compensation), r2k = vd_add(power, vd_set(SF_LOG2_255));
    vd r2 = vd_max(vd_times(SF_WHITEN_UNDO, r2k), vd_set(1e-30)), r = vd_mul(r2, vd_rsqrt(r2));
    vd inv_root_a = vd_rsqrt(f.a), inv_root_c = vd_rsqrt(f.c), inv_root_det = vd_rsqrt(f.det);
    vd root_a = vd_mul(f.a, inv_root_a), root_c = vd_mul(f.c, inv_root_c);
    vd inv_c = vd_mul(inv_root_c, inv_root_c);
    vd u = vd_fma(vd_times((double)eye->fx, f.p[0]), f.inv_z, vd_set((double)eye->cx));
    vd v = vd_fma(vd_times((double)eye->fy, f.p[1]), f.inv_z, vd_set((double)eye->cy));
    vd half_width = vd_mul(r, root_a), half_height = vd_mul(r, root_c);
    vd reach = vd_mul(r2, vd_mul(f.det, inv_c)), squeeze = vd_mul(vd_mul(f.det, inv_c), inv_c);
    vd_narrow(b->field[U] + part, u);
    vd_narrow(b->field[V] + part, v);
    vd_narrow(b->field[L00] + part, vd_mul(vd_times(SF_WHITEN, root_c), inv_root_det));
    vd_narrow(b->field[L01] + part, vd_mul(vd_mul(vd_times(-SF_WHITEN, f.b), inv_root_c), inv_root_det));
    vd_narrow(b->field[M] + part, vd_times(SF_WHITEN, inv_root_c));
    vd_narrow(b->field[POWER] + part, power);
    vd_narrow(b->field[DEPTH] + part, f.p[2]);
    vd_narrow(b->field[SLOPE] + part, vd_mul(f.b, inv_c));
    vd_narrow(b->field[REACH] + part, reach);
    vd_narrow(b->field[SQUEEZE] + part, squeeze);
    vd_narrow(b->field[LEAN] + part, vd_mul(vd_mul(f.b, r), inv_root_a));
    vd_narrow(b->field[HALF_WIDTH] + part, half_width);
    vd_narrow(b->field[HALF_HEIGHT] + part, half_height);
    for (int k = 0; k < 3; k++) vd_narrow(b->direction[k] + part, direction[k]);
    vdm in = tile_rows(eye, u, v, half_width, half_height, b->first_row + part, b->rows + part);

    /* the first reason holds */
    unsigned all = (1u << VD) - 1;
    vdm finite = vdm_and(vdm_and(within(f.p[0], (double)FLT_MAX), within(f.p[1], (double)FLT_MAX)),
                         within(f.p[2], (double)FLT_MAX));
    unsigned not_finite = ~vdm_bits(finite);
    unsigned out = ~vdm_bits(vd_lt(vd_set((double)eye->near_plane), f.p[2])) & ~not_finite;
    vdm shaped = vdm_and(f.finite, vd_le(vd_set(1 / (double)FLT_MAX), inv_distance));
    not_finite |= ~vdm_bits(shaped) & ~out;
    out |= ~vdm_bits(vd_lt(vd_set(0), r2k)) & ~not_finite;
    vdm placed = vdm_and(vdm_and(within(u, (double)FLT_MAX), within(v, (double)FLT_MAX)),
                         vdm_and(within(reach, (double)FLT_MAX), within(squeeze, (double)FLT_MAX)));
    not_finite |= ~vdm_bits(placed) & ~out;
    out |= ~vdm_bits(in) & ~not_finite;
    b->not_finite |= (not_finite & all) << part;
    b->out_of_view |= (out & all) << part;
}

/* Coefficient k of a channel: the lanes from `part` on. */
VEC vf coefficient(const sf_params *params, size_t first, int part, int k, int ch) {
    int band = k == 0 ? 0 : k < 4 ? 1 : k < 9 ? 2 : 3;
    int at = 3 * (k - band * band) + ch;
    return vf_load(component(params, SF_FIELD_sh0 + band, 3 * (2 * band + 1), at, first + (size_t)part));
}

/* 4. colour */
VEC void project_colour_of(const sf_project_args *a, size_t first, int degree, block *b) {
    for (int part = 0; part < SF_LANES; part += VW) {
        vf direction[3], Y[16], rgb[3], most = vf_set(FLT_MAX);
        for (int k = 0; k < 3; k++) direction[k] = vf_load(b->direction[k] + part);
        sh_basis(degree, direction, Y);
        unsigned finite = ~0u;
        for (int ch = 0; ch < 3; ch++) {
            rgb[ch] = vf_set(0.5f);
            for (int k = 0; k < (degree + 1) * (degree + 1); k++)
                rgb[ch] = vf_fma(Y[k], coefficient(&a->params, first, part, k, ch), rgb[ch]);
            finite &= vm_bits(vm_and(vf_le(rgb[ch], most), vf_ge(rgb[ch], vf_neg(most))));
            vf_store(b->field[RED + ch] + part, vf_max(rgb[ch], vf_set(0)));
        }
        b->not_finite |= (~finite << part) & (((1u << VW) - 1) << part) & ~b->out_of_view;
    }
}

/* Compiled for each degree, as the geometry need not be. */
VEC void project_colour(const sf_project_args *a, size_t first, block *b) {
    switch (a->sh_degree) {
    case 0:
        project_colour_of(a, first, 0, b);
        break;
    case 1:
        project_colour_of(a, first, 1, b);
        break;
    case 2:
        project_colour_of(a, first, 2, b);
        break;
    default:
        project_colour_of(a, first, 3, b);
    }
}

void SF_AT_LEVEL(sf_project)(const sf_project_args *a, size_t first, size_t end) {
    for (size_t blk = first; blk < end; blk++) {
        size_t at = blk * SF_LANES;
        block b;
        b.not_finite = b.out_of_view = 0;
        for (int part = 0; part < SF_LANES; part += VD) project_part(a, at, part, &b);
        if ((b.not_finite | b.out_of_view) != 0xffff) {
            project_colour(a, at, &b);
            for (int part = 0; part < FIELDS; part += VW) {
                const float *rows[VW];
                vf column[SF_LANES];
                for (int i = 0; i < VW; i++) rows[i] = b.field[part + i];
                vf_transpose(rows, column);
                for (int i = 0; i < SF_LANES; i++)
                    vf_store((float *)&a->splats[at + (size_t)i] + part, column[i]);
            }
        }
        for (int i = 0; i < SF_LANES; i++) {
            int lost = b.not_finite >> i & 1, out = b.out_of_view >> i & 1;
            a->state[at + (size_t)i] = (uint8_t)(lost ? SF_NOT_FINITE : out ? SF_OUT_OF_VIEW : SF_SEEN);
            a->first_row[at + (size_t)i] = (uint16_t)b.first_row[i];
            a->rows[at + (size_t)i] = (uint16_t)(lost | out ? 0 : b.rows[i]);
        }
    }
}

/* ---- the gradient
 * ------------------------------------------------------------------------------------------ */

enum { SUMS = 9 };

/* What comes from the screen for a block; 0 for what is not seen. */
typedef struct arrival {
    _Alignas(64) double sums[SUMS][SF_LANES];
    lanes used[3];     /* dL/drgb where the colour is not clamped */
    lanes l00, l01, m; /* as they were blended with */
    lanes direction[3], d_direction[3];
    unsigned seen;
} arrival;

/* Adds up the slots of each Gaussian. */
VEC void arrive(const sf_project_bwd_args *b, size_t first, arrival *r) {
    r->seen = 0;
    for (int i = 0; i < SF_LANES; i++) {
        size_t at = first + (size_t)i;
        _Alignas(64) double row[8] = {0};
        double last = 0;
        r->l00[i] = r->l01[i] = r->m[i] = r->used[0][i] = r->used[1][i] = r->used[2][i] = 0;
        if (b->forward.state[at] == SF_SEEN) {
            vd1 sum[8 / VD1];
            for (int k = 0; k < 8 / VD1; k++) sum[k] = vd1_set(0);
            for (uint32_t slot = b->slot[at]; slot < b->slot[at + 1]; slot++) {
                const float *sums = b->sums + (size_t)slot * SF_SUMS;
                for (int k = 0; k < 8 / VD1; k++) sum[k] = vd1_add(sum[k], vd1_widen(sums + k * VD1));
                last += (double)sums[8];
            }
            for (int k = 0; k < 8 / VD1; k++) vd1_store(row + k * VD1, sum[k]);
            const sf_splat *s = &b->forward.splats[at];
            r->l00[i] = s->l00, r->l01[i] = s->l01, r->m[i] = s->m;
            for (int ch = 0; ch < 3; ch++) r->used[ch][i] = s->rgb[ch] > 0 ? (float)row[ch] : 0.0f;
            r->seen |= 1u << i;
        }
        for (int k = 0; k < 8; k++) r->sums[k][i] = row[k];
        r->sums[8][i] = last;
    }
}

VEC float *gradient(const sf_params *grads, int field, int components, int c, size_t at) {
    return grads->field[field] + sf_at(at, components, c);
}

/* Through the colour (M.4): dL/dSH, and dL/d of the direction. `to` counts from the gradients' first block.
 */
VEC void colour_bwd_of(const sf_project_bwd_args *b, size_t first, size_t to, int degree, arrival *r) {
    for (int part = 0; part < SF_LANES; part += VW) {
        vf direction[3], Y[16], h[16], used[3], out[3];
        for (int k = 0; k < 3; k++) {
            direction[k] = vf_load(r->direction[k] + part);
            used[k] = vf_load(r->used[k] + part);
        }
        sh_basis(degree, direction, Y);
        for (int k = 0; k < (degree + 1) * (degree + 1); k++) {
            int band = k == 0 ? 0 : k < 4 ? 1 : k < 9 ? 2 : 3, in_band = 3 * (k - band * band);
            h[k] = vf_set(0);
            for (int ch = 0; ch < 3; ch++) {
                h[k] = vf_fma(coefficient(&b->forward.params, first, part, k, ch), used[ch], h[k]);
                vf_store(gradient(&b->grads, SF_FIELD_sh0 + band, 3 * (2 * band + 1), in_band + ch,
                                  to + (size_t)part),
                         vf_mul(Y[k], used[ch]));
            }
        }
        sh_basis_bwd(degree, direction, h, out);
        for (int k = 0; k < 3; k++) vf_store(r->d_direction[k] + part, out[k]);
    }
}

/* dL/dA from the whitened second moments: G_A = L^T S (L A), and through the opacity compensation. */
VEC void covariance_bwd(const sf_project_args *a, const projection *f, const vd *sums, const vd *l, vd *d_A0,
                        vd *d_A1) {
    vd turn0[3], turn1[3]; /* A1 x n, n x A0 */
    cross3(f->A1, f->n, turn0);
    cross3(f->n, f->A0, turn1);
    vd tt = sums[6], ts = sums[7], ss = sums[8], undo2 = vd_set(SF_WHITEN_UNDO * SF_WHITEN_UNDO);
    vd lead = vd_times(SF_WHITEN, vd_rsqrt(vd_mul(f->c, f->det))), low = vd_set(a->eye->low_pass);
    for (int k = 0; k < 3; k++) {
        /* l00 A0 + l01 A1 = (c A0 - b A1) / sqrt(c det), and c A0 - b A1 = eps A0 + A1 x n without
         * cancellation */
        vd B0 = vd_mul(lead, vd_fma(low, f->A0[k], turn0[k])), B1 = vd_mul(l[2], f->A1[k]);
        vd H0 = vd_mul(undo2, vd_fma(tt, B0, vd_mul(ts, B1)));
        vd H1 = vd_mul(undo2, vd_fma(ts, B0, vd_mul(ss, B1)));
        d_A0[k] = vd_mul(l[0], H0);
        d_A1[k] = vd_fma(l[1], H0, vd_mul(l[2], H1));
    }
    if (!a->antialiased) return;
    vd inv_det = vd_reciprocal(f->det);
    vdm above =
        vd_lt(vd_set(2.5e-5), vd_mul(f->nn, inv_det)); /* where the compensation is not at its floor */
    vd p = vd_keep(above, sums[3]), d_nn = vd_keep(above, vd_sub(vd_reciprocal(f->nn), inv_det));
    for (int k = 0; k < 3; k++) { /* ln k = (ln |n|^2 - ln det) / 2 */
        vd low_det = vd_mul(low, inv_det);
        d_A0[k] = vd_fma(p, vd_fnma(low_det, f->A0[k], vd_mul(d_nn, turn0[k])), d_A0[k]);
        d_A1[k] = vd_fma(p, vd_fnma(low_det, f->A1[k], vd_mul(d_nn, turn1[k])), d_A1[k]);
    }
}

/* dL/dR to the quaternion as stored, through its normalisation (equation 3, with M.3's last term). */
VEC void quaternion_bwd(const projection *f, const vd *G, vd *d_quat) {
    vd w = f->q[0], x = f->q[1], y = f->q[2], z = f->q[3], d[4];
    vd a01 = vd_sub(G[3], G[1]), a02 = vd_sub(G[2], G[6]), a12 = vd_sub(G[7], G[5]);
    vd s01 = vd_add(G[1], G[3]), s02 = vd_add(G[2], G[6]), s12 = vd_add(G[5], G[7]);
    d[0] = vd_fma(z, a01, vd_fma(y, a02, vd_mul(x, a12)));
    d[1] = vd_fma(y, s01, vd_fma(z, s02, vd_mul(w, a12)));
    d[2] = vd_fma(x, s01, vd_fma(z, s12, vd_mul(w, a02)));
    d[3] = vd_fma(x, s02, vd_fma(y, s12, vd_mul(w, a01)));
    d[1] = vd_fnma(vd_add(x, x), vd_add(G[4], G[8]), d[1]);
    d[2] = vd_fnma(vd_add(y, y), vd_add(G[0], G[8]), d[2]);
    d[3] = vd_fnma(vd_add(z, z), vd_add(G[0], G[4]), d[3]);
    vd along = vd_fma(d[0], w, vd_fma(d[1], x, vd_fma(d[2], y, vd_mul(d[3], z))));
    vd scale = vd_add(f->inv_norm, f->inv_norm);
    for (int k = 0; k < 4; k++) d_quat[k] = vd_mul(vd_fnma(along, f->q[k], d[k]), scale);
}

/* Left twist and focal lengths (M.6), from d_p = dL/dp_c, the colour's part of dL/dmean, and the gradients of
 * the rows of T. */
VEC void camera_bwd(const sf_eye *eye, const projection *f, const vd *d_p, const vd *d_color, const vd *d_T0,
                    const vd *d_T1, vd *camera) {
    vd J00 = vd_times((double)eye->fx, f->inv_z), J11 = vd_times((double)eye->fy, f->inv_z);
    vd J02 = vd_neg(vd_mul(J00, f->X)), J12 = vd_neg(vd_mul(J11, f->Y)), W[3][3], Q[3][3], turn[3];
    for (int k = 0; k < 3; k++) {
        W[0][k] = vd_mul(J00, d_T0[k]);
        W[1][k] = vd_mul(J11, d_T1[k]);
        W[2][k] = vd_fma(J02, d_T0[k], vd_mul(J12, d_T1[k]));
    }
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) Q[r][c] = dot3f(W[r], eye->R + 3 * c, 1);
    cross3(f->p, d_p, turn);
    for (int k = 0; k < 3; k++) camera[k] = vd_add(d_p[k], dot3f(d_color, eye->R + 3 * k, 1));
    camera[3] = vd_add(turn[0], vd_sub(Q[2][1], Q[1][2]));
    camera[4] = vd_add(turn[1], vd_sub(Q[0][2], Q[2][0]));
    camera[5] = vd_add(turn[2], vd_sub(Q[1][0], Q[0][1]));
    camera[6] = vd_fma(f->p[0], d_p[0], Q[0][0]);
    camera[7] = vd_fma(f->p[1], d_p[1], Q[1][1]);
}

/* Stores a gradient's component, 0 where it is not to be used. */
VEC void put(const sf_project_bwd_args *b, int field, int components, int c, size_t to, vdm use, vd value) {
    vd_narrow(gradient(&b->grads, field, components, c, to), vd_keep(use, value));
}

/* Lanes part .. part+VD-1 of a block. Returns which have a gradient that is not finite. */
VEC unsigned geometry_bwd(const sf_project_bwd_args *b, size_t first, size_t to, int part, const arrival *r) {
    const sf_project_args *a = &b->forward;
    const sf_eye *eye = a->eye;
    projection f;
    size_t at = first + (size_t)part;
    vd sums[SUMS], l[3], direction[3], d_direction[3], d_color[3], inv_distance;
    project_shape(a, at, &f);
    inv_distance = look(a, at, direction);
    for (int k = 0; k < SUMS; k++) sums[k] = vd_load(r->sums[k] + part);
    l[0] = vd_widen(r->l00 + part), l[1] = vd_widen(r->l01 + part), l[2] = vd_widen(r->m + part);

    /* 1. colour and opacity */
    for (int k = 0; k < 3; k++) d_direction[k] = vd_widen(r->d_direction[k] + part);
    vd along = dot3(direction, d_direction);
    for (int k = 0; k < 3; k++)
        d_color[k] = vd_mul(vd_fnma(direction[k], along, d_direction[k]), inv_distance);
    vd d_logit = vd_mul(sums[3], vd_sub(vd_set(1), f.opacity));

    /* 2. mean on the screen: dL/du = L^T (sum p t, sum p s) */
    vd undo = vd_set(SF_WHITEN_UNDO), du = vd_mul(undo, vd_mul(l[0], sums[4]));
    vd dv = vd_mul(undo, vd_fma(l[1], sums[4], vd_mul(l[2], sums[5])));
    vd nx = vd_times(0.5 * (double)eye->width, du), ny = vd_times(0.5 * (double)eye->height, dv);
    vd square = vd_fma(nx, nx, vd_mul(ny, ny));
    vd screen = vd_mul(square, vd_rsqrt(vd_max(square, vd_set(1e-300))));

    /* 3. covariance: to A, then to scales, rotation and T */
    vd d_A0[3], d_A1[3], d_T0[3], d_T1[3], d_R[9], d_scale[3], d_quat[4];
    covariance_bwd(a, &f, sums, l, d_A0, d_A1);
    for (int k = 0; k < 3; k++) d_T0[k] = d_T1[k] = vd_set(0);
    for (int k = 0; k < 3; k++) { /* column k of M = R diag(s) */
        d_scale[k] = vd_fma(d_A0[k], f.A0[k], vd_mul(d_A1[k], f.A1[k]));
        vd s0 = vd_mul(d_A0[k], f.s[k]), s1 = vd_mul(d_A1[k], f.s[k]);
        for (int row = 0; row < 3; row++) {
            d_R[3 * row + k] = vd_fma(f.T0[row], s0, vd_mul(f.T1[row], s1));
            d_T0[row] = vd_fma(s0, f.R[3 * row + k], d_T0[row]);
            d_T1[row] = vd_fma(s1, f.R[3 * row + k], d_T1[row]);
        }
    }
    quaternion_bwd(&f, d_R, d_quat);

    /* 4. T = J R_cw to J, and J to the mean in the camera's frame, with the clamp's exact derivative */
    vd d_J00 = dot3f(d_T0, eye->R, 1), d_J02 = dot3f(d_T0, eye->R + 6, 1);
    vd d_J11 = dot3f(d_T1, eye->R + 3, 1), d_J12 = dot3f(d_T1, eye->R + 6, 1);
    vd fz = vd_times((double)eye->fx, f.inv_z), gz = vd_times((double)eye->fy, f.inv_z), d_p[3],
       one = vd_set(1);
    vd twice_x = vd_add(one, vd_keep(f.in_x, one)), twice_y = vd_add(one, vd_keep(f.in_y, one));
    d_p[0] = vd_mul(fz, vd_sub(du, vd_keep(f.in_x, vd_mul(d_J02, f.inv_z))));
    d_p[1] = vd_mul(gz, vd_sub(dv, vd_keep(f.in_y, vd_mul(d_J12, f.inv_z))));
    vd through_x = vd_add(vd_fma(du, f.p[0], d_J00), vd_neg(vd_mul(vd_mul(twice_x, f.X), d_J02)));
    vd through_y = vd_add(vd_fma(dv, f.p[1], d_J11), vd_neg(vd_mul(vd_mul(twice_y, f.Y), d_J12)));
    d_p[2] = vd_neg(vd_mul(f.inv_z, vd_fma(fz, through_x, vd_mul(gz, through_y))));

    /* 5. to the world */
    vd d_mean[3];
    for (int k = 0; k < 3; k++) d_mean[k] = vd_add(dot3f(d_p, eye->R + k, 3), d_color[k]);

    /* one value that is not finite makes the sum so; |Y| < 8 */
    vd sum = vd_add(magnitude(d_logit), screen);
    for (int k = 0; k < 3; k++)
        sum = vd_add(sum, vd_add(vd_add(magnitude(d_mean[k]), magnitude(d_scale[k])),
                                 vd_times(8, magnitude(sums[k]))));
    for (int k = 0; k < 4; k++) sum = vd_add(sum, magnitude(d_quat[k]));
    unsigned seen = r->seen >> part & ((1u << VD) - 1),
             finite = vdm_bits(vd_le(sum, vd_set((double)FLT_MAX)));
    vdm use = vdm_of(seen & finite);
    to += (size_t)part;
    for (int k = 0; k < 3; k++) {
        put(b, SF_FIELD_mean, 3, k, to, use, d_mean[k]);
        put(b, SF_FIELD_log_scale, 3, k, to, use, d_scale[k]);
    }
    for (int k = 0; k < 4; k++) put(b, SF_FIELD_quat, 4, k, to, use, d_quat[k]);
    put(b, SF_FIELD_logit_opacity, 1, 0, to, use, d_logit);
    vd_narrow(b->screen + at, vd_keep(use, screen));
    if (b->camera) {
        vd camera[SF_CAMERA_SUMS];
        camera_bwd(eye, &f, d_p, d_color, d_T0, d_T1, camera);
        for (int k = 0; k < SF_CAMERA_SUMS;
             k++) { /* lane by lane: who is not seen must not change the order of the sum */
            _Alignas(64) double lane[VD];
            vd_store(lane, vd_keep(use, camera[k]));
            for (int i = 0; i < VD; i++) b->camera[k] += lane[i];
        }
    }
    return (seen & ~finite) << part;
}

/* No gradient for the colour of the lanes of `lost`. */
static void clear_colour(const sf_project_bwd_args *b, size_t to, int degree, unsigned lost) {
    for (int band = 0; band <= degree; band++)
        for (int c = 0; c < 3 * (2 * band + 1); c++)
            for (int i = 0; i < SF_LANES; i++)
                if (lost >> i & 1) gradient(&b->grads, SF_FIELD_sh0 + band, 3 * (2 * band + 1), c, to)[i] = 0;
}

static void clear_bands(const sf_project_bwd_args *b, size_t to, int band) {
    for (; band < 4; band++)
        if (b->grads.field[SF_FIELD_sh0 + band])
            memset(gradient(&b->grads, SF_FIELD_sh0 + band, 3 * (2 * band + 1), 0, to), 0,
                   (size_t)(3 * (2 * band + 1)) * sizeof(lanes));
}

/* Of a block that is not seen. */
static void clear_all(const sf_project_bwd_args *b, size_t at, size_t to) {
#define CLEAR(name, components)                                                                              \
    if (b->grads.field[SF_FIELD_##name])                                                                     \
        memset(gradient(&b->grads, SF_FIELD_##name, components, 0, to), 0, (components) * sizeof(lanes));
    SF_FIELDS(CLEAR)
#undef CLEAR
    memset(b->screen + at, 0, sizeof(lanes));
}

VEC void colour_bwd(const sf_project_bwd_args *b, size_t first, size_t to, arrival *r) {
    switch (b->forward.sh_degree) {
    case 0:
        colour_bwd_of(b, first, to, 0, r);
        break;
    case 1:
        colour_bwd_of(b, first, to, 1, r);
        break;
    case 2:
        colour_bwd_of(b, first, to, 2, r);
        break;
    default:
        colour_bwd_of(b, first, to, 3, r);
    }
}

void SF_AT_LEVEL(sf_project_bwd)(const sf_project_bwd_args *b, size_t first, size_t end) {
    int degree = b->forward.sh_degree;
    for (size_t blk = first; blk < end; blk++) {
        size_t at = blk * SF_LANES, to = (blk - first) * SF_LANES;
        arrival r;
        arrive(b, at, &r);
        if (!r.seen) {
            clear_all(b, at, to);
            continue;
        }
        for (int part = 0; part < SF_LANES; part += VD) {
            vd direction[3];
            vdm seen = vdm_of(r.seen >> part & ((1u << VD) - 1));
            look(&b->forward, at + (size_t)part, direction);
            for (int k = 0; k < 3; k++) vd_narrow(r.direction[k] + part, vd_keep(seen, direction[k]));
        }
        colour_bwd(b, at, to, &r);
        unsigned lost = 0;
        for (int part = 0; part < SF_LANES; part += VD) lost |= geometry_bwd(b, at, to, part, &r);
        clear_bands(b, to, degree + 1);
        if (lost) {
            clear_colour(b, to, degree, lost);
            *b->not_finite += (unsigned)__builtin_popcount(lost);
        }
    }
}
