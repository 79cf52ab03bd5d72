/* pose_check.h - whether poses from outside agree with the pictures. */
#ifndef SF_LIVE_POSE_CHECK_H
#define SF_LIVE_POSE_CHECK_H

#include "live_state.h"

/* Compares the newest keyframe with one some keyframes before, until enough pairs tell: a warning says that
 * most matches contradict the poses, and which other reading they agree with. SF_ERR_MEMORY. */
sf_status sf_live_check_poses(sf_live *live);

#endif
