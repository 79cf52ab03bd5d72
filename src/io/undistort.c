/* undistort.c - see undistort.h. */
#include "undistort.h"

#include <math.h>

int sf_lens_is_distorted(const sf_lens *lens) {
    return lens->k1 != 0 || lens->k2 != 0 || lens->p1 != 0 || lens->p2 != 0;
}

int sf_lens_is_valid(const sf_lens *lens) {
    return isfinite(lens->fx) && isfinite(lens->fy) && isfinite(lens->cx) && isfinite(lens->cy) &&
           isfinite(lens->k1) && isfinite(lens->k2) && isfinite(lens->p1) && isfinite(lens->p2) &&
           lens->fx > 0 && lens->fy > 0;
}

/* The least positive root of the derivative of r d(r), 1 + 3 k1 r2 + 5 k2 r2^2. */
double sf_lens_limit(const sf_lens *lens) {
    double a = 5 * lens->k2, b = 3 * lens->k1, inside = b * b - 4 * a;
    if (a == 0) return b < 0 ? -1 / b : INFINITY;
    if (inside < 0) return INFINITY;
    /* q has the sign of -b: no cancellation. The roots are q/a and 1/q; their product is 1/a. */
    double q = b < 0 ? (-b + sqrt(inside)) / 2 : (-b - sqrt(inside)) / 2;
    double first = q / a, second = 1 / q, least = INFINITY;
    if (first > 0) least = first;
    if (second > 0 && second < least) least = second;
    return least;
}

/* Where a pixel of the new picture comes from: four taps and their weights. */
typedef struct taps {
    size_t at[4];
    double part[4];
} taps;

int sf_lens_source(const sf_lens *lens, double limit, double u, double v, double source[2]) {
    double x = (u - lens->cx) / lens->fx, y = (v - lens->cy) / lens->fy, r2 = x * x + y * y;
    if (!(r2 < limit)) return 0;
    double d = 1 + r2 * (lens->k1 + r2 * lens->k2);
    double xd = x * d + 2 * lens->p1 * x * y + lens->p2 * (r2 + 2 * x * x);
    double yd = y * d + 2 * lens->p2 * x * y + lens->p1 * (r2 + 2 * y * y);
    source[0] = lens->fx * xd + lens->cx - 0.5;
    source[1] = lens->fy * yd + lens->cy - 0.5;
    return 1;
}

static int find_taps(const sf_picture *p, const double source[2], taps *t) {
    if (!(source[0] >= 0 && source[1] >= 0 && source[0] <= p->width - 1 && source[1] <= p->height - 1))
        return 0;
    size_t left = (size_t)source[0], top = (size_t)source[1], width = (size_t)p->width;
    size_t right = left + 1 < width ? left + 1 : left, bottom = top + 1 < (size_t)p->height ? top + 1 : top;
    double h = source[0] - (double)left, v = source[1] - (double)top;
    *t = (taps){{top * width + left, top * width + right, bottom * width + left, bottom * width + right},
                {(1 - h) * (1 - v), h * (1 - v), (1 - h) * v, h * v}};
    return 1;
}

/* Colours are averaged by their weights: what a mask hides must not seep into what it shows. */
static void resample(const sf_picture *from, taps *t, const sf_picture *to, size_t at) {
    size_t plane = (size_t)from->width * (size_t)from->height;
    double total = 1;
    if (from->weight) {
        double sum = 0;
        for (int i = 0; i < 4; i++) sum += t->part[i] * from->weight[t->at[i]];
        to->weight[at] = (uint8_t)(sum + 0.5);
        if (sum > 0) {
            for (int i = 0; i < 4; i++) t->part[i] *= from->weight[t->at[i]];
            total = sum;
        }
    } else {
        to->weight[at] = 255;
    }
    for (size_t c = 0; c < 3; c++) {
        const uint8_t *source = from->rgb + c * plane;
        double sum = 0;
        for (int i = 0; i < 4; i++) sum += t->part[i] * source[t->at[i]];
        to->rgb[c * plane + at] = (uint8_t)(sum / total + 0.5);
    }
}

static void resample_all(const sf_lens *lens, const sf_picture *from, const sf_picture *to) {
    size_t width = (size_t)from->width, plane = width * (size_t)from->height;
    double limit = sf_lens_limit(lens);
    for (size_t at = 0; at < plane; at++) {
        double source[2];
        taps t;
        if (sf_lens_source(lens, limit, (double)(at % width) + 0.5, (double)(at / width) + 0.5, source) &&
            find_taps(from, source, &t)) {
            resample(from, &t, to, at);
        } else {
            to->weight[at] = 0;
            for (size_t c = 0; c < 3; c++) to->rgb[c * plane + at] = 0;
        }
    }
}

sf_status sf_undistort(sf_context *ctx, const sf_lens *lens, sf_picture *picture) {
    size_t plane = (size_t)picture->width * (size_t)picture->height;
    sf_picture to = *picture;
    to.rgb = sf_alloc(ctx, plane, 3);
    to.weight = sf_alloc(ctx, plane, 1);
    if (!to.rgb || !to.weight) {
        sf_picture_free(ctx, &to);
        return SF_ERR_MEMORY;
    }
    resample_all(lens, picture, &to);
    sf_picture_free(ctx, picture);
    *picture = to;
    return SF_OK;
}
