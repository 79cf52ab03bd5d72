/* loss.c - L1 + SSIM over a band of rows, and the gradient of it, in vectors of pixels.
 *
 * A row goes through four stations, each five rows behind the one before: filtered along the row, filtered
 * down the columns and turned into the maps of M.5, these filtered along, and these filtered down. What waits
 * for the columns' filter waits in rings of rows, which stay in the cache.
 */
#include "kernels.h"

#include "vec.h"

enum {
    MARGIN = SF_LANES,
    PLANES = 4,
    MAPS = 3,
    GROUP = 4, /* rows filtered down at a time: one row read serves up to four */
    REACH = 2 * SF_SSIM_RADIUS
};

/* The window's weights at distance 0 .. 5. */
static const float window[SF_SSIM_RADIUS + 1] = {0.2660117249f, 0.2130055377f, 0.1093606895f,
                                                 0.0360007721f, 0.0075987581f, 0.0010283801f};

/* Row `row` of a ring; those behind the rings are spare. */
VEC float *ring_row(const sf_loss_args *a, int ring, int row) {
    size_t at = (size_t)ring * SF_LOSS_RING + (unsigned)row % SF_LOSS_RING;
    return a->scratch + at * (a->stride + 2 * MARGIN) + MARGIN;
}

VEC float *spare_row(const sf_loss_args *a, int k) { return ring_row(a, PLANES + MAPS, k); }

/* Row r of a group of plane or map k. */
VEC float *group_row(const sf_loss_args *a, int k, int r) { return spare_row(a, k * GROUP + r); }

/* Zeros before and behind the spare rows' pictures: what the filter along a row finds there. */
static void clear_margins(const sf_loss_args *a) {
    for (int k = 0; k < PLANES * GROUP; k++) {
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
            sum = vf_fma(vf_set(window[k]), vf_add(vf_beside(row + x, -k), vf_beside(row + x, k)), sum);
        vf_store(out + x, sum);
    }
}

/* Rows y .. y + GROUP - 1 of a ring, filtered down the columns, to group rows k. */
VEC void filter_down(const sf_loss_args *a, int ring, int y, int k) {
    const float *in[REACH + GROUP];
    for (int r = 0; r < REACH + GROUP; r++) in[r] = ring_row(a, ring, y - SF_SSIM_RADIUS + r);
    float *out = group_row(a, k, 0);
    size_t apart = a->stride + 2 * MARGIN;
    for (int x = 0; x < a->width; x += VW) {
        vf v[REACH + GROUP];
        for (int r = 0; r < REACH + GROUP; r++) v[r] = vf_load(in[r] + x);
        for (int r = 0; r < GROUP; r++) {
            const vf *center = v + SF_SSIM_RADIUS + r;
            vf sum = vf_mul(vf_set(window[0]), center[0]);
            for (int d = 1; d <= SF_SSIM_RADIUS; d++)
                sum = vf_fma(vf_set(window[d]), vf_add(center[-d], center[d]), sum);
            vf_store(out + (size_t)r * apart + x, sum);
        }
    }
}

/* 1. x, y, x^2 + y^2 and x y of a row, filtered along it. The variances are needed in their sum alone. */
static void enter_row(const sf_loss_args *a, int y) {
    if (y < 0 || y >= a->height) {
        clear_rings(a, 0, PLANES, y);
        return;
    }
    float *plane[PLANES];
    for (int k = 0; k < PLANES; k++) plane[k] = group_row(a, k, 0);
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

/* 2. S and the maps G1 = dS/dmx - 2 mx dS/dsxx - my dS/dsxy, dS/dsxx, dS/dsxy of row r of the group; 3.
 * these, filtered along row y. Returns the row's sum of S. */
VEC double compare_row(const sf_loss_args *a, int r, int y, int backward) {
    if (y < 0 || y >= a->height) {
        clear_rings(a, PLANES, PLANES + MAPS, y);
        return 0;
    }
    float *mean[PLANES];
    for (int k = 0; k < PLANES; k++) mean[k] = group_row(a, k, r);
    vf sum = vf_set(0), two = vf_set(2);
    for (int i = 0; i < a->width; i += VW) {
        vf mx = vf_load(mean[0] + i), my = vf_load(mean[1] + i), mxy = vf_mul(mx, my);
        vf mm = vf_fma(mx, mx, vf_mul(my, my)), sxy = vf_sub(vf_load(mean[3] + i), mxy);
        vf A1 = vf_fma(two, mxy, vf_set(SF_SSIM_C1)), A2 = vf_fma(two, sxy, vf_set(SF_SSIM_C2));
        vf B1 = vf_add(mm, vf_set(SF_SSIM_C1));
        vf B2 = vf_add(vf_sub(vf_load(mean[2] + i), mm), vf_set(SF_SSIM_C2));
        vf inv = vf_reciprocal(vf_mul(B1, B2)), S = vf_mul(vf_mul(A1, A2), inv);
        vm in = inside(i, a->width);
        sum = vf_add(sum, vf_keep(in, S));
        if (!backward) continue;
        vf d_sxx = vf_neg(vf_mul(vf_mul(S, inv), B1)), d_sxy = vf_mul(vf_mul(two, A1), inv);
        vf d_mx = vf_mul(vf_mul(two, inv), vf_fnma(vf_mul(mx, S), B2, vf_mul(my, A2)));
        vf_store(mean[0] + i, vf_keep(in, vf_fnma(vf_mul(two, mx), d_sxx, vf_fnma(my, d_sxy, d_mx))));
        vf_store(mean[1] + i, vf_keep(in, d_sxx));
        vf_store(mean[2] + i, vf_keep(in, d_sxy));
    }
    for (int k = 0; backward && k < MAPS; k++) filter_along(a, mean[k], ring_row(a, PLANES + k, y));
    return (double)vf_sum(sum);
}

/* 4. the gradient of row y, whose filtered maps are row r of the group, and its sum of L1. */
VEC double differentiate_row(const sf_loss_args *a, int r, int y, int with_ssim) {
    const float *mean[MAPS];
    for (int k = 0; k < MAPS; k++) mean[k] = group_row(a, k, r);
    float least = a->delta > SF_LOSS_LEAST_DELTA ? a->delta : SF_LOSS_LEAST_DELTA;
    vf sum = vf_set(0), rising = vf_set(-a->l1_scale), ssim_scale = vf_set(a->ssim_scale);
    vf delta = vf_set(least), slope = vf_set(1.0f / least), half = vf_set(0.5f / least), one = vf_set(1);
    for (int i = 0; i < a->width; i += VW) {
        size_t at = (size_t)y * a->stride + (size_t)i;
        vm in = inside(i, a->width);
        /* y - x: 0, and never -0, where both have no weight */
        vf u = weighted(a, at), v = vf_load(a->y + at), off = vf_sub(v, u), far = magnitude(off);
        vf h = vf_min(far, delta);
        sum = vf_add(sum, vf_keep(in, vf_fma(h, vf_mul(h, half), vf_sub(far, h))));
        if (!a->d_x) continue;
        vf d = vf_mul(rising, vf_max(vf_min(vf_mul(off, slope), one), vf_neg(one)));
        if (with_ssim) {
            vf g = vf_fma(vf_add(u, u), vf_load(mean[1] + i), vf_load(mean[0] + i));
            d = vf_fma(ssim_scale, vf_fma(v, vf_load(mean[2] + i), g), d);
        }
        if (a->weight) d = vf_mul(d, vf_load(a->weight + at));
        vf_store(a->d_x + at, vf_keep(in, d));
    }
    /* the rest of the row, from the next whole vector on */
    size_t from = ((size_t)a->width + VW - 1) / VW * VW;
    for (size_t i = from; a->d_x && i < a->stride; i += VW)
        vf_store(a->d_x + (size_t)y * a->stride + i, vf_set(0));
    return (double)vf_sum(sum);
}

/* Rows of the picture that a station sees to: of the group at y those from `first` to `end` - 1. */
static int group_begin(int y, int first) { return y < first ? first - y : 0; }
static int group_end(int y, int end) { return y + GROUP > end ? end - y : GROUP; }

void SF_AT_LEVEL(sf_loss)(const sf_loss_args *a) {
    int backward = a->d_x && a->ssim_scale != 0.0f, halo = backward ? SF_SSIM_RADIUS : 0;
    int first = a->first_row, end = a->end_row, far = halo + SF_SSIM_RADIUS;
    for (int y = first; !backward && y < end; y++) a->l1[y - first] = differentiate_row(a, 0, y, 0);
    if (!a->ssim) return;
    clear_margins(a);
    /* groups of rows: y enters, five rows behind it is compared, five rows behind that is differentiated */
    for (int y = first - far - GROUP; y < end + far + GROUP; y += GROUP) {
        int middle = y - SF_SSIM_RADIUS, last = middle - SF_SSIM_RADIUS;
        for (int r = group_begin(y, first - far); r < group_end(y, end + far); r++) enter_row(a, y + r);
        if (group_begin(middle, first - halo) < group_end(middle, end + halo))
            for (int k = 0; k < PLANES; k++) filter_down(a, k, middle, k);
        for (int r = group_begin(middle, first - halo); r < group_end(middle, end + halo); r++) {
            double sum = compare_row(a, r, middle + r, backward);
            if (middle + r >= first && middle + r < end) a->ssim[middle + r - first] = sum;
        }
        if (!backward || group_begin(last, first) >= group_end(last, end)) continue;
        for (int k = 0; k < MAPS; k++) filter_down(a, PLANES + k, last, k);
        for (int r = group_begin(last, first); r < group_end(last, end); r++)
            a->l1[last + r - first] = differentiate_row(a, r, last + r, 1);
    }
}
