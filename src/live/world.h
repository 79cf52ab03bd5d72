/* world.h - where a map that began from pictures lies in the world of a board or of poses from outside. */
#ifndef SF_LIVE_WORLD_H
#define SF_LIVE_WORLD_H

#include <splatfit/model.h>

#include "../pose/rigid.h"

enum { SF_WORLD_PAIRS = 48 };

/* Poses that are known in both. */
typedef struct sf_world {
    sf_camera map[SF_WORLD_PAIRS], world[SF_WORLD_PAIRS];
    size_t count, oldest; /* the one that the next one replaces, when there are all */
    int is_known;
    sf_similarity similarity; /* from the map to the world */
} sf_world;

/* Takes a pose that is known in both, if it is far enough from the newest one, and works out the similarity
 * when there are enough from places far enough apart. distance: to what the camera sees, in the map. Returns
 * whether the similarity is known for the first time. */
int sf_world_note(sf_world *world, const sf_camera *in_map, const sf_rigid *in_world, double distance);

#endif
