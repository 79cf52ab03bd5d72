/* undistort.h - lenses, and pictures resampled to what a pinhole camera would have taken. */
#ifndef SF_IO_UNDISTORT_H
#define SF_IO_UNDISTORT_H

#include "picture.h"

#include <splatfit/camera.h>

int sf_lens_is_distorted(const sf_lens *lens);

/* All values finite, focal lengths > 0. */
int sf_lens_is_valid(const sf_lens *lens);

/* r2 = x^2 + y^2 up to which the polynomial still grows: beyond, it would show the inside once more. */
double sf_lens_limit(const sf_lens *lens);

/* Where the lens shows what a pinhole camera of its fx, fy, cx, cy shows at (u, v), px; of the source whole
 * numbers are the centres of pixels. 0, and no source, from the limit on. */
int sf_lens_source(const sf_lens *lens, double limit, double u, double v, double source[2]);

/* Resamples the picture, in place and at its size, to the pinhole camera of the lens' fx, fy, cx, cy. Weights
 * come along, and are 0 where the source lies outside of the picture or where the polynomial has turned back,
 * so that no pixel is invented. SF_ERR_MEMORY leaves the picture as it was. */
sf_status sf_undistort(sf_context *ctx, const sf_lens *lens, sf_picture *picture);

#endif
