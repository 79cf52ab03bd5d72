/* deformation.h - map deformation: Gaussians follow the corrected poses of keyframes. */
#ifndef SF_LIVE_DEFORMATION_H
#define SF_LIVE_DEFORMATION_H

#include <splatfit/camera.h>
#include <splatfit/fitter.h>

#include "../pose/view.h"
#include "../scene/gaussians.h"

/* A camera at the pose that it was thought to have, and the pose that it has. */
typedef struct sf_correction {
    sf_camera camera;
    sf_rigid to;
    double scale; /* of depths as they are to those as they were thought to be */
} sf_correction;

/* A model was fitted to pictures at the old poses. When poses are corrected, Gaussians left in place would be
 * off by the correction until the fit had moved them. Here each mean moves so that it keeps its pixel and its
 * depth in the pictures that show it: x + sum_k w_k (R'_k^T (s_k (R_k x + t_k) - t'_k) - x) / sum_k w_k, over
 * the cameras k that see x, with w_k = 1 / depth^2, as a pixel there is that much larger in the world. A
 * Gaussian that no camera sees stays. SF_ERR_MEMORY: all stay. */
sf_status sf_deform_map(sf_context *ctx, sf_model *model, const sf_correction *corrections, size_t count);

/* The same for all models of a fit (sf_online_move_means). SF_ERR_MEMORY: all stay. */
sf_status sf_deform_fit(sf_context *ctx, sf_fitter *fitter, const sf_correction *corrections, size_t count);

#endif
