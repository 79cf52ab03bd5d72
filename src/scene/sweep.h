/* sweep.h - plane-sweep stereo: surface points found by matching pictures with each other, for projects
 * without sparse points and for the keyframes of a live fit. */
#ifndef SF_SCENE_SWEEP_H
#define SF_SCENE_SWEEP_H

#include "cloud.h"
#include "scene.h"

typedef struct sf_sweep_options {
    size_t wanted;   /* most points to return, > 0 */
    double nearest;  /* camera z from which on surfaces are looked for, world units, > 0 */
    double extent;   /* of the scene, world units: how far cameras look whose axes do not meet */
    int first_alone; /* points of the first view are wanted: of the others, depths are found in those alone
                        that confirm them */
} sf_sweep_options;

/* Finds points on the surfaces that at least two of the n views show. A point is confirmed if all but one of
 * the neighbours whose pictures it falls in agree on its depth. Masked pixels are not matched. Of many views
 * some are left out, evenly. The views are only read, and may belong to any scene or to no scene. On success
 * the caller destroys `cloud`: 0..wanted points, the same bytes for any number of threads. 0 points are not
 * an error: pictures without texture and a single view give no points. SF_ERR_MEMORY: cloud is empty. Must
 * not be called from a task of the pool. */
sf_status sf_sweep_points(sf_context *ctx, const sf_view *const *views, size_t n,
                          const sf_sweep_options *options, sf_cloud *cloud);

#endif
