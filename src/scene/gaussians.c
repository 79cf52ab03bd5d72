/* gaussians.c - storage of the Gaussians. */
#include "gaussians.h"

#include <math.h>
#include <string.h>

#include "gaussian_math.h"

#define COMPONENTS(name, components) components,
static const int field_components[] = {SF_FIELDS(COMPONENTS)};
#undef COMPONENTS

int sf_field_components(int field) { return field_components[field]; }

int sf_field_stored(int field, int sh_degree) { return field <= SF_FIELD_sh0 + sh_degree; }

sf_status sf_blocked_resize(sf_context *ctx, int components, void *array_pointer, size_t used, size_t room) {
    size_t block = (size_t)components * SF_LANES * sizeof(float);
    return sf_resize(ctx, array_pointer, sf_blocks(used), sf_blocks(room), block);
}

sf_status sf_params_create(sf_context *ctx, const size_t room[SF_BANDS], int sh_degree, sf_params *params) {
    memset(params, 0, sizeof *params);
    for (int f = 0; f < SF_FIELD_COUNT && sf_field_stored(f, sh_degree); f++)
        if (sf_blocked_resize(ctx, field_components[f], &params->field[f], 0, room[sf_field_band(f)])) {
            sf_params_destroy(ctx, params);
            return SF_ERR_MEMORY;
        }
    return SF_OK;
}

void sf_params_destroy(sf_context *ctx, sf_params *params) {
    for (int f = 0; f < SF_FIELD_COUNT; f++) sf_free(ctx, params->field[f]);
    memset(params, 0, sizeof *params);
}

/* Lanes first .. end-1 of a field. */
static void set_neutral(const sf_params *params, int field, size_t first, size_t end) {
    float *array = params->field[field];
    int n = field_components[field];
    for (size_t i = first; i < end; i++) {
        for (int c = 0; c < n; c++) array[sf_at(i, n, c)] = 0;
        if (field == SF_FIELD_quat) array[sf_at(i, n, 0)] = 1;
        if (field == SF_FIELD_logit_opacity) array[i] = SF_INVISIBLE;
    }
}

void sf_model_note_change(sf_model *model) {
    model->version = atomic_fetch_add_explicit(&model->ctx->versions, 1, memory_order_relaxed) + 1;
}

sf_status sf_model_create_banded(sf_context *ctx, const size_t banded[SF_BANDS], size_t capacity,
                                 int sh_degree, sf_model **out) {
    *out = NULL;
    if (capacity > INT32_MAX - SF_LANES)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "count: %zu Gaussians are more than 2^31 - 17", capacity);
    sf_model *model = sf_calloc(ctx, 1, sizeof *model);
    if (!model) return SF_ERR_MEMORY;
    model->ctx = ctx;
    model->sh_degree = sh_degree;
    sf_model_note_change(model);
    for (int band = 0; band <= sh_degree; band++) {
        int by_all = banded[band] == banded[0];
        sf_status status = sf_model_set_room(model, band, by_all ? capacity : banded[band]);
        if (!status) continue;
        sf_model_destroy(&model);
        return status;
    }
    model->count = banded[0];
    memcpy(model->banded, banded, sizeof model->banded);
    *out = model;
    return SF_OK;
}

/* The capacity is at most that of every array of the band. */
sf_status sf_model_set_room(sf_model *model, int band, size_t room) {
    sf_params *p = &model->params;
    size_t used = model->banded[band], whole = sf_blocks(room) * SF_LANES;
    sf_model_note_change(model);
    if (model->capacity[band] > whole) model->capacity[band] = whole;
    for (int f = 0; f < SF_FIELD_COUNT && sf_field_stored(f, model->sh_degree); f++) {
        if (sf_field_band(f) != band) continue;
        sf_status status = sf_blocked_resize(model->ctx, field_components[f], &p->field[f], used, room);
        if (status) return status;
        if (f == SF_FIELD_quat || f == SF_FIELD_logit_opacity) /* the others are 0 already, and not touched */
            set_neutral(p, f, used, whole);
    }
    model->capacity[band] = whole;
    return SF_OK;
}

sf_status sf_model_create(sf_context *ctx, size_t count, int sh_degree, sf_model **model) {
    size_t banded[SF_BANDS] = {0};
    *model = NULL;
    if (sh_degree < 0 || sh_degree > SF_MAX_SH_DEGREE)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "sh_degree: %d is not in 0..%d", sh_degree, SF_MAX_SH_DEGREE);
    for (int band = 0; band <= sh_degree; band++) banded[band] = count;
    return sf_model_create_banded(ctx, banded, count, sh_degree, model);
}

void sf_model_destroy(sf_model **model_pointer) {
    sf_model *model = *model_pointer;
    if (!model) return;
    sf_params_destroy(model->ctx, &model->params);
    sf_free(model->ctx, model);
    *model_pointer = NULL;
}

void sf_model_resize(sf_model *model, size_t count) {
    sf_model_note_change(model);
    for (int f = 0; f < SF_FIELD_COUNT && sf_field_stored(f, model->sh_degree); f++)
        set_neutral(&model->params, f, count, model->banded[sf_field_band(f)]);
    for (int band = 0; band < SF_BANDS; band++)
        if (model->banded[band] > count) model->banded[band] = count;
    model->count = count;
}

/* Whole blocks of all fields that both store. */
static void copy_fields(const sf_model *from, const sf_model *to) {
    for (int f = 0; f < SF_FIELD_COUNT; f++) {
        size_t count = from->banded[sf_field_band(f)];
        if (count && to->params.field[f])
            memcpy(to->params.field[f], from->params.field[f], sf_field_values(f, count) * sizeof(float));
    }
}

sf_status sf_model_copy(const sf_model *model, size_t capacity, sf_model **copy) {
    sf_status status = sf_model_create_banded(model->ctx, model->banded, capacity, model->sh_degree, copy);
    if (!status) sf_model_assign(*copy, model);
    return status;
}

sf_status sf_model_copy_whole(const sf_model *model, int sh_degree, sf_model **copy) {
    sf_status status = sf_model_create(model->ctx, model->count, sh_degree, copy);
    if (status) return status;
    copy_fields(model, *copy);
    (*copy)->antialiased = model->antialiased;
    memcpy((*copy)->origin, model->origin, sizeof model->origin);
    (*copy)->unit = model->unit;
    return SF_OK;
}

void sf_model_assign(sf_model *model, const sf_model *from) {
    sf_model_resize(model, 0);
    copy_fields(from, model);
    model->count = from->count;
    memcpy(model->banded, from->banded, sizeof model->banded);
    model->antialiased = from->antialiased;
    memcpy(model->origin, from->origin, sizeof model->origin);
    model->unit = from->unit;
}

void sf_model_reorder(sf_model *model, sf_order *order) {
    sf_model_note_change(model);
    for (int f = 0; f < SF_FIELD_COUNT && sf_field_stored(f, model->sh_degree); f++) {
        int band = sf_field_band(f);
        sf_order_add_blocked(order, field_components[f], band, model->params.field[f], model->banded[band]);
    }
    sf_order_apply(order);
    for (int f = 0; f < SF_FIELD_COUNT && sf_field_stored(f, model->sh_degree); f++) {
        size_t had = model->banded[sf_field_band(f)], now = order->banded[sf_field_band(f)];
        set_neutral(&model->params, f, now, sf_blocks(had > now ? had : now) * SF_LANES);
    }
    memcpy(model->banded, order->banded, sizeof model->banded);
    model->count = order->banded[0];
}

size_t sf_model_count(const sf_model *model) { return model->count; }
int sf_model_sh_degree(const sf_model *model) { return model->sh_degree; }
int sf_model_antialiased(const sf_model *model) { return model->antialiased; }
void sf_model_set_antialiased(sf_model *model, int antialiased) {
    model->antialiased = antialiased != 0;
    sf_model_note_change(model);
}

int sf_model_has_origin(const sf_model *model) {
    return model->origin[0] != 0 || model->origin[1] != 0 || model->origin[2] != 0;
}

void sf_model_get_origin(const sf_model *model, double origin[3]) {
    memcpy(origin, model->origin, sizeof model->origin);
}

void sf_model_set_origin(sf_model *model, const double origin[3]) {
    for (int k = 0; k < 3; k++) {
        double move = ldexp(model->origin[k] - origin[k], -model->unit);
        for (size_t i = 0; move != 0 && i < model->count; i++) {
            float *value = sf_value(&model->params, SF_FIELD_mean, i, k);
            *value = (float)((double)*value + move);
        }
        model->origin[k] = origin[k];
    }
    sf_model_note_change(model);
}

void sf_model_set_unit(sf_model *model, int unit) {
    int change = model->unit - unit;
    size_t n = change ? sf_field_values(SF_FIELD_mean, model->count) : 0;
    float *mean = model->params.field[SF_FIELD_mean], *log_scale = model->params.field[SF_FIELD_log_scale];
    for (size_t k = 0; k < n; k++) {
        mean[k] = ldexpf(mean[k], change);
        double scale = (double)log_scale[k] + change * 0.69314718055994531;
        log_scale[k] = (float)fmin(fmax(scale, (double)SF_LOG_SCALE_LEAST), (double)SF_LOG_SCALE_MOST);
    }
    model->unit = unit;
    sf_model_resize(model, model->count); /* lanes behind the last Gaussian are neutral again */
}

/* Walks over one Gaussian's values and the caller's arrays. */
typedef void (*move_fn)(float *blocked, float *plain);

static void take(float *blocked, float *plain) { *blocked = *plain; }
static void give(float *blocked, float *plain) { *plain = *blocked; }

/* A range of Gaussians, in both forms. */
typedef struct walk {
    const sf_params *params;
    const size_t *banded;
    int sh_degree;
    size_t first, count;
    const sf_gaussians *plain;
    move_fn move;
} walk;

static void move_field(const walk *w, int field, float *plain, size_t stride, size_t at) {
    int n = field_components[field];
    size_t banded = w->banded[sf_field_band(field)];
    float lacking = 0; /* a band that the Gaussian lacks: read as 0; when written, checked to be 0 before */
    for (size_t i = 0; plain && i < w->count; i++)
        for (int c = 0; c < n; c++) {
            int has = w->first + i < banded;
            w->move(has ? &w->params->field[field][sf_at(w->first + i, n, c)] : &lacking,
                    &plain[i * stride + at + (size_t)c]);
        }
}

/* Where the coefficients of each band begin. */
static const size_t band_at[SF_BANDS + 1] = {0, 3, 12, 27, 48};

static size_t sh_values(int sh_degree) { return band_at[sh_degree + 1]; }

static void move_all(const walk *w) {
    const sf_gaussians *g = w->plain;
    move_field(w, SF_FIELD_mean, g->means, 3, 0);
    move_field(w, SF_FIELD_quat, g->quats, 4, 0);
    move_field(w, SF_FIELD_log_scale, g->log_scales, 3, 0);
    move_field(w, SF_FIELD_logit_opacity, g->logit_opacities, 1, 0);
    for (int band = 0; band <= w->sh_degree; band++)
        move_field(w, SF_FIELD_sh0 + band, g->sh, sh_values(w->sh_degree), band_at[band]);
}

static sf_status check_range(const sf_model *model, size_t first, size_t count) {
    if (first <= model->count && count <= model->count - first) return SF_OK;
    return sf_fail(model->ctx, SF_ERR_ARGUMENT, "range: Gaussians %zu .. +%zu of %zu", first, count,
                   model->count);
}

/* Values for bands that a Gaussian lacks would be lost. */
static sf_status check_bands(const sf_model *model, size_t first, size_t count, const float *sh) {
    size_t stride = sh_values(model->sh_degree);
    for (size_t i = 0; sh && i < count; i++) {
        int degree = sf_degree_of(model, first + i);
        for (size_t k = sh_values(degree); k < stride; k++)
            if (sh[i * stride + k] != 0)
                return sf_fail(model->ctx, SF_ERR_ARGUMENT,
                               "sh: Gaussian %zu is packed to degree %d and cannot take %g of a higher one",
                               first + i, degree, (double)sh[i * stride + k]);
    }
    return SF_OK;
}

sf_status sf_model_set(sf_model *model, size_t first, size_t count, const sf_gaussians *from) {
    sf_status status = check_range(model, first, count);
    if (!status) status = check_bands(model, first, count, from->sh);
    if (status) return status;
    walk w = {&model->params, model->banded, model->sh_degree, first, count, from, take};
    move_all(&w);
    sf_model_note_change(model);
    return SF_OK;
}

sf_status sf_model_get(const sf_model *model, size_t first, size_t count, const sf_gaussians *to) {
    sf_status status = check_range(model, first, count);
    if (!status) sf_params_get(&model->params, model->banded, model->sh_degree, first, count, to);
    return status;
}

void sf_params_get(const sf_params *params, const size_t banded[SF_BANDS], int sh_degree, size_t first,
                   size_t count, const sf_gaussians *to) {
    walk w = {params, banded, sh_degree, first, count, to, give};
    move_all(&w);
}

void sf_axis_of(const sf_params *params, size_t i, int axis, float *direction) {
    float q[4];
    for (int k = 0; k < 4; k++) q[k] = *sf_value(params, SF_FIELD_quat, i, k);
    sf_quat_axis(q, axis, direction);
}
