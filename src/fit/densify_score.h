/* densify_score.h - statistics of densification by error. */
#ifndef SF_FIT_DENSIFY_SCORE_H
#define SF_FIT_DENSIFY_SCORE_H

#include "fitter.h"

/* Replaces densify.gradient_sum by each Gaussian's error share in several training views, below 0 for
 * Gaussians that have no blend weight in them. SF_ERR_MEMORY: nothing has changed. */
sf_status sf_densify_score(sf_fitter *fitter);

#endif
