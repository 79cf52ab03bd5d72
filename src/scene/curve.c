/* curve.c - sorts points along a space-filling curve. */
#include "curve.h"

#include <math.h>
#include <stdlib.h>

#include "../base/statistics.h"

/* Sort key: the class, then the position on the curve. */
enum { AXIS_BITS = 20, CLASS_AT = 60, CLASSES = 16 };

enum { SAMPLES = 4096, REACH = 1024 }; /* of the curve's cube: see bound */

typedef struct place {
    uint64_t code;
    uint32_t index;
} place;

static int by_code(const void *a, const void *b) {
    const place *x = a, *y = b;
    if (x->code != y->code) return x->code < y->code ? -1 : 1;
    return x->index < y->index ? -1 : 1;
}

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
    for (size_t i = 0; i < 3 * n; i++) {
        c.least[i % 3] = fmin(c.least[i % 3], (double)xyz[i]);
        most[i % 3] = fmax(most[i % 3], (double)xyz[i]);
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

/* Index of a cell on Hilbert's curve through a cube of 2^AXIS_BITS cells a side (Skilling 2004, "Programming
 * the Hilbert curve"). Unlike the Z-curve it never jumps. Changes the axes. */
static uint64_t along(uint32_t axes[3]) {
    const uint32_t top = 1u << (AXIS_BITS - 1);
    for (uint32_t bit = top; bit > 1; bit >>= 1) {
        uint32_t below = bit - 1;
        for (int k = 0; k < 3; k++) {
            uint32_t swapped = axes[k] & bit ? 0 : (axes[0] ^ axes[k]) & below;
            axes[0] ^= axes[k] & bit ? below : swapped;
            axes[k] ^= swapped;
        }
    }
    axes[1] ^= axes[0];
    axes[2] ^= axes[1];
    uint32_t flip = 0;
    for (uint32_t bit = top; bit > 1; bit >>= 1) flip ^= axes[2] & bit ? bit - 1 : 0;
    return spread(axes[0] ^ flip) << 2 | spread(axes[1] ^ flip) << 1 | spread(axes[2] ^ flip);
}

static void find_places(const float *xyz, size_t n, const uint8_t *classes, place *places) {
    cube c = bound(xyz, n);
    const double most = (1 << AXIS_BITS) - 1;
    double scale = c.side > 0 ? most / c.side : 0;
    for (size_t i = 0; i < n; i++) {
        places[i] = (place){.index = (uint32_t)i};
        if (classes) places[i].code = (uint64_t)(CLASSES - 1 - classes[i]) << CLASS_AT;
        uint32_t axes[3];
        for (size_t k = 0; k < 3; k++) /* fmax: NaN becomes 0 */
            axes[k] = (uint32_t)fmin(fmax(scale * ((double)xyz[3 * i + k] - c.least[k]), 0), most);
        places[i].code |= along(axes);
    }
}

sf_status sf_curve_order(sf_context *ctx, const float *xyz, size_t n, const uint8_t *classes,
                         uint32_t **order) {
    place *places = sf_alloc(ctx, n + 1, sizeof *places);
    *order = sf_alloc(ctx, n + 1, sizeof **order);
    sf_status status = places && *order ? SF_OK : SF_ERR_MEMORY;
    if (!status) {
        find_places(xyz, n, classes, places);
        qsort(places, n, sizeof *places, by_code);
        for (size_t i = 0; i < n; i++) (*order)[i] = places[i].index;
    } else {
        sf_free(ctx, *order);
        *order = NULL;
    }
    sf_free(ctx, places);
    return status;
}
