/* undistort.h - lenses, and pictures resampled to what a pinhole camera would have taken. */
#ifndef SF_IO_UNDISTORT_H
#define SF_IO_UNDISTORT_H

#include "picture.h"

/* COLMAP's PINHOLE, SIMPLE_PINHOLE, SIMPLE_RADIAL, RADIAL and OPENCV in one. A ray (x, y, 1), with
 * r2 = x^2 + y^2 and d = 1 + k1 r2 + k2 r2^2, is seen at pixel (fx x' + cx, fy y' + cy), where
 *     x' = x d + 2 p1 x y + p2 (r2 + 2 x^2)        y' = y d + 2 p2 x y + p1 (r2 + 2 y^2). */
typedef struct sf_lens {
    double fx, fy, cx, cy; /* px */
    double k1, k2, p1, p2;
} sf_lens;

int sf_lens_is_distorted(const sf_lens *lens);

/* All values finite, focal lengths > 0. */
int sf_lens_is_valid(const sf_lens *lens);

/* Resamples the picture, in place and at its size, to the pinhole camera of the lens' fx, fy, cx, cy. Weights
 * come along, and are 0 where the source lies outside of the picture or where the polynomial has turned back,
 * so that no pixel is invented. SF_ERR_MEMORY leaves the picture as it was. */
sf_status sf_undistort(sf_context *ctx, const sf_lens *lens, sf_picture *picture);

#endif
