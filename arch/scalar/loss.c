/* loss.c - L1 + SSIM over a band of rows, and the gradient of it, in plain C. */
#include "scalar.h"

#include <math.h>
#include <string.h>

enum { TAPS = 2 * SF_SSIM_RADIUS + 1 };

/* exp(-i^2 / (2 1.5^2)) over their sum, i = -5 .. 5 */
static const float window[TAPS] = {0.0010283801f, 0.0075987581f, 0.0360007721f, 0.1093606895f,
                                   0.2130055377f, 0.2660117249f, 0.2130055377f, 0.1093606895f,
                                   0.0360007721f, 0.0075987581f, 0.0010283801f};

/* Scratch: the band and its halo of up to 5 horizontally filtered planes, then a fully filtered row of each.
 */
static float *scratch_row(const sf_loss_args *a, int plane, int row) {
    int top = a->first_row - SF_SSIM_RADIUS;
    return a->scratch + ((size_t)plane * SF_LOSS_HALO_BAND + (size_t)(row - top)) * a->stride;
}

static float *filtered_row(const sf_loss_args *a, int plane) {
    return a->scratch + (5 * (size_t)SF_LOSS_HALO_BAND + (size_t)plane) * a->stride;
}

/* Horizontal means of u * v (v NULL: of u) for the band and its halo; zeros outside of the picture. */
static void filter_rows(const sf_loss_args *a, int plane, const float *u, const float *v) {
    for (int y = a->first_row - SF_SSIM_RADIUS; y < a->end_row + SF_SSIM_RADIUS; y++) {
        float *out = scratch_row(a, plane, y);
        if (y < 0 || y >= a->height) {
            memset(out, 0, (size_t)a->width * sizeof *out);
            continue;
        }
        const float *ur = u + (size_t)y * a->stride, *vr = v ? v + (size_t)y * a->stride : NULL;
        for (int x = 0; x < a->width; x++) {
            int from = x < SF_SSIM_RADIUS ? -x : -SF_SSIM_RADIUS;
            int to = x + SF_SSIM_RADIUS < a->width ? SF_SSIM_RADIUS : a->width - 1 - x;
            float sum = 0;
            for (int k = from; k <= to; k++)
                sum += window[k + SF_SSIM_RADIUS] * (vr ? ur[x + k] * vr[x + k] : ur[x + k]);
            out[x] = sum;
        }
    }
}

/* The vertical half, of one row. */
static void filter_columns(const sf_loss_args *a, int plane, int y, float *out) {
    memset(out, 0, (size_t)a->width * sizeof *out);
    for (int k = -SF_SSIM_RADIUS; k <= SF_SSIM_RADIUS; k++) {
        const float *in = scratch_row(a, plane, y + k);
        for (int x = 0; x < a->width; x++) out[x] += window[k + SF_SSIM_RADIUS] * in[x];
    }
}

void sf_loss_scalar(const sf_loss_args *a) {
    for (int y = a->first_row; y < a->end_row; y++) {
        const float *x = a->x + (size_t)y * a->stride, *t = a->y + (size_t)y * a->stride;
        double sum = 0;
        for (int i = 0; i < a->width; i++) sum += (double)fabsf(x[i] - t[i]);
        *a->l1 += sum;
    }
    if (!a->ssim) return;

    filter_rows(a, 0, a->x, NULL);
    filter_rows(a, 1, a->y, NULL);
    filter_rows(a, 2, a->x, a->x);
    filter_rows(a, 3, a->y, a->y);
    filter_rows(a, 4, a->x, a->y);
    for (int y = a->first_row; y < a->end_row; y++) {
        float *mean[5];
        for (int k = 0; k < 5; k++) filter_columns(a, k, y, mean[k] = filtered_row(a, k));
        double sum = 0;
        for (int i = 0; i < a->width; i++) {
            float mx = mean[0][i], my = mean[1][i];
            float sxx = mean[2][i] - mx * mx, syy = mean[3][i] - my * my, sxy = mean[4][i] - mx * my;
            float A1 = 2 * mx * my + SF_SSIM_C1, A2 = 2 * sxy + SF_SSIM_C2;
            float B1 = mx * mx + my * my + SF_SSIM_C1, B2 = sxx + syy + SF_SSIM_C2;
            float inv = 1.0f / (B1 * B2), S = A1 * A2 * inv;
            float d_mx = 2 * my * A2 * inv - 2 * mx * S / B1, d_sxx = -S / B2, d_sxy = 2 * A1 * inv;
            size_t at = (size_t)y * a->stride + (size_t)i;
            a->map[0][at] = d_mx - 2 * mx * d_sxx - my * d_sxy;
            a->map[1][at] = d_sxx;
            a->map[2][at] = d_sxy;
            sum += (double)S;
        }
        *a->ssim += sum;
    }
}

void sf_loss_bwd_scalar(const sf_loss_args *a) {
    int with_ssim = a->ssim_scale != 0.0f;
    for (int k = 0; with_ssim && k < 3; k++) filter_rows(a, k, a->map[k], NULL);
    for (int y = a->first_row; y < a->end_row; y++) {
        size_t row = (size_t)y * a->stride;
        const float *x = a->x + row, *t = a->y + row;
        float *d_x = a->d_x + row, *mean[3];
        for (int k = 0; with_ssim && k < 3; k++) filter_columns(a, k, y, mean[k] = filtered_row(a, k));
        for (int i = 0; i < a->width; i++) {
            float difference = x[i] - t[i];
            d_x[i] = a->l1_scale * (float)((difference > 0) - (difference < 0));
            if (with_ssim) d_x[i] += a->ssim_scale * (mean[0][i] + 2 * x[i] * mean[1][i] + t[i] * mean[2][i]);
        }
    }
}
