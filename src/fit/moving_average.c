/* moving_average.c - the moving average (EMA) of the parameters over the last steps.
 *
 * Each step fits one view, which shows when the model is rendered between two steps. At the end of a fit the
 * cool-down removes that noise. A model that is displayed and tracked against while it is trained is averaged
 * instead (option ema_steps).
 */
#include "moving_average.h"

#include <math.h>

void sf_take_moving_average(const sf_fitter *f, sf_model *copy) {
    if (!(f->moments.mean_kept > 0)) return;
    for (int field = 0; sf_has_momentum(field); field++)
        sf_mean_take(&f->moments, field, sf_field_values(field, copy->count), f->model->params.field[field],
                     copy->params.field[field]);
    /* The parameter is within the range that files allow. The average can leave it by rounding, or by the
     * offset of a parameter that was limited. */
    float *scales = copy->params.field[SF_FIELD_log_scale];
    for (size_t k = 0; k < sf_field_values(SF_FIELD_log_scale, copy->count); k++)
        scales[k] = fminf(fmaxf(scales[k], SF_LOG_SCALE_LEAST_TRAINED), SF_LOG_SCALE_MOST);
}

/* Arrays for the averaged fields; the others are shared with the model. */
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
