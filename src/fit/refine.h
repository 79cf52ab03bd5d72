/* refine.h - corrections of the training views' poses and focal lengths (M.6), kept beside the scene. */
#ifndef SF_FIT_REFINE_H
#define SF_FIT_REFINE_H

#include "../render/workspace.h"
#include "views.h"

#include <splatfit/fitter.h>

/* The loss leaves a common motion and a common scale of poses and model open. Either two poses are held, far
 * apart; or what is common to all corrections (turns in the views' frames, displacements in the world) is
 * taken back, beyond what chance explains. After each sync of `views`. */
void sf_hold_two(sf_view_states *views);
void sf_hold_mean(sf_view_states *views);

/* Puts what was learned in the place of a camera as given: pose and focal lengths of a training view, the
 * focal lengths alone of any other. */
void sf_refine_camera(const sf_view_states *views, uint32_t id, sf_camera *camera);

/* Notes how far away is what a view sees, once, after it has been projected. otherwise: where it sees
 * nothing. */
void sf_note_depth(sf_view_state *view, const sf_workspace *ws, double otherwise);

/* One step of Adam on the view's pose; gradient: [6], of the twist at the pose in use. rate: radians, of the
 * translation depths. */
void sf_refine_pose(sf_view_state *view, const double *gradient, const sf_fit_options *options, double rate);

/* One step of Adam on the focal lengths of the view's lens; gradient: [2], of their logarithms. */
void sf_refine_focal(const sf_view_states *views, const sf_view_state *view, const double *gradient,
                     const sf_fit_options *options, double rate);

/* Medians over the training views: degrees turned, depths moved, change of the mean focal length. */
void sf_refinement(const sf_view_states *views, double *degrees, double *depths, double *focal);

#endif
