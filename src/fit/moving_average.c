/* moving_average.c - the model without the noise of single steps.
 *
 * Each step pleases one view, and who looks between two steps sees that. A fit that ends lets its rates fall;
 * one that is watched and tracked against while it goes on shows means of its last steps (ema_steps).
 */
#include "moving_average.h"

#include <math.h>

void sf_take_moving_average(const sf_fitter *f, sf_model *copy) {
    if (!(f->moments.mean_kept > 0)) return;
    for (int field = 0; sf_has_momentum(field); field++)
        sf_mean_take(&f->moments, field, sf_field_values(field, copy->count), f->model->params.field[field],
                     copy->params.field[field]);
    /* A step holds the parameter within what a model's file may hold; the mean is off it by what it was
     * before, and by rounding. */
    float *scales = copy->params.field[SF_FIELD_log_scale];
    for (size_t k = 0; k < sf_field_values(SF_FIELD_log_scale, copy->count); k++)
        scales[k] = fminf(fmaxf(scales[k], -SF_LOG_SCALE_MOST), SF_LOG_SCALE_MOST);
}

/* Arrays of its own for what has a mean; the others are the model's. */
static sf_status make_room(sf_fitter *f) {
    const sf_model *m = f->model;
    sf_model *shown = &f->shown;
    if (shown->capacity[0] == m->capacity[0]) return SF_OK;
    shown->capacity[0] = 0;
    for (int field = 0; sf_has_momentum(field); field++) {
        sf_status status = sf_blocked_resize(f->ctx, sf_field_components(field), &shown->params.field[field],
                                             0, m->capacity[0]);
        if (status) return status;
    }
    shown->capacity[0] = m->capacity[0];
    return SF_OK;
}

const sf_model *sf_fitter_average_model(sf_fitter *f) {
    if (!(f->moments.mean_kept > 0) || make_room(f)) return f->model;
    sf_params own = f->shown.params;
    f->shown = *f->model;
    for (int field = 0; sf_has_momentum(field); field++) f->shown.params.field[field] = own.field[field];
    sf_take_moving_average(f, &f->shown);
    return &f->shown;
}

void sf_average_free(sf_fitter *f) {
    for (int field = 0; sf_has_momentum(field); field++) sf_free(f->ctx, f->shown.params.field[field]);
}
