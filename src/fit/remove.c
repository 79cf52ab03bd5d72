/* remove.c - which Gaussians stay. */
#include "remove.h"

#include <math.h>

#include "../scene/gaussian_math.h"
#include "reorder.h"
#include "select_merge.h"

float sf_min_logit_opacity(const sf_fitter *f) {
    double opacity = f->options.prune_opacity;
    return opacity > 0 ? sf_logitf(fminf((float)opacity, 0.999f)) : -INFINITY;
}

int sf_is_kept(const sf_fitter *f, size_t i, float faintest) {
    const sf_params *p = &f->model->params;
    for (int field = 0; field < SF_FIELD_COUNT; field++)
        for (int c = 0; i < f->model->banded[sf_field_band(field)] && c < sf_field_components(field); c++)
            if (!isfinite(*sf_value(p, field, i, c))) return 0;
    return p->field[SF_FIELD_logit_opacity][i] >= faintest && !(f->densify.gradient_sum[i] < 0);
}

/* degrees: NULL or [count], no higher than the present ones. */
static sf_status remove_others(sf_fitter *f, float faintest, const uint8_t *degrees) {
    size_t kept = 0, count = f->model->count, lowered = 0;
    sf_remap_entry *places = sf_alloc(f->ctx, count, sizeof *places);
    if (!places) return SF_ERR_MEMORY;
    for (size_t i = 0; i < count; i++) {
        if (!sf_is_kept(f, i, faintest)) continue;
        sf_remap_entry place = (sf_remap_entry){(uint32_t)i, (uint8_t)sf_degree_of(f->model, i)};
        if (degrees && degrees[i] < place.degree) place.degree = degrees[i], lowered++;
        places[kept++] = place;
    }
    sf_status status = kept < count || lowered ? sf_reorder(f, places, kept, NULL) : SF_OK;
    sf_free(f->ctx, places);
    return status;
}

sf_status sf_remove_marked(sf_fitter *f, const uint8_t *degrees) {
    return remove_others(f, sf_min_logit_opacity(f), degrees);
}

sf_status sf_remove_not_finite(sf_fitter *f) {
    size_t had = f->model->count, finite = 0;
    while (finite < had && sf_is_kept(f, finite, -INFINITY)) finite++;
    if (finite == had) return SF_OK;
    sf_merges_undo_all(f); /* the others find other places */
    sf_status status = remove_others(f, -INFINITY, NULL);
    if (f->model->count < had)
        sf_log(f->ctx, SF_LOG_WARNING,
               "step %lld: removed %zu of %zu Gaussians with values that are not finite", (long long)f->step,
               had - f->model->count, had);
    return status;
}
