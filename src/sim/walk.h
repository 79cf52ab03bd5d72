/* walk.h - how somebody carries a camera, in a minute: around a board on a table, or through a corridor. */
#ifndef SF_SIM_WALK_H
#define SF_SIM_WALK_H

#include <splatfit/camera.h>

#include "vec3.h"

enum { SF_WALK_SECONDS = 60, SF_WALK_WAVES = 18, SF_WALK_JERKS = 12 };

/* SF_WALK_CORRIDOR: a circle of 21 units about the middle of the room, looking ahead and outwards. */
typedef enum sf_walk_way { SF_WALK_TABLE, SF_WALK_CORRIDOR } sf_walk_way;

/* The way, and the random part of one walk: the sway and the jerks of the hand. */
typedef struct sf_walk {
    sf_walk_way way;
    double phase[SF_WALK_WAVES];
    struct {
        double at;        /* s */
        sf_vec3 turn, by; /* radians in the camera's axes; world units */
    } jerk[SF_WALK_JERKS];
} sf_walk;

void sf_walk_init(sf_walk *walk, sf_walk_way which, uint64_t seed);

/* The pose at a time, s; the walk closes after SF_WALK_SECONDS. Sets R_cw and t_cw alone: the world is the
 * studio's. */
void sf_walk_pose(const sf_walk *walk, double seconds, sf_camera *camera);

/* Looks from `from` to `at` with the horizon turned by `roll` radians. */
void sf_camera_aim(sf_camera *camera, sf_vec3 from, sf_vec3 at, double roll);

#endif
