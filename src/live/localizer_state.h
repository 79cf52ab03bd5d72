/* localizer_state.h - what is known of the pose of the frame in hand, and of those before it. */
#ifndef SF_LIVE_LOCALIZER_STATE_H
#define SF_LIVE_LOCALIZER_STATE_H

#include <splatfit/live.h>

#include "../pose/landmarks.h"
#include "../pose/track.h"
#include "ticker.h"

enum { SF_FIRST_CAMERAS = 24 };

/* A pose that is known before the model is drawn. */
typedef struct sf_fix {
    sf_pose_from from; /* SF_POSE_NONE: none */
    sf_track_prior prior;
    double deviation; /* standard deviation, rad and parts of the distance; 0: `prior` tells it */
} sf_fix;

typedef struct sf_localizer {
    sf_detector *detector; /* NULL: no board */
    sf_tracker *tracker;
    sf_landmarks *landmarks;

    /* Of the frame. */
    sf_fix fix;           /* its pose from a board or from outside */
    sf_followed followed; /* its pose from landmarks */
    int fixed;            /* `fix` is so accurate that the fit holds the pose */
    int sure;             /* its pose is trusted, and it is as sharp as others: it may become a keyframe */

    /* Of the last frames. */
    sf_live_state state;
    sf_rigid pose, pose_before; /* of the last two frames whose pose was found */
    int64_t pose_ns, pose_before_ns;
    int poses;              /* found one after another, up to 2 */
    int misses;             /* frames since */
    int doubts;             /* good poses still needed until the camera counts as found again */
    double usual_agreement; /* moving average over the tracked frames; 0: none yet */
    double distance;        /* to what the camera sees, world units; 0: not known */
    int has_own_world;      /* it began from pictures: unit and frame are its own */
    int has_origin;         /* the scene's was chosen, or 0 is near enough */
    sf_camera first_cameras[SF_FIRST_CAMERAS]; /* of poses from outside, until the distance is known */
    size_t first_count;

    uint64_t looked_at, tracked, lost; /* frames; frames with a pose; times that the pose was lost */
    uint64_t found_again;              /* times that a place was recognized */
    sf_ticker poses_found;
} sf_localizer;

#endif
