/* describe.c - directions and descriptors of the points found in an octave. */
#include "describe.h"

#include <math.h>
#include <string.h>

#include "elementary.h"

#define TURN 6.28318530717958647692

/* Samples are so many deviations apart: 15 gradients reach over 9 deviations for the direction, over 15, five
 * cells of three, for the descriptor. */
#define ORIENT_STEP   0.6
#define DESCRIBE_STEP 1.0

enum { MOST_DIRECTIONS = 2 };

sf_status sf_spots_add(sf_context *ctx, sf_spots *spots, const sf_spot *spot) {
    sf_status status =
        sf_grow(ctx, &spots->items, &spots->capacity, spots->count, spots->count + 1, sizeof *spot);
    if (!status) spots->items[spots->count++] = *spot;
    return status;
}

/* ---- blocks of points -----------------------------------------------------------------------------------
 */

/* Points with a direction, and the rows they are in. */
typedef struct block {
    sf_patch_args patch;
    sf_keypoint points[SF_LANES];
} block;

static void open_block(block *b, const sf_describe_args *args, const sf_band *level) {
    memset(b, 0, sizeof *b);
    b->patch = (sf_patch_args){.pixels = level->rows,
                               .stride = level->stride,
                               .width = args->width,
                               .height = level->end - level->first,
                               .out = args->sums};
}

static void put_point(block *b, const sf_spot *spot, int first_row, double a, double across) {
    size_t lane = b->patch.count++;
    b->patch.x[lane] = spot->x;
    b->patch.y[lane] = spot->y - (float)first_row;
    b->patch.a[lane] = (float)a;
    b->patch.b[lane] = (float)across;
}

/* ---- directions (S.4) -----------------------------------------------------------------------------------
 */

static void smooth(float h[SF_ORIENTATIONS]) {
    for (int pass = 0; pass < 6; pass++) {
        float first = h[0], before = h[SF_ORIENTATIONS - 1];
        for (int k = 0; k < SF_ORIENTATIONS; k++) {
            float after = k + 1 < SF_ORIENTATIONS ? h[k + 1] : first, sum = before + h[k] + after;
            before = h[k];
            h[k] = sum * (1 / 3.0f);
        }
    }
}

typedef struct peak {
    double angle;
    float height;
} peak;

static peak peak_at(const float *h, int k) {
    double left = (double)h[(k + SF_ORIENTATIONS - 1) % SF_ORIENTATIONS], here = (double)h[k];
    double right = (double)h[(k + 1) % SF_ORIENTATIONS];
    double place = k + (left - right) / 2 / (left - 2 * here + right); /* of the parabola */
    return (peak){(place < 0 ? place + SF_ORIENTATIONS : place) * (TURN / SF_ORIENTATIONS), h[k]};
}

/* The two highest peaks, the second no lower than 0.8 of the first. Returns how many. */
static int find_peaks(const float *h, peak peaks[MOST_DIRECTIONS]) {
    peaks[0] = peaks[1] = (peak){0};
    for (int k = 0; k < SF_ORIENTATIONS; k++) {
        float left = h[(k + SF_ORIENTATIONS - 1) % SF_ORIENTATIONS], right = h[(k + 1) % SF_ORIENTATIONS];
        if (!(h[k] > left && h[k] >= right)) continue;
        peak p = peak_at(h, k);
        if (p.height > peaks[0].height)
            peaks[1] = peaks[0], peaks[0] = p;
        else if (p.height > peaks[1].height)
            peaks[1] = p;
    }
    return (peaks[0].height > 0) + (peaks[0].height > 0 && peaks[1].height > 0.8f * peaks[0].height);
}

/* ---- descriptors (S.6) ----------------------------------------------------------------------------------
 */

/* Of length 1, no number above 0.2, then the roots of what sums to 1, in parts of 512. */
static void finish(const float *sums, size_t lane, uint8_t *descriptor) {
    float v[SF_DESCRIPTOR], squares = 0, total = 0;
    for (int k = 0; k < SF_DESCRIPTOR; k++) {
        v[k] = sums[(size_t)k * SF_LANES + lane];
        squares += v[k] * v[k];
    }
    float most = 0.2f * sqrtf(squares);
    for (int k = 0; k < SF_DESCRIPTOR; k++) {
        v[k] = v[k] < most ? v[k] : most;
        total += v[k];
    }
    float scale = total > 0 ? 512.0f * 512.0f / total : 0;
    for (int k = 0; k < SF_DESCRIPTOR; k++) {
        float root = sqrtf(v[k] * scale) + 0.5f;
        descriptor[k] = (uint8_t)(root < SF_MATCH_MOST ? root : SF_MATCH_MOST);
    }
}

static sf_status describe_block(const sf_describe_args *args, block *b) {
    if (!b->patch.count) return SF_OK;
    args->kernels->describe(&b->patch);
    for (size_t lane = 0; lane < b->patch.count; lane++) {
        uint8_t *descriptor = sf_feature_list_add(args->list, &b->points[lane]);
        if (!descriptor) return SF_ERR_MEMORY;
        finish(args->sums, lane, descriptor);
    }
    b->patch.count = 0;
    return SF_OK;
}

static sf_keypoint keypoint_of(const sf_describe_args *args, const sf_spot *spot, double angle) {
    return (sf_keypoint){.x = (float)(spot->x * args->step + 0.5),
                         .y = (float)(spot->y * args->step + 0.5),
                         .scale = (float)(spot->scale * args->step),
                         .angle = (float)angle,
                         .response = spot->response};
}

/* Adds the point with each of its directions to a block, which is described when it is full. */
static sf_status turn_point(const sf_describe_args *args, const sf_band *level, const sf_spot *spot,
                            float histogram[SF_ORIENTATIONS], block *b) {
    peak peaks[MOST_DIRECTIONS];
    smooth(histogram);
    int count = find_peaks(histogram, peaks);
    for (int i = 0; i < count && i < args->directions; i++) {
        double c, s, step = DESCRIBE_STEP * (double)spot->scale;
        sf_plain_turn(peaks[i].angle, &c, &s);
        b->points[b->patch.count] = keypoint_of(args, spot, peaks[i].angle);
        put_point(b, spot, level->first, step * c, step * s);
        sf_status status = b->patch.count == SF_LANES ? describe_block(args, b) : SF_OK;
        if (status) return status;
    }
    return SF_OK;
}

/* Whether the rows hold all that the descriptor sees, as far as the picture goes. */
static int is_ready(const sf_describe_args *args, const sf_band *level, const sf_spot *spot) {
    return level->end == args->height || spot->y + SF_DESCRIBE_REACH < (float)level->end;
}

sf_status sf_describe(const sf_describe_args *args, const sf_band *level, sf_spots *spots) {
    float histograms[SF_LANES][SF_ORIENTATIONS];
    block unturned, turned;
    size_t waiting = 0, next = 0;
    sf_status status = SF_OK;
    open_block(&turned, args, level);
    while (next < spots->count && !status) {
        sf_spot ready[SF_LANES];
        open_block(&unturned, args, level);
        for (; next < spots->count && unturned.patch.count < SF_LANES; next++) {
            sf_spot spot = spots->items[next];
            if (!is_ready(args, level, &spot)) {
                spots->items[waiting++] = spot;
                continue;
            }
            ready[unturned.patch.count] = spot;
            put_point(&unturned, &spot, level->first, ORIENT_STEP * (double)spot.scale, 0);
        }
        if (!unturned.patch.count) break;
        args->kernels->orient(&unturned.patch);
        for (size_t lane = 0; lane < unturned.patch.count; lane++)
            for (int k = 0; k < SF_ORIENTATIONS; k++)
                histograms[lane][k] = args->sums[(size_t)k * SF_LANES + lane];
        for (size_t lane = 0; lane < unturned.patch.count && !status; lane++)
            status = turn_point(args, level, &ready[lane], histograms[lane], &turned);
    }
    spots->count = waiting;
    return status ? status : describe_block(args, &turned);
}
