/* exposure.h - a gain and a bias per channel of each training picture, between the render and the loss. */
#ifndef SF_FIT_EXPOSURE_H
#define SF_FIT_EXPOSURE_H

#include "../render/workspace.h"
#include "views.h"

#include <splatfit/fitter.h>

typedef struct sf_exposure {
    float *rgb[SF_CHANNELS]; /* planes as the workspace's; the render's own between expose and expose_bwd */
    size_t capacity;
} sf_exposure;

/* Room for planes as large as the workspace's. */
sf_status sf_exposure_room(sf_exposure *exposure, const sf_workspace *ws);
void sf_exposure_free(sf_exposure *exposure, sf_context *ctx);

/* Puts y = exp(log_gain) x + bias, at most 1 as pictures are, in the place of the render x, for the loss. */
void sf_expose(sf_exposure *exposure, sf_workspace *ws, const sf_view_state *view);

/* The render in the place of y, or y in that of the render. */
void sf_expose_swap(sf_exposure *exposure, sf_workspace *ws);

/* Puts the render back, takes ws->d_rgb from dL/dy to dL/dx, and gives the gradient of the three log gains
 * and the three biases, [6]. */
void sf_expose_bwd(sf_exposure *exposure, sf_workspace *ws, const sf_view_state *view, double *gradient);

/* One step of Adam on the view's six values; then all views' are moved together, so that their mean is 0:
 * else the model's own colours would be free to drift. decay: of the rates since the start. */
void sf_exposure_update(sf_view_states *views, sf_view_state *view, const double *gradient,
                        const sf_fit_options *options, double decay);

#endif
