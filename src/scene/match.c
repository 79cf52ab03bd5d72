/* match.c - plane-sweep stereo: for planes of constant depth in the reference, neighbours are warped through
 * the plane and compared with it by normalised cross-correlation over small windows. The depth of a pixel is
 * where the correlation peaks.
 *
 * A sample outside of a neighbour's picture or masked is NaN: the variance of a window with one compares
 * false, and the window gets no score. Loops run over whole blocks of pixels, so that compilers vectorise
 * them.
 */
#include "match.h"

#include <math.h>
#include <string.h>

#include "../base/select.h"
#include "../kernels/kernels.h"
#include "pixels.h"

enum {
    RADIUS = 3, /* of a window, px */
    SIDE = 2 * RADIUS + 1,
    BLOCK = 16,
    MARGIN = 16, /* on both sides of a row; >= RADIUS, and keeps rows aligned */
};

/* Texture: the least standard deviation in a window, of values in 0..1; noise of 8-bit pictures is below it.
 */
#define LEAST_DEVIATION 0.012
/* The least correlation of a peak, and its least margin over any other peak. */
#define LEAST_SCORE 0.7f
#define LEAST_LEAD  0.03f
#define NO_SCORE    (-2.0f)

static size_t padded(int width) { return ((size_t)width + BLOCK - 1) / BLOCK * BLOCK; }

sf_status sf_grey_create(sf_context *ctx, const sf_view *view, int factor, sf_grey *grey) {
    *grey = (sf_grey){.camera = sf_camera_downscaled(&view->camera, factor), .factor = factor};
    grey->stride = padded(grey->camera.width) + 2 * MARGIN;
    grey->values = sf_alloc(ctx, (size_t)grey->camera.height * grey->stride, sizeof *grey->values);
    return grey->values ? SF_OK : SF_ERR_MEMORY;
}

void sf_grey_destroy(sf_context *ctx, sf_grey *grey) {
    sf_free(ctx, grey->values);
    grey->values = NULL;
}

sf_status sf_grey_fill(const sf_context *ctx, const sf_view *view, sf_grey *grey) {
    static const float luma[3] = {0.299f, 0.587f, 0.114f};
    sf_view_pixels p;
    sf_status status = sf_view_open(view, &p);
    if (status) return status;
    size_t width = (size_t)view->camera.width, pixels = width * (size_t)view->camera.height;
    for (int y = 0; y < grey->camera.height; y++) {
        float *row = grey->values + (size_t)y * grey->stride, part[BLOCK];
        size_t from = (size_t)(y * grey->factor) * width;
        for (size_t x = 0; x < grey->stride; x++) row[x] = NAN;
        for (int x = 0; x < grey->camera.width; x += BLOCK) {
            int n = grey->camera.width - x < BLOCK ? grey->camera.width - x : BLOCK;
            size_t at = from + (size_t)(x * grey->factor);
            for (int k = 0; k < n; k++) row[MARGIN + x + k] = -0.5f;
            for (size_t ch = 0; ch < 3; ch++) {
                ctx->kernels->unpack(p.rgb + ch * pixels + at, NULL, width, grey->factor, part, n);
                for (int k = 0; k < n; k++) row[MARGIN + x + k] += luma[ch] * part[k];
            }
            if (!p.weight) continue;
            ctx->kernels->unpack(NULL, p.weight + at, width, grey->factor, part, n);
            for (int k = 0; k < n; k++)
                if (part[k] < 1.0f) row[MARGIN + x + k] = NAN;
        }
    }
    sf_view_close(view, &p);
    return SF_OK;
}

/* The homography from the reference to a neighbour through a plane: pixel (x, y) of the reference, at inverse
 * depth w, maps to A (x, y, 1) + w b in the neighbour, in homogeneous pixels. */
typedef struct relation {
    const sf_grey *grey;
    double A[9], b[3];
} relation;

static relation relate(const sf_grey *reference, const sf_grey *neighbour) {
    const sf_camera *r = &reference->camera, *n = &neighbour->camera;
    relation to = {.grey = neighbour};
    double R[9], t[3];
    for (int i = 0; i < 3; i++) {
        t[i] = n->t_cw[i];
        for (int j = 0; j < 3; j++) {
            R[3 * i + j] = 0;
            for (int k = 0; k < 3; k++) R[3 * i + j] += n->R_cw[3 * i + k] * r->R_cw[3 * j + k];
        }
        for (int j = 0; j < 3; j++) t[i] -= R[3 * i + j] * r->t_cw[j];
    }
    for (int j = 0; j < 3; j++) {
        R[j] = n->fx * R[j] + n->cx * R[6 + j];
        R[3 + j] = n->fy * R[3 + j] + n->cy * R[6 + j];
    }
    for (int i = 0; i < 3; i++) {
        to.A[3 * i] = R[3 * i] / r->fx;
        to.A[3 * i + 1] = R[3 * i + 1] / r->fy;
        to.A[3 * i + 2] = R[3 * i + 2] - to.A[3 * i] * r->cx - to.A[3 * i + 1] * r->cy;
    }
    to.b[0] = n->fx * t[0] + n->cx * t[2];
    to.b[1] = n->fy * t[1] + n->cy * t[2];
    to.b[2] = t[2];
    return to;
}

/* Where a pixel lies in the neighbour; 0 if it lies behind it. */
static int relate_pixel(const relation *to, double x, double y, double w, double *u, double *v) {
    double p[3];
    for (int i = 0; i < 3; i++)
        p[i] = to->A[3 * i] * x + to->A[3 * i + 1] * y + to->A[3 * i + 2] + w * to->b[i];
    *u = p[0] / p[2], *v = p[1] / p[2];
    return p[2] > 0;
}

int sf_match_planes(const sf_grey *reference, const sf_grey *const *neighbours, size_t count, double first,
                    double last, int most) {
    enum { SAMPLES = 5, FEWEST = 8 };
    double farthest = 0;
    for (size_t k = 0; k < count; k++) {
        relation to = relate(reference, neighbours[k]);
        for (int i = 0; i < SAMPLES * SAMPLES; i++) {
            double x = (i % SAMPLES + 0.5) / SAMPLES * reference->camera.width, u0, v0, u1, v1;
            double y = (i / SAMPLES + 0.5) / SAMPLES * reference->camera.height;
            if (relate_pixel(&to, x, y, first, &u0, &v0) && relate_pixel(&to, x, y, last, &u1, &v1))
                farthest = fmax(farthest, hypot(u1 - u0, v1 - v0));
        }
    }
    if (farthest >= most - 1) return most;
    int planes = (int)farthest + 2;
    return planes > FEWEST ? planes : FEWEST;
}

/* Warps a row: the neighbour's values at the reference's pixels through the plane, bilinear. */
static void warp_row(const sf_grey *grey, const float *H, int y, size_t width, float *restrict out) {
    float most_u = (float)(grey->camera.width - 1), most_v = (float)(grey->camera.height - 1);
    float stride = (float)grey->stride, middle = (float)y + 0.5f; /* products below 2^24 are exact */
    float row[3] = {H[1] * middle + H[2], H[4] * middle + H[5], H[7] * middle + H[8]};
    for (size_t x = 0; x < width; x += BLOCK) {
        float du[BLOCK], dv[BLOCK];
        int32_t at[BLOCK];
        for (int k = 0; k < BLOCK; k++) {
            float p = (float)((int)x + k) + 0.5f;
            float z = H[6] * p + row[2], inverse = 1.0f / z;
            float u = (H[0] * p + row[0]) * inverse - 0.5f, v = (H[3] * p + row[1]) * inverse - 0.5f;
            int inside = (z > 0) & (u >= 0) & (u < most_u) & (v >= 0) & (v < most_v);
            u = sf_select(inside, u, 0);
            v = sf_select(inside, v, 0);
            float left = (float)(int)u, top = (float)(int)v;
            at[k] = (int)(top * stride + left);
            du[k] = sf_select(inside, u - left, NAN);
            dv[k] = v - top;
        }
        for (int k = 0; k < BLOCK; k++) {
            const float *p = grey->values + MARGIN + at[k], *q = p + grey->stride;
            float above = p[0] + du[k] * (p[1] - p[0]), below = q[0] + du[k] * (q[1] - q[0]);
            out[x + (size_t)k] = above + dv[k] * (below - above);
        }
    }
}

/* sums[x] = sum of a b over the SIDE pixels about x; a and b have margins. */
static void sum_along_row(const float *restrict a, const float *restrict b, size_t width,
                          float *restrict sums) {
    for (size_t x = 0; x < width; x += BLOCK) {
        float product[BLOCK + 2 * RADIUS + 2];
        const float *of_a = a + x, *of_b = b + x;
        for (int k = 0; k < BLOCK + 2 * RADIUS + 2; k++) product[k] = of_a[k - RADIUS] * of_b[k - RADIUS];
        for (int k = 0; k < BLOCK; k++)
            sums[x + (size_t)k] = ((product[k] + product[k + 1]) + (product[k + 2] + product[k + 3])) +
                                  ((product[k + 4] + product[k + 5]) + product[k + 6]);
    }
}

/* The sum of SIDE rows, `apart` floats one from the other. */
static void sum_rows(const float *restrict rows, size_t apart, size_t width, float *restrict sums) {
    for (size_t x = 0; x < width; x += BLOCK)
        for (int k = 0; k < BLOCK; k++) {
            const float *r = rows + x + (size_t)k;
            sums[x + (size_t)k] = ((r[0] + r[apart]) + (r[2 * apart] + r[3 * apart])) +
                                  ((r[4 * apart] + r[5 * apart]) + r[6 * apart]);
        }
}

/* State of each pixel during the sweep: [height][padded width / BLOCK][STATES][BLOCK]. */
enum {
    SUM,       /* of the reference over the window */
    SHARPNESS, /* 1 / sqrt(n^2 variance) of the reference; 0: too little texture */
    BEFORE_LAST,
    LAST, /* scores of the last two planes */
    BEST,
    BEST_BEFORE,
    BEST_AFTER, /* score of the highest peak, and on both sides of it */
    BEST_PLANE,
    RIVAL, /* score of the second highest peak */
    STATES
};

/* Sums along rows for each neighbour: of y, y y and x y, SIDE rows of each, the newest in turn. */
enum { SUM_Y, SUM_YY, SUM_XY, SUMS };

typedef struct sweep {
    const sf_grey *reference;
    relation to[SF_MATCH_NEIGHBOURS];
    float H[SF_MATCH_NEIGHBOURS][9]; /* through the current plane */
    size_t count, width;             /* width padded */
    float *state;
    float *ring[SF_MATCH_NEIGHBOURS][SUMS];
    float *warped, *ones; /* rows with margins */
    float *totals[SUMS], *first, *second;
} sweep;

static size_t row_floats(const sf_camera *camera) { return padded(camera->width) + 2 * MARGIN; }

size_t sf_match_scratch(const sf_camera *camera) {
    size_t width = padded(camera->width);
    return STATES * width * (size_t)camera->height + SF_MATCH_NEIGHBOURS * SUMS * SIDE * width +
           2 * row_floats(camera) + (SUMS + 2) * width;
}

static float *take(float **scratch, size_t floats) {
    float *taken = *scratch;
    *scratch += floats;
    return taken;
}

static void share_out(sweep *s, float *scratch) {
    size_t rows = (size_t)s->reference->camera.height, with_margins = row_floats(&s->reference->camera);
    s->state = take(&scratch, STATES * s->width * rows);
    for (size_t k = 0; k < SF_MATCH_NEIGHBOURS; k++)
        for (int i = 0; i < SUMS; i++) s->ring[k][i] = take(&scratch, SIDE * s->width);
    s->warped = take(&scratch, with_margins);
    s->ones = take(&scratch, with_margins);
    for (int i = 0; i < SUMS; i++) s->totals[i] = take(&scratch, s->width);
    s->first = take(&scratch, s->width);
    s->second = take(&scratch, s->width);
    for (size_t x = 0; x < with_margins; x++) s->warped[x] = NAN, s->ones[x] = 1;
}

/* The states of the block of pixels that holds (x, y). */
static float *block_of(const sweep *s, int y, size_t x) {
    return s->state + STATES * ((size_t)y * s->width + x / BLOCK * BLOCK);
}

/* n^2 times the least variance. */
static float least_spread(void) {
    return (float)(LEAST_DEVIATION * LEAST_DEVIATION * (SIDE * SIDE) * (SIDE * SIDE));
}

/* Sums of the reference itself; its rows use the ring of the first neighbour. */
static void measure_reference(sweep *s) {
    const sf_grey *grey = s->reference;
    float *const *ring = s->ring[0];
    /* no peak before the second plane */
    static const float start[STATES] = {
        [BEFORE_LAST] = -NO_SCORE, [LAST] = NO_SCORE,       [BEST] = NO_SCORE,
        [BEST_BEFORE] = NO_SCORE,  [BEST_AFTER] = NO_SCORE, [RIVAL] = NO_SCORE,
    };
    for (size_t i = 0; i < STATES * s->width * (size_t)grey->camera.height; i++)
        s->state[i] = start[i / BLOCK % STATES];
    for (int y = 0; y < grey->camera.height; y++) {
        const float *row = grey->values + (size_t)y * grey->stride + MARGIN;
        size_t slot = (size_t)(y % SIDE) * s->width;
        sum_along_row(row, s->ones + MARGIN, s->width, ring[SUM_Y] + slot);
        sum_along_row(row, row, s->width, ring[SUM_YY] + slot);
        if (y < SIDE - 1) continue;
        sum_rows(ring[SUM_Y], s->width, s->width, s->totals[SUM_Y]);
        sum_rows(ring[SUM_YY], s->width, s->width, s->totals[SUM_YY]);
        for (size_t x = 0; x < s->width; x++) {
            float sum = s->totals[SUM_Y][x], spread = SIDE * SIDE * s->totals[SUM_YY][x] - sum * sum;
            if (!(spread > least_spread())) continue;
            float *block = block_of(s, y - RADIUS, x);
            block[SUM * BLOCK + x % BLOCK] = sum;
            block[SHARPNESS * BLOCK + x % BLOCK] = 1.0f / sqrtf(spread);
        }
    }
}

/* Correlation of a block of windows with a neighbour; y, yy and xy: its sums; first and second: the two
 * highest so far. */
static void correlate(const float *restrict state, const float *restrict y, const float *restrict yy,
                      const float *restrict xy, float *restrict first, float *restrict second) {
    const float n = SIDE * SIDE, least = least_spread();
    for (int k = 0; k < BLOCK; k++) {
        float sharpness = state[SHARPNESS * BLOCK + k], high = first[k], low = second[k];
        float spread = n * yy[k] - y[k] * y[k];
        float score = (n * xy[k] - state[SUM * BLOCK + k] * y[k]) * sharpness / sqrtf(spread);
        int known = (spread > least) & (sharpness > 0);
        int higher = known & (score > high);
        float lower = sf_select(higher, high, score);
        int lower_higher = known & (lower > low);
        first[k] = sf_select(higher, score, high);
        second[k] = sf_select(lower_higher, lower, low);
    }
}

/* Adds the scores of a block of pixels in a plane, and checks whether the plane before it was a peak. */
static void note(float *restrict state, const float *restrict scores, float plane) {
    float *before = state + BEFORE_LAST * BLOCK, *last = state + LAST * BLOCK, *best = state + BEST * BLOCK;
    float *best_before = state + BEST_BEFORE * BLOCK, *best_after = state + BEST_AFTER * BLOCK;
    float *best_plane = state + BEST_PLANE * BLOCK, *rival = state + RIVAL * BLOCK;
    for (int k = 0; k < BLOCK; k++) {
        float score = scores[k], was = last[k], earlier = before[k], top = best[k], second = rival[k];
        int is_peak = (was >= earlier) & (was > score);
        int higher = is_peak & (was > top);
        float lower = sf_select(higher, top, was);
        int lower_higher = is_peak & (lower > second);
        rival[k] = sf_select(lower_higher, lower, second);
        best[k] = sf_select(higher, was, top);
        best_before[k] = sf_select(higher, earlier, best_before[k]);
        best_after[k] = sf_select(higher, score, best_after[k]);
        best_plane[k] = sf_select(higher, plane - 1.0f, best_plane[k]);
        before[k] = was;
        last[k] = score;
    }
}

static void fill(float *restrict row, size_t width, float value) {
    for (size_t x = 0; x < width; x++) row[x] = value;
}

/* Adds the scores of row y in a plane. */
static void note_row(const sweep *s, int y, float plane) {
    for (size_t x = 0; x < s->width; x += BLOCK) note(block_of(s, y, x), s->first + x, plane);
}

/* Scores of the windows around row y, once its SIDE rows are in the neighbours' rings. */
static void score_row(const sweep *s, int y) {
    fill(s->first, s->width, NO_SCORE);
    fill(s->second, s->width, NO_SCORE);
    for (size_t k = 0; k < s->count; k++) {
        for (int i = 0; i < SUMS; i++) sum_rows(s->ring[k][i], s->width, s->width, s->totals[i]);
        for (size_t x = 0; x < s->width; x += BLOCK)
            correlate(block_of(s, y, x), s->totals[SUM_Y] + x, s->totals[SUM_YY] + x, s->totals[SUM_XY] + x,
                      s->first + x, s->second + x);
    }
    if (s->count > 1) /* the mean of the two best: one neighbour alone may match by chance */
        for (size_t x = 0; x < s->width; x++) s->first[x] = 0.5f * (s->first[x] + s->second[x]);
}

static void sweep_plane(sweep *s, double inverse_depth, int plane) {
    const sf_grey *grey = s->reference;
    for (size_t k = 0; k < s->count; k++)
        for (int i = 0; i < 9; i++)
            s->H[k][i] = (float)(s->to[k].A[i] + (i % 3 == 2 ? inverse_depth * s->to[k].b[i / 3] : 0));
    for (int y = 0; y < grey->camera.height; y++) {
        const float *row = grey->values + (size_t)y * grey->stride + MARGIN;
        float *warped = s->warped + MARGIN;
        size_t slot = (size_t)(y % SIDE) * s->width;
        for (size_t k = 0; k < s->count; k++) {
            warp_row(s->to[k].grey, s->H[k], y, s->width, warped);
            sum_along_row(warped, s->ones + MARGIN, s->width, s->ring[k][SUM_Y] + slot);
            sum_along_row(warped, warped, s->width, s->ring[k][SUM_YY] + slot);
            sum_along_row(warped, row, s->width, s->ring[k][SUM_XY] + slot);
        }
        if (y < SIDE - 1) continue;
        score_row(s, y - RADIUS);
        note_row(s, y - RADIUS, (float)plane);
    }
}

/* The top of the parabola through a peak and its two sides, in planes. */
static double peak_offset(double before, double top, double after) {
    double bend = before - 2 * top + after;
    return bend < 0 ? fmax(-0.5, fmin(0.5, 0.5 * (before - after) / bend)) : 0;
}

static void conclude(const sweep *s, const sf_match_range *range, float *inverse_depth, float *score) {
    size_t width = (size_t)s->reference->camera.width, height = (size_t)s->reference->camera.height;
    double step = (range->last - range->first) / (range->planes - 1);
    for (size_t y = 0; y < height; y++) {
        for (size_t x = 0; x < width; x++) {
            const float *state = block_of(s, (int)y, x) + x % BLOCK;
            float best = state[BEST * BLOCK], before = state[BEST_BEFORE * BLOCK];
            float after = state[BEST_AFTER * BLOCK];
            size_t to = y * width + x;
            inverse_depth[to] = score[to] = 0;
            /* a peak at the first or last plane, or beside a plane without a score, does not count */
            if (best < LEAST_SCORE || best < state[RIVAL * BLOCK] + LEAST_LEAD) continue;
            if (before < -1 || after < -1) continue;
            double plane =
                (double)state[BEST_PLANE * BLOCK] + peak_offset((double)before, (double)best, (double)after);
            inverse_depth[to] = (float)(range->first + step * plane);
            score[to] = fminf(best, 1.0f);
        }
    }
}

void sf_match(const sf_grey *reference, const sf_grey *const *neighbours, size_t count,
              const sf_match_range *range, float *scratch, float *inverse_depth, float *score) {
    sweep s = {.reference = reference, .count = count, .width = padded(reference->camera.width)};
    share_out(&s, scratch);
    measure_reference(&s);
    for (size_t k = 0; k < count; k++) s.to[k] = relate(reference, neighbours[k]);
    for (int plane = 0; plane < range->planes; plane++)
        sweep_plane(&s, range->first + (range->last - range->first) * plane / (range->planes - 1), plane);
    fill(s.first, s.width, NO_SCORE); /* after the last plane, so that a peak there is found */
    for (int y = RADIUS; y < reference->camera.height - RADIUS; y++) note_row(&s, y, (float)range->planes);
    conclude(&s, range, inverse_depth, score);
}
