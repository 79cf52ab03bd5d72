/* live.h - fits the scene in front of a camera while it moves: poses, keyframes, first Gaussians, the fit.
 *
 * One thread calls sf_live_step again and again; it never waits for the camera for long. Frames are taken in
 * on a thread of the object's own, which never waits for the fit, and points are looked for on another.
 */
#ifndef SPLATFIT_LIVE_H
#define SPLATFIT_LIVE_H

#include <stdint.h>

#include "calibrate.h"
#include "fitter.h"
#include "source.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A live fit: the frames that come in, what is tracked, and the fit of it. */
typedef struct sf_live sf_live;

/* Where a pose came from. */
typedef enum sf_pose_from {
    SF_POSE_NONE,    /* it is not known */
    SF_POSE_BOARD,   /* a board in view alone */
    SF_POSE_OUTSIDE, /* the caller's, or the frame's own camera, alone */
    SF_POSE_TRACK    /* landmarks and the model; refine what is known besides */
} sf_pose_from;

/* The camera's pose at a time (ns, as sf_frame.time_ns), from outside: R_cw (row-major) and t_cw as in
 * camera.h. information (row-major 6 x 6): inverse covariance of its left twist, world units and radians.
 * Returns SF_OK, or SF_ERR_EMPTY where it is not known. Called from sf_live_step. */
typedef sf_status (*sf_pose_fn)(void *user, int64_t time_ns, double R_cw[9], double t_cw[3],
                                double information[36]);

/* Start from sf_live_options_default(). */
typedef struct sf_live_options {
    sf_fit_options fit;    /* time_limit: of the whole run, from the first frame; 0: without an end */
    const sf_board *board; /* gives poses in its frame, in metres; NULL: none. Read until sf_live_destroy */
    sf_pose_fn pose;       /* NULL: none */
    void *pose_user;       /* handed to pose */
    int own_poses; /* 1: the frames' own cameras are poses from outside; 0: they are only told, as truth */
    sf_lens lens;  /* of the frames; fx 0: of the frames' own camera where they have one, else a guess: a
                      picture 60 degrees wide */
    int downscale; /* box-average the frames by this, 1..16 */
    double track_rate;   /* frames a second to look at, 0.1..1000, where they come so fast */
    int steps_per_frame; /* of the fit, for sources that are not in real time: every frame is looked at, and
                            the run can be repeated to the byte; 0: as time allows */
    int64_t keyframes_most; /* 8..100000: the one that its neighbours make up for best goes when there are
                               more */
    int hold_out;           /* of the keyframes every n-th is never trained on, only evaluated; 0: none */
    double keyframe_gap;    /* keyframes: a new one where the camera has moved by this part of the distance to
                            what it sees, or turned by this angle (rad), from all of them, 0.001..1; of the
                            first 60 from a fifth of it on, evenly */
    const char *thermal; /* folder in which the kernel says whether it holds the processor back for its heat:
                            the fit then rests for a part of the time, frames are tracked as before. Read
                            until sf_live_destroy; NULL: it is not looked at */
} sf_live_options;

/* A fit with exposures; no poses from outside; downscale 1, 12 frames a second, 300
 * keyframes, hold_out 8, keyframe_gap 0.07, thermal "/sys". */
SF_API sf_live_options sf_live_options_default(void);

/* Begins with the frames of `source`, which stays the caller's, belongs to the object until sf_live_destroy,
 * and was best opened with a context of its own. SF_ERR_ARGUMENT: an option out of range (named), nothing to
 * take poses from; SF_ERR_UNSUPPORTED: a board, without libapriltag. On failure *live is NULL. */
SF_API sf_status sf_live_create(sf_context *context, sf_source *source, const sf_live_options *options,
                                sf_live **live);
SF_API void sf_live_destroy(sf_live **live);

/* A piece of the work: a frame that is due, else a step of the fit, else a short wait. SF_ERR_END: time_limit
 * is over, or the source has ended, and all that is held out was looked at a last time; SF_ERR_CANCELLED;
 * SF_ERR_IO: the source broke. What there is of a model stays whole in every case. */
SF_API sf_status sf_live_step(sf_live *live);

/* Makes the step in progress the last one. Safe from any thread and from a signal handler. */
SF_API void sf_live_cancel(sf_live *live);

/* 1: frames are tracked and shown, the fit waits and takes in nothing; 0: it goes on. */
SF_API void sf_live_pause(sf_live *live, int paused);

/* As sf_source_lock_exposure, before the next frame; a warning says where the source refuses. Safe from any
 * thread. */
SF_API void sf_live_lock_exposure(sf_live *live, int locked);

/* Forgets the model and all keyframes. */
SF_API void sf_live_reset(sf_live *live);

/* What a live fit does with the newest frames. */
typedef enum sf_live_state {
    SF_LIVE_WAITING,    /* for a first pose */
    SF_LIVE_STARTING,   /* gathers first keyframes from several places */
    SF_LIVE_TRACKING,   /* finds their poses, and fits */
    SF_LIVE_LOST,       /* no pose for the newest frames; the fit goes on */
    SF_LIVE_STATE_COUNT /* how many there are */
} sf_live_state;

/* What is wrong of what comes. None of it harms the model: such frames are not fitted. */
typedef enum sf_live_trouble {
    SF_LIVE_FINE,    /* nothing */
    SF_LIVE_SILENT,  /* no frame comes for 2 s */
    SF_LIVE_BLANK,   /* frames show nothing: a covered lens, darkness */
    SF_LIVE_BLURRED, /* frames are far less sharp than the model there: a camera that shakes, or is out of
                        focus */
    SF_LIVE_TROUBLE_COUNT /* how many there are */
} sf_live_trouble;

/* Where a live fit stands, between two calls of sf_live_step. */
typedef struct sf_live_progress {
    sf_live_state state;        /* as of the newest frame that was looked at */
    sf_live_trouble trouble;    /* now; a warning tells when it begins */
    int paused;                 /* by sf_live_pause */
    int exposure_locked;        /* 1: by sf_live_lock_exposure; 0: it is not; -1: the source cannot be told */
    double seconds;             /* since the first frame */
    sf_source_counts frames;    /* what became of the source's */
    uint64_t passed_over;       /* frames that came too fast for the loop */
    uint64_t tracked;           /* frames whose pose was found, of those looked at */
    uint64_t looked_at;         /* frames that a pose was looked for in */
    uint64_t lost;              /* times that the pose was lost */
    double frame_rate;          /* frames a second that come, over the last seconds */
    double track_rate;          /* poses a second, over the last seconds */
    double track_ms;            /* that a look at a frame takes, over the last */
    double duty;                /* part of its time that the fit works: 1, down to 0.1 on a hot machine */
    size_t keyframes, held_out; /* all of them; those that are never trained on */
    size_t spawned;             /* Gaussians at points found after the start */
    int has_fit;                /* the fields below hold */
    sf_fit_progress fit;        /* of the fit itself */
    double held_out_psnr;       /* dB, mean over the keyframes held out, with the poses as tracked, exposed as
                                   the training keyframes before and after them were; NAN */
    double held_out_psnr_corrected; /* with exposure corrected, as sf_quality; NAN */
    double first_psnr;              /* dB, of the first keyframe, exposure corrected; NAN */
} sf_live_progress;

/* Where the live fit stands. Call it from the thread of sf_live_step. */
SF_API void sf_live_get_progress(const sf_live *live, sf_live_progress *progress);

/* The frame that was looked at last. */
typedef struct sf_live_frame {
    uint64_t number;     /* of those looked at, from 1; 0: none yet */
    int64_t time_ns;     /* as sf_frame has it */
    sf_camera camera;    /* of the picture as it is fitted; the pose where `from` is not SF_POSE_NONE */
    sf_pose_from from;   /* where the pose comes from */
    double agreement;    /* of picture and model, -1..1 */
    int has_truth;       /* the frame told its own camera, which was not used */
    sf_camera truth;     /* where has_truth */
    const float *rgb[3]; /* planes of camera.height x camera.width, 0..1, until the next step */
    const sf_board_corner *corners; /* of the board, in that picture, until the next step */
    size_t corner_count;            /* of corners; 0: no board was seen */
} sf_live_frame;

/* Tells of the frame that was looked at last. Call it from the thread of sf_live_step. */
SF_API void sf_live_get_frame(const sf_live *live, sf_live_frame *frame);

/* A copy of the model as sf_fitter_snapshot makes it; the caller destroys it. SF_ERR_EMPTY: there is none
 * yet. */
SF_API sf_status sf_live_snapshot(const sf_live *live, sf_model **model);

/* Renders that model; as sf_render. SF_ERR_EMPTY: there is none yet. */
SF_API sf_status sf_live_render(sf_live *live, const sf_camera *camera, const sf_image_out *out);

/* The keyframes that there are, as a scene: pictures, and poses as they were found. It is the object's. */
SF_API sf_scene *sf_live_scene(sf_live *live);
/* Writes their cameras, as the fit has refined them, as INRIA's cameras.json, atomically. */
SF_API sf_status sf_live_save_cameras(sf_live *live, const char *path);

#ifdef __cplusplus
}
#endif
#endif
