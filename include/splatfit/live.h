/* live.h - fits the scene in front of a camera while it moves: poses, keyframes, first Gaussians, the fit.
 *
 * One thread calls sf_live_step again and again; it never waits for the camera for long. The object has two
 * more threads: one takes frames and never waits for the fit, one searches for new points.
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

/* A live fit: incoming frames, the tracked camera, and the fit of the keyframes. */
typedef struct sf_live sf_live;

/* Where a pose came from. */
typedef enum sf_pose_from {
    SF_POSE_NONE,    /* the pose is not known */
    SF_POSE_BOARD,   /* from a board in view alone */
    SF_POSE_OUTSIDE, /* from the caller's callback or from the frame's own camera alone */
    SF_POSE_TRACK,   /* from landmarks and the model, with a board's or an outside pose as a prior */
    SF_POSE_PICTURES /* from the first map, which is made of pictures alone */
} sf_pose_from;

/* The camera's pose at a time (ns, as sf_frame.time_ns), from outside: R_cw (row-major) and t_cw as in
 * camera.h. information (row-major 6 x 6): inverse covariance of its left twist, world units and radians; all
 * 0: not known, standard deviations of 0.01 of the distance to the scene and 0.01 rad are assumed.
 * Coordinates may be far from 0 (UTM, ECEF): the scene gets an origin near the first poses. Returns SF_OK, or
 * SF_ERR_EMPTY where it is not known. Called from sf_live_step. */
typedef sf_status (*sf_pose_fn)(void *user, int64_t time_ns, double R_cw[9], double t_cw[3],
                                double information[36]);

/* Start from sf_live_options_default(). */
typedef struct sf_live_options {
    sf_fit_options fit;    /* time_limit: of the whole run, from the first frame; 0: without an end */
    const sf_board *board; /* a board, which gives poses in its frame, in metres; NULL: there is no board.
                              Read until sf_live_destroy */
    sf_pose_fn pose;       /* NULL: no poses from a callback */
    void *pose_user;       /* handed to pose */
    int own_poses; /* 1: the frames' own cameras are used as poses from outside; 0: they are only reported, in
                      sf_live_frame.truth */
    int from_pictures; /* 1: where neither a board nor a pose from outside is seen, the first map is made from
                          pictures alone, in the frame of its first camera; 0: frames without a pose are
                          passed over */
    double scale; /* of such a map: the distance from its first camera to what that sees, in the unit that is
                     wanted, 1e-9..1e9; 0: 1 */
    sf_lens lens; /* of the frames; fx 0: that of the frames' own camera where they have one. Else it is found
                     with the first map from pictures; with a board or poses from outside it is a guess: a
                     picture 60 degrees wide */
    int find_lens;          /* 1: a lens of the frames' own camera is not used; lens.fx must be 0 */
    int downscale;          /* box-average the frames by this, 1..16 */
    double track_rate;      /* most frames to track in a second, 0.1..1000 */
    int steps_per_frame;    /* training steps after each frame, for sources that are not in real time: every
                               frame    is tracked, and the run can be repeated to the byte; 0: as time allows */
    int64_t keyframes_most; /* most keyframes, 8..100000: beyond it the most redundant one is removed */
    int hold_out;           /* every n-th keyframe is never trained on, only evaluated; 0: none */
    double keyframe_gap;    /* a frame becomes a keyframe where, compared with every keyframe, the camera has
                               moved by this fraction of the distance to the scene or turned by this angle
                               (rad), 0.001..1. The first 60 keyframes need less: from a fifth of it, rising
                               evenly */
    const char *thermal;    /* folder of the kernel's thermal state ("/sys"). While the kernel throttles the
                               processor, the fit rests for a part of the time; frames are tracked as before.
                               Read    until sf_live_destroy; NULL: not checked */
} sf_live_options;

/* A fit that learns exposures; no board and no poses from outside, a start from pictures; downscale 1, 12
 * frames a second, 300 keyframes, hold_out 8, keyframe_gap 0.07, thermal "/sys". */
SF_API sf_live_options sf_live_options_default(void);

/* Begins with the frames of `source`. The caller closes the source after sf_live_destroy and does not use it
 * before; it is best opened with a separate context. SF_ERR_ARGUMENT: an option out of range (named), no
 * start from pictures, no board and no other poses; SF_ERR_UNSUPPORTED: a board, without libapriltag. On
 * failure *live is NULL. */
SF_API sf_status sf_live_create(sf_context *context, sf_source *source, const sf_live_options *options,
                                sf_live **live);
SF_API void sf_live_destroy(sf_live **live);

/* Handles a frame that is due, else does a step of the fit, else waits a little. SF_ERR_END: time_limit is
 * over or the source has ended, and all held-out keyframes were evaluated a last time; SF_ERR_CANCELLED;
 * SF_ERR_IO: the source failed. The model stays usable in every case. */
SF_API sf_status sf_live_step(sf_live *live);

/* Makes the step in progress the last one. Safe from any thread and from a signal handler. */
SF_API void sf_live_cancel(sf_live *live);

/* 1: pauses the fit: no training steps, no new keyframes; frames are still tracked and shown. 0: continues.
 */
SF_API void sf_live_pause(sf_live *live, int paused);

/* Calls sf_source_lock_exposure before the next frame; a warning is logged if the source refuses. Safe from
 * any thread. */
SF_API void sf_live_lock_exposure(sf_live *live, int locked);

/* Forgets the model and all keyframes. */
SF_API void sf_live_reset(sf_live *live);

/* The state of tracking. */
typedef enum sf_live_state {
    SF_LIVE_WAITING,    /* waits for a first pose */
    SF_LIVE_STARTING,   /* collects the first keyframes, from several places */
    SF_LIVE_TRACKING,   /* finds the poses of frames, and fits */
    SF_LIVE_LOST,       /* finds no pose for the newest frames; the fit goes on */
    SF_LIVE_STATE_COUNT /* how many there are */
} sf_live_state;

/* What is wrong with the incoming frames. Such frames do not become keyframes, so they cannot harm the model.
 */
typedef enum sf_live_trouble {
    SF_LIVE_FINE,    /* nothing is wrong */
    SF_LIVE_SILENT,  /* no frame has come for 2 s */
    SF_LIVE_BLANK,   /* frames without contrast: a covered lens, darkness */
    SF_LIVE_BLURRED, /* frames far less sharp than the model there: the camera shakes or is out of focus */
    SF_LIVE_TROUBLE_COUNT /* how many there are */
} sf_live_trouble;

/* What the user should do, if anything: the most urgent. It stays for a second and a half at least, and is
 * shown only when the frames of 0.3 s agree, so that it can be read. */
typedef enum sf_live_advice {
    SF_ADVICE_NONE,       /* all is well */
    SF_ADVICE_SIDEWAYS,   /* move sideways: the start needs pictures from several places */
    SF_ADVICE_SLOWER,     /* the camera turns or moves too fast, or its pictures are blurred */
    SF_ADVICE_DARKER,     /* the picture is darker than the keyframes */
    SF_ADVICE_BRIGHTER,   /* the picture is brighter than the keyframes */
    SF_ADVICE_COME_BACK,  /* tracking is lost: go back to where the camera was */
    SF_ADVICE_MORE_VIEWS, /* what is in sight was seen from too few sides, or is not fitted well */
    SF_ADVICE_COUNT       /* how many there are */
} sf_live_advice;

/* The progress of a live fit, between two calls of sf_live_step. */
typedef struct sf_live_progress {
    sf_live_state state;     /* after the newest frame that was tracked */
    sf_live_trouble trouble; /* now; a warning is logged when it begins */
    sf_live_advice advice;   /* now */
    int paused;              /* by sf_live_pause */
    int own_world; /* 1: the poses began with a first map from pictures: unit and frame are that map's own */
    double focal_length;        /* px: of the pictures that are fitted; 0 before the first frame */
    int exposure_locked;        /* 1: by sf_live_lock_exposure; 0: it is not; -1: the source cannot be told */
    double seconds;             /* since the first frame */
    sf_source_counts frames;    /* of the source, as sf_source_count gives them */
    uint64_t passed_over;       /* frames replaced by a newer one before the loop took them */
    uint64_t tracked;           /* frames whose pose was found */
    uint64_t looked_at;         /* frames whose pose was searched for */
    uint64_t lost;              /* times that tracking was lost */
    double frame_rate;          /* frames a second that come, over the last seconds */
    double track_rate;          /* poses a second, over the last seconds */
    double track_ms;            /* time to handle a frame, a moving average */
    double duty;                /* fraction of time that the fit works: 1, down to 0.1 under throttling */
    size_t keyframes, held_out; /* all keyframes; those that are never trained on */
    size_t spawned;             /* Gaussians added at points found after the start */
    int has_fit;                /* 1: the fit has begun, and the field `fit` is valid */
    sf_fit_progress fit;        /* of the fit itself */
    double held_out_psnr; /* dB, mean over the held-out keyframes at their tracked poses, with the exposure
                             of the training keyframes before and after each; NAN before the first */
    double held_out_psnr_corrected; /* with exposure corrected, as in sf_quality; NAN before the first */
    double first_psnr; /* dB, of the first keyframe, exposure corrected; NAN before it is known */
} sf_live_progress;

/* Gets the progress. Call it from the thread of sf_live_step. */
SF_API void sf_live_get_progress(const sf_live *live, sf_live_progress *progress);

/* The frame that was tracked last. */
typedef struct sf_live_frame {
    uint64_t number;     /* counted over the tracked frames, from 1; 0: no frame yet */
    int64_t time_ns;     /* as in sf_frame */
    sf_camera camera;    /* of the undistorted picture; its pose, relative to the scene's origin, is valid
                            unless `from` is SF_POSE_NONE */
    sf_pose_from from;   /* where the pose comes from */
    double agreement;    /* correlation of picture and model, -1..1 */
    int has_truth;       /* the frame came with its own camera, which was not used for tracking */
    sf_camera truth;     /* where has_truth */
    const float *rgb[3]; /* planes of camera.height x camera.width, 0..1, until the next step */
    const sf_board_corner *corners; /* of the board, in that picture, until the next step */
    size_t corner_count;            /* of corners; 0: no board was seen */
} sf_live_frame;

/* Gets the frame that was tracked last. Call it from the thread of sf_live_step. */
SF_API void sf_live_get_frame(const sf_live *live, sf_live_frame *frame);

/* A part of the scene: a cube of a grid in which training keyframes see a surface of the model. */
typedef struct sf_live_cell {
    float center[3];  /* world units, relative to the scene's origin */
    uint32_t views;   /* training keyframes that see it */
    uint32_t sectors; /* bits: from which of 14 directions, those of a cube's faces (-x +x -y +y -z +z: bits 0
                         to 5) and corners (bits 6 to 13: 6 + 1 for +x + 2 for +y + 4 for +z) */
    float spread;     /* rad: how far those directions differ, the arc cosine of the length of their mean */
    float error; /* mean absolute difference of model and keyframes there, 0..1, in pictures reduced to 64 px
                    and smoothed, exposures taken out */
    float coverage; /* 0: badly covered, 1: well, the least of three: 5 keyframes, a spread of 0.2 rad, an
                       error of 0.04 (0 at 0.16) */
} sf_live_cell;

/* How well the scene is covered. */
typedef struct sf_live_coverage {
    double cell;  /* world units: the side of a cell, a tenth of the distance to the scene; 0: no fit yet */
    size_t cells; /* that keyframes see, 65,536 at most */
    double mean;  /* of their coverage; NAN: there are none */
    double in_sight;    /* mean coverage of what the camera sees; NAN: not known */
    int has_worst;      /* some part of the scene needs more views: */
    sf_live_cell worst; /* the middle of the part that needs them most */
    double look_ms;     /* the time that a look at a keyframe takes, a moving average: looks take 2 % of the
                           time of the fit */
} sf_live_coverage;

/* Sums up the coverage. Call it from the thread of sf_live_step, as the next two. */
SF_API void sf_live_get_coverage(const sf_live *live, sf_live_coverage *coverage);
/* Copies up to `capacity` cells that keyframes see, from index `first`; returns how many. */
SF_API size_t sf_live_get_cells(const sf_live *live, size_t first, size_t capacity, sf_live_cell *cells);

/* SF_COVERAGE_UNKNOWN: there is no surface, or no training keyframe sees it. */
enum { SF_COVERAGE_UNKNOWN = 255 };

/* The coverage of what each pixel of a camera sees, [height][width]: 0 (badly covered) to 254 (well), or
 * SF_COVERAGE_UNKNOWN. The time is that of a render: a small camera (64 px wide) is enough to be laid over a
 * picture. SF_ERR_EMPTY: there is no model yet; SF_ERR_ARGUMENT: not a camera; SF_ERR_MEMORY. */
SF_API sf_status sf_live_draw_coverage(sf_live *live, const sf_camera *camera, uint8_t *coverage);

/* A copy of the model as sf_fitter_snapshot makes it; the caller destroys it. SF_ERR_EMPTY: there is no model
 * yet. */
SF_API sf_status sf_live_snapshot(const sf_live *live, sf_model **model);

/* Renders that model; as sf_render. SF_ERR_EMPTY: there is no model yet. */
SF_API sf_status sf_live_render(sf_live *live, const sf_camera *camera, const sf_image_out *out);

/* The similarity that takes a map that began from pictures (sf_live_progress.own_world) to the world of the
 * board or of the poses from outside that were seen since. Poses, scene and model stay in the map's own
 * world: apply it to them (sf_camera_transform, sf_model_transform). It is adjusted as more is seen.
 * SF_ERR_EMPTY: not known, or there is no map of that kind. */
SF_API sf_status sf_live_get_world(const sf_live *live, sf_similarity *to_world);

/* A keyframe as it is known by now. */
typedef struct sf_live_keyframe {
    int64_t time_ns;  /* of its frame, as in sf_frame */
    int held_out;     /* 1: never trained on */
    sf_camera camera; /* as refined by the fit, relative to the scene's origin */
    int has_truth;    /* its frame came with its own camera, which was not used for tracking */
    sf_camera truth;  /* where has_truth */
} sf_live_keyframe;

/* Copies up to `capacity` keyframes, the oldest first, from index `first`; returns how many. Call it from the
 * thread of sf_live_step. */
SF_API size_t sf_live_get_keyframes(const sf_live *live, size_t first, size_t capacity,
                                    sf_live_keyframe *keyframes);

/* The current keyframes as a scene: pictures and tracked poses. The scene belongs to the object.
 * sf_scene_get_origin: where its coordinates, those of frames and the model's lie in the world; 0 unless
 * poses from outside are far from 0. */
SF_API sf_scene *sf_live_scene(sf_live *live);
/* Writes the keyframes' cameras, as refined by the fit, as INRIA's cameras.json, atomically: in the world
 * that sf_live_get_world tells, if it is known; world as in sf_scene_save_cameras. */
SF_API sf_status sf_live_save_cameras(sf_live *live, const char *path, int world);

/* Writes the keyframes as a COLMAP project, which sf_scene_load reads: sparse/0 with their cameras, as
 * refined by the fit, and the landmarks that two keyframes or more see, as points; images with their
 * pictures, undistorted, as JPEG; masks where undistorted pictures have empty parts. In the coordinates of
 * the world. Folders are made where they are missing, but for those above `folder`; files of the same name
 * are replaced. SF_ERR_EMPTY: there is no keyframe yet; SF_ERR_IO; SF_ERR_MEMORY. */
SF_API sf_status sf_live_save_project(sf_live *live, const char *folder);

#ifdef __cplusplus
}
#endif
#endif
