/* verify.h - which pairs of photos show the same place, and the geometry of each. */
#ifndef SF_SFM_VERIFY_H
#define SF_SFM_VERIFY_H

#include "map.h"
#include "match.h"
#include "photos.h"

/* Pairs with their matches; those of a pair that agree with its geometry come first. */
typedef struct sf_verified {
    sf_photo_pair *pairs;
    sf_matches *matches;   /* [count], of features */
    sf_verified_pair *agreed; /* [agreed_count]: pairs with a geometry */
    size_t count, agreed_count;
} sf_verified;

/* Matches the features of every pair of the list, on all threads. SF_ERR_MEMORY. */
sf_status sf_verify_match(sf_context *ctx, const sf_photo_list *list, sf_verified *v);

/* Finds the geometry of each pair by its matches. Cameras without a fixed lens or a prior of the focal length
 * get the focal length for which most of their pairs agree; `camera_of`: [photos], an index into `cameras`.
 * Then the pairs' poses through these lenses. error: px of an inlier. SF_ERR_MEMORY. */
sf_status sf_verify_geometry(sf_context *ctx, const sf_photo_list *list, const uint32_t *camera_of,
                             double error, sf_map_camera *cameras, size_t camera_count, sf_verified *v);

void sf_verified_free(sf_context *ctx, sf_verified *v);

#endif
