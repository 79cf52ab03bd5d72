/* format.h - pixel formats by name, and what a picture of one takes. */
#ifndef SF_CAPTURE_FORMAT_H
#define SF_CAPTURE_FORMAT_H

#include <stddef.h>

#include <splatfit/source.h>

/* Beyond these no source allocates for a picture. */
enum { SF_FRAME_MAX_SIDE = 65535, SF_FRAME_MAX_PIXELS = 1 << 28 };

/* SF_PIXEL_FORMATS: there is none of that name. */
sf_pixel_format sf_pixel_format_find(const char *name);

/* Bytes of all planes of a picture within the limits, one close behind the other; 0: SF_PIXEL_MJPEG. */
size_t sf_pixel_bytes(sf_pixel_format format, int32_t width, int32_t height);

/* By how much the rows of a plane are shorter than those of plane 0 where all share one stride: that is given
 * for plane 0. */
size_t sf_pixel_stride_part(sf_pixel_format format, int plane);

/* Points a frame, whose format and size are set, at planes that lie so. */
void sf_frame_set_planes(sf_frame *frame, const uint8_t *data);

/* "640x480". 0: is none, or beyond the limits. */
int sf_frame_parse_size(const char *text, int32_t *width, int32_t *height);

#endif
