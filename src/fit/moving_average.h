/* moving_average.h - the moving average of the model over the last steps. */
#ifndef SF_FIT_MOVING_AVERAGE_H
#define SF_FIT_MOVING_AVERAGE_H

#include "fitter.h"

/* The model to show and to track against: its moving average where one is kept (option ema_steps), else the
 * model itself, as also where memory is short. The fitter's, to be read until the next step. */
const sf_model *sf_fitter_average_model(sf_fitter *fitter);
/* Puts the moving averages into a copy of the model. */
void sf_take_moving_average(const sf_fitter *fitter, sf_model *copy);
/* Frees what sf_fitter_average_model has made. */
void sf_average_free(sf_fitter *fitter);

#endif
