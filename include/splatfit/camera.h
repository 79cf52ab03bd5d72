/* camera.h - a pinhole camera in COLMAP's convention (src/render/README.md). */
#ifndef SPLATFIT_CAMERA_H
#define SPLATFIT_CAMERA_H

#include <stdint.h>

#include "status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* p_c = R_cw p_w + t_cw with +x right, +y down, +z forward; the point (x, y, z) of the camera's frame lands
 * at pixel (fx x/z + cx, fy y/z + cy). Pixel (i, j) covers [i, i+1) x [j, j+1). */
typedef struct sf_camera {
    int32_t width, height; /* px, 1..65535 */
    double fx, fy;         /* px, > 0 */
    double cx, cy;         /* px; the middle of the picture is width/2, height/2 */
    double R_cw[9];        /* world to camera, row-major, orthonormal */
    double t_cw[3];        /* world units */
} sf_camera;

/* COLMAP's PINHOLE, SIMPLE_PINHOLE, SIMPLE_RADIAL, RADIAL and OPENCV in one,
 * and FULL_OPENCV without k4 to k6. A ray (x, y, 1), with
 * r2 = x^2 + y^2 and d = 1 + k1 r2 + k2 r2^2 + k3 r2^3, is seen at pixel (fx x' + cx, fy y' + cy), where
 *     x' = x d + 2 p1 x y + p2 (r2 + 2 x^2)        y' = y d + 2 p2 x y + p1 (r2 + 2 y^2). */
typedef struct sf_lens {
    double fx, fy, cx, cy; /* px */
    double k1, k2, p1, p2, k3;
} sf_lens;

/* The camera's centre in the world, o_c = -R_cw^T t_cw. */
SF_API void sf_camera_center(const sf_camera *camera, double center[3]);

/* The camera that sees the same through a picture box-averaged by `factor` (>= 1): sizes are divided and
 * rounded down (what is left over at the right and bottom is cut), fx, fy, cx, cy are divided. */
SF_API sf_camera sf_camera_downscaled(const sf_camera *camera, int factor);

/* The unit quaternion w x y z of a rotation (row-major), its greatest component above 0; and back, of a
 * quaternion of any norm but 0. */
SF_API void sf_rotation_to_quat(const double R[9], double quat[4]);
SF_API void sf_rotation_from_quat(const double quat[4], double R[9]);

/* SF_OK if sizes, focal lengths and pose are in range and finite and the rotation is orthonormal to 1e-3. */
SF_API sf_status sf_camera_check(const sf_camera *camera);

#ifdef __cplusplus
}
#endif
#endif
