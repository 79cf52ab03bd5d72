/* frames.h - the frames of a simulated camera: when each is taken, how it is exposed, what it shows.
 *
 * A frame depends on the simulation's name and on its own number, not on which ones were taken before it,
 * unless the exposure is locked.
 */
#ifndef SF_SIM_FRAMES_H
#define SF_SIM_FRAMES_H

#include <splatfit/source.h>

#include "baked.h"
#include "sensor.h"
#include "sim.h"

enum { SF_SIM_METER_TIMES = 240 };

typedef struct sf_sim_frames {
    sf_context *ctx;
    sf_sim sim;
    sf_sensor_curve curve;
    sf_baked *baked;                 /* NULL: drawn exactly */
    float *linear, *smeared, *depth; /* [height][width][3], depth [height][width]; those that are needed */
    int locked;                      /* the exposure stays as it was in the last frame */
    double last_bright, locked_at;
    float bright[SF_SIM_METER_TIMES]; /* the exposure along the frames, 1: as it is without control */
} sf_sim_frames;

/* When a frame is taken. */
typedef struct sf_sim_moment {
    uint64_t number;
    double seconds, early; /* after frame 0 was due; before this one is */
    double place;          /* on the path, in frames */
} sf_sim_moment;

/* SF_ERR_ARGUMENT as sf_sim_init, SF_ERR_MEMORY: nothing is held. */
sf_status sf_sim_frames_init(sf_context *ctx, const char *name, sf_sim_frames *frames);
void sf_sim_frames_free(sf_sim_frames *frames);

sf_sim_moment sf_sim_moment_of(const sf_sim_frames *frames, uint64_t number);

/* Takes the picture: data [height][width][3], and of `frame` the camera, exposure_s and gain. */
void sf_sim_take(sf_sim_frames *frames, const sf_sim_moment *moment, uint8_t *data, sf_frame *frame);

/* As sf_source_lock_exposure. */
void sf_sim_lock_exposure(sf_sim_frames *frames, int locked);

#endif
