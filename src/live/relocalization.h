/* relocalization.h - where a picture was taken, from the picture alone. */
#ifndef SF_LIVE_RELOCALIZATION_H
#define SF_LIVE_RELOCALIZATION_H

#include "live_state.h"

/* A pose from features that keyframes share with the picture in hand. */
typedef struct sf_place_pose {
    int found;      /* 0: there is none, or it is doubtful */
    sf_rigid pose;  /* world to camera */
    size_t agree;   /* features of the picture that agree with it */
    double seconds; /* that it took */
} sf_place_pose;

/* The pose from the features that the keyframes chosen[count] share with a place: the picture in hand, whose
 * features are known, or a keyframe. At most `drawings` keyframes get depths; without them the others say
 * nothing. A pose is found where features all over the picture agree with it and no others with a place
 * elsewhere. SF_ERR_MEMORY. */
sf_status sf_live_find_place(sf_live *live, const sf_place *place, const size_t *chosen, size_t count,
                             int drawings, sf_place_pose *found);

/* Whether the model drawn at a pose looks like the picture in all of its parts, but for a few that something
 * may hide: two places may be alike in most of a picture. SF_ERR_MEMORY. */
sf_status sf_live_confirm_place(sf_live *live, const sf_rigid *pose, int *confirmed);

/* As sf_live_find_place, from the keyframes that look most like the picture; with each miss from other ones.
 */
sf_status sf_live_relocalize(sf_live *live, sf_place_pose *found);

#endif
