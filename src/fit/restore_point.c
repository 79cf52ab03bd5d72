/* restore_point.c - an earlier model to go back to. */
#include "restore_point.h"

#include <string.h>

#include "densify.h"
#include "ranks.h"
#include "reorder.h"
#include "select_merge.h"

int sf_has_restore_point(const sf_fitter *f) {
    return f->restore.model || !sf_half_model_is_empty(&f->restore.half);
}

void sf_drop_restore_point(sf_fitter *f) {
    sf_model_destroy(&f->restore.model);
    sf_half_model_free(f->ctx, &f->restore.half);
}

sf_status sf_expand_restore_point(sf_fitter *f) {
    if (sf_half_model_is_empty(&f->restore.half)) return SF_OK;
    sf_status status = sf_half_model_copy(&f->restore.half, f->ctx, &f->restore.model);
    if (!status) sf_half_model_free(f->ctx, &f->restore.half);
    return status;
}

/* The model as it was before tentative merges, as floats. */
static sf_status save_model(sf_fitter *f) {
    sf_drop_restore_point(f); /* first, so that no more than one is in memory */
    sf_status status = sf_model_copy(f->model, f->model->count, &f->restore.model);
    if (!status) sf_merges_undo(&f->merges, f->restore.model);
    return status;
}

/* The same in half of the memory. */
static sf_status save_half(sf_fitter *f) {
    sf_status status = f->merges.count ? save_model(f) : SF_OK;
    if (!status) status = sf_half_model_set(f->merges.count ? f->restore.model : f->model, &f->restore.half);
    sf_model_destroy(&f->restore.model);
    return status;
}

sf_status sf_save_restore_point(sf_fitter *f) {
    sf_status status = sf_is_shared(f) ? save_model(f) : save_half(f);
    memcpy(f->restore.background, f->background, sizeof f->background);
    return status;
}

sf_status sf_go_to_restore_point(sf_fitter *f) {
    const sf_restore_point *from = &f->restore;
    sf_status status = sf_fitter_room(f, from->model ? from->model->banded : from->half.banded);
    if (status) return status;
    f->merges.count = 0, f->merges.on_ranks = 0; /* the restore point has none */
    if (from->model)
        sf_model_assign(f->model, from->model);
    else
        sf_half_model_get(&from->half, f->model);
    sf_optimizer_reset_all(&f->moments, f->model);
    sf_densify_clear(&f->densify, f->model->count);
    memset(f->units.inverse, 0, f->model->count * sizeof *f->units.inverse);
    memcpy(f->background, from->background, sizeof f->background);
    f->validation.psnr = f->validation.best_psnr;
    f->optimizer_restart = f->step;
    return SF_OK;
}
