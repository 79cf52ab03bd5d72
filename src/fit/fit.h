/* fit.h - creates the state of a fit, and parts of a step. */
#ifndef SF_FIT_FIT_H
#define SF_FIT_FIT_H

#include "fitter.h"

/* Makes a fitter without a model and its arrays, and checks the options. SF_ERR_ARGUMENT, with the option's
 * name; SF_ERR_EMPTY: the scene has no training view; SF_ERR_MEMORY. On failure *fitter is NULL. */
sf_status sf_fitter_create_empty(sf_context *ctx, sf_scene *scene, const sf_fit_options *options,
                                 sf_fitter **fitter);

/* After the update of a step for which selection or densification is due: selection where that is due, then
 * densification, unless only selection was due. */
void sf_select_and_densify(sf_fitter *fitter, double fraction);

#endif
