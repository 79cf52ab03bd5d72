/* sfm_scene_fixture.h - pictures' keypoints and matches of a scene with a known truth. */
#ifndef SFM_SCENE_FIXTURE_H
#define SFM_SCENE_FIXTURE_H

#include "../../src/sfm/mapper.h"
#include "../../src/sfm/verify.h"
#include "sfm_fixture.h"

/* What to simulate: views on a ring around an object, all of whose points face outwards; views of a wall; or
 * views all around from one place. */
typedef struct sfm_scene_options {
    size_t views, points, cameras; /* views take turns with the cameras */
    double noise, wrong;           /* px of keypoints; share of wrong matches */
    size_t reach;                  /* neighbours of a view that it is matched with, on either side */
    uint64_t seed;
    sfm_layout layout;
    int plain; /* 1: the first camera's lens is distorted twice as much, and the others' are not */
} sfm_scene_options;

typedef struct sfm_scene {
    sf_context *ctx;
    size_t views, points, cameras;
    sfm_layout layout;
    double *at;               /* [points][3] */
    sf_rigid *truth;          /* [views] */
    sf_lens *lenses;          /* [cameras] */
    sf_map_camera *known;     /* [cameras]: what is told of them */
    sf_map_picture *pictures; /* [views] */
    uint32_t **point_of;      /* [views][keypoints] */
    sf_matched_pair *pairs;
    size_t pair_count;
} sfm_scene;

void sfm_scene_make(sf_context *ctx, const sfm_scene_options *options, sfm_scene *scene);
void sfm_scene_free(sfm_scene *scene);

/* Finds each pair's geometry, and the focal lengths that are not told, and keeps the inliers. */
void sfm_scene_verify(sfm_scene *scene);

sf_map_input sfm_scene_input(const sfm_scene *scene);

/* Moves the map onto the truth (a similarity by the centers of its placed pictures) and measures: the median
 * and greatest rotation (rad) and distance of centers, in parts of the ring's radius. */
typedef struct sfm_map_errors {
    double rotation, rotation_most, center, center_most;
} sfm_map_errors;
sfm_map_errors sfm_scene_compare(const sfm_scene *scene, const sf_map *map);

#endif
