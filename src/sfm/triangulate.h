/* triangulate.h - points from where cameras see them (GEOMETRY.md, S.17). */
#ifndef SF_SFM_TRIANGULATE_H
#define SF_SFM_TRIANGULATE_H

#include <stddef.h>

#include "../pose/lens.h"

/* A camera that sees the point at a pixel, and along the ray (x, y, 1). */
typedef struct sf_sight {
    const sf_lens *lens;
    const sf_rigid *pose; /* world to camera */
    double pixel[2], ray[2];
    double unit; /* px, of errors (0: 1) */
} sf_sight;

/* The point of least distance from the rays of `count` >= 2 cameras. 0: the rays are parallel. */
int sf_triangulate_rays(const sf_sight *sights, size_t count, double at[3]);

/* Moves the point to where the squares of its residuals in px are least (Gauss and Newton). Returns their
 * mean square per camera; infinite if the point is behind one. */
double sf_triangulate_refine(const sf_sight *sights, size_t count, double at[3]);

/* The distance between where a camera sees the point and where it should, in its unit; infinite behind it. */
double sf_sight_error(const sf_sight *sight, const double at[3]);

/* Whether two of the lines from the cameras' centers to the point make an angle with a cosine below this; the
 * first SF_SIGHTS_MOST are looked at. */
enum { SF_SIGHTS_MOST = 64 };
int sf_is_wide(const sf_sight *sights, size_t count, const double at[3], double cosine);

/* The angle (rad) at a point of the first camera's frame between its ray and the second camera's; T as in
 * essential.h. 0: the rays do not meet in front of both. */
double sf_pair_angle(const sf_rigid *T, const double a[2], const double b[2]);

#endif
