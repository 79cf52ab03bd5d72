/* random.h - points at random where nothing better is known. */
#ifndef SF_SCENE_RANDOM_H
#define SF_SCENE_RANDOM_H

#include "../base/rng.h"
#include "sweep.h"

/* Appends points behind random pixels of the n > 0 views (>= 1): `count` of them times the share of the
 * pictures in which no point of `cloud` lies yet, and only there. Of random depths, about those of the points
 * beside the pixel where the picture has any, each point has one at which it hangs before what is known to be
 * seen in as few other views as may be, and about which views agree best in colour; the farthest of those
 * that are as good. `cloud` has room for `count` more. Masked pixels give none. The scene's extent (world
 * units) stands for the distance of what cameras see whose axes do not meet. SF_ERR_MEMORY: cloud is as it
 * was. */
sf_status sf_random_points(sf_context *ctx, const sf_view *const *views, size_t n, size_t count,
                           double extent, sf_rng *rng, sf_cloud *cloud);

/* Whether points (possibly zero of them) lie on the surfaces that the n > 0 views show: for a fifth of a
 * fixed random sample of the points, no other depth behind their pixels agrees better with other views. Where
 * next to no point is in a picture, nothing is held against them. */
int sf_points_agree(const sf_view *const *views, size_t n, const sf_cloud *cloud);

#endif
