/* remove.c - removes Gaussians that are marked, too faint or not finite. */
#include "remove.h"

#include <math.h>

#include "../scene/gaussian_math.h"
#include "reorder.h"
#include "select_merge.h"

float sf_min_logit_opacity(const sf_fitter *f) {
    double opacity = f->options.prune_opacity;
    return opacity > 0 ? sf_logitf(fminf((float)opacity, 0.999f)) : -INFINITY;
}

int sf_is_kept(const sf_fitter *f, size_t i, float min_logit) {
    const sf_params *p = &f->model->params;
    for (int field = 0; field < SF_FIELD_COUNT; field++)
        for (int c = 0; i < f->model->banded[sf_field_band(field)] && c < sf_field_components(field); c++)
            if (!isfinite(*sf_value(p, field, i, c))) return 0;
    return p->field[SF_FIELD_logit_opacity][i] >= min_logit && !(f->densify.gradient_sum[i] < 0);
}

/* Removes the Gaussians that sf_is_kept does not keep. degrees: NULL or [count], new SH degrees. */
static sf_status remove_below(sf_fitter *f, float min_logit, const uint8_t *degrees) {
    size_t kept = 0, count = f->model->count, lowered = 0;
    sf_remap_entry *entries = sf_alloc(f->ctx, count, sizeof *entries);
    if (!entries) return SF_ERR_MEMORY;
    for (size_t i = 0; i < count; i++) {
        if (!sf_is_kept(f, i, min_logit)) continue;
        sf_remap_entry entry = (sf_remap_entry){(uint32_t)i, (uint8_t)sf_degree_of(f->model, i)};
        if (degrees && degrees[i] < entry.degree) entry.degree = degrees[i], lowered++;
        entries[kept++] = entry;
    }
    sf_status status = kept < count || lowered ? sf_reorder(f, entries, kept, NULL) : SF_OK;
    sf_free(f->ctx, entries);
    return status;
}

sf_status sf_remove_marked(sf_fitter *f, const uint8_t *degrees) {
    return remove_below(f, sf_min_logit_opacity(f), degrees);
}

sf_status sf_remove_not_finite(sf_fitter *f) {
    size_t had = f->model->count, finite = 0;
    while (finite < had && sf_is_kept(f, finite, -INFINITY)) finite++;
    if (finite == had) return SF_OK;
    sf_merges_undo_all(f); /* the merges refer to indices, which change */
    sf_status status = remove_below(f, -INFINITY, NULL);
    if (f->model->count < had)
        sf_log(f->ctx, SF_LOG_WARNING,
               "step %lld: removed %zu of %zu Gaussians with values that are not finite", (long long)f->step,
               had - f->model->count, had);
    return status;
}
