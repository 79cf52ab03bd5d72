/* localizer.h - the pose of a frame: from a board or from outside, from landmarks and from the model. */
#ifndef SF_LIVE_LOCALIZER_H
#define SF_LIVE_LOCALIZER_H

#include "live_state.h"

/* Finds the pose of the frame in hand, and fills in live->input.frame. */
sf_status sf_live_localize(sf_live *live);
void sf_live_forget_pose(sf_live *live);
/* A keyframe's pose was corrected from `from` to `to`: the last poses move with it. */
void sf_live_correct_pose(sf_live *live, const sf_rigid *from, const sf_rigid *to);

#endif
