/* relative_pose.h - the pose of one camera from another's, refined over pairs of rays (GEOMETRY.md, S.18). */
#ifndef SF_SFM_RELATIVE_POSE_H
#define SF_SFM_RELATIVE_POSE_H

#include <stddef.h>

#include "../pose/rigid.h"

/* Moves T (|t| = 1, as in essential.h) to where the weighted squares of Sampson's distances are least, over
 * the pairs a, b [count][2] of rays; weights [count], NULL: all 1. Returns that sum. */
double sf_relative_pose_refine(const double *a, const double *b, const double *weights, size_t count,
                               int steps, sf_rigid *T);

#endif
