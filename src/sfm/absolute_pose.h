/* absolute_pose.h - the pose of a camera from points of the world and where it sees them (GEOMETRY.md, S.16).
 */
#ifndef SF_SFM_ABSOLUTE_POSE_H
#define SF_SFM_ABSOLUTE_POSE_H

#include <stddef.h>
#include <stdint.h>

#include "../pose/lens.h"

enum { SF_P3P_MOST = 4 };

/* The poses (world to camera) from which three points [count][3], which sample[3] names, are seen along their
 * rays (x, y, 1), [count][2]. Returns how many; none for points in a line. */
int sf_pose_from_3(const double *points, const double *rays, const uint32_t sample[3],
                   sf_rigid poses[SF_P3P_MOST]);

/* Which points of which pixels; where nothing is said, of all. */
typedef struct sf_correspondences {
    const double *points; /* [count][3], world */
    const double *pixels; /* [count][2], px */
    size_t count;
} sf_correspondences;

/* Moves the pose, and the focal length with with_focal (fx and fy by one factor), to where the squares of the
 * residuals, with Cauchy's weights of the given scale (c, px), are least; `members` [member_count]: which
 * observations. Returns the cost per member; infinite where there is none. */
double sf_pose_refine(const sf_correspondences *s, const uint32_t *members, size_t member_count, double scale,
                      int with_focal, sf_lens *lens, sf_rigid *T);

#endif
