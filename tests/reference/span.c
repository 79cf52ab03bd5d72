/* span.c - the tiles of a row that a Gaussian must and may be listed in (M.1, extent). */
#include "bounds.h"

/* Beyond the ellipse, px. */
static const double MARGIN = 0.01;

/* Where t^2 + s^2 <= r2k: at offset dy from the mean, slope dy +- sqrt(r2k - m^2 dy^2) / l00. */
typedef struct ellipse {
    double u, v, slope, m, l00, r2k, height;
} ellipse;

static ellipse ellipse_of(const sf_splat *s, double more) {
    double r2k = fmax((double)s->log2_opacity + log2(255) + more, 0);
    return (ellipse){(double)s->u,   (double)s->v, -(double)s->l01 / (double)s->l00, (double)s->m,
                     (double)s->l00, r2k,          sqrt(r2k) / (double)s->m};
}

static double half_width(const ellipse *e, double dy) {
    return sqrt(fmax(e->r2k - e->m * e->m * dy * dy, 0)) / e->l00;
}

/* What rounding to float32 may move a boundary by, px. */
static double rounding(const ellipse *e, double dy) {
    return 8 * FLOAT_UNIT * (fabs(e->u) + 2 * fabs(e->slope * dy) + sqrt(e->r2k) / e->l00);
}

static void clip(double first, double last, int tiles_x, test_ref_span *span) {
    first = fmax(first, 0), last = fmin(last, tiles_x - 1);
    *span = first <= last ? (test_ref_span){(int)first, (int)last + 1} : (test_ref_span){0, 0};
}

static void needed_of(const sf_splat *s, int row, int tiles_x, test_ref_span *needed) {
    ellipse e = ellipse_of(s, -128 * FLOAT_UNIT);
    double first = INFINITY, last = -INFINITY;
    for (int y = row * SF_TILE; y < (row + 1) * SF_TILE; y++) {
        double dy = y + 0.5 - e.v, half = half_width(&e, dy), less = rounding(&e, dy);
        if (fabs(dy) > e.height * (1 - 8 * FLOAT_UNIT)) continue;
        double from = ceil(e.u + e.slope * dy - half + less - 0.5),
               to = floor(e.u + e.slope * dy + half - less - 0.5);
        from = fmax(from, 0), to = fmin(to, SF_TILE * (double)tiles_x - 1);
        if (from > to) continue;
        first = fmin(first, floor(from / SF_TILE)), last = fmax(last, floor(to / SF_TILE));
    }
    clip(first, last, tiles_x, needed);
}

void test_ref_span_row(const sf_splat *s, int row, int tiles_x, test_ref_span *needed,
                       test_ref_span *allowed) {
    needed_of(s, row, tiles_x, needed);
    ellipse e = ellipse_of(s, 128 * FLOAT_UNIT);
    double more = MARGIN + 8 * FLOAT_UNIT * (fabs(e.v) + e.height + row * SF_TILE),
           top = row * SF_TILE + 0.5 - e.v;
    double low = fmax(top - more, -e.height - more), high = fmin(top + SF_TILE - 1 + more, e.height + more);
    double left = INFINITY, right = -INFINITY;
    /* the right boundary is concave, with its peak here; the left one mirrors it */
    double peak = e.slope * e.l00 * e.height / sqrt(e.m * e.m + e.slope * e.slope * e.l00 * e.l00);
    const double at[4] = {low, high, fmin(fmax(peak, low), high), fmin(fmax(-peak, low), high)};
    for (int k = 0; low <= high && k < 4; k++) {
        double beyond = MARGIN + rounding(&e, at[k]), half = half_width(&e, at[k]);
        left = fmin(left, e.u + e.slope * at[k] - half - beyond);
        right = fmax(right, e.u + e.slope * at[k] + half + beyond);
    }
    clip(ceil((left - (SF_TILE - 0.5)) / SF_TILE), floor((right - 0.5) / SF_TILE), tiles_x, allowed);
}
