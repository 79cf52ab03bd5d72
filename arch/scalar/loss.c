/* loss.c - L1 + SSIM over a band of rows, and the gradient of it, in plain C.
 *
 * A row goes through four stations, each five rows behind the one before: filtered along the row, filtered
 * down the columns and turned into the maps of M.5, these filtered along, and these filtered down. What waits
 * for the columns' filter waits in rings of rows.
 */
#include "scalar.h"

#include <math.h>
#include <string.h>

enum { TAPS = 2 * SF_SSIM_RADIUS + 1, PLANES = 4, MAPS = 3 };

/* exp(-i^2 / (2 1.5^2)) over their sum, i = -5 .. 5 */
static const float window[TAPS] = {0.0010283801f, 0.0075987581f, 0.0360007721f, 0.1093606895f,
                                   0.2130055377f, 0.2660117249f, 0.2130055377f, 0.1093606895f,
                                   0.0360007721f, 0.0075987581f, 0.0010283801f};

/* Row `row` of a ring; those behind the rings are spare. */
static float *ring_row(const sf_loss_args *a, int ring, int row) {
    return a->scratch + ((size_t)ring * SF_LOSS_RING + (unsigned)row % SF_LOSS_RING) * a->stride;
}

static float *spare_row(const sf_loss_args *a, int k) {
    return a->scratch + (size_t)((PLANES + MAPS) * SF_LOSS_RING + k) * a->stride;
}

static void filter_along(const sf_loss_args *a, const float *row, float *out) {
    for (int x = 0; x < a->width; x++) {
        int from = x < SF_SSIM_RADIUS ? -x : -SF_SSIM_RADIUS;
        int to = x + SF_SSIM_RADIUS < a->width ? SF_SSIM_RADIUS : a->width - 1 - x;
        out[x] = 0;
        for (int k = from; k <= to; k++) out[x] += window[k + SF_SSIM_RADIUS] * row[x + k];
    }
}

static void filter_down(const sf_loss_args *a, int ring, int y, float *out) {
    memset(out, 0, (size_t)a->width * sizeof *out);
    for (int k = -SF_SSIM_RADIUS; k <= SF_SSIM_RADIUS; k++) {
        const float *in = ring_row(a, ring, y + k);
        for (int x = 0; x < a->width; x++) out[x] += window[k + SF_SSIM_RADIUS] * in[x];
    }
}

static void clear_rings(const sf_loss_args *a, int first, int end, int y) {
    for (int ring = first; ring < end; ring++)
        memset(ring_row(a, ring, y), 0, (size_t)a->width * sizeof(float));
}

static float weight_at(const sf_loss_args *a, size_t at) { return a->weight ? a->weight[at] : 1.0f; }

static float delta_of(const sf_loss_args *a) { return fmaxf(a->delta, SF_LOSS_LEAST_DELTA); }

/* 1. x, y, x^2 + y^2 and x y of a row, filtered along it. The variances are needed in their sum alone. */
static void enter_row(const sf_loss_args *a, int y) {
    if (y < 0 || y >= a->height) {
        clear_rings(a, 0, PLANES, y);
        return;
    }
    float *plane[PLANES];
    for (int k = 0; k < PLANES; k++) plane[k] = spare_row(a, k);
    for (int i = 0; i < a->width; i++) {
        size_t at = (size_t)y * a->stride + (size_t)i;
        float u = a->x[at] * weight_at(a, at), v = a->y[at];
        plane[0][i] = u;
        plane[1][i] = v;
        plane[2][i] = u * u + v * v;
        plane[3][i] = u * v;
    }
    for (int k = 0; k < PLANES; k++) filter_along(a, plane[k], ring_row(a, k, y));
}

/* 2. S and the maps G1 = dS/dmx - 2 mx dS/dsxx - my dS/dsxy, dS/dsxx, dS/dsxy; 3. these, filtered along.
 * Returns the row's sum of S. */
static double compare_row(const sf_loss_args *a, int y) {
    if (y < 0 || y >= a->height) {
        clear_rings(a, PLANES, PLANES + MAPS, y);
        return 0;
    }
    float *mean[PLANES];
    for (int k = 0; k < PLANES; k++) filter_down(a, k, y, mean[k] = spare_row(a, k));
    double sum = 0;
    for (int i = 0; i < a->width; i++) {
        float mx = mean[0][i], my = mean[1][i], mm = mx * mx + my * my;
        float sxy = mean[3][i] - mx * my, A1 = 2 * mx * my + SF_SSIM_C1, A2 = 2 * sxy + SF_SSIM_C2;
        float B1 = mm + SF_SSIM_C1, B2 = mean[2][i] - mm + SF_SSIM_C2;
        float inv = 1.0f / (B1 * B2), S = A1 * A2 * inv;
        float d_mx = 2 * my * A2 * inv - 2 * mx * S / B1, d_sxx = -S / B2, d_sxy = 2 * A1 * inv;
        mean[0][i] = d_mx - 2 * mx * d_sxx - my * d_sxy;
        mean[1][i] = d_sxx;
        mean[2][i] = d_sxy;
        sum += (double)S;
    }
    for (int k = 0; k < MAPS; k++) filter_along(a, mean[k], ring_row(a, PLANES + k, y));
    return sum;
}

/* 4. the gradient of a row. */
static void differentiate_row(const sf_loss_args *a, int y) {
    int with_ssim = a->ssim_scale != 0.0f;
    float *d_x = a->d_x + (size_t)y * a->stride, *mean[MAPS], delta = delta_of(a);
    for (int k = 0; with_ssim && k < MAPS; k++) filter_down(a, PLANES + k, y, mean[k] = spare_row(a, k));
    for (int i = 0; i < a->width; i++) {
        size_t at = (size_t)y * a->stride + (size_t)i;
        float weight = weight_at(a, at), u = a->x[at] * weight, v = a->y[at];
        float d = -a->l1_scale * fminf(fmaxf((v - u) * (1.0f / delta), -1.0f), 1.0f);
        if (with_ssim) d += a->ssim_scale * (mean[0][i] + 2 * u * mean[1][i] + v * mean[2][i]);
        d_x[i] = weight * d;
    }
    for (size_t i = (size_t)a->width; i < a->stride; i++) d_x[i] = 0;
}

static double l1_row(const sf_loss_args *a, int y) {
    double sum = 0;
    float delta = delta_of(a), half = 0.5f / delta;
    for (int i = 0; i < a->width; i++) {
        size_t at = (size_t)y * a->stride + (size_t)i;
        float d = fabsf(a->x[at] * weight_at(a, at) - a->y[at]), h = fminf(d, delta);
        sum += (double)(d - h + h * (h * half));
    }
    return sum;
}

void sf_loss_scalar(const sf_loss_args *a) {
    int backward = a->d_x && a->ssim_scale != 0.0f, halo = backward ? SF_SSIM_RADIUS : 0;
    for (int y = a->first_row; y < a->end_row; y++) a->l1[y - a->first_row] = l1_row(a, y);
    for (int y = a->first_row - halo - SF_SSIM_RADIUS; a->ssim && y < a->end_row + halo + SF_SSIM_RADIUS;
         y++) {
        enter_row(a, y);
        int middle = y - SF_SSIM_RADIUS, last = middle - SF_SSIM_RADIUS;
        if (middle < a->first_row - halo) continue;
        double sum = compare_row(a, middle);
        if (middle >= a->first_row && middle < a->end_row) a->ssim[middle - a->first_row] = sum;
        if (backward && last >= a->first_row) differentiate_row(a, last);
    }
    for (int y = a->first_row; a->d_x && !backward && y < a->end_row; y++) differentiate_row(a, y);
}
