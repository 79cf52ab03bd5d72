/* optimizer_state.c - the optimizer state of each parameter. */
#include "optimizer_state.h"

#include <string.h>

enum { FIRST, SECOND, OFFSET }; /* parts; 16-bit moments: words with both in the first */

static const char *const part_names[][SF_MOMENT_PARTS] = {
    [SF_MOMENTS_FLOAT] = {"m", "v", "lag"}, [SF_MOMENTS_HALF] = {"mv", "v", "lag"}};

const char *sf_moment_part(const sf_optimizer_state *moments, int part) {
    return part_names[moments->format][part];
}

int sf_moment_components(const sf_optimizer_state *moments, int part, int field) {
    int n = sf_field_components(field);
    if (!sf_has_momentum(field)) return part == SECOND ? n / 3 : 0; /* one for three channels */
    if (part == OFFSET) return moments->mean_kept > 0 ? n : 0;
    return part == FIRST || moments->format == SF_MOMENTS_FLOAT ? n : 0;
}

int sf_moment_values(const sf_optimizer_state *moments, int sh_degree) {
    int values = 0;
    for (int field = 0; field < SF_FIELD_COUNT && sf_field_stored(field, sh_degree); field++)
        for (int part = 0; part < SF_MOMENT_PARTS; part++)
            values += sf_moment_components(moments, part, field);
    return values;
}

/* The same; 0 for a field that the model does not store. */
static int components_of(const sf_optimizer_state *moments, int part, int field, const sf_model *model) {
    return sf_field_stored(field, model->sh_degree) ? sf_moment_components(moments, part, field) : 0;
}

sf_optimizer_state sf_optimizer_moments(int format, int64_t ema_steps) {
    return (sf_optimizer_state){.format = format, .mean_kept = ema_steps > 1 ? 1 - 1 / (float)ema_steps : 0};
}

sf_status sf_optimizer_create(const sf_model *model, int format, int64_t ema_steps,
                              sf_optimizer_state *moments) {
    *moments = sf_optimizer_moments(format, ema_steps);
    for (int band = 0; band <= model->sh_degree; band++) {
        sf_status status = sf_optimizer_set_room(moments, model, band, model->capacity[band]);
        if (!status) continue;
        sf_optimizer_destroy(model->ctx, moments);
        return status;
    }
    return SF_OK;
}

void sf_optimizer_destroy(sf_context *ctx, sf_optimizer_state *moments) {
    for (int part = 0; part < SF_MOMENT_PARTS; part++)
        for (int field = 0; field < SF_FIELD_COUNT; field++) sf_free(ctx, moments->part[part][field]);
    memset(moments->part, 0, sizeof moments->part);
}

sf_status sf_optimizer_set_room(sf_optimizer_state *moments, const sf_model *model, int band, size_t room) {
    for (int part = 0; part < SF_MOMENT_PARTS; part++)
        for (int field = 0; field < SF_FIELD_COUNT; field++) {
            void **array = &moments->part[part][field];
            int n = components_of(moments, part, field, model);
            if (sf_field_band(field) != band || !n) continue;
            size_t used = *array ? model->banded[band] : 0;
            sf_status status = sf_blocked_resize(model->ctx, n, array, used, room);
            if (status) return status;
        }
    return SF_OK;
}

void sf_optimizer_reorder(const sf_optimizer_state *moments, const sf_model *model, sf_order *order) {
    for (int part = 0; part < SF_MOMENT_PARTS; part++)
        for (int field = 0; field < SF_FIELD_COUNT; field++) {
            int n = components_of(moments, part, field, model), band = sf_field_band(field);
            if (n) sf_order_add_blocked(order, n, band, moments->part[part][field], model->banded[band]);
        }
}

/* The part of the second moment that a new Gaussian keeps. Its blend weights are smaller than its parent's,
 * and so are its gradients; and its shape still has to move. A lower second moment makes steps of mean, scale
 * and rotation up to three times longer. Colours and opacity fit already. */
static float part_kept(int field) {
    return field == SF_FIELD_mean || field == SF_FIELD_log_scale || field == SF_FIELD_quat ? 0.1f : 1;
}

static void restart(const sf_optimizer_state *moments, int field, size_t i) {
    int all = sf_field_components(field);
    for (int c = 0; c < sf_moment_components(moments, OFFSET, field); c++)
        ((float *)moments->part[OFFSET][field])[sf_at(i, all, c)] = 0;
    for (int c = 0; c < sf_moment_components(moments, FIRST, field); c++) {
        char *value = (char *)moments->part[FIRST][field] + SF_MOMENT_VALUE * sf_at(i, all, c);
        uint32_t word;
        memcpy(&word, value, sizeof word);
        if (moments->format == SF_MOMENTS_HALF)
            word = sf_bits_of(part_kept(field) * sf_float_of((word & 0xffffu) << 15)) >> 15;
        else
            word = 0;
        memcpy(value, &word, sizeof word);
    }
    int n = sf_moment_components(moments, SECOND, field);
    for (int c = 0; c < n; c++) ((float *)moments->part[SECOND][field])[sf_at(i, n, c)] *= part_kept(field);
}

void sf_optimizer_restart(const sf_optimizer_state *moments, const sf_model *model, size_t i) {
    for (int field = 0; field < SF_FIELD_COUNT; field++)
        if (i < model->banded[sf_field_band(field)]) restart(moments, field, i);
}

void sf_optimizer_reset(const sf_optimizer_state *moments, const sf_model *model, size_t i) {
    for (int part = 0; part < SF_MOMENT_PARTS; part++)
        for (int field = 0; field < SF_FIELD_COUNT; field++) {
            int n = components_of(moments, part, field, model);
            char *array = moments->part[part][field];
            for (int c = 0; i < model->banded[sf_field_band(field)] && c < n; c++)
                memset(array + SF_MOMENT_VALUE * sf_at(i, n, c), 0, SF_MOMENT_VALUE);
        }
}

void sf_optimizer_reset_all(const sf_optimizer_state *moments, const sf_model *model) {
    for (int part = 0; part < SF_MOMENT_PARTS; part++)
        for (int field = 0; field < SF_FIELD_COUNT; field++) {
            size_t n = (size_t)components_of(moments, part, field, model);
            if (n)
                memset(moments->part[part][field], 0,
                       SF_MOMENT_VALUE * n * model->capacity[sf_field_band(field)]);
        }
}

void sf_optimizer_decay_second(const sf_optimizer_state *moments, size_t first, size_t end, float beta2,
                               uint32_t steps) {
    for (int field = 0; sf_has_momentum(field); field++) {
        size_t block = (size_t)sf_field_components(field) * SF_LANES;
        float *v = (float *)moments->part[SECOND][field] + first * block;
        for (size_t at = 0; at < (end - first) * block; at += SF_LANES)
            for (uint32_t step = 0; step < steps; step++)
                for (size_t k = 0; k < SF_LANES; k++) v[at + k] *= beta2;
    }
}

void sf_optimizer_step(const sf_optimizer_state *moments, const sf_kernels *kernels, sf_value_range range,
                       float *p, const float *g, const sf_adam *step, uint32_t key) {
    int field = range.field;
    size_t at = range.at, n = range.n;
    void *first = moments->part[FIRST][field], *second = moments->part[SECOND][field];
    if (!sf_has_momentum(field))
        kernels->rmsprop(p, g, (float *)second + at / 3, n / 3, step);
    else if (moments->format == SF_MOMENTS_HALF)
        kernels->adam_half(p, g, (uint32_t *)first + at, n, step, key + (uint32_t)at);
    else
        kernels->adam(p, g, (float *)first + at, (float *)second + at, n, step);
}

void sf_mean_open(const sf_optimizer_state *moments, int field, size_t at, size_t n, const float *p) {
    if (!sf_moment_components(moments, OFFSET, field)) return;
    float *mean = (float *)moments->part[OFFSET][field] + at;
    for (size_t k = 0; k < n; k++) mean[k] += p[k];
}

void sf_mean_close(const sf_optimizer_state *moments, int field, size_t at, size_t n, const float *p) {
    if (!sf_moment_components(moments, OFFSET, field)) return;
    float *offset = (float *)moments->part[OFFSET][field] + at;
    for (size_t k = 0; k < n; k++) offset[k] = moments->mean_kept * (offset[k] - p[k]);
}

void sf_mean_take(const sf_optimizer_state *moments, int field, size_t n, const float *from, float *p) {
    const float *offset = moments->part[OFFSET][field];
    for (size_t k = 0; k < n; k++) p[k] = from[k] + offset[k];
}
