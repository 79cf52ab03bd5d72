/* exposure.h - a gain and a bias per channel of each training picture, between the render and the loss. */
#ifndef SF_FIT_EXPOSURE_H
#define SF_FIT_EXPOSURE_H

#include "../render/workspace.h"
#include "views.h"

#include <splatfit/fitter.h>

typedef struct sf_exposure {
    float *rgb[SF_CHANNELS]; /* planes like the workspace's; between sf_expose and sf_expose_bwd the render */
    size_t capacity;
} sf_exposure;

/* Room for planes as large as the workspace's. */
sf_status sf_exposure_room(sf_exposure *exposure, const sf_workspace *ws);
void sf_exposure_free(sf_exposure *exposure, sf_context *ctx);

/* Replaces the render x by y = min(exp(log_gain) x + bias, 1) for the loss; pictures are at most 1. */
void sf_expose(sf_exposure *exposure, sf_workspace *ws, const sf_view_state *view);

/* Swaps the render and y. */
void sf_expose_swap(sf_exposure *exposure, sf_workspace *ws);

/* Puts the render back, turns ws->d_rgb from dL/dy into dL/dx, and writes the gradient of the three log gains
 * and the three biases, [6]. */
void sf_expose_bwd(sf_exposure *exposure, sf_workspace *ws, const sf_view_state *view, double *gradient);

/* One step of Adam on the six values of the view. Then those of all views are shifted to a mean of 0, or the
 * colours of the model could drift. decay: factor of the learning rates. */
void sf_exposure_update(sf_view_states *views, sf_view_state *view, const double *gradient,
                        const sf_fit_options *options, double decay);

#endif
