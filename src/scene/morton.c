/* morton.c - points in the order of a curve through space. */
#include "morton.h"

#include <math.h>
#include <stdlib.h>

/* The code of a place, and above it the class. */
enum { AXIS_BITS = 20, CLASS_AT = 60, CLASSES = 16 };

typedef struct place {
    uint64_t code;
    uint32_t index;
} place;

static int along_curve(const void *a, const void *b) {
    const place *x = a, *y = b;
    if (x->code != y->code) return x->code < y->code ? -1 : 1;
    return x->index < y->index ? -1 : 1;
}

/* The bits of a number, two zeros between each. */
static uint64_t spread(uint64_t x) {
    x = (x | x << 32) & 0x1f00000000ffff;
    x = (x | x << 16) & 0x1f0000ff0000ff;
    x = (x | x << 8) & 0x100f00f00f00f00f;
    x = (x | x << 4) & 0x10c30c30c30c30c3;
    return (x | x << 2) & 0x1249249249249249;
}

/* The cube around all points. */
typedef struct cube {
    double least[3], side;
} cube;

static cube bound(const float *xyz, size_t n) {
    double most[3] = {-INFINITY, -INFINITY, -INFINITY};
    cube c = {.least = {INFINITY, INFINITY, INFINITY}};
    for (size_t i = 0; i < 3 * n; i++) {
        c.least[i % 3] = fmin(c.least[i % 3], (double)xyz[i]);
        most[i % 3] = fmax(most[i % 3], (double)xyz[i]);
    }
    for (int k = 0; k < 3; k++) c.side = fmax(c.side, most[k] - c.least[k]);
    return c;
}

static void find_places(const float *xyz, size_t n, const uint8_t *classes, place *places) {
    cube c = bound(xyz, n);
    double scale = c.side > 0 ? ((1 << AXIS_BITS) - 1) / c.side : 0;
    for (size_t i = 0; i < n; i++) {
        places[i] = (place){.index = (uint32_t)i};
        if (classes) places[i].code = (uint64_t)(CLASSES - 1 - classes[i]) << CLASS_AT;
        for (size_t k = 0; k < 3; k++)
            places[i].code |= spread((uint64_t)(scale * ((double)xyz[3 * i + k] - c.least[k]))) << k;
    }
}

sf_status sf_morton_order(sf_context *ctx, const float *xyz, size_t n, const uint8_t *classes,
                          uint32_t **order) {
    place *places = sf_alloc(ctx, n + 1, sizeof *places);
    *order = sf_alloc(ctx, n + 1, sizeof **order);
    sf_status status = places && *order ? SF_OK : SF_ERR_MEMORY;
    if (!status) {
        find_places(xyz, n, classes, places);
        qsort(places, n, sizeof *places, along_curve);
        for (size_t i = 0; i < n; i++) (*order)[i] = places[i].index;
    } else {
        sf_free(ctx, *order);
        *order = NULL;
    }
    sf_free(ctx, places);
    return status;
}
