/* nearest.h - the nearest points of each point. */
#ifndef SF_SCENE_NEAREST_H
#define SF_SCENE_NEAREST_H

#include "../base/context.h"

typedef struct sf_nearest {
    uint32_t point;
    float distance; /* INFINITY: there are no more points */
} sf_nearest;

/* nearest[i][0 .. wanted-1]: the others nearest to point i of [n][3], finite, nearest first. SF_ERR_MEMORY.
 */
sf_status sf_find_nearest(sf_context *ctx, const float *points, size_t n, int wanted, sf_nearest *nearest);

/* distances[i] = mean distance from point i of [n][3] to its (up to) 3 nearest others; 0 if there is no
 * other. */
sf_status sf_nearest_distances(sf_context *ctx, const float *points, size_t n, float *distances);

#endif
