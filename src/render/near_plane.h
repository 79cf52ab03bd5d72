/* near_plane.h - the near plane of a view, from what the model has in its picture. */
#ifndef SF_RENDER_NEAR_PLANE_H
#define SF_RENDER_NEAR_PLANE_H

#include "../kernels/kernels.h"
#include "../scene/gaussians.h"

/* The nearest depth to draw, world units, above 0: a small part of the depth that nearly all Gaussians in the
 * picture are beyond. It follows the model under any scaling and any rigid motion of the world.
 * cluster: of the ranks that each have a part of the model, or NULL. */
float sf_near_plane_of(const sf_model *model, const sf_eye *eye, struct sf_cluster *cluster);

#endif
