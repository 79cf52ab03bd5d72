/* plane.h - poses that the homography of a plane stands for; pure rotations (GEOMETRY.md, S.14, S.15). */
#ifndef SF_SFM_PLANE_H
#define SF_SFM_PLANE_H

#include <stddef.h>
#include <stdint.h>

#include "../pose/rigid.h"

/* The poses of the second camera from the first's that a homography between rays, b ~ H a, stands for; with
 * n the plane's unit normal in the first camera's frame and d its distance, H ~ R + t n^T / d and t is in
 * units of d. Half of the poses have points behind a camera. Returns their number: 4, 1 for a rotation
 * without a translation (t = 0, n = 0), 0 where H is none. normals may be NULL. */
int sf_homography_poses(const double H[9], sf_rigid poses[4], double normals[12]);

/* The rotation that best turns the rays a [count][2] into b, of those pairs that `members` (uint8_t flags;
 * NULL: all) names. 0: fewer than 2 pairs. */
int sf_rotation_between(const double *a, const double *b, const uint8_t *members, size_t count, double R[9]);

#endif
