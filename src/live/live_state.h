/* live_state.h - the state of a live fit: a struct for each part, which the files of that part write. */
#ifndef SF_LIVE_LIVE_STATE_H
#define SF_LIVE_LIVE_STATE_H

#include <stdatomic.h>

#include <splatfit/live.h>

#include "../scene/scene.h"
#include "evaluation.h"
#include "frame_grabber.h"
#include "frame_quality.h"
#include "guidance_state.h"
#include "keyframe_list.h"
#include "localizer_state.h"
#include "point_spawner.h"

/* The frame in hand. */
typedef struct sf_live_input {
    const sf_picture *picture;
    sf_live_frame frame;           /* what sf_live_get_frame tells of it */
    float thumbnail[SF_THUMBNAIL]; /* of the picture */
    uint8_t *bytes;                /* [height][width][3], and a mask or grey */
    size_t byte_capacity;
} sf_live_input;

/* Whose turn it is: a frame's or the fit's. Times are s of the clock. */
typedef struct sf_live_pace {
    double first_frame, next_frame; /* when the first came, and when the next is due */
    double track_seconds;           /* that a frame takes, moving average */
    int steps_due;                  /* with steps_per_frame, before the next frame */
    double duty;                    /* the part of its time that the fit works, 0..1 */
    double next_check;              /* of thermal throttling */
    double rest_until;              /* of the fit */
} sf_live_pace;

struct sf_live {
    sf_context *ctx;
    sf_live_options options;
    sf_frame_grabber *grabber;
    sf_scene *scene;
    sf_fitter *fitter; /* NULL: not begun */
    atomic_int cancelled;
    int paused, source_ended, finished;

    sf_live_input input;
    sf_frame_quality quality;
    sf_localizer localizer;
    sf_keyframes keyframes;
    sf_spawning spawning;
    sf_evaluation evaluation;
    sf_guidance guidance;
    sf_live_pace pace;
};

#endif
