/* morton.c - Gaussians in the order of a curve through space. */
#include "morton.h"

#include <math.h>
#include <stdlib.h>

#include "../scene/gaussians.h"

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

/* The cube around all means. */
typedef struct cube {
    double least[3], side;
} cube;

static sf_status mean_of(const sf_model *model, size_t i, float mean[3]) {
    const sf_gaussians f = {.means = mean};
    return sf_model_get(model, i, 1, &f);
}

static sf_status bound(const sf_model *model, cube *c) {
    double most[3] = {-INFINITY, -INFINITY, -INFINITY};
    sf_status status = SF_OK;
    *c = (cube){.least = {INFINITY, INFINITY, INFINITY}};
    for (size_t i = 0; i < sf_model_count(model) && !status; i++) {
        float mean[3];
        status = mean_of(model, i, mean);
        for (int k = 0; k < 3 && !status; k++) {
            c->least[k] = fmin(c->least[k], (double)mean[k]);
            most[k] = fmax(most[k], (double)mean[k]);
        }
    }
    for (int k = 0; k < 3; k++) c->side = fmax(c->side, most[k] - c->least[k]);
    return status;
}

static sf_status find_places(const sf_model *model, const uint8_t *classes, place *places) {
    cube c;
    sf_status status = bound(model, &c);
    double scale = c.side > 0 ? ((1 << AXIS_BITS) - 1) / c.side : 0;
    for (size_t i = 0; i < sf_model_count(model) && !status; i++) {
        float mean[3];
        status = mean_of(model, i, mean);
        places[i] = (place){.index = (uint32_t)i};
        if (classes) places[i].code = (uint64_t)(CLASSES - 1 - classes[i]) << CLASS_AT;
        for (int k = 0; k < 3 && !status; k++)
            places[i].code |= spread((uint64_t)(scale * ((double)mean[k] - c.least[k]))) << k;
    }
    return status;
}

sf_status sf_morton_order(const sf_model *model, const uint8_t *classes, uint32_t **order) {
    size_t n = sf_model_count(model);
    place *places = sf_alloc(model->ctx, n + 1, sizeof *places);
    *order = sf_alloc(model->ctx, n + 1, sizeof **order);
    sf_status status = places && *order ? find_places(model, classes, places) : SF_ERR_MEMORY;
    if (!status) {
        qsort(places, n, sizeof *places, along_curve);
        for (size_t i = 0; i < n; i++) (*order)[i] = places[i].index;
    } else {
        sf_free(model->ctx, *order);
        *order = NULL;
    }
    sf_free(model->ctx, places);
    return status;
}
