/* keyframe_list.h - the frames that are fitted, and what is known of each. */
#ifndef SF_LIVE_KEYFRAME_LIST_H
#define SF_LIVE_KEYFRAME_LIST_H

#include <splatfit/live.h>

#include "../pose/view.h"
#include "../sfm/features.h"
#include "frame_grabber.h"

/* What a place is found again by: 150 bytes a feature of the picture and 128 of each of the few, so 110 KB a
 * keyframe at most. */
typedef struct sf_place {
    sf_features features;
    sf_features few;  /* descriptors of those of the largest scales */
    float *depths;    /* [features.count] camera z, world units; 0: not known; NULL: not drawn yet */
    int64_t drawn_at; /* step of the fit that `depths` are from */
} sf_place;

/* The picture of a keyframe is a view of the scene. */
typedef struct sf_keyframe {
    uint32_t id;          /* of the view */
    int held_out;         /* never trained on */
    int hold, told;       /* its pose is to be held; the fit knows of it */
    int searched;         /* for points */
    uint64_t found_again; /* times that the camera was lost before, and a place was recognized */
    double light;         /* as sf_picture has it */
    int64_t time_ns;      /* of its frame */
    int has_truth;        /* its frame told its own pose, which was not used: */
    sf_rigid truth;
    int has_outside;             /* a pose of its frame came from outside: */
    sf_rigid outside;            /* as it came */
    sf_rigid pose;               /* world to camera, as it is known by now */
    double center[3];            /* of the camera */
    sf_place place;              /* the keyframe's own */
    double psnr, psnr_corrected; /* dB, when last evaluated; NAN */
} sf_keyframe;

typedef struct sf_keyframes {
    sf_keyframe *list; /* oldest first */
    size_t count, capacity;
    int64_t made;        /* so far, those included that made room for others */
    int wanted;          /* the camera is far enough from all of them for another one, */
    int forced;          /* the next good frame becomes one, wherever it is */
    double wanted_since; /* since this time of the frames' clock, s */
} sf_keyframes;

/* How poses from outside may have been meant. */
enum { SF_POSE_READINGS = 4 };

typedef struct sf_pose_check {
    int pairs;                               /* of keyframes, compared so far */
    size_t matches, agree[SF_POSE_READINGS]; /* of theirs, and those that agree with each reading */
} sf_pose_check;

#endif
