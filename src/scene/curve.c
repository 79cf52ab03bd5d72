/* curve.c - sorts points along a space-filling curve. */
#include "curve.h"

#include <math.h>
#include <string.h>

#include "../base/pool.h"
#include "../base/statistics.h"
#include "../kernels/kernels.h"

/* Sort key: the class, then the position on the curve. */
enum { AXIS_BITS = 20, CLASS_AT = 60, CLASSES = 16 };

enum { SAMPLES = 4096, REACH = 1024 }; /* of the curve's cube: see bound */

enum { TASK = 256 * SF_LANES /* points */, RUN = 1 << 14 /* that is sorted in a cache */ };
enum { DIGIT_BITS = 8, DIGITS = 1 << DIGIT_BITS, PASSES = 8 };
_Static_assert(PASSES *DIGIT_BITS >= 64, "the passes of the sort reach all bits of a key");

typedef struct place {
    uint64_t code;
    uint32_t index;
} place;

/* Spreads the bits of a number, with two zeros between each. */
static uint64_t spread(uint64_t x) {
    x = (x | x << 32) & 0x1f00000000ffff;
    x = (x | x << 16) & 0x1f0000ff0000ff;
    x = (x | x << 8) & 0x100f00f00f00f00f;
    x = (x | x << 4) & 0x10c30c30c30c30c3;
    return (x | x << 2) & 0x1249249249249249;
}

/* A cube of cells; what lies outside belongs to the cells at its sides. */
typedef struct cube {
    double least[3], side;
} cube;

/* The middle of the points along an axis, and how far from it they usually are; of up to SAMPLES of them. */
static void measure(const float *xyz, size_t n, int axis, double *middle, double *usual) {
    float values[SAMPLES];
    size_t samples = n < SAMPLES ? n : SAMPLES, count = 0;
    for (size_t i = 0; i < samples; i++) {
        values[count] = xyz[3 * (size_t)((double)i * (double)n / (double)samples) + (size_t)axis];
        count += isfinite(values[count]) != 0;
    }
    *middle = (double)sf_medianf(values, count);
    for (size_t i = 0; i < count; i++) values[i] = fabsf(values[i] - (float)*middle);
    *usual = (double)sf_medianf(values, count);
}

/* The bounding cube of all points, but no more than REACH times what is usual: with points very far from all
 * others, the rest would share a cell. */
static cube bound(const float *xyz, size_t n) {
    double most[3] = {-INFINITY, -INFINITY, -INFINITY}, middle[3], usual[3], reach = 0;
    cube c = {.least = {INFINITY, INFINITY, INFINITY}};
    for (size_t i = 0; i < 3 * n; i += 3)
        for (size_t k = 0; k < 3; k++) { /* NaN is neither */
            double at = (double)xyz[i + k];
            if (at < c.least[k]) c.least[k] = at;
            if (at > most[k]) most[k] = at;
        }
    for (int k = 0; k < 3; k++) {
        measure(xyz, n, k, &middle[k], &usual[k]);
        reach = fmax(reach, REACH * usual[k]);
    }
    for (int k = 0; k < 3; k++) {
        if (reach > 0 && isfinite(reach)) {
            c.least[k] = fmax(c.least[k], middle[k] - reach);
            most[k] = fmin(most[k], middle[k] + reach);
        }
        c.side = fmax(c.side, most[k] - c.least[k]);
    }
    return c;
}

/* Cells of SF_LANES points, by axis. */
typedef uint32_t cells[3][SF_LANES];

/* Turns cells into where they are on Hilbert's curve through a cube of 2^AXIS_BITS cells a side, bits by
 * axis (Skilling 2004, "Programming the Hilbert curve"). Unlike the Z-curve it never jumps. No branches, and
 * lanes innermost, so that compilers vectorise it. */
static void follow_curve(cells c) {
    for (int b = AXIS_BITS - 1; b > 0; b--)
        for (int i = 0; i < SF_LANES; i++) {
            const uint32_t below = (1u << b) - 1;
            uint32_t x = c[0][i], y = c[1][i], z = c[2][i];
            x ^= (0u - (x >> b & 1)) & below;
            uint32_t set = 0u - (y >> b & 1), swapped = ~set & (x ^ y) & below;
            x ^= (set & below) | swapped;
            y ^= swapped;
            set = 0u - (z >> b & 1);
            swapped = ~set & (x ^ z) & below;
            x ^= (set & below) | swapped;
            z ^= swapped;
            c[0][i] = x, c[1][i] = y, c[2][i] = z;
        }
    uint32_t flip[SF_LANES] = {0};
    for (int i = 0; i < SF_LANES; i++) {
        c[1][i] ^= c[0][i];
        c[2][i] ^= c[1][i];
    }
    for (int b = AXIS_BITS - 1; b > 0; b--)
        for (int i = 0; i < SF_LANES; i++) flip[i] ^= (0u - (c[2][i] >> b & 1)) & ((1u << b) - 1);
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < SF_LANES; i++) c[k][i] ^= flip[i];
}

typedef struct places_job {
    const float *xyz;
    const uint8_t *classes;
    size_t n;
    cube cube;
    place *places;
} places_job;

static void places_task(void *job_pointer, size_t task, int thread) {
    (void)thread;
    const places_job *job = job_pointer;
    const double most = (1 << AXIS_BITS) - 1, scale = job->cube.side > 0 ? most / job->cube.side : 0;
    size_t end = (task + 1) * TASK < job->n ? (task + 1) * TASK : job->n;
    for (size_t first = task * TASK; first < end; first += SF_LANES) {
        cells c = {{0}};
        size_t lanes = end - first < SF_LANES ? end - first : SF_LANES;
        for (size_t i = 0; i < lanes; i++)
            for (size_t k = 0; k < 3; k++) {
                double at = scale * ((double)job->xyz[3 * (first + i) + k] - job->cube.least[k]);
                at = at > 0 ? at : 0; /* NaN becomes 0 */
                c[k][i] = (uint32_t)(at < most ? at : most);
            }
        follow_curve(c);
        for (size_t i = 0; i < lanes; i++) {
            uint64_t code = spread(c[0][i]) << 2 | spread(c[1][i]) << 1 | spread(c[2][i]);
            if (job->classes) code |= (uint64_t)(CLASSES - 1 - job->classes[first + i]) << CLASS_AT;
            job->places[first + i] = (place){code, (uint32_t)(first + i)};
        }
    }
}

/* Sorts n places stably by code: a radix sort with `spare` as second buffer, without the passes in which all
 * have one digit. The result is in `places`. */
static void sort_run(place *places, place *spare, size_t n) {
    uint32_t counts[PASSES][DIGITS] = {{0}};
    place *from = places, *to = spare;
    for (size_t i = 0; i < n; i++)
        for (int pass = 0; pass < PASSES; pass++)
            counts[pass][places[i].code >> (pass * DIGIT_BITS) & (DIGITS - 1)]++;
    for (int pass = 0; pass < PASSES; pass++) {
        uint32_t *at = counts[pass], sum = 0;
        int shift = pass * DIGIT_BITS;
        if (at[places[0].code >> shift & (DIGITS - 1)] == n) continue;
        for (int d = 0; d < DIGITS; d++) {
            uint32_t count = at[d];
            at[d] = sum;
            sum += count;
        }
        for (size_t i = 0; i < n; i++) to[at[from[i].code >> shift & (DIGITS - 1)]++] = from[i];
        place *sorted = to;
        to = from, from = sorted;
    }
    if (from != places) memcpy(places, from, n * sizeof *places);
}

/* Runs of `run` places; merging makes them twice as long, from `places` to `spare`. */
typedef struct sort_job {
    place *places, *spare;
    size_t n, run;
} sort_job;

static size_t least_of(size_t a, size_t b) { return a < b ? a : b; }

static void sort_task(void *job_pointer, size_t task, int thread) {
    (void)thread;
    const sort_job *job = job_pointer;
    size_t first = task * job->run;
    sort_run(job->places + first, job->spare + first, least_of(job->run, job->n - first));
}

static void merge_task(void *job_pointer, size_t task, int thread) {
    (void)thread;
    const sort_job *job = job_pointer;
    size_t i = 2 * task * job->run, middle = least_of(i + job->run, job->n);
    size_t j = middle, end = least_of(middle + job->run, job->n);
    const place *from = job->places;
    place *to = job->spare + i;
    while (i < middle && j < end) {
        int second = from[j].code < from[i].code;
        *to++ = second ? from[j] : from[i];
        j += (size_t)second, i += (size_t)!second;
    }
    memcpy(to, from + i, (middle - i) * sizeof *to);
    memcpy(to + (middle - i), from + j, (end - j) * sizeof *to);
}

/* Sorts stably by code; returns the buffer with the result. */
static const place *sort_places(sf_context *ctx, place *places, place *spare, size_t n) {
    sort_job job = {places, spare, n, RUN};
    sf_pool_run(ctx->pool, (n + RUN - 1) / RUN, sort_task, &job);
    for (; job.run < n; job.run *= 2) {
        sf_pool_run(ctx->pool, (n + 2 * job.run - 1) / (2 * job.run), merge_task, &job);
        place *merged = job.spare;
        job.spare = job.places, job.places = merged;
    }
    return job.places;
}

sf_status sf_curve_order(sf_context *ctx, const float *xyz, size_t n, const uint8_t *classes,
                         uint32_t **order) {
    place *places = sf_alloc(ctx, n + 1, 2 * sizeof *places);
    *order = sf_alloc(ctx, n + 1, sizeof **order);
    sf_status status = places && *order ? SF_OK : SF_ERR_MEMORY;
    if (!status) {
        places_job job = {.xyz = xyz, .classes = classes, .n = n, .cube = bound(xyz, n), .places = places};
        sf_pool_run(ctx->pool, (n + TASK - 1) / TASK, places_task, &job);
        const place *sorted = sort_places(ctx, places, places + n, n);
        for (size_t i = 0; i < n; i++) (*order)[i] = sorted[i].index;
    } else {
        sf_free(ctx, *order);
        *order = NULL;
    }
    sf_free(ctx, places);
    return status;
}
