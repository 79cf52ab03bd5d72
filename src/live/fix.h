/* fix.h - the pose of a frame as it is known before the model is drawn: from a board, from outside, or from a
 * first map. */
#ifndef SF_LIVE_FIX_H
#define SF_LIVE_FIX_H

#include <math.h>

#include "live_state.h"

/* Finds the pose of the frame in hand; from SF_POSE_NONE: there is none. */
sf_status sf_fix_find(sf_live *live, sf_fix *fix);

/* The pose that a first map from pictures gives it: the first of the map stays where it is, the others may
 * move. */
void sf_fix_by_first_map(const sf_live *live, sf_fix *fix);

/* Of a pose with a standard deviation in rad and parts of the distance. While the distance is not known,
 * nothing is there that the position could be weighed against. */
void sf_fix_tell_accuracy(sf_fix *fix, double distance);

/* Whether the pose leaves the model nothing to say. */
int sf_fix_is_held(const sf_fix *fix);

/* Makes a pose relative to another origin. */
void sf_pose_shift(double R[9], double t[3], const double origin[3]);

static inline int sf_pose_is_finite(const sf_rigid *pose) {
    for (int k = 0; k < 9; k++)
        if (!isfinite(pose->R[k])) return 0;
    return isfinite(pose->t[0]) && isfinite(pose->t[1]) && isfinite(pose->t[2]);
}

#endif
