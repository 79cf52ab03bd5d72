/* live_state.h - the state of a live fit: a struct for each part, which the files of that part write. */
#ifndef SF_LIVE_LIVE_STATE_H
#define SF_LIVE_LIVE_STATE_H

#include <stdatomic.h>

#include <splatfit/live.h>

#include "../scene/scene.h"
#include "evaluation.h"
#include "found_lens.h"
#include "frame_grabber.h"
#include "frame_quality.h"
#include "guidance_state.h"
#include "keyframe_list.h"
#include "localizer_state.h"
#include "point_spawner.h"
#include "start.h"
#include "world.h"

/* The frame in hand. */
typedef struct sf_live_input {
    const sf_picture *picture;
    sf_live_frame frame;        /* what sf_live_get_frame tells of it */
    const sf_rigid *first_pose; /* the frame's in the first map from pictures; NULL: it is not of that map */
    uint64_t number;            /* of such a frame */
    int has_outside;            /* a pose came from outside: */
    sf_rigid outside;           /* as it came */
    sf_place place;             /* of the picture, */
    int has_place;              /* where it was asked for */
    uint8_t *bytes;             /* [height][width][3], and a mask or grey */
    size_t byte_capacity;
} sf_live_input;

/* Whether the last keyframes before a loss were compared with old ones. */
typedef struct sf_loop_checked {
    uint64_t lost, found_again; /* times, when it was lost */
    uint64_t next;              /* frame from which on they are compared again */
    int tries;                  /* left */
} sf_loop_checked;

/* An old place that the newest keyframe shows, and has another pose by. */
typedef struct sf_loop {
    int is_seen;
    int64_t made;  /* keyframes, before that one */
    uint32_t old;  /* id of the keyframe of the old place */
    sf_rigid pose; /* of the newest, by the old one's map */
    double scale;  /* as in sf_loop_link */
    int is_scaled;
    sf_loop_checked checked;
} sf_loop;

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
    sf_start start;
    sf_found_lens lens;
    sf_world world; /* where the map lies, if it began from pictures */
    sf_frame_quality quality;
    sf_localizer localizer;
    sf_keyframes keyframes;
    sf_loop loop;
    sf_spawning spawning;
    sf_pose_check pose_check;
    sf_evaluation evaluation;
    sf_guidance guidance;
    sf_live_pace pace;
};

#endif
