/* sweep.h - points on what pictures show, found by matching them with each other: where structure from motion
 * left none, and for keyframes of a camera that is still moving. */
#ifndef SF_SCENE_SWEEP_H
#define SF_SCENE_SWEEP_H

#include "cloud.h"
#include "scene.h"

typedef struct sf_sweep_options {
    size_t wanted;  /* most points to return, > 0 */
    double nearest; /* camera z from which on surfaces are looked for, world units, > 0 */
    double extent;  /* of the scene, world units: how far cameras look whose axes do not meet */
} sf_sweep_options;

/* Points on the surfaces that at least two of the n views show: of the neighbours of a view that should show
 * a point all but one have it where it is. Masked pixels are not matched. Where there are many views, some
 * are left out, evenly. The views are only read, and may belong to any scene or none. On success `cloud` is
 * the caller's to destroy: 0..wanted points, the same bytes for any number of threads. No point is no
 * failure: pictures without texture and a single view give none. SF_ERR_MEMORY: cloud is empty. Not from
 * within a task of the pool. */
sf_status sf_sweep_points(sf_context *ctx, const sf_view *const *views, size_t n,
                          const sf_sweep_options *options, sf_cloud *cloud);

#endif
