/* frame_motion.c - see frame_motion.h. */
#include "frame_motion.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Motion is measured in pictures whose longer side has at most so many pixels, */
enum { SIDE = 160 };
/* and from another frame once it is above so many. */
#define FAR 4.0
/* Grey levels: blocks whose values deviate less have no texture. */
#define TEXTURE 3.0
/* Of its deviation: a block that differs more, on average, was not found again. */
#define DIFFERENT 0.8
/* What a pixel of displacement costs, in grey levels summed over a block: of places that fit as well, the
 * nearest. */
enum { COST = 24 };

double sf_frame_sharpness(const uint8_t *pixels, int width, int height) {
    double edges = 0, sum = 0, squares = 0, count = 0;
    if (width < 8 || height < 8) return 0;
    for (int y = 1; y + 1 < height; y++) {
        const uint8_t *p = pixels + (size_t)y * (size_t)width, *above = p - width, *below = p + width;
        uint32_t row_sum = 0;
        uint64_t row_squares = 0, row_edges = 0;
        for (int x = 1; x + 1 < width; x++) {
            int laplacian = 4 * p[x] - p[x - 1] - p[x + 1] - above[x] - below[x];
            row_edges += (uint64_t)(laplacian * laplacian);
            row_sum += p[x], row_squares += (uint32_t)p[x] * p[x];
        }
        edges += (double)row_edges, sum += row_sum, squares += (double)row_squares, count += width - 2;
    }
    double variance = squares / count - pow(sum / count, 2);
    return variance > 0.25 ? edges / count / variance : 0;
}

/* ---- the way of blocks ---- */

/* The standard deviation of a block's values. */
static double texture_of(const uint8_t *block, size_t stride) {
    unsigned sum = 0, squares = 0, n = SF_FRAME_BLOCK * SF_FRAME_BLOCK;
    for (size_t y = 0; y < SF_FRAME_BLOCK; y++)
        for (size_t x = 0; x < SF_FRAME_BLOCK; x++) {
            unsigned value = block[y * stride + x];
            sum += value, squares += value * value;
        }
    return sqrt(fmax((double)squares / n - pow((double)sum / n, 2), 0));
}

static unsigned difference(const uint8_t *a, const uint8_t *b, size_t stride) {
    unsigned sum = 0;
    for (size_t y = 0; y < SF_FRAME_BLOCK; y++) {
        unsigned row = 0;
        for (size_t x = 0; x < SF_FRAME_BLOCK; x++)
            row += (unsigned)abs(a[y * stride + x] - b[y * stride + x]);
        sum += row;
    }
    return sum;
}

static int at_least(int a, int b) { return a > b ? a : b; }
static int at_most(int a, int b) { return a < b ? a : b; }

/* Where the block at x, y of a is in b. Returns the difference there. */
static unsigned find_block(const uint8_t *a, const uint8_t *b, int width, int height, const int at[2],
                           int shift[2]) {
    size_t stride = (size_t)width;
    const uint8_t *block = a + (size_t)at[1] * stride + (size_t)at[0];
    unsigned least = UINT32_MAX, found = 0;
    int x0 = at_least(-SF_FRAME_REACH, -at[0]), y0 = at_least(-SF_FRAME_REACH, -at[1]);
    int x1 = at_most(SF_FRAME_REACH, width - SF_FRAME_BLOCK - at[0]);
    int y1 = at_most(SF_FRAME_REACH, height - SF_FRAME_BLOCK - at[1]);
    for (int dy = y0; dy <= y1; dy++)
        for (int dx = x0; dx <= x1; dx++) {
            unsigned sum =
                difference(block, b + (size_t)(at[1] + dy) * stride + (size_t)(at[0] + dx), stride);
            unsigned cost = sum + COST * (unsigned)(abs(dx) + abs(dy));
            if (cost < least) least = cost, found = sum, shift[0] = dx, shift[1] = dy;
        }
    return found;
}

double sf_frame_displacement(const uint8_t *a, const uint8_t *b, int width, int height) {
    double way = 0;
    size_t seen = 0, found = 0;
    for (int y = 0; y + SF_FRAME_BLOCK <= height; y += SF_FRAME_BLOCK)
        for (int x = 0; x + SF_FRAME_BLOCK <= width; x += SF_FRAME_BLOCK) {
            const int at[2] = {x, y};
            int shift[2] = {0, 0};
            double texture = texture_of(a + (size_t)y * (size_t)width + (size_t)x, (size_t)width);
            if (texture < TEXTURE) continue;
            seen++;
            double differs = find_block(a, b, width, height, at, shift);
            if (differs > DIFFERENT * texture * SF_FRAME_BLOCK * SF_FRAME_BLOCK) continue;
            found++;
            way += hypot(shift[0], shift[1]);
        }
    if (!seen) return 0;
    return 4 * found < seen ? SF_FRAME_REACH : way / (double)found;
}

/* ---- frames in their order ---- */

void sf_frame_judge_begin(sf_frame_judge *judge, sf_context *ctx) { *judge = (sf_frame_judge){.ctx = ctx}; }

void sf_frame_judge_end(sf_frame_judge *judge) {
    sf_free(judge->ctx, judge->anchor);
    sf_free(judge->ctx, judge->frame);
    sf_frame_judge_begin(judge, judge->ctx);
}

/* The means of factor x factor pixels. */
static void reduce(const uint8_t *pixels, size_t stride, int factor, uint8_t *to, int width, int height) {
    size_t n = (size_t)factor;
    for (size_t y = 0; y < (size_t)height; y++)
        for (size_t x = 0; x < (size_t)width; x++) {
            unsigned sum = 0;
            for (size_t j = 0; j < n; j++)
                for (size_t i = 0; i < n; i++) sum += pixels[(y * n + j) * stride + x * n + i];
            to[y * (size_t)width + x] = (uint8_t)((sum + n * n / 2) / (n * n));
        }
}

/* Room for pictures of another size than those before: nothing is known of the way between the two. */
static sf_status resize(sf_frame_judge *j, int width, int height) {
    sf_free(j->ctx, j->anchor);
    sf_free(j->ctx, j->frame);
    size_t pixels = (size_t)width * (size_t)height;
    j->anchor = sf_alloc(j->ctx, pixels + 1, 1);
    j->frame = sf_alloc(j->ctx, pixels + 1, 1);
    j->path = j->last;
    j->width = width, j->height = height;
    return j->anchor && j->frame ? SF_OK : SF_ERR_MEMORY;
}

sf_status sf_frame_judge_next(sf_frame_judge *j, const uint8_t *pixels, int width, int height,
                              sf_frame_judged *judged) {
    int longer = width > height ? width : height, factor = (longer + SIDE - 1) / SIDE;
    int first = j->width != width / factor || j->height != height / factor;
    sf_status status = first ? resize(j, width / factor, height / factor) : SF_OK;
    if (status) return status;
    reduce(pixels, (size_t)width, factor, first ? j->anchor : j->frame, j->width, j->height);
    double moved = first ? 0 : sf_frame_displacement(j->anchor, j->frame, j->width, j->height);
    double part = moved * factor / (longer > 0 ? longer : 1);
    j->last = fmax(j->last, j->path + part);
    *judged = (sf_frame_judged){.sharpness = sf_frame_sharpness(pixels, width, height), .path = j->last};
    if (moved < FAR) return SF_OK;
    uint8_t *before = j->anchor;
    j->anchor = j->frame, j->frame = before;
    j->path = j->last;
    return SF_OK;
}
