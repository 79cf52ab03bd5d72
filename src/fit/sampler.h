/* sampler.h - the order in which training views are drawn. */
#ifndef SF_FIT_SAMPLER_H
#define SF_FIT_SAMPLER_H

#include "fitter.h"

/* Retains the next training view; the caller releases it. Each view is drawn once a pass. Views that were
 * added to the scene since the pass began come next; removed views are skipped. SF_ERR_EMPTY: there is no
 * training view. SF_ERR_MEMORY. */
sf_status sf_next_view(sf_fitter *fitter, sf_view **view);
/* The next view begins a new pass. */
void sf_sampler_restart(sf_view_sampler *sampler);

#endif
