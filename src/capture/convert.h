/* convert.h - what the formats of frames are made of. */
#ifndef SF_CAPTURE_CONVERT_H
#define SF_CAPTURE_CONVERT_H

#include "../kernels/kernels.h"

#include <splatfit/source.h>

/* Planes of a format, 1..3; 0 for SF_PIXEL_MJPEG and what is no format. */
int sf_format_planes(sf_pixel_format format);

/* Bytes that a row of plane `plane` has at least, and rows of that plane, in a picture of width x height px:
 * chroma that is shared by pixels is rounded up. */
size_t sf_plane_row_bytes(sf_pixel_format format, int plane, int32_t width);
int32_t sf_plane_rows(sf_pixel_format format, int plane, int32_t height);

/* Whether matrix and range matter to the format: all that has a Y. */
int sf_format_has_luma(sf_pixel_format format);

/* The weights of R and B in Y. */
void sf_luma_weights(sf_yuv_matrix matrix, double *red, double *blue);

/* The numbers of the kernel `convert`, each the float nearest to it. */
sf_yuv sf_yuv_of(sf_yuv_matrix matrix, int full_range);

#endif
