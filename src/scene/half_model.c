/* half_model.c - a copy of a model in about half of its memory. */
#include "half_model.h"

#include <string.h>

/* 16-bit floats: sign, 5 bits of exponent with an offset of 15, 10 bits of fraction. */
enum { FRACTION_LESS = 13, OFFSET_LESS = 112 << 23, HALF_MOST = 0x7bff, HALF_NAN = 0x7fff };

/* To the nearest; of equals away from 0. By integers, for threads flush denormal floats. */
static uint16_t half_of(float value) {
    uint32_t bits = sf_bits_of(value), sign = bits >> 16 & 0x8000u, size = bits & 0x7fffffffu;
    if (size > 0x7f800000u) return HALF_NAN;
    if (size < OFFSET_LESS + (1u << 23)) return (uint16_t)sign;
    uint32_t half = (size - OFFSET_LESS + (1u << (FRACTION_LESS - 1))) >> FRACTION_LESS;
    return (uint16_t)(sign | (half < HALF_MOST ? half : HALF_MOST));
}

static float float_of(uint16_t half) {
    uint32_t size = half & 0x7fffu, sign = (uint32_t)(half & 0x8000u) << 16;
    if (size == HALF_NAN) return sf_float_of(0x7fc00000u);
    return sf_float_of(sign | (size ? (size << FRACTION_LESS) + OFFSET_LESS : 0));
}

static int is_whole(int field) { return field == SF_FIELD_mean; }

size_t sf_half_model_values(const sf_half_model *half, int field) {
    return sf_field_stored(field, half->sh_degree)
               ? sf_field_values(field, half->banded[sf_field_band(field)])
               : 0;
}

int sf_half_model_is_empty(const sf_half_model *half) { return !half->field[SF_FIELD_mean]; }

void sf_half_model_free(sf_context *ctx, sf_half_model *half) {
    for (int f = 0; f < SF_FIELD_COUNT; f++) sf_free(ctx, half->field[f]);
    memset(half, 0, sizeof *half);
}

/* Room for a field; an array that is much larger than needed is replaced. */
static sf_status set_room(sf_context *ctx, sf_half_model *half, int field) {
    size_t need =
        (sf_half_model_values(half, field) + 1) * (is_whole(field) ? sizeof(float) : sizeof(uint16_t));
    if (half->bytes[field] >= need && half->bytes[field] <= need + need / 8) return SF_OK;
    sf_free(ctx, half->field[field]);
    half->field[field] = sf_alloc(ctx, need, 1);
    half->bytes[field] = half->field[field] ? need : 0;
    return half->field[field] ? SF_OK : SF_ERR_MEMORY;
}

sf_status sf_half_model_set(const sf_model *model, sf_half_model *half) {
    memcpy(half->banded, model->banded, sizeof half->banded);
    memcpy(half->origin, model->origin, sizeof half->origin);
    half->sh_degree = model->sh_degree;
    half->antialiased = model->antialiased;
    half->unit = model->unit;
    for (int f = 0; f < SF_FIELD_COUNT; f++) {
        if (set_room(model->ctx, half, f)) {
            sf_half_model_free(model->ctx, half);
            return SF_ERR_MEMORY;
        }
        const float *from = model->params.field[f];
        uint16_t *to = half->field[f];
        size_t n = sf_half_model_values(half, f);
        if (is_whole(f) && n) memcpy(to, from, n * sizeof *from);
        for (size_t k = 0; k < n && !is_whole(f); k++) to[k] = half_of(from[k]);
    }
    return SF_OK;
}

void sf_half_model_expand(const sf_half_model *half, int field, size_t first, size_t count, float *to) {
    const uint16_t *from = half->field[field];
    if (is_whole(field)) {
        memcpy(to, (const float *)half->field[field] + first, count * sizeof *to);
        return;
    }
    for (size_t k = 0; k < count; k++) to[k] = float_of(from[first + k]);
}

void sf_half_model_get(const sf_half_model *half, sf_model *model) {
    sf_model_resize(model, 0);
    for (int f = 0; f < SF_FIELD_COUNT; f++) {
        float *to = model->params.field[f];
        size_t n = to ? sf_half_model_values(half, f) : 0;
        if (n) sf_half_model_expand(half, f, 0, n, to);
    }
    model->count = half->banded[0];
    memcpy(model->banded, half->banded, sizeof model->banded);
    memcpy(model->origin, half->origin, sizeof model->origin);
    model->antialiased = half->antialiased;
    model->unit = half->unit;
}

sf_status sf_half_model_copy(const sf_half_model *half, sf_context *ctx, sf_model **model) {
    sf_status status = sf_model_create_banded(ctx, half->banded, half->banded[0], half->sh_degree, model);
    if (!status) sf_half_model_get(half, *model);
    return status;
}
