/* pose_search.h - the pose of a camera from points of which some are wrong (GEOMETRY.md, S.26). */
#ifndef SF_SFM_POSE_SEARCH_H
#define SF_SFM_POSE_SEARCH_H

#include "../base/context.h"
#include "absolute_pose.h"
#include "ransac.h"

/* Points and where a picture sees them. */
typedef struct sf_pose_search {
    sf_correspondences all;         /* of the arrays below */
    double *points, *pixels, *rays; /* [count][3] world, [count][2] px, [count][2] */
    double *scratch;                /* [2 count] */
    uint32_t *members;              /* [count] */
    sf_lens lens;
} sf_pose_search;

/* Memory for `most` observations. 0: there is none; sf_pose_search_free in any case. */
int sf_pose_search_make(sf_context *ctx, size_t most, const sf_lens *lens, sf_pose_search *search);
void sf_pose_search_free(sf_context *ctx, sf_pose_search *search);

/* One more: a point of the world, and the pixel that shows it. */
void sf_pose_search_add(sf_pose_search *search, const double point[3], const double pixel[2]);

/* What agrees with a pose. */
typedef struct sf_pose_search_options {
    double error_px; /* the greatest distance from where the pose puts the point */
    size_t least;    /* observations that agree, for a pose */
    uint64_t seed;
} sf_pose_search_options;

/* Looks for the pose that most observations agree with, at the present lens. found->count 0: there is none.
 */
void sf_pose_search_run(sf_pose_search *search, const sf_pose_search_options *options,
                        sf_ransac_result *found);

/* The pose (world to camera) that was found. */
sf_rigid sf_pose_search_pose(const sf_ransac_result *found);

/* Refines a pose, and the focal length with with_focal, over the observations that agree with it. Returns how
 * many do, members[] lists them; 0: fewer than `least`. */
size_t sf_pose_search_refine(sf_pose_search *search, const sf_pose_search_options *options, int with_focal,
                             sf_rigid *pose);

#endif
