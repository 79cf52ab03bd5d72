/* live_walk_fixture.h - a live fit of a walk through a simulated scene, which is then shown single pictures.
 */
#ifndef TESTS_UNIT_LIVE_WALK_FIXTURE_H
#define TESTS_UNIT_LIVE_WALK_FIXTURE_H

#include "testing.h"

#include "live/live.h"
#include "sim/frames.h"

typedef struct live_walk {
    sf_context *ctx, *source_ctx;
    sf_source *source;
    sf_live *live;
    sf_sim_frames sim;
    int frames; /* that were looked at */
    float *linear, *depth, *planes;
    uint8_t *data;
    sf_picture picture;
} live_walk;

/* Looks at the first `frames` frames of a source, whose own poses are used. The walk stays where it is: what
 * draws it points into it. */
void live_walk_open(const char *name, int frames, int steps_per_frame, live_walk *walk);
void live_walk_close(live_walk *walk);

/* The camera of a frame of the walk, in the studio's world, swung by an angle about what is before it, or
 * turned by an angle about itself; both about the vertical, radians. */
sf_camera live_walk_camera(const live_walk *walk, double frame, double swing, double turn);

/* A lost camera takes pictures there until its pose is found, `tries` at most. Returns how many it took; 0:
 * it was not found. */
int live_walk_find(live_walk *walk, const sf_camera *studio, int tries);

/* How far the pose that was found is off: rad; and parts of the distance to the scene. */
void live_walk_error(const live_walk *walk, double *angle, double *apart);

/* The angle to the nearest direction of a keyframe, rad. */
double live_walk_nearest(const live_walk *walk);

#endif
