/* loss.c - L1 + SSIM over a band of rows, and the gradient of it, in vectors of pixels.
 *
 * A row goes through four stations, each five rows behind the one before: filtered along the row, filtered
 * down the columns and turned into the maps of M.5, these filtered along, and these filtered down. What waits
 * for the columns' filter waits in rings of rows, which stay in the cache.
 */
#include "kernels.h"

#include "vec.h"

enum { MARGIN = SF_LANES, PLANES = 4, MAPS = 3 };

/* The window's weights at distance 0 .. 5. */
static const float window[SF_SSIM_RADIUS + 1] = {0.2660117249f, 0.2130055377f, 0.1093606895f,
                                                 0.0360007721f, 0.0075987581f, 0.0010283801f};

/* Row `row` of a ring; the four rows behind the rings are spare. */
VEC float *ring_row(const sf_loss_args *a, int ring, int row) {
    size_t at = (size_t)ring * SF_LOSS_RING + (unsigned)row % SF_LOSS_RING;
    return a->scratch + at * (a->stride + 2 * MARGIN) + MARGIN;
}

VEC float *spare_row(const sf_loss_args *a, int k) { return ring_row(a, PLANES + MAPS, k); }

/* Zeros before and behind the spare rows' pictures: what the filter along a row finds there. */
static void clear_margins(const sf_loss_args *a) {
    for (int k = 0; k < PLANES; k++) {
        float *row = spare_row(a, k);
        for (int i = 0; i < MARGIN; i++) row[-1 - i] = 0;
        for (size_t i = (size_t)a->width; i < a->stride + MARGIN; i++) row[i] = 0;
    }
}

static void clear_rings(const sf_loss_args *a, int first, int end, int y) {
    for (int ring = first; ring < end; ring++) {
        float *row = ring_row(a, ring, y);
        for (int x = 0; x < a->width; x += VW) vf_store(row + x, vf_set(0));
    }
}

/* Lanes x .. x + VW - 1 that lie in the picture. */
VEC vm inside(int x, int width) {
    _Alignas(64) float lane[VW];
    for (int i = 0; i < VW; i++) lane[i] = (float)i;
    return vf_le(vf_load(lane), vf_set((float)(width - 1 - x)));
}

VEC vf magnitude(vf a) { return vf_max(a, vf_neg(a)); }

/* The rendered picture times the weight. */
VEC vf weighted(const sf_loss_args *a, size_t at) {
    vf x = vf_load(a->x + at);
    if (a->weight) x = vf_mul(x, vf_load(a->weight + at));
    return x;
}

VEC void filter_along(const sf_loss_args *a, const float *row, float *out) {
    for (int x = 0; x < a->width; x += VW) {
        vf sum = vf_mul(vf_set(window[0]), vf_load(row + x));
        for (int k = 1; k <= SF_SSIM_RADIUS; k++)
            sum = vf_fma(vf_set(window[k]), vf_add(vf_loadu(row + x - k), vf_loadu(row + x + k)), sum);
        vf_store(out + x, sum);
    }
}

/* The rows that one output row of a ring is made of, from five above to five below. */
typedef struct column {
    const float *row[2 * SF_SSIM_RADIUS + 1];
} column;

VEC column column_of(const sf_loss_args *a, int ring, int y) {
    column c;
    for (int k = -SF_SSIM_RADIUS; k <= SF_SSIM_RADIUS; k++)
        c.row[SF_SSIM_RADIUS + k] = ring_row(a, ring, y + k);
    return c;
}

VEC vf filter_down(const column *c, int x) {
    vf sum = vf_mul(vf_set(window[0]), vf_load(c->row[SF_SSIM_RADIUS] + x));
    for (int k = 1; k <= SF_SSIM_RADIUS; k++)
        sum = vf_fma(vf_set(window[k]),
                     vf_add(vf_load(c->row[SF_SSIM_RADIUS - k] + x), vf_load(c->row[SF_SSIM_RADIUS + k] + x)),
                     sum);
    return sum;
}

/* 1. x, y, x^2 + y^2 and x y of a row, filtered along it. The variances are needed in their sum alone. */
static void enter_row(const sf_loss_args *a, int y) {
    if (y < 0 || y >= a->height) {
        clear_rings(a, 0, PLANES, y);
        return;
    }
    float *plane[PLANES];
    for (int k = 0; k < PLANES; k++) plane[k] = spare_row(a, k);
    for (int i = 0; i < a->width; i += VW) {
        size_t at = (size_t)y * a->stride + (size_t)i;
        vm in = inside(i, a->width);
        vf u = vf_keep(in, weighted(a, at)), v = vf_keep(in, vf_load(a->y + at));
        vf_store(plane[0] + i, u);
        vf_store(plane[1] + i, v);
        vf_store(plane[2] + i, vf_fma(u, u, vf_mul(v, v)));
        vf_store(plane[3] + i, vf_mul(u, v));
    }
    for (int k = 0; k < PLANES; k++) filter_along(a, plane[k], ring_row(a, k, y));
}

/* 2. S and the maps G1 = dS/dmx - 2 mx dS/dsxx - my dS/dsxy, dS/dsxx, dS/dsxy; 3. these, filtered along.
 * Returns the row's sum of S. */
static double compare_row(const sf_loss_args *a, int y, int backward) {
    if (y < 0 || y >= a->height) {
        clear_rings(a, PLANES, PLANES + MAPS, y);
        return 0;
    }
    column mean[PLANES];
    float *map[MAPS];
    for (int k = 0; k < PLANES; k++) mean[k] = column_of(a, k, y);
    for (int k = 0; k < MAPS; k++) map[k] = spare_row(a, k);
    vf sum = vf_set(0), one = vf_set(1), two = vf_set(2);
    for (int i = 0; i < a->width; i += VW) {
        vf mx = filter_down(&mean[0], i), my = filter_down(&mean[1], i), mxy = vf_mul(mx, my);
        vf mm = vf_fma(mx, mx, vf_mul(my, my)), sxy = vf_sub(filter_down(&mean[3], i), mxy);
        vf A1 = vf_fma(two, mxy, vf_set(SF_SSIM_C1)), A2 = vf_fma(two, sxy, vf_set(SF_SSIM_C2));
        vf B1 = vf_add(mm, vf_set(SF_SSIM_C1));
        vf B2 = vf_add(vf_sub(filter_down(&mean[2], i), mm), vf_set(SF_SSIM_C2));
        vf inv = vf_div(one, vf_mul(B1, B2)), S = vf_mul(vf_mul(A1, A2), inv);
        vm in = inside(i, a->width);
        sum = vf_add(sum, vf_keep(in, S));
        if (!backward) continue;
        vf d_sxx = vf_neg(vf_mul(vf_mul(S, inv), B1)), d_sxy = vf_mul(vf_mul(two, A1), inv);
        vf d_mx = vf_mul(vf_mul(two, inv), vf_fnma(vf_mul(mx, S), B2, vf_mul(my, A2)));
        vf_store(map[0] + i, vf_keep(in, vf_fnma(vf_mul(two, mx), d_sxx, vf_fnma(my, d_sxy, d_mx))));
        vf_store(map[1] + i, vf_keep(in, d_sxx));
        vf_store(map[2] + i, vf_keep(in, d_sxy));
    }
    for (int k = 0; backward && k < MAPS; k++) filter_along(a, map[k], ring_row(a, PLANES + k, y));
    return (double)vf_sum(sum);
}

/* 4. the gradient of a row. */
static void differentiate_row(const sf_loss_args *a, int y) {
    int with_ssim = a->ssim_scale != 0.0f;
    column mean[MAPS];
    for (int k = 0; with_ssim && k < MAPS; k++) mean[k] = column_of(a, PLANES + k, y);
    vf scale = vf_set(a->l1_scale), ssim_scale = vf_set(a->ssim_scale);
    for (size_t i = 0; i < a->stride; i += VW) {
        size_t at = (size_t)y * a->stride + i;
        vf u = weighted(a, at), v = vf_load(a->y + at);
        vf d = vf_sub(vf_keep(vf_ge(u, v), scale), vf_keep(vf_ge(v, u), scale));
        if (with_ssim) {
            vf g = vf_fma(vf_add(u, u), filter_down(&mean[1], (int)i), filter_down(&mean[0], (int)i));
            d = vf_fma(ssim_scale, vf_fma(v, filter_down(&mean[2], (int)i), g), d);
        }
        if (a->weight) d = vf_mul(d, vf_load(a->weight + at));
        vf_store(a->d_x + at, vf_keep(inside((int)i, a->width), d));
    }
}

static double l1_row(const sf_loss_args *a, int y) {
    vf sum = vf_set(0);
    for (int i = 0; i < a->width; i += VW) {
        size_t at = (size_t)y * a->stride + (size_t)i;
        sum =
            vf_add(sum, vf_keep(inside(i, a->width), magnitude(vf_sub(weighted(a, at), vf_load(a->y + at)))));
    }
    return (double)vf_sum(sum);
}

void SF_AT_LEVEL(sf_loss)(const sf_loss_args *a) {
    int backward = a->d_x && a->ssim_scale != 0.0f, halo = backward ? SF_SSIM_RADIUS : 0;
    if (a->ssim) clear_margins(a);
    for (int y = a->first_row; y < a->end_row; y++) a->l1[y - a->first_row] = l1_row(a, y);
    for (int y = a->first_row - halo - SF_SSIM_RADIUS; a->ssim && y < a->end_row + halo + SF_SSIM_RADIUS;
         y++) {
        enter_row(a, y);
        int middle = y - SF_SSIM_RADIUS, last = middle - SF_SSIM_RADIUS;
        if (middle < a->first_row - halo) continue;
        double sum = compare_row(a, middle, backward);
        if (middle >= a->first_row && middle < a->end_row) a->ssim[middle - a->first_row] = sum;
        if (backward && last >= a->first_row) differentiate_row(a, last);
    }
    for (int y = a->first_row; a->d_x && !backward && y < a->end_row; y++) differentiate_row(a, y);
}
