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

sf_status sf_moments_create(const sf_model *model, int format, sf_moments *moments) {
    *moments = (sf_moments){.format = format};
    for (int band = 0; band <= model->sh_degree; band++) {
        sf_status status = sf_moments_set_room(moments, model, band, model->capacity[band]);
        if (!status) continue;
        sf_moments_destroy(model->ctx, moments);
        return status;
    }
    return SF_OK;
}

void sf_moments_destroy(sf_context *ctx, sf_moments *moments) {
    for (int part = 0; part < SF_MOMENT_PARTS; part++)
        for (int field = 0; field < SF_FIELD_COUNT; field++) sf_free(ctx, moments->part[part][field]);
    memset(moments->part, 0, sizeof moments->part);
}

/* Whether there is such an array. */
static int is_kept(const sf_moments *moments, int part, int field, const sf_model *model) {
    return sf_moment_part(moments->format, part) && sf_field_stored(field, model->sh_degree);
}

sf_status sf_moments_set_room(sf_moments *moments, const sf_model *model, int band, size_t room) {
    for (int part = 0; part < SF_MOMENT_PARTS; part++)
        for (int field = 0; field < SF_FIELD_COUNT; field++) {
            void **array = &moments->part[part][field];
            if (sf_field_band(field) != band || !is_kept(moments, part, field, model)) continue;
            sf_status status =
                sf_field_resize(model->ctx, field, array, *array ? model->banded[band] : 0, room);
            if (status) return status;
        }
    return SF_OK;
}

void sf_moments_arrange(const sf_moments *moments, const sf_model *model, const sf_order *order) {
    for (int part = 0; part < SF_MOMENT_PARTS; part++)
        for (int field = 0; field < SF_FIELD_COUNT; field++)
            if (is_kept(moments, part, field, model))
                sf_field_arrange(field, moments->part[part][field], model->banded[sf_field_band(field)],
                                 order);
}

/* The part of its squares that a field of a newcomer keeps. Its share of a picture is smaller than what it
 * was made of, so are its gradients, and it has to find a place of its own: up to three times the steps for
 * what makes its shape. Colours and opacity are right already. */
static float part_kept(int field) {
    return field == SF_FIELD_mean || field == SF_FIELD_log_scale || field == SF_FIELD_quat ? 0.1f : 1;
}

static void restart(const sf_moments *moments, int field, size_t at) {
    if (moments->format == SF_MOMENTS_HALF) {
        uint32_t *word = (uint32_t *)moments->part[0][field] + at;
        *word = sf_bits_of(part_kept(field) * sf_float_of((*word & 0xffffu) << 15)) >> 15;
    } else {
        ((float *)moments->part[0][field])[at] = 0;
        ((float *)moments->part[1][field])[at] *= part_kept(field);
    }
}

void sf_moments_restart(const sf_moments *moments, const sf_model *model, size_t i) {
    for (int field = 0; field < SF_FIELD_COUNT; field++) {
        int n = sf_field_components(field);
        for (int c = 0; i < model->banded[sf_field_band(field)] && c < n; c++)
            restart(moments, field, sf_at(i, n, c));
    }
}

void sf_moments_forget(const sf_moments *moments, const sf_model *model, size_t i) {
    for (int part = 0; part < SF_MOMENT_PARTS; part++)
        for (int field = 0; field < SF_FIELD_COUNT; field++) {
            int n = sf_field_components(field);
            char *array = moments->part[part][field];
            for (int c = 0; array && i < model->banded[sf_field_band(field)] && c < n; c++)
                memset(array + SF_MOMENT_VALUE * sf_at(i, n, c), 0, SF_MOMENT_VALUE);
        }
}

void sf_moments_forget_all(const sf_moments *moments, const sf_model *model) {
    for (int part = 0; part < SF_MOMENT_PARTS; part++)
        for (int field = 0; field < SF_FIELD_COUNT; field++)
            if (is_kept(moments, part, field, model))
                memset(moments->part[part][field], 0,
                       SF_MOMENT_VALUE * sf_field_values(field, model->capacity[sf_field_band(field)]));
}

void sf_moments_step(const sf_moments *moments, const sf_kernels *kernels, int field, size_t at, size_t n,
                     float *p, const float *g, const sf_adam *step, uint32_t key) {
    void *first = moments->part[0][field], *second = moments->part[1][field];
    if (moments->format == SF_MOMENTS_HALF)
        kernels->adam_half(p, g, (uint32_t *)first + at, n, step, key + (uint32_t)at);
    else
        kernels->adam(p, g, (float *)first + at, (float *)second + at, n, step);
}
