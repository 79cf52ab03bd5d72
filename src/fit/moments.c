/* moments.c - Adam's two moments of every parameter, as floats or in 16 bits each. */
#include "moments.h"

#include <string.h>

static const char *const part_names[][SF_MOMENT_PARTS] = {
    [SF_MOMENTS_FLOAT] = {"m", "v"}, [SF_MOMENTS_HALF] = {"mv", NULL}};

const char *sf_moment_part(int format, int part) { return part_names[format][part]; }

size_t sf_moment_bytes(int format) {
    size_t bytes = 0;
    for (int part = 0; part < SF_MOMENT_PARTS; part++)
        if (sf_moment_part(format, part)) bytes += SF_MOMENT_VALUE;
    return bytes;
}

sf_status sf_moments_create(sf_context *ctx, int format, size_t capacity, int sh_degree,
                            sf_moments *moments) {
    *moments = (sf_moments){.format = format};
    for (int part = 0; part < SF_MOMENT_PARTS; part++)
        for (int field = 0; field < SF_FIELD_COUNT; field++) {
            if (!sf_moment_part(format, part) || !sf_field_stored(field, sh_degree)) continue;
            size_t lanes = (size_t)sf_field_components(field) * SF_LANES;
            moments->part[part][field] = sf_calloc(ctx, sf_blocks(capacity), lanes * SF_MOMENT_VALUE);
            if (moments->part[part][field]) continue;
            sf_moments_destroy(ctx, moments);
            return SF_ERR_MEMORY;
        }
    return SF_OK;
}

void sf_moments_destroy(sf_context *ctx, sf_moments *moments) {
    for (int part = 0; part < SF_MOMENT_PARTS; part++)
        for (int field = 0; field < SF_FIELD_COUNT; field++) sf_free(ctx, moments->part[part][field]);
    memset(moments->part, 0, sizeof moments->part);
}

/* The moments of component c of Gaussian i, of whatever type. */
static char *value_at(void *array, int field, size_t i, int c) {
    return (char *)array + SF_MOMENT_VALUE * sf_at(i, sf_field_components(field), c);
}

void sf_moments_copy(const sf_moments *source, size_t from, const sf_moments *moments, size_t to) {
    for (int part = 0; part < SF_MOMENT_PARTS; part++)
        for (int field = 0; field < SF_FIELD_COUNT; field++) {
            void *array = moments->part[part][field], *of = source->part[part][field];
            for (int c = 0; array && c < sf_field_components(field); c++)
                memcpy(value_at(array, field, to, c), value_at(of, field, from, c), SF_MOMENT_VALUE);
        }
}

void sf_moments_forget(const sf_moments *moments, size_t i) {
    for (int part = 0; part < SF_MOMENT_PARTS; part++)
        for (int field = 0; field < SF_FIELD_COUNT; field++) {
            void *array = moments->part[part][field];
            for (int c = 0; array && c < sf_field_components(field); c++)
                memset(value_at(array, field, i, c), 0, SF_MOMENT_VALUE);
        }
}

void sf_moments_step(const sf_moments *moments, const sf_kernels *kernels, int field, size_t at, size_t n,
                     float *p, const float *g, const sf_adam *step, uint32_t key) {
    void *first = moments->part[0][field], *second = moments->part[1][field];
    if (moments->format == SF_MOMENTS_HALF)
        kernels->adam_half(p, g, (uint32_t *)first + at, n, step, key + (uint32_t)at);
    else
        kernels->adam(p, g, (float *)first + at, (float *)second + at, n, step);
}
