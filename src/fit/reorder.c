/* reorder.c - reorders Gaussians and resizes all arrays that follow the model. */
#include "reorder.h"

#include <string.h>

#include "../scene/curve.h"
#include "out_of_view.h"

/* Fewer Gaussians are not sorted: they fit into the caches in any order. */
enum { LEAST_SORTED = 1024 };

static size_t least_of(size_t a, size_t b) { return a < b ? a : b; }

/* The counters of all groups, 0: second moments are brought up to date before Gaussians are moved. */
static sf_status out_of_view_room(sf_fitter *f, size_t room) {
    size_t groups = room / (SF_PROJECT_BLOCKS * SF_LANES) + 1;
    uint32_t *steps = sf_calloc(f->ctx, groups, sizeof *steps);
    if (!steps) return SF_ERR_MEMORY;
    sf_free(f->ctx, f->out_of_view.steps);
    f->out_of_view.steps = steps;
    return SF_OK;
}

/* Resizes the arrays of a band. The model's capacity is lowered first and raised last, so that no array is
 * ever smaller than it says. */
static sf_status set_room(sf_fitter *f, int band, size_t room) {
    sf_model *m = f->model;
    size_t used = m->count;
    room = sf_blocks(room) * SF_LANES;
    if (room < m->capacity[band]) m->capacity[band] = room;
    sf_status status = sf_optimizer_set_room(&f->moments, m, band, room);
    if (!status && band == 0) {
        status = sf_resize(f->ctx, &f->densify.gradient_sum, used, room, sizeof *f->densify.gradient_sum);
        if (!status)
            status =
                sf_resize(f->ctx, &f->densify.visible_count, used, room, sizeof *f->densify.visible_count);
        if (!status) status = sf_resize(f->ctx, &f->units.inverse, used, room, sizeof *f->units.inverse);
        if (!status) status = out_of_view_room(f, room);
    }
    return status ? status : sf_model_set_room(m, band, room);
}

/* Capacity for `count` Gaussians: half as much again, up to max_gaussians. */
static size_t room_for(const sf_fitter *f, size_t count) {
    size_t most = (size_t)f->options.max_gaussians, room = count + count / 2;
    return room <= most ? room : count > most ? count : most;
}

/* Capacity for a band: that of the other fields (whole) if all Gaussians have the band. */
static size_t room_of_band(const sf_fitter *f, const size_t banded[SF_BANDS], int band, size_t whole) {
    return banded[band] == banded[0] ? whole : least_of(room_for(f, banded[band]), whole);
}

sf_status sf_fitter_room(sf_fitter *f, const size_t banded[SF_BANDS]) {
    size_t whole = f->model->capacity[0];
    sf_status status = SF_OK;
    if (banded[0] > whole) whole = room_for(f, banded[0]);
    for (int band = 0; band <= f->model->sh_degree && !status; band++)
        if (banded[band] > f->model->capacity[band])
            status = set_room(f, band, room_of_band(f, banded, band, whole));
    return status;
}

/* Shrinks the arrays of bands that are mostly unused. On failure they stay larger. */
static void trim(sf_fitter *f) {
    const sf_model *m = f->model;
    for (int band = 1; band <= m->sh_degree; band++) {
        size_t room = room_of_band(f, m->banded, band, m->capacity[0]);
        if (m->capacity[band] > room + room / 2 + SF_LANES) (void)set_room(f, band, room);
    }
}

sf_status sf_fitter_set_room(sf_fitter *f, size_t count) {
    const sf_model *m = f->model;
    size_t whole = count > m->count ? count : m->count;
    sf_status status = SF_OK;
    for (int band = 0; band <= m->sh_degree && !status; band++)
        status = set_room(f, band, room_of_band(f, m->banded, band, whole));
    return status;
}

sf_status sf_fitter_start_room(sf_fitter *f, size_t count) {
    sf_model *m = f->model;
    size_t whole = count > m->count ? count : m->count;
    sf_status status = SF_OK;
    for (int band = 0; band <= m->sh_degree && !status; band++)
        status = sf_model_set_room(m, band, room_of_band(f, m->banded, band, whole));
    if (!status) status = sf_optimizer_create(m, (int)f->options.moments, f->options.ema_steps, &f->moments);
    if (status) return status;
    f->densify.gradient_sum = sf_calloc(f->ctx, m->capacity[0], sizeof *f->densify.gradient_sum);
    f->densify.visible_count = sf_calloc(f->ctx, m->capacity[0], sizeof *f->densify.visible_count);
    f->units.inverse = sf_calloc(f->ctx, m->capacity[0], sizeof *f->units.inverse);
    status = out_of_view_room(f, m->capacity[0]);
    return f->densify.gradient_sum && f->densify.visible_count && f->units.inverse ? status : SF_ERR_MEMORY;
}

/* Brings all arrays into the order; frees it. created: of the order. */
static sf_status apply(sf_fitter *f, sf_status created, sf_order *order) {
    size_t had = f->model->count;
    sf_status status = created;
    sf_update_second_moments(f);
    if (!status) status = sf_fitter_room(f, order->banded);
    if (!status) status = sf_order_prepare(f->ctx, order);
    if (!status) {
        sf_order_add_values(order, f->densify.gradient_sum, sizeof *f->densify.gradient_sum, had);
        sf_order_add_values(order, f->densify.visible_count, sizeof *f->densify.visible_count, had);
        sf_order_add_values(order, f->units.inverse, sizeof *f->units.inverse, had);
        sf_optimizer_reorder(&f->moments, f->model, order);
        sf_model_reorder(f->model, order);
    }
    sf_order_free(f->ctx, order);
    if (!status) trim(f);
    return status;
}

sf_status sf_reorder(sf_fitter *f, const sf_remap_entry *entries, size_t n, uint32_t *moved_to) {
    sf_order order;
    return apply(f, sf_order_create(f->ctx, entries, n, moved_to, &order), &order);
}

sf_status sf_reorder_unsorted(sf_fitter *f, const sf_remap_entry *entries, size_t n, uint32_t *moved_to) {
    sf_order order;
    if (n < LEAST_SORTED) return sf_reorder(f, entries, n, moved_to);
    return apply(f, sf_order_create_in_place(f->ctx, entries, n, moved_to, &order), &order);
}

/* The means as plain values. */
static void get_means(const sf_model *m, float *xyz) {
    const float *means = m->params.field[SF_FIELD_mean];
    for (size_t i = 0; i < m->count; i++)
        for (int k = 0; k < 3; k++) xyz[3 * i + (size_t)k] = means[sf_at(i, 3, k)];
}

sf_status sf_list_along_curve(const sf_model *m, sf_remap_entry *entries) {
    size_t n = m->count;
    uint32_t *order = NULL;
    float *xyz = sf_alloc(m->ctx, 3 * n + 1, sizeof *xyz);
    if (xyz) get_means(m, xyz);
    sf_status status = xyz ? sf_curve_order(m->ctx, xyz, n, NULL, &order) : SF_ERR_MEMORY;
    sf_free(m->ctx, xyz);
    for (size_t i = 0; i < n && !status; i++)
        entries[i] = (sf_remap_entry){order[i], (uint8_t)sf_degree_of(m, order[i])};
    sf_free(m->ctx, order);
    return status;
}

sf_status sf_fitter_sort(sf_fitter *f) {
    size_t n = f->model->count;
    if (n < LEAST_SORTED) return SF_OK;
    sf_remap_entry *entries = sf_alloc(f->ctx, n, sizeof *entries);
    sf_status status = entries ? sf_list_along_curve(f->model, entries) : SF_ERR_MEMORY;
    if (!status) status = sf_reorder(f, entries, n, NULL);
    sf_free(f->ctx, entries);
    return status;
}
