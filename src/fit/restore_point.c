/* restore_point.c - an earlier model to go back to. */
#include "restore_point.h"

#include <string.h>

#include "densify.h"
#include "reorder.h"
#include "select_merge.h"

/* Whether `best` has room for the model, and not more than the model. */
static int has_room(const sf_model *best, const sf_model *model) {
    for (int band = 0; band <= model->sh_degree; band++)
        if (best->capacity[band] < model->banded[band] || best->capacity[band] > model->capacity[band])
            return 0;
    return 1;
}

sf_status sf_save_restore_point(sf_fitter *f) {
    if (!f->restore.model || !has_room(f->restore.model, f->model)) {
        sf_model *best;
        sf_status status = sf_model_copy(f->model, f->model->capacity[0], &best);
        if (status) return status;
        sf_model_destroy(&f->restore.model);
        f->restore.model = best;
    } else {
        sf_model_assign(f->restore.model, f->model);
    }
    memcpy(f->restore.background, f->background, sizeof f->background);
    sf_merges_undo(&f->merges, f->restore.model);
    return SF_OK;
}

sf_status sf_go_to_restore_point(sf_fitter *f) {
    sf_status status = sf_fitter_room(f, f->restore.model->banded);
    if (status) return status;
    f->merges.count = 0; /* the restore point has none */
    sf_model_assign(f->model, f->restore.model);
    sf_optimizer_reset_all(&f->moments, f->model);
    sf_densify_clear(&f->densify, f->model->count);
    memset(f->units.inverse, 0, f->model->count * sizeof *f->units.inverse);
    memcpy(f->background, f->restore.background, sizeof f->background);
    f->validation.psnr = f->validation.best_psnr;
    f->optimizer_restart = f->step;
    return SF_OK;
}
