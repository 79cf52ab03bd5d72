/* sim.h - a simulated camera that is carried around a simulated scene: "sim:studio?option=value&...".
 *
 * Three parts that know nothing of each other: the scene (studio.h), the camera's path and the sensor.
 */
#ifndef SF_CAPTURE_SIM_H
#define SF_CAPTURE_SIM_H

#include "source.h"
#include "studio.h"

typedef struct sf_sim {
    sf_studio studio;
    int32_t width, height; /* px */
    uint64_t frames, seed;
    double fps;      /* in real time; 0: not */
    int loop;        /* goes round and round */
    double fov;      /* degrees, across the width */
    double phase[6]; /* of the hand's sway, from the seed */
} sf_sim;

/* Reads the name of a simulated source. Options: width, height, frames, seed, fov, fps,
 * loop.
 * SF_ERR_ARGUMENT: unknown scene or option, value out of range. */
sf_status sf_sim_init(sf_context *ctx, const char *name, sf_sim *sim);

/* The camera of frame 0 .. frames-1: once around a loop in front of the scene's middle, 200 degrees wide, low
 * on the way out to the right and back from the left, high in between, with a hand's sway. */
void sf_sim_camera(const sf_sim *sim, uint64_t frame, sf_camera *camera);

/* Opens the source for sf_source_open. */
sf_status sf_sim_open(sf_context *ctx, const char *name, sf_source *source);

#endif
