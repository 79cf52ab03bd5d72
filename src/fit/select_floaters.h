/* select_floaters.h - near-camera floaters: Gaussians around a training camera, or close in front of it. */
#ifndef SF_FIT_SELECT_FLOATERS_H
#define SF_FIT_SELECT_FLOATERS_H

#include "fitter.h"

/* Marks them for removal in densify.gradient_sum (below 0). SF_ERR_MEMORY: none is marked. */
sf_status sf_mark_floaters(sf_fitter *fitter);

#endif
