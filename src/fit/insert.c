/* insert.c - adds Gaussians at given points while a fit runs. */
#include <math.h>

#include "../scene/init.h"
#include "fitter.h"
#include "reorder.h"
#include "select_merge.h"

static int is_point(const float *xyz, float radius) {
    return isfinite(xyz[0]) && isfinite(xyz[1]) && isfinite(xyz[2]) && isfinite(radius) && radius > 0;
}

/* Appends `count` Gaussians, copies of the first one until they are set. */
static sf_status append_copies(sf_fitter *f, size_t count, uint32_t *moved_to) {
    size_t had = f->model->count;
    sf_remap_entry *entries = sf_alloc(f->ctx, had + count, sizeof *entries);
    if (!entries) return SF_ERR_MEMORY;
    for (size_t i = 0; i < had; i++)
        entries[i] = (sf_remap_entry){(uint32_t)i, (uint8_t)sf_degree_of(f->model, i)};
    for (size_t i = 0; i < count; i++) entries[had + i] = (sf_remap_entry){0, (uint8_t)f->model->sh_degree};
    sf_status status = sf_reorder(f, entries, had + count, moved_to);
    sf_free(f->ctx, entries);
    return status;
}

/* Sets Gaussian i to neutral values and clears its state. */
static void clear(sf_fitter *f, size_t i) {
    const sf_params *p = &f->model->params;
    for (int field = 0; field < SF_FIELD_COUNT; field++)
        for (int k = 0; sf_field_stored(field, f->model->sh_degree) && k < sf_field_components(field); k++)
            *sf_value(p, field, i, k) = field == SF_FIELD_quat && k == 0 ? 1 : 0;
    sf_optimizer_reset(&f->moments, f->model, i);
    f->densify.gradient_sum[i] = 0;
    f->densify.visible_count[i] = 0;
    f->units.inverse[i] = 0;
}

sf_status sf_fitter_add_points(sf_fitter *f, size_t count, const float *xyz, const uint8_t *rgb,
                               const float *radius, size_t *added) {
    size_t most = (size_t)f->options.max_gaussians, n = 0, had;
    if (added) *added = 0;
    sf_merges_undo_all(f); /* the merges refer to indices, which change */
    had = f->model->count;
    for (size_t i = 0; i < count && had + n < most; i++) n += (size_t)is_point(xyz + 3 * i, radius[i]);
    if (!n || !had) return had ? SF_OK : sf_fail(f->ctx, SF_ERR_EMPTY, "model: it has no Gaussian left");
    uint32_t *moved_to = sf_alloc(f->ctx, had + n, sizeof *moved_to);
    sf_status status = moved_to ? append_copies(f, n, moved_to) : SF_ERR_MEMORY;
    for (size_t i = 0, k = 0; k < n && !status; i++) {
        if (!is_point(xyz + 3 * i, radius[i])) continue;
        uint32_t at = moved_to[had + k++];
        clear(f, at);
        float at_xyz[3];
        for (size_t axis = 0; axis < 3; axis++) at_xyz[axis] = ldexpf(xyz[3 * i + axis], -f->model->unit);
        double scale = ldexp(fmin((double)radius[i], f->extent), -f->model->unit);
        sf_point_gaussian(&f->model->params, at, at_xyz, rgb + 3 * i, scale, f->options.init_opacity);
    }
    sf_free(f->ctx, moved_to);
    if (!status && added) *added = n;
    return status;
}
