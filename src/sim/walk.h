/* walk.h - how somebody carries a camera around a board on a table, in a minute. */
#ifndef SF_SIM_WALK_H
#define SF_SIM_WALK_H

#include <splatfit/camera.h>

#include "vec3.h"

enum { SF_WALK_SECONDS = 60, SF_WALK_WAVES = 18, SF_WALK_JERKS = 12 };

/* The random part of one walk: the sway and the jerks of the hand. */
typedef struct sf_walk {
    double phase[SF_WALK_WAVES];
    struct {
        double at;        /* s */
        sf_vec3 turn, by; /* radians in the camera's axes; world units */
    } jerk[SF_WALK_JERKS];
} sf_walk;

void sf_walk_init(sf_walk *walk, uint64_t seed);

/* The pose at a time, s; the walk closes after SF_WALK_SECONDS. Sets R_cw and t_cw alone: the world is the
 * studio's. */
void sf_walk_pose(const sf_walk *walk, double seconds, sf_camera *camera);

/* Looks from `from` to `at` with the horizon turned by `roll` radians. */
void sf_camera_aim(sf_camera *camera, sf_vec3 from, sf_vec3 at, double roll);

#endif
