/* undistort.h - pictures resampled to what a pinhole camera would have taken.
 *
 * The pinhole camera has the lens' own focal lengths: the middle keeps its resolution, whatever the lens. Of
 * a perspective lens it has the picture's size too. Of a fisheye it shows all that the lens sees across and
 * down, up to 60 degrees on each side: what lies beyond would be stretched more than fourfold, and is
 * cropped.
 */
#ifndef SF_IO_UNDISTORT_H
#define SF_IO_UNDISTORT_H

#include "optics.h"
#include "picture.h"

/* The picture of the pinhole camera. */
typedef struct sf_undistorted {
    int width, height; /* px */
    double cx, cy;     /* px; a whole number of pixels off the lens' */
} sf_undistorted;

/* Of a picture of that size. */
sf_undistorted sf_undistort_frame(const sf_optics *optics, int width, int height);

/* Degrees across the middle of a picture of that size: that the lens sees, that the pinhole camera keeps. */
void sf_undistort_field(const sf_optics *optics, int width, int height, double *seen, double *kept);

/* Resamples the picture, in place, to the frame of its pinhole camera. Weights come along, and are 0 where
 * the source lies outside of the picture or where the lens has turned back, so that no pixel is invented.
 * SF_ERR_MEMORY leaves the picture as it was. */
sf_status sf_undistort(sf_context *ctx, const sf_optics *optics, sf_picture *picture);

#endif
