/* loss.c - L1 + SSIM over a band of rows, and the gradient of it, in vectors of pixels.
 *
 * The window is separable and symmetric: each row of the band and its halo is filtered along the row first,
 * from a copy with zeros on both sides, then the band's rows down the columns.
 */
#include "kernels.h"

#include "vec.h"

enum { MARGIN = SF_LANES };

/* The window's weights at distance 0 .. 5. */
static const float window[SF_SSIM_RADIUS + 1] = {0.2660117249f, 0.2130055377f, 0.1093606895f,
                                                 0.0360007721f, 0.0075987581f, 0.0010283801f};

static float *scratch_row(const sf_loss_args *a, int plane, int row) {
    int top = a->first_row - SF_SSIM_RADIUS;
    return a->scratch + ((size_t)plane * SF_LOSS_HALO_BAND + (size_t)(row - top)) * a->stride;
}

/* A row with MARGIN zeros before it and at least as many behind. */
static float *padded_row(const sf_loss_args *a) {
    return a->scratch + 5 * (size_t)SF_LOSS_HALO_BAND * a->stride + MARGIN;
}

static void clear_margins(const sf_loss_args *a) {
    float *row = padded_row(a);
    for (int i = 0; i < MARGIN; i++) row[-1 - i] = 0;
    for (size_t i = (size_t)a->width; i < a->stride + MARGIN; i++) row[i] = 0;
}

/* The padded row to a filtered one. */
VEC void filter_along(const float *row, float *out, int width) {
    for (int x = 0; x < width; x += VW) {
        vf sum = vf_set(window[0]) * vf_load(row + x);
        for (int k = 1; k <= SF_SSIM_RADIUS; k++)
            sum = vf_fma(vf_set(window[k]), vf_loadu(row + x - k) + vf_loadu(row + x + k), sum);
        vf_store(out + x, sum);
    }
}

/* u, or its product with v, of rows of the band and its halo, filtered along each row. */
VEC void filter_rows(const sf_loss_args *a, int plane, const float *u, const float *v) {
    float *row = padded_row(a);
    for (int y = a->first_row - SF_SSIM_RADIUS; y < a->end_row + SF_SSIM_RADIUS; y++) {
        float *out = scratch_row(a, plane, y);
        if (y < 0 || y >= a->height) {
            for (int x = 0; x < a->width; x += VW) vf_store(out + x, vf_set(0));
            continue;
        }
        const float *from = u + (size_t)y * a->stride, *by = v ? v + (size_t)y * a->stride : NULL;
        for (int x = 0; x < a->width; x += VW) {
            vf value = vf_load(from + x);
            if (by) value = value * vf_load(by + x);
            vf_store(row + x, value);
        }
        for (int x = a->width; x % VW; x++) row[x] = 0; /* what lies beyond the picture is no zero */
        filter_along(row, out, a->width);
    }
}

/* One vector of a row of the band, filtered down the column too. */
VEC vf filter_down(const sf_loss_args *a, int plane, int y, int x) {
    const float *at = scratch_row(a, plane, y) + x;
    vf sum = vf_set(window[0]) * vf_load(at);
    for (size_t k = 1; k <= SF_SSIM_RADIUS; k++)
        sum = vf_fma(vf_set(window[k]), vf_load(at - k * a->stride) + vf_load(at + k * a->stride), sum);
    return sum;
}

/* Lanes x .. x + VW - 1 that lie in the picture. */
VEC vm inside(int x, int width) {
    _Alignas(64) float lane[VW];
    for (int i = 0; i < VW; i++) lane[i] = (float)i;
    return vf_le(vf_load(lane), vf_set((float)(width - 1 - x)));
}

VEC vf magnitude(vf a) { return vf_max(a, vf_set(0) - a); }

/* One vector of the maps; returns S. */
VEC vf ssim_vector(const sf_loss_args *a, int y, int x) {
    vf two = vf_set(2), one = vf_set(1);
    vf mx = filter_down(a, 0, y, x), my = filter_down(a, 1, y, x), mxy = mx * my;
    vf sxx = vf_fnma(mx, mx, filter_down(a, 2, y, x)), syy = vf_fnma(my, my, filter_down(a, 3, y, x));
    vf sxy = filter_down(a, 4, y, x) - mxy;
    vf A1 = vf_fma(two, mxy, vf_set(SF_SSIM_C1)), A2 = vf_fma(two, sxy, vf_set(SF_SSIM_C2));
    vf B1 = vf_fma(mx, mx, vf_fma(my, my, vf_set(SF_SSIM_C1))), B2 = sxx + syy + vf_set(SF_SSIM_C2);
    vf inv = vf_div(one, B1 * B2), S = A1 * A2 * inv;
    vf d_sxx = vf_set(0) - S * inv * B1, d_sxy = two * A1 * inv;
    vf d_mx = two * inv * vf_fnma(mx * S, B2, my * A2);
    size_t at = (size_t)y * a->stride + (size_t)x;
    vf_store(a->map[0] + at, vf_fnma(two * mx, d_sxx, vf_fnma(my, d_sxy, d_mx)));
    vf_store(a->map[1] + at, d_sxx);
    vf_store(a->map[2] + at, d_sxy);
    return S;
}

void SF_AT_LEVEL(sf_loss)(const sf_loss_args *a) {
    if (a->ssim) {
        clear_margins(a);
        filter_rows(a, 0, a->x, NULL);
        filter_rows(a, 1, a->y, NULL);
        filter_rows(a, 2, a->x, a->x);
        filter_rows(a, 3, a->y, a->y);
        filter_rows(a, 4, a->x, a->y);
    }
    for (int y = a->first_row; y < a->end_row; y++) {
        const float *rx = a->x + (size_t)y * a->stride, *ry = a->y + (size_t)y * a->stride;
        vf l1 = vf_set(0), ssim = vf_set(0);
        for (int x = 0; x < a->width; x += VW) {
            vm in = inside(x, a->width);
            l1 = l1 + vf_keep(in, magnitude(vf_load(rx + x) - vf_load(ry + x)));
            if (a->ssim) ssim = ssim + vf_keep(in, ssim_vector(a, y, x));
        }
        *a->l1 += (double)vf_sum(l1);
        if (a->ssim) *a->ssim += (double)vf_sum(ssim);
    }
}

void SF_AT_LEVEL(sf_loss_bwd)(const sf_loss_args *a) {
    int with_ssim = a->ssim_scale != 0.0f;
    if (with_ssim) {
        clear_margins(a);
        for (int k = 0; k < 3; k++) filter_rows(a, k, a->map[k], NULL);
    }
    vf zero = vf_set(0), scale = vf_set(a->l1_scale), ssim_scale = vf_set(a->ssim_scale);
    for (int y = a->first_row; y < a->end_row; y++) {
        size_t row = (size_t)y * a->stride;
        for (int i = 0; i < a->width; i += VW) {
            vf x = vf_load(a->x + row + i), t = vf_load(a->y + row + i);
            vf d = vf_select(vf_ge(x, t), scale, zero) - vf_select(vf_ge(t, x), scale, zero);
            if (with_ssim) {
                vf g = vf_fma(x + x, filter_down(a, 1, y, i), filter_down(a, 0, y, i));
                d = vf_fma(ssim_scale, vf_fma(t, filter_down(a, 2, y, i), g), d);
            }
            vf_store(a->d_x + row + i, d);
        }
    }
}
