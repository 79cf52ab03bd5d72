/* validation.h - training views kept out of the training: they choose the best model and end the run. */
#ifndef SF_FIT_VALIDATION_H
#define SF_FIT_VALIDATION_H

#include "fitter.h"

/* Assigns the training views that are new since the last call to validation or training; ids: of all training
 * views, ascending. SF_ERR_MEMORY. */
sf_status sf_assign_views(sf_fitter *fitter, const uint32_t *ids, size_t count);
/* Mean PSNR of the views of validation that are not blurred; *views: how many those are. SF_ERR_MEMORY. */
sf_status sf_measure_validation(sf_fitter *fitter, double *psnr, size_t *views);
/* The next model that is validated becomes the best one: the present model was changed on purpose, and may be
 * worse. */
void sf_forget_best_model(sf_validation *validation);
/* Validates when it is due, saves the best model, merges the views of validation back into the training when
 * the cool-down begins, and ends the run: SF_ERR_END. SF_ERR_MEMORY. */
sf_status sf_validation_step(sf_fitter *fitter, double fraction);
/* Whether validation chooses the best model now. */
int sf_validation_chooses(const sf_validation *validation);

#endif
