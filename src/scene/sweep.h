/* sweep.h - points on surfaces by plane-sweep stereo: for scenes without structure-from-motion points, and
 * for keyframes of a moving camera. */
#ifndef SF_SCENE_SWEEP_H
#define SF_SCENE_SWEEP_H

#include "cloud.h"
#include "scene.h"

typedef struct sf_sweep_options {
    size_t wanted;  /* most points, > 0 */
    double nearest; /* least depth of surfaces, camera z, world units, > 0 */
    double extent;  /* of the scene, world units: the distance that cameras look at whose axes do not meet */
} sf_sweep_options;

/* Finds points on surfaces that at least two of the n views show: of the neighbours whose pictures a point
 * falls in all but one must confirm it. Masked pixels are not matched. Of many views some are left out,
 * evenly. The views are only read, and may belong to any scene or none. On success `cloud` is the caller's to
 * destroy: 0..wanted points, the same bytes for any number of threads. Pictures without texture or a single
 * view give no point, which is no failure. SF_ERR_MEMORY: cloud is empty. Must not be called from a task of
 * the pool. */
sf_status sf_sweep_points(sf_context *ctx, const sf_view *const *views, size_t n,
                          const sf_sweep_options *options, sf_cloud *cloud);

#endif
