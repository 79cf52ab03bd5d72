/* update.h - one step of the optimizer. */
#ifndef SF_FIT_UPDATE_H
#define SF_FIT_UPDATE_H

#include "fitter.h"

/* Turns the gradients of the projected Gaussians into those of the parameters, makes one step of Adam on all
 * fields, limits the scales, and adds to the statistics of densification. d_camera: NULL or
 * [SF_CAMERA_SUMS], the gradient of the camera. SF_ERR_MEMORY: nothing has changed. */
sf_status sf_update(sf_fitter *fitter, double fraction, double *d_camera);
/* One step of Adam on the background; gradient: [3]. */
void sf_update_background(sf_fitter *fitter, double fraction, const double *gradient);

#endif
