/* fuse.h - depth fusion: from the depths of single views to points that several views confirm. */
#ifndef SF_SCENE_FUSE_H
#define SF_SCENE_FUSE_H

#include "cloud.h"
#include "match.h"

/* A view and the depths that a sweep found in it. */
typedef struct sf_seen {
    const sf_view *view;
    uint32_t place; /* index of the view among the given ones */
    sf_grey grey;
    float *inverse_depth, *score; /* as sf_match gives them */
    double distance;              /* camera z of what it sees, world units */
    sf_match_range range;
    sf_match_range widest;                             /* the range at first, which `range` stays within */
    size_t neighbour[SF_MATCH_NEIGHBOURS], neighbours; /* indices of the views that it was matched with */
} sf_seen;

/* The points of all views whose depth is confirmed by the neighbours' depths, at most `wanted`: among those
 * within a pixel or a few of each other the one with the highest score. `cloud` is the caller's to destroy,
 * and empty on failure (SF_ERR_MEMORY). */
sf_status sf_fuse(sf_context *ctx, const sf_seen *seen, size_t n, size_t wanted, sf_cloud *cloud);

#endif
