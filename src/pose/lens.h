/* lens.h - the lens with its distortion: pixels, rays and derivatives (README, P.1). */
#ifndef SF_POSE_LENS_H
#define SF_POSE_LENS_H

#include <splatfit/camera.h>

#include "rigid.h"

/* Parameters of a lens that are estimated, in the order of sf_lens: all but k3. */
enum { SF_LENS_PARAMETERS = 8 };

/* The pixel of a point of the camera's frame (README, P.1), with its derivatives by the point, d_point
 * [2][3], and by the lens, d_lens [2][8]; both may be NULL. 0 where the point is not in front of the camera.
 */
int sf_lens_project(const sf_lens *lens, const double point[3], double pixel[2], double *d_point,
                    double *d_lens);

/* The ray (x, y, 1) seen at a pixel. 0 where there is none, or none is found. */
int sf_lens_ray(const sf_lens *lens, const double pixel[2], double ray[2]);

/* The derivative of a pixel by the left twist of the pose, J [2][6], from that by the point p of the camera's
 * frame, d_point [2][3]: d_point [I, -[p]x]. */
void sf_twist_derivative(const double d_point[6], const double p[3], double J[2 * SF_TWIST]);

#endif
