/* undistort.h - lenses, and pictures resampled to what a pinhole camera would have taken. */
#ifndef SF_IO_UNDISTORT_H
#define SF_IO_UNDISTORT_H

#include "picture.h"

#include <splatfit/camera.h>

int sf_lens_is_distorted(const sf_lens *lens);

/* All values finite, focal lengths > 0. */
int sf_lens_is_valid(const sf_lens *lens);

/* Resamples the picture, in place and at its size, to the pinhole camera of the lens' fx, fy, cx, cy. Weights
 * come along, and are 0 where the source lies outside of the picture or where the polynomial has turned back,
 * so that no pixel is invented. SF_ERR_MEMORY leaves the picture as it was. */
sf_status sf_undistort(sf_context *ctx, const sf_lens *lens, sf_picture *picture);

#endif
