/* points.h - new Gaussians where a keyframe shows what the model lacks. */
#ifndef SF_LIVE_POINTS_H
#define SF_LIVE_POINTS_H

#include "live_state.h"

/* Where no search goes on: starts one around the newest keyframe that was not searched yet. */
sf_status sf_live_ask_for_points(sf_live *live);
/* Adds those of the points that a search found which the model lacks. */
sf_status sf_live_take_points(sf_live *live);

/* `radius` of a new Gaussian at a point (world units), or the greatest that stays within 8 px in all
 * keyframes that show it. camera: of the keyframes. */
float sf_limit_radius(const sf_keyframes *keyframes, const sf_camera *camera, double near_plane,
                      const float xyz[3], float radius);

#endif
