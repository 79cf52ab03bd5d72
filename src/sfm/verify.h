/* verify.h - the geometry of all pairs of pictures, and focal lengths that are not known (GEOMETRY.md, S.22).
 */
#ifndef SF_SFM_VERIFY_H
#define SF_SFM_VERIFY_H

#include "map.h"

typedef struct sf_verify_options {
    double error_px;    /* the greatest error of an inlier */
    size_t least_count; /* inliers of a pair */
    uint64_t seed;
} sf_verify_options;

/* 4 px, 15 inliers, seed 1. */
sf_verify_options sf_verify_options_default(void);

/* Finds the geometry of each of the pairs from its matches. On return the matches that agree with it come
 * first, and `count` is their number (0: there is no geometry). The cameras that are neither fixed nor have a
 * prior have a guess as the focal length of their lens; pairs of two pictures of one such camera overrule it,
 * and it is written back. Of pictures, keypoints and camera are read. The same bytes for any number of
 * threads. SF_ERR_MEMORY: pairs and cameras are as they were. */
sf_status sf_verify_pairs(sf_context *ctx, const sf_verify_options *options, const sf_map_picture *pictures,
                          sf_map_camera *cameras, size_t camera_count, sf_matched_pair *pairs,
                          size_t pair_count);

#endif
