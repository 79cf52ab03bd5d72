/* v4l2_layout.h - what a driver gave when a format was set, and how a frame then lies in memory. */
#ifndef SF_CAPTURE_V4L2_LAYOUT_H
#define SF_CAPTURE_V4L2_LAYOUT_H

#include "v4l2_device.h"

/* struct v4l2_format, the same for nodes with one plane of memory and with several. */
typedef struct sf_v4l2_given {
    uint32_t fourcc, width, height, field, colorspace, ycbcr_enc, quantization;
    uint32_t planes;                      /* of memory */
    size_t stride[SF_FRAME_PLANES];       /* bytes, of each plane of memory; 0: unknown */
    size_t memory_bytes[SF_FRAME_PLANES]; /* of each */
} sf_v4l2_given;

/* Reads the present format of a node. SF_ERR_IO. */
sf_status sf_v4l2_get_given(sf_v4l2_device *device, sf_v4l2_given *given);

/* Sets format and size; *given: what the driver made of them. SF_ERR_IO. */
sf_status sf_v4l2_set_given(sf_v4l2_device *device, const sf_v4l2_pixels *pixels, int32_t width,
                            int32_t height, sf_v4l2_given *given);

/* Fills in size, colours and planes of a picture whose `pixels` are set. SF_ERR_UNSUPPORTED: half frames, too
 * few bytes a row or plane, another number of planes. */
sf_status sf_v4l2_lay_out(sf_v4l2_device *device, const sf_v4l2_given *given, sf_v4l2_picture *picture);

#endif
