/* random.h - random points for initialisation. */
#ifndef SF_SCENE_RANDOM_H
#define SF_SCENE_RANDOM_H

#include "../base/rng.h"
#include "sweep.h"

/* Appends points behind random pixels of the n > 0 views. If `cloud` is empty: `count`, each at the one of
 * several random depths at which the colours of the views agree best; of equally good ones the farthest.
 * Else: `count` times the part of the pictures in which no point of `cloud` lies, and only there. Such a
 * point is farther than the points beside its pixel, up to 20 times as far, with an evenly distributed
 * inverse depth; points beyond 100 extents count for nothing. It hides no surface that the points show and is
 * not nearer to any camera than the points in that camera's picture, if one of several depths allows that.
 * `cloud` must have room for `count` more. Masked pixels give none. Cameras whose axes do not meet are taken
 * to look at the scene's extent (world units). SF_ERR_MEMORY, or as sf_view_open: the points that
 * cloud had are unchanged. */
sf_status sf_random_points(sf_context *ctx, const sf_view *const *views, size_t n, size_t count,
                           double extent, sf_rng *rng, sf_cloud *cloud);

/* Whether points (possibly zero of them) lie on the surfaces that the n > 0 views show: for a fifth of a
 * fixed random sample of the points, no other depth behind their pixels agrees better with other views. Where
 * next to no point is in a picture, nothing is held against them. SF_ERR_MEMORY; as sf_view_open. */
sf_status sf_points_agree(sf_context *ctx, const sf_view *const *views, size_t n, const sf_cloud *cloud,
                          int *agree);

#endif
