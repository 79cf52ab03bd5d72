/* patch.c - see patch.h: the alignment of Lucas and Kanade, with a gain and a bias. */
#include "patch.h"

#include <math.h>
#include <string.h>

#include "../base/linear.h"

enum {
    SIDE = 2 * SF_PATCH_REACH + 1,
    PIXELS = SIDE * SIDE,
    WIDE = SIDE + 2, /* one px more around, for the slopes */
    ROUNDS = 12,
    UNKNOWNS = 4, /* displacement, gain, bias */
    CORNER_REACH = 3
};

#define STILL          0.01 /* px: a step that moves less is the last */
#define FARTHEST       6.0  /* px of a level: what moved more was not found */
#define LEAST_CONTRAST 1e-5f

/* 1. Pictures in several sizes */

static void halve(const float *from, int width, float *to, int to_width, int to_height) {
    for (int y = 0; y < to_height; y++)
        for (int x = 0; x < to_width; x++) {
            const float *p = from + (size_t)(2 * y) * (size_t)width + 2 * x;
            to[(size_t)y * (size_t)to_width + (size_t)x] = 0.25f * (p[0] + p[1] + p[width] + p[width + 1]);
        }
}

sf_status sf_pyramid_make(sf_context *ctx, const sf_camera *camera, float *const rgb[3], size_t stride,
                          sf_pyramid *p) {
    int width = camera->width, height = camera->height;
    for (int i = 0; i < SF_PYRAMID_LEVELS; i++, width /= 2, height /= 2) {
        size_t pixels = (size_t)width * (size_t)height;
        sf_status status = sf_grow(ctx, &p->levels[i].grey, &p->levels[i].capacity, 0, pixels, sizeof(float));
        if (status) return status;
        p->levels[i].width = width, p->levels[i].height = height;
        if (i) halve(p->levels[i - 1].grey, p->levels[i - 1].width, p->levels[i].grey, width, height);
        for (size_t y = 0; !i && y < (size_t)height; y++)
            for (size_t x = 0; x < (size_t)width; x++) {
                size_t at = y * stride + x;
                p->levels[0].grey[y * (size_t)width + x] = sf_grey(rgb[0][at], rgb[1][at], rgb[2][at]);
            }
    }
    return SF_OK;
}

void sf_pyramid_free(sf_context *ctx, sf_pyramid *p) {
    for (int i = 0; i < SF_PYRAMID_LEVELS; i++) sf_free(ctx, p->levels[i].grey);
    *p = (sf_pyramid){0};
}

/* Whether all within `reach` px of a point can be looked up. */
static int has_room(const sf_pyramid *p, int level, double u, double v, double reach) {
    return u - reach >= 0.5 && v - reach >= 0.5 && u + reach < p->levels[level].width - 0.5 &&
           v + reach < p->levels[level].height - 0.5;
}

/* The picture between its pixels; there is room. */
static double look_up(const sf_pyramid *p, int level, double u, double v) {
    int x = (int)(u - 0.5), y = (int)(v - 0.5), width = p->levels[level].width;
    const float *g = p->levels[level].grey + (size_t)y * (size_t)width + x;
    double a = u - 0.5 - x, b = v - 0.5 - y;
    double top = (double)g[0] + a * (double)(g[1] - g[0]);
    double bottom = (double)g[width] + a * (double)(g[width + 1] - g[width]);
    return top + b * (bottom - top);
}

/* 2. Patches */

int sf_patch_cut(const sf_pyramid *p, double u, double v, sf_patch *patch) {
    if (!has_room(p, 0, u, v, SF_PATCH_REACH + 1)) return 0;
    for (int level = 0; level < SF_PYRAMID_LEVELS; level++) {
        double at_u = ldexp(u, -level), at_v = ldexp(v, -level);
        double last_u = p->levels[level].width - 0.51, last_v = p->levels[level].height - 0.51;
        uint8_t *to = patch->grey[level];
        for (int y = -SF_STORED_REACH; y <= SF_STORED_REACH; y++)
            for (int x = -SF_STORED_REACH; x <= SF_STORED_REACH; x++) {
                double grey =
                    look_up(p, level, fmin(fmax(at_u + x, 0.5), last_u), fmin(fmax(at_v + y, 0.5), last_v));
                *to++ = (uint8_t)(255 * fmin(fmax(grey, 0), 1) + 0.5);
            }
    }
    return 1;
}

/* The patch as it should look here. 0: it does not reach so far. */
static int warp(const sf_patch *patch, int level, const double back[4], float *to) {
    const uint8_t *from = patch->grey[level];
    double reach = SF_PATCH_REACH + 1, most = SF_STORED_REACH - 1e-9;
    if (!((fabs(back[0]) + fabs(back[1])) * reach < most && (fabs(back[2]) + fabs(back[3])) * reach < most))
        return 0;
    for (int y = -SF_PATCH_REACH - 1; y <= SF_PATCH_REACH + 1; y++)
        for (int x = -SF_PATCH_REACH - 1; x <= SF_PATCH_REACH + 1; x++) {
            double u = back[0] * x + back[1] * y + SF_STORED_REACH;
            double v = back[2] * x + back[3] * y + SF_STORED_REACH;
            int i = (int)u, j = (int)v;
            const uint8_t *p = from + j * SF_STORED_SIDE + i;
            float a = (float)(u - i), b = (float)(v - j), top = p[0] + a * (float)(p[1] - p[0]);
            float bottom = p[SF_STORED_SIDE] + a * (float)(p[SF_STORED_SIDE + 1] - p[SF_STORED_SIDE]);
            *to++ = (top + b * (bottom - top)) / 255;
        }
    return 1;
}

/* What stays the same from round to round: the patch, its slopes, and the normal equations. */
typedef struct alignment {
    float value[PIXELS], across[PIXELS], down[PIXELS]; /* greys, from 0.5 on */
    double L[UNKNOWNS * UNKNOWNS];
    float mean, variance;
} alignment;

static int prepare(const float *wide, alignment *a) {
    float sum = 0, squares = 0, xx = 0, xy = 0, yy = 0, xv = 0, yv = 0, x1 = 0, y1 = 0;
    for (int y = 0, i = 0; y < SIDE; y++)
        for (int x = 0; x < SIDE; x++, i++) {
            const float *at = wide + (y + 1) * WIDE + x + 1;
            float value = *at - 0.5f, dx = (at[1] - at[-1]) / 2, dy = (at[WIDE] - at[-WIDE]) / 2;
            a->value[i] = value, a->across[i] = dx, a->down[i] = dy;
            sum += value, squares += value * value;
            xx += dx * dx, xy += dx * dy, yy += dy * dy;
            xv += dx * value, yv += dy * value, x1 += dx, y1 += dy;
        }
    a->mean = sum / PIXELS;
    a->variance = squares / PIXELS - a->mean * a->mean;
    const float A[UNKNOWNS * UNKNOWNS] = {xx, 0, 0, 0, xy, yy, 0, 0, xv, yv, squares, 0, x1, y1, sum, PIXELS};
    for (int k = 0; k < UNKNOWNS * UNKNOWNS; k++) a->L[k] = (double)A[k] * (k % 5 ? 1 : 1 + 1e-6);
    return a->variance > LEAST_CONTRAST && sf_cholesky(UNKNOWNS, a->L);
}

/* The picture around a point, between its pixels; there is room. Returns how well it correlates. */
static double sample(const sf_pyramid *p, int level, double u, double v, const alignment *at,
                     float *picture) {
    int x = (int)(u - 0.5), y = (int)(v - 0.5), width = p->levels[level].width;
    const float *from =
        p->levels[level].grey + (size_t)(y - SF_PATCH_REACH) * (size_t)width + x - SF_PATCH_REACH;
    float a = (float)(u - 0.5 - x), b = (float)(v - 0.5 - y), sum = 0, squares = 0, both = 0;
    const float w[4] = {(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b};
    for (int j = 0; j < SIDE; j++, from += width)
        for (int i = 0; i < SIDE; i++)
            picture[j * SIDE + i] =
                w[0] * from[i] + w[1] * from[i + 1] + w[2] * from[i + width] + w[3] * from[i + width + 1];
    for (int i = 0; i < PIXELS; i++) {
        float value = picture[i] - 0.5f; /* greys around 0 lose less */
        sum += value, squares += value * value, both += value * at->value[i];
    }
    float mean = sum / PIXELS, variance = squares / PIXELS - mean * mean;
    return variance > LEAST_CONTRAST
               ? (double)(both / PIXELS - mean * at->mean) / sqrt((double)(variance * at->variance))
               : -1;
}

/* A step of Gauss and Newton: J^T r, for what the picture is beyond gain x patch + bias. */
static void descend(const alignment *at, const float *picture, double gain, double bias, double g[UNKNOWNS]) {
    float sums[UNKNOWNS] = {0}, scale = (float)gain, offset = (float)bias + 0.5f;
    for (int i = 0; i < PIXELS; i++) {
        float r = picture[i] - scale * at->value[i] - offset;
        sums[0] -= at->across[i] * r, sums[1] -= at->down[i] * r;
        sums[2] -= at->value[i] * r, sums[3] -= r;
    }
    for (int k = 0; k < UNKNOWNS; k++) g[k] = (double)sums[k];
    sf_cholesky_solve(UNKNOWNS, at->L, g);
}

static double find_at_level(const sf_pyramid *p, const sf_patch *patch, int level, const double back[4],
                            double *u, double *v) {
    double gain = 1, bias = 0, from_u = *u, from_v = *v, like = -2;
    float wide[WIDE * WIDE], picture[PIXELS];
    alignment at;
    if (!warp(patch, level, back, wide) || !prepare(wide, &at)) return -2;
    for (int round = 0; round < ROUNDS; round++) {
        double g[UNKNOWNS];
        if (!has_room(p, level, *u, *v, SF_PATCH_REACH) ||
            !(fabs(*u - from_u) < FARTHEST && fabs(*v - from_v) < FARTHEST))
            return -2;
        like = sample(p, level, *u, *v, &at, picture);
        descend(&at, picture, gain, bias, g);
        gain = fmin(fmax(gain - g[2], 0.2), 5), bias -= g[3];
        *u += g[0] / gain, *v += g[1] / gain;
        if (fabs(g[0]) + fabs(g[1]) < STILL * gain) return like;
    }
    return level ? like : -2; /* coarse ones are a start */
}

double sf_patch_find(const sf_pyramid *p, const sf_patch *patch, const double back[4], int coarsest,
                     double *u, double *v) {
    double like = -2;
    for (int level = coarsest; level >= 0; level--) {
        double at_u = ldexp(*u, -level), at_v = ldexp(*v, -level);
        like = find_at_level(p, patch, level, back, &at_u, &at_v);
        if (like < -1 && level) continue; /* near the edge of the picture */
        *u = ldexp(at_u, level), *v = ldexp(at_v, level);
    }
    return like;
}

/* 3. Corners */

void sf_cornerness(const sf_pyramid *p, int y, float *cornerness) {
    enum { BLOCK = 64, WITH_REACH = BLOCK + 2 * CORNER_REACH };
    int width = p->levels[0].width, end = width - CORNER_REACH - 1;
    const float n = (2 * CORNER_REACH + 1) * (2 * CORNER_REACH + 1);
    for (int x = 0; x < width; x++) cornerness[x] = 0;
    if (y <= CORNER_REACH || y + CORNER_REACH + 1 >= p->levels[0].height) return;
    for (int first = CORNER_REACH + 1; first < end; first += BLOCK) {
        float xx[WITH_REACH] = {0}, xy[WITH_REACH] = {0}, yy[WITH_REACH] = {0}; /* sums along columns */
        int count = end - first < BLOCK ? end - first : BLOCK;
        for (int j = y - CORNER_REACH; j <= y + CORNER_REACH; j++) {
            const float *g = p->levels[0].grey + (size_t)j * (size_t)width + first - CORNER_REACH;
            const float *above = g - width, *below = g + width, *left = g - 1, *right = g + 1;
            for (int i = 0; i < count + 2 * CORNER_REACH; i++) {
                float dx = 0.5f * (right[i] - left[i]), dy = 0.5f * (below[i] - above[i]);
                xx[i] += dx * dx, xy[i] += dx * dy, yy[i] += dy * dy;
            }
        }
        for (int k = 0; k < count; k++) {
            float a = 0, b = 0, c = 0;
            for (int i = k; i <= k + 2 * CORNER_REACH; i++) a += xx[i], b += xy[i], c += yy[i];
            float half = 0.5f * (a - c);
            cornerness[first + k] = (0.5f * (a + c) - sqrtf(half * half + b * b)) / n;
        }
    }
}
