/* neighbours.h - the common focus of cameras, and the choice of neighbour views for matching. */
#ifndef SF_SCENE_NEIGHBOURS_H
#define SF_SCENE_NEIGHBOURS_H

#include <stddef.h>

#include <splatfit/camera.h>

/* The least-squares point nearest to the optical axes of cameras[0..n-1]: what cameras that look inward look
 * at. Not finite for parallel axes. */
void sf_focus_point(const sf_camera *const *cameras, size_t n, double focus[3]);

/* Distance that a camera looks at: to the focus if that is in front, else the scene's extent. */
double sf_look_distance(const sf_camera *camera, const double focus[3], double extent);

/* The distance that each of n cameras looks at, world units. Cameras that look inward look at their common
 * focus. Where there is none (places along a street, a walk), it is the focus of the nearest cameras; where
 * those do not look inward either, the distance at which they triangulate best; where they are in one place,
 * `extent`. Returns whether all have a common focus. */
int sf_look_distances(const sf_camera *const *cameras, size_t n, double extent, double *distances);

/* Finds up to `most` of the n cameras that see what camera `self` sees at `distance` (its camera z, world
 * units) from another place: overlapping pictures, similar directions, a good triangulation angle; best
 * first, and not all from one place. Writes their indices; returns how many. */
size_t sf_choose_neighbours(const sf_camera *const *cameras, size_t n, size_t self, double distance,
                            size_t most, size_t *chosen);

/* The pixel and depth of a point of the world; 0: it is not in the picture. */
int sf_camera_sees(const sf_camera *c, const double p[3], double *u, double *v, double *z);

#endif
