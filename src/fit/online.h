/* online.h - a fit whose pictures, poses and points arrive while it runs: what src/live needs beside
 * fitter.h.
 */
#ifndef SF_FIT_ONLINE_H
#define SF_FIT_ONLINE_H

#include "../render/workspace.h"
#include "../scene/gaussians.h"

#include <splatfit/fitter.h>

/* SF_ERR_ARGUMENT, with the option's name, where sf_fitter_create would refuse the options. */
sf_status sf_online_check(sf_context *ctx, const sf_fit_options *options);

/* Whether the fit has a state of the training view: from then on its pose and exposure can be set. */
int sf_online_has_view(const sf_fitter *fitter, uint32_t id);

/* Corrects the camera of such a view, as sf_fitter_set_pose, its intrinsics too. The scene has its own copy.
 * SF_ERR_MEMORY. */
sf_status sf_online_set_camera(sf_fitter *fitter, uint32_t id, const sf_camera *camera);

/* Corrects a camera of the scene as sf_fitter_get_camera does; it does not ask the scene, which may be
 * locked. */
void sf_online_refine_camera(const sf_fitter *fitter, uint32_t id, sf_camera *camera);

/* World units: the nearest depth that is drawn, and the extent of the scene. */
double sf_online_near_plane(const sf_fitter *fitter);
double sf_online_extent(const sf_fitter *fitter);

/* The model to track against, with the parameters' moving averages where they are kept, and how the next step
 * draws it. The fitter's, to be read until the next step. */
const sf_model *sf_online_model(sf_fitter *fitter, sf_render_options *options);

/* Draws the same model with all of its bands and with depths. *drawing: the fitter's, to be read until it
 * draws or steps again. SF_ERR_MEMORY. */
sf_status sf_online_draw(sf_fitter *fitter, const sf_camera *camera, const sf_workspace **drawing);

/* Calls `move` with each model that the fit may continue from: the present one, and the best one so far,
 * which comes back after a divergence. Tentative merges are undone before, for undoing them later would bring
 * back the means of before. */
void sf_online_move_means(sf_fitter *fitter, void (*move)(sf_model *model, void *user), void *user);

#endif
