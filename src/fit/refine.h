/* refine.h - refines the training views' poses and focal lengths (M.6). The scene keeps the given ones. */
#ifndef SF_FIT_REFINE_H
#define SF_FIT_REFINE_H

#include "../render/workspace.h"
#include "views.h"

#include <splatfit/fitter.h>

/* Fixes the gauge: the loss does not change with a common motion and scale of poses and model. sf_hold_two
 * fixes two poses that are far apart. sf_hold_mean removes the common part of all corrections (rotations in
 * the views' frames, displacements in the world) as far as it is beyond chance. Call one of them after each
 * sync of `views`. */
void sf_hold_two(sf_view_states *views);
void sf_hold_mean(sf_view_states *views);

/* Replaces the values of a given camera by the learned ones: pose and focal lengths of a training view.
 * Another view follows its neighbours (follow.h), and has the focal lengths of training views with its lens.
 */
void sf_refine_camera(const sf_view_states *views, uint32_t id, sf_camera *camera);

/* Views that were kept out so far, as those of validation, begin where their neighbours went: the model has
 * moved with these. Views that were drawn before or are held stay. */
void sf_begin_at_neighbours(sf_view_states *views, const uint32_t *ids, size_t count);

/* Measures the depth of what a view sees, once, after it has been projected; otherwise: the depth where it
 * sees nothing. */
void sf_note_depth(sf_view_state *view, const sf_workspace *ws, double otherwise);

/* One step of the view's pose; gradient: [6], of the twist at the current pose. rate: the longest step of a
 * value, in radians, for the translation relative to the depth. */
void sf_refine_pose(sf_view_state *view, const double *gradient, double rate);

/* One step of Adam on the focal lengths of the view's lens; gradient: [2], of their logarithms. */
void sf_refine_focal(const sf_view_states *views, const sf_view_state *view, const double *gradient,
                     const sf_fit_options *options, double rate);

/* Medians over the training views: rotation in degrees, displacement in depths, relative change of the mean
 * focal length. */
void sf_refinement(const sf_view_states *views, double *degrees, double *depths, double *focal);

#endif
