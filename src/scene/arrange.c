/* arrange.c - orders Gaussians by falling SH degree; the move itself is in move.c. */
#include "gaussians.h"

#include <string.h>

enum { VACANT = UINT32_MAX };

int sf_degree_of(const sf_model *model, size_t i) {
    int degree = model->sh_degree;
    while (degree && i >= model->banded[degree]) degree--;
    return degree;
}

/* Allocates the order and counts its bands; at[degree]: where the entries of a degree begin. */
static sf_status begin_order(sf_context *ctx, const sf_remap_entry *entries, size_t n, size_t at[SF_BANDS],
                             sf_order *order) {
    *order = (sf_order){.ctx = ctx, .from = sf_alloc(ctx, n + 1, sizeof *order->from)};
    if (!order->from) return SF_ERR_MEMORY;
    for (size_t k = 0; k < n; k++)
        for (int band = 0; band <= entries[k].degree; band++) order->banded[band]++;
    for (int degree = 0; degree < SF_BANDS; degree++) /* higher degrees come first */
        at[degree] = degree < SF_MAX_SH_DEGREE ? order->banded[degree + 1] : 0;
    return SF_OK;
}

sf_status sf_order_create(sf_context *ctx, const sf_remap_entry *entries, size_t n, uint32_t *where,
                          sf_order *order) {
    size_t at[SF_BANDS];
    sf_status status = begin_order(ctx, entries, n, at, order);
    for (size_t k = 0; k < n && !status; k++) {
        size_t to = at[entries[k].degree]++;
        order->from[to] = entries[k].from;
        if (where) where[k] = (uint32_t)to;
    }
    return status;
}

sf_status sf_order_create_in_place(sf_context *ctx, const sf_remap_entry *entries, size_t n, uint32_t *where,
                                   sf_order *order) {
    size_t at[SF_BANDS];
    sf_status status = begin_order(ctx, entries, n, at, order);
    if (status) return status;
    for (size_t i = 0; i < n; i++) order->from[i] = VACANT;
    for (size_t k = 0; k < n; k++) {
        size_t i = entries[k].from, first = at[entries[k].degree], end = order->banded[entries[k].degree];
        int keeps = i >= first && i < end && order->from[i] == VACANT;
        where[k] = keeps ? (uint32_t)i : VACANT;
        if (keeps) order->from[i] = (uint32_t)i;
    }
    for (size_t k = 0; k < n; k++) {
        if (where[k] != VACANT) continue;
        size_t *to = &at[entries[k].degree];
        while (order->from[*to] != VACANT) ++*to;
        order->from[*to] = entries[k].from;
        where[k] = (uint32_t)*to;
    }
    return SF_OK;
}

/* The highest band of Gaussian i that is not all 0. */
static uint8_t used_degree(const sf_model *model, size_t i) {
    for (int degree = sf_degree_of(model, i); degree > 0; degree--) {
        int field = SF_FIELD_sh0 + degree, n = sf_field_components(field);
        for (int c = 0; c < n; c++)
            if (model->params.field[field][sf_at(i, n, c)] != 0) return (uint8_t)degree;
    }
    return 0;
}

sf_status sf_model_pack(sf_model *model) {
    sf_order order = {0};
    sf_remap_entry *entries = sf_alloc(model->ctx, model->count, sizeof *entries);
    if (!entries) return SF_ERR_MEMORY;
    for (size_t i = 0; i < model->count; i++)
        entries[i] = (sf_remap_entry){(uint32_t)i, used_degree(model, i)};
    sf_status status = sf_order_create(model->ctx, entries, model->count, NULL, &order);
    sf_free(model->ctx, entries);
    if (!status) status = sf_order_prepare(model->ctx, &order);
    if (!status) sf_model_reorder(model, &order);
    sf_order_free(model->ctx, &order);
    for (int band = 1; band <= model->sh_degree && !status; band++) {
        size_t room = model->banded[band]; /* on failure the arrays stay larger than needed */
        if (sf_blocks(room) * SF_LANES < model->capacity[band]) (void)sf_model_set_room(model, band, room);
    }
    return status;
}

void sf_model_degrees(const sf_model *model, size_t count[SF_MAX_SH_DEGREE + 1]) {
    for (int degree = 0; degree < SF_BANDS; degree++)
        count[degree] = model->banded[degree] - (degree < SF_MAX_SH_DEGREE ? model->banded[degree + 1] : 0);
}

size_t sf_model_floats(const sf_model *model) {
    size_t floats = 0;
    for (int f = 0; f < SF_FIELD_COUNT; f++)
        floats += model->banded[sf_field_band(f)] * (size_t)sf_field_components(f);
    return floats;
}
