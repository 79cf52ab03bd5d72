/* gaussians.c - storage of the Gaussians. */
#include "gaussians.h"

#include <string.h>

#define COMPONENTS(name, components) components,
static const int field_components[] = {SF_FIELDS(COMPONENTS)};
#undef COMPONENTS

int sf_field_components(int field) { return field_components[field]; }

int sf_field_stored(int field, int sh_degree) { return field <= SF_FIELD_sh0 + sh_degree; }

sf_status sf_params_create(sf_context *ctx, size_t capacity, int sh_degree, sf_params *params) {
    memset(params, 0, sizeof *params);
    for (int f = 0; f < SF_FIELD_COUNT && sf_field_stored(f, sh_degree); f++) {
        size_t lane_bytes = (size_t)field_components[f] * SF_LANES * sizeof(float);
        params->field[f] = sf_calloc(ctx, sf_blocks(capacity), lane_bytes);
        if (!params->field[f]) {
            sf_params_destroy(ctx, params);
            return SF_ERR_MEMORY;
        }
    }
    return SF_OK;
}

void sf_params_destroy(sf_context *ctx, sf_params *params) {
    for (int f = 0; f < SF_FIELD_COUNT; f++) sf_free(ctx, params->field[f]);
    memset(params, 0, sizeof *params);
}

void sf_params_copy(const sf_params *source, size_t from, const sf_params *params, size_t to) {
    for (int f = 0; f < SF_FIELD_COUNT; f++)
        for (int c = 0; params->field[f] && c < field_components[f]; c++)
            params->field[f][sf_at(to, field_components[f], c)] =
                source->field[f][sf_at(from, field_components[f], c)];
}

static void set_neutral(sf_model *model, size_t i) {
    for (int f = 0; f < SF_FIELD_COUNT; f++)
        for (int c = 0; model->params.field[f] && c < field_components[f]; c++)
            model->params.field[f][sf_at(i, field_components[f], c)] = 0;
    model->params.field[SF_FIELD_quat][sf_at(i, 4, 0)] = 1;
    model->params.field[SF_FIELD_logit_opacity][i] = SF_INVISIBLE;
}

sf_status sf_model_create_room(sf_context *ctx, size_t capacity, int sh_degree, sf_model **out) {
    *out = NULL;
    if (sh_degree < 0 || sh_degree > SF_MAX_SH_DEGREE)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "sh_degree: %d is not in 0..%d", sh_degree, SF_MAX_SH_DEGREE);
    if (capacity > INT32_MAX - SF_LANES)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "count: %zu Gaussians are more than 2^31 - 17", capacity);
    sf_model *model = sf_calloc(ctx, 1, sizeof *model);
    if (!model) return SF_ERR_MEMORY;
    model->ctx = ctx;
    model->sh_degree = sh_degree;
    model->capacity = sf_blocks(capacity) * SF_LANES;
    if (sf_params_create(ctx, capacity, sh_degree, &model->params)) {
        sf_free(ctx, model);
        return SF_ERR_MEMORY;
    }
    for (size_t i = 0; i < model->capacity; i++) set_neutral(model, i);
    *out = model;
    return SF_OK;
}

sf_status sf_model_create(sf_context *ctx, size_t count, int sh_degree, sf_model **model) {
    sf_status status = sf_model_create_room(ctx, count, sh_degree, model);
    if (!status) (*model)->count = count;
    return status;
}

void sf_model_destroy(sf_model **model_pointer) {
    sf_model *model = *model_pointer;
    if (!model) return;
    sf_params_destroy(model->ctx, &model->params);
    sf_free(model->ctx, model);
    *model_pointer = NULL;
}

void sf_model_resize(sf_model *model, size_t count) {
    for (size_t i = count; i < model->count; i++) set_neutral(model, i);
    model->count = count;
}

sf_status sf_model_copy(const sf_model *model, size_t capacity, int sh_degree, sf_model **copy) {
    sf_status status = sf_model_create_room(model->ctx, capacity, sh_degree, copy);
    if (status) return status;
    for (int f = 0; f < SF_FIELD_COUNT; f++)
        if (model->params.field[f] && (*copy)->params.field[f])
            memcpy((*copy)->params.field[f], model->params.field[f],
                   sf_blocks(model->count) * SF_LANES * (size_t)field_components[f] * sizeof(float));
    (*copy)->count = model->count;
    (*copy)->antialiased = model->antialiased;
    return SF_OK;
}

size_t sf_model_count(const sf_model *model) { return model->count; }
int sf_model_sh_degree(const sf_model *model) { return model->sh_degree; }
int sf_model_antialiased(const sf_model *model) { return model->antialiased; }
void sf_model_set_antialiased(sf_model *model, int antialiased) { model->antialiased = antialiased != 0; }

/* Walks one Gaussian's values beside the caller's arrays. */
typedef void (*move_fn)(float *blocked, float *plain);

static void take(float *blocked, float *plain) { *blocked = *plain; }
static void give(float *blocked, float *plain) { *plain = *blocked; }

static void move_field(const sf_params *params, int field, size_t first, size_t count, float *plain,
                       size_t stride, size_t at, move_fn move) {
    int n = field_components[field];
    for (size_t i = 0; plain && i < count; i++)
        for (int c = 0; c < n; c++)
            move(&params->field[field][sf_at(first + i, n, c)], &plain[i * stride + at + (size_t)c]);
}

static void move_all(const sf_params *params, int sh_degree, size_t first, size_t count,
                     const sf_gaussians *g, move_fn move) {
    static const size_t band_at[] = {0, 3, 12, 27};
    size_t sh_stride = 3 * (size_t)(sh_degree + 1) * (size_t)(sh_degree + 1);
    move_field(params, SF_FIELD_mean, first, count, g->means, 3, 0, move);
    move_field(params, SF_FIELD_quat, first, count, g->quats, 4, 0, move);
    move_field(params, SF_FIELD_log_scale, first, count, g->log_scales, 3, 0, move);
    move_field(params, SF_FIELD_logit_opacity, first, count, g->logit_opacities, 1, 0, move);
    for (int band = 0; band <= sh_degree; band++)
        move_field(params, SF_FIELD_sh0 + band, first, count, g->sh, sh_stride, band_at[band], move);
}

static sf_status check_range(const sf_model *model, size_t first, size_t count) {
    if (first <= model->count && count <= model->count - first) return SF_OK;
    return sf_fail(model->ctx, SF_ERR_ARGUMENT, "range: Gaussians %zu .. +%zu of %zu", first, count,
                   model->count);
}

sf_status sf_model_set(sf_model *model, size_t first, size_t count, const sf_gaussians *from) {
    sf_status status = check_range(model, first, count);
    if (!status) move_all(&model->params, model->sh_degree, first, count, from, take);
    return status;
}

sf_status sf_model_get(const sf_model *model, size_t first, size_t count, const sf_gaussians *to) {
    sf_status status = check_range(model, first, count);
    if (!status) sf_params_get(&model->params, model->sh_degree, first, count, to);
    return status;
}

void sf_params_get(const sf_params *params, int sh_degree, size_t first, size_t count,
                   const sf_gaussians *to) {
    move_all(params, sh_degree, first, count, to, give);
}
