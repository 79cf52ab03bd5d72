/* blur.h - training views that are blurred. */
#ifndef SF_FIT_BLUR_H
#define SF_FIT_BLUR_H

#include "fitter.h"

/* Finds the blurred training views once, when it is due, and logs them. SF_ERR_MEMORY: some may be missing.
 */
sf_status sf_measure_blur(sf_fitter *fitter, double fraction);
/* Leaves blurred views out of most passes; called when a pass has just begun. */
void sf_skip_blurred_views(sf_fitter *fitter);

#endif
