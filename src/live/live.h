/* live.h - the inside of a live fit. */
#ifndef SF_LIVE_LIVE_H
#define SF_LIVE_LIVE_H

#include <stdatomic.h>

#include <splatfit/live.h>

#include "../scene/scene.h"
#include "../pose/landmarks.h"
#include "../pose/track.h"
#include "frame_grabber.h"
#include "point_spawner.h"

enum {
    SF_THUMBNAIL_WIDTH = 32,
    SF_THUMBNAIL_HEIGHT = 24,
    SF_THUMBNAIL = SF_THUMBNAIL_WIDTH * SF_THUMBNAIL_HEIGHT,
    SF_LIVE_RECENT = 6, /* keyframes: the newest, none of which makes room for another */
    SF_LIVE_FIRST = 24,
    SF_LIVE_TIMES = 64,
    SF_LIVE_SURE = 6 /* poses one after another, of a camera that was lost, until it is found */
};

/* A keyframe's picture is in the scene; here is what it is found again by. */
typedef struct sf_keyframe {
    uint32_t id; /* of the view */
    int held_out;
    int hold, told;                /* its pose is to be held; the fit knows of it */
    int searched;                  /* for points */
    double light;                  /* as sf_picture has it */
    sf_rigid pose;                 /* as it was found */
    double center[3];              /* of the camera */
    float thumbnail[SF_THUMBNAIL]; /* grey, mean 0, norm 1 */
    double psnr, psnr_corrected;   /* dB, when last looked at; NAN */
} sf_keyframe;

/* A pose that is known before the model is looked at. */
typedef struct sf_fix {
    sf_pose_from from; /* SF_POSE_NONE: none */
    sf_track_prior prior;
} sf_fix;

/* Times of events, for their rate. */
typedef struct sf_ticker {
    double time[SF_LIVE_TIMES];
    uint64_t count;
} sf_ticker;

struct sf_live {
    sf_context *ctx;
    sf_live_options options;
    sf_frame_grabber *grabber;
    sf_detector *detector; /* NULL: no board */
    sf_tracker *tracker;
    sf_landmarks *landmarks;
    sf_renderer *renderer;
    sf_spawner *spawner;
    sf_scene *scene;
    sf_fitter *fitter; /* NULL: not begun */
    atomic_int cancelled;
    int paused, source_ended, finished;
    int steps_due; /* with steps_per_frame, before the next frame */

    /* The frame that is looked at. */
    const sf_picture *picture;
    sf_live_frame frame;
    float thumbnail[SF_THUMBNAIL]; /* of the picture */
    sf_fix fix;                    /* what is known of its pose from outside */
    sf_followed followed;          /* what landmarks say of it */
    int fixed;                     /* its pose is known well from outside the model */
    int sure;                      /* it is where its pose says, and as sharp as others */
    uint8_t *bytes;                /* [height][width][3], and grey */
    size_t byte_capacity;
    double sharpness, usual_sharpness, unlike; /* unlike: in parts of what was usual before it */

    /* Where the camera is. */
    sf_live_state state;
    sf_rigid pose, pose_before; /* of the last two frames whose pose was found */
    int64_t pose_ns, pose_before_ns;
    int poses;                              /* found one after another, up to 2 */
    int misses;                             /* frames since */
    int doubts;                             /* poses that are still to come, for it to be found again */
    double usual_agreement, usual_detail;   /* of the frames that were tracked; 0: none yet */
    int blurred, blank;                     /* frames one after another */
    sf_live_trouble trouble;                /* of the frames */
    double distance;                        /* to what the camera sees, world units; 0: not known */
    sf_camera first_cameras[SF_LIVE_FIRST]; /* of poses from outside, until the distance is known */
    size_t first_count;

    sf_keyframe *keyframes;
    size_t keyframe_count, keyframe_capacity;
    int64_t keyframes_made;
    int wanted;          /* a keyframe is, */
    double wanted_since; /* by the frames' clock, s */
    size_t evaluate_next;
    double evaluated; /* s */

    double first_frame, next_frame;      /* s of the clock */
    double duty, next_check, rest_until; /* of the fit: the part of its time, and s of the clock */
    uint64_t looked_at, tracked, lost;
    size_t spawned;
    sf_ticker poses_found;
    double track_seconds; /* smoothed */
};

/* localizer.c */
/* Looks for the pose of live->picture, and fills in live->frame. */
sf_status sf_live_localize(sf_live *live);
void sf_live_forget_pose(sf_live *live);
/* The camera moved as it did, from a pose that has become another one. */
void sf_live_correct_pose(sf_live *live, const sf_rigid *from, const sf_rigid *to);

/* keyframes.c */
/* Takes the frame as a keyframe where one is wanted and it is good enough. *taken: whether. */
sf_status sf_live_offer_keyframe(sf_live *live, int *taken);
/* The camera of the frames, at a pose. */
sf_camera sf_live_camera_at(const sf_live *live, const sf_rigid *pose);
/* Of a picture, relative to its own contrast: brightness does not matter. */
double sf_picture_sharpness(const sf_picture *picture);
/* The keyframe that looks most like the picture of this thumbnail, of those after `rank` better ones. NULL.
 */
const sf_keyframe *sf_recognize_place(const sf_live *live, const float thumbnail[SF_THUMBNAIL], int rank);
/* A picture made small, its greys around 0 with squares that sum to 1. Returns the standard deviation of its
 * greys, 0..1. */
double sf_make_thumbnail(const sf_picture *picture, float thumbnail[SF_THUMBNAIL]);
/* Tells the fit which poses to hold, and what exposures to begin with, as soon as it has taken up the views.
 */
void sf_live_tell_fit(sf_live *live);
/* Begins the fit when there are keyframes from enough places. */
sf_status sf_live_begin(sf_live *live);
/* Looks at a keyframe that is held out, or the first one, now and then. */
sf_status sf_live_evaluate(sf_live *live);
/* At all of these at once. */
sf_status sf_live_evaluate_all(sf_live *live);
/* A keyframe's exposure as it is known by now: what the fit learned, before that what its light says, or
 * its neighbours. */
void sf_live_exposure(const sf_live *live, uint32_t id, double gain[3], double bias[3]);

/* points.c */
/* Where no search goes on: has points looked for around the newest keyframe that was not searched yet. */
sf_status sf_live_ask_for_points(sf_live *live);
/* Takes in what a search found, of it what the model lacks. */
sf_status sf_live_take_points(sf_live *live);
/* The radius of a new Gaussian at a point, made less where it would be large in a keyframe. */
float sf_live_limit_radius(const sf_live *live, const float xyz[3], float radius);

void sf_tick(sf_ticker *ticker, double now);
double sf_tick_rate(const sf_ticker *ticker, double now);

#endif
