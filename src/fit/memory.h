/* memory.h - estimates the memory of a fit in advance. */
#ifndef SF_FIT_MEMORY_H
#define SF_FIT_MEMORY_H

#include "fitter.h"

/* Estimates the memory of a fit with bands up to sh_degree, and lowers options.max_gaussians to what fits
 * into the budget. SF_ERR_MEMORY, with the figures: not even `least` Gaussians fit. */
sf_status sf_fitter_plan_memory(sf_fitter *fitter, size_t least, int sh_degree);
/* Stops densification (densify.out_of_memory) where the process uses more than its budget. */
void sf_fitter_watch_memory(sf_fitter *fitter);

#endif
