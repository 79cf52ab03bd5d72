/* densify.h - adds Gaussians: splits and clones, or relocates. */
#ifndef SF_FIT_DENSIFY_H
#define SF_FIT_DENSIFY_H

#include "fitter.h"

/* Removes Gaussians that are too faint or not finite, then splits and clones up to the planned number; or
 * relocates, as option growth says. SF_ERR_MEMORY. */
sf_status sf_densify_step(sf_fitter *fitter, double fraction);
/* Ends densification for lack of memory, and logs it once. */
void sf_densify_end(sf_fitter *fitter);
/* Clears the statistics that densification uses. */
void sf_densify_clear(sf_densify *densify, size_t count);

#endif
