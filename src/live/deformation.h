/* deformation.h - map deformation: Gaussians follow the corrected poses of keyframes. */
#ifndef SF_LIVE_DEFORMATION_H
#define SF_LIVE_DEFORMATION_H

#include <splatfit/camera.h>
#include <splatfit/fitter.h>

#include "../pose/view.h"
#include "../scene/gaussians.h"

/* A camera as it was thought to be, and the pose that it has. Its focal length is `zoom` times as long, and
 * what it shows `scale` times as far from it (1: as it was thought). */
typedef struct sf_correction {
    sf_camera camera;
    sf_rigid to;
    double zoom, scale;
} sf_correction;

/* A model was fitted to pictures at the old poses. When poses are corrected, Gaussians left in place would be
 * off by the correction until the fit had moved them. Here each mean moves so that it keeps its pixel and its
 * depth in the pictures that show it: x + sum_k w_k (R'_k^T (D_k (R_k x + t_k) - t'_k) - x) / sum_k w_k, over
 * the cameras k that see x, with w_k = 1 / depth^2, as a pixel there is that much larger in the world, and
 * D_k the diagonal matrix of scale / zoom, scale / zoom, scale. A Gaussian that no camera sees stays.
 * SF_ERR_MEMORY: all stay. */
sf_status sf_deform_map(sf_context *ctx, sf_model *model, const sf_correction *corrections, size_t count);

/* The same for all models of a fit (sf_online_move_means). SF_ERR_MEMORY: all stay. */
sf_status sf_deform_fit(sf_context *ctx, sf_fitter *fitter, const sf_correction *corrections, size_t count);

#endif
