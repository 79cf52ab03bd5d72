/* draw_view.h - renders a training view, and loads the picture that it is compared with. */
#ifndef SF_FIT_DRAW_VIEW_H
#define SF_FIT_DRAW_VIEW_H

#include "fitter.h"

/* Renders into fitter->workspace at the fitter's level, degree and step_background, with the camera and the
 * exposure learned of the view (state; NULL: nothing is learned), and loads the target, ready for the loss.
 * *weight_sum: of the pixels of the target. SF_ERR_EMPTY: the view is wholly masked. SF_ERR_MEMORY. */
sf_status sf_draw_view(sf_fitter *fitter, const sf_view *view, const sf_view_state *state,
                       double *weight_sum);

/* Loads the target of the picture in fitter->workspace, whose size is the view's over `factor`, and sums its
 * weights. SF_ERR_MEMORY, and as sf_view_open. */
sf_status sf_load_target(sf_fitter *fitter, const sf_view *view, int factor, double *weight_sum);

#endif
