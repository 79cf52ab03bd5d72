/* libcamera_format.h - pixel formats that libcamera and this library share, and how a frame of one lies in
 * memory. */
#ifndef SF_CAPTURE_LIBCAMERA_FORMAT_H
#define SF_CAPTURE_LIBCAMERA_FORMAT_H

#include <stddef.h>
#include <stdint.h>

#include <splatfit/source.h>

typedef struct sf_libcamera_format {
    uint32_t fourcc; /* of DRM, without a modifier */
    sf_pixel_format format;
} sf_libcamera_format;

/* The formats in the order in which to choose one; NULL: there are no more. */
const sf_libcamera_format *sf_libcamera_format_at(size_t index);

/* NULL: there is none. A name is that of sf_pixel_format_name, in letters of either case. */
const sf_libcamera_format *sf_libcamera_format_of(uint32_t fourcc);
const sf_libcamera_format *sf_libcamera_format_named(const char *name);

/* What a camera offers: fourccs, 0 where one has a modifier, which no format of ours has. */
typedef struct sf_libcamera_offer {
    uint32_t own; /* libcamera's choice */
    const uint32_t *fourccs;
    size_t count; /* 0: not told */
} sf_libcamera_offer;

/* The format asked for ("": none); otherwise the first of ours that is offered, libcamera's choice before.
 * NULL: it is not offered. */
const sf_libcamera_format *sf_libcamera_format_choose(const sf_libcamera_offer *offer, const char *asked);

/* Writes the names of those that are offered and read, "NV12, MJPEG", or that there is none. */
void sf_libcamera_format_list(const sf_libcamera_offer *offer, char *text, size_t bytes);

/* A mode of a camera, for lists. has_modifier: the fourcc has one. */
sf_device_mode sf_libcamera_mode(uint32_t fourcc, int has_modifier, int32_t width, int32_t height);

/* How a frame lies in memory. */
typedef struct sf_libcamera_picture {
    sf_pixel_format format;
    int32_t width, height; /* px */
    size_t stride;         /* bytes, of plane 0; 0: a JPEG */
    sf_yuv_matrix matrix;
    int full_range;
} sf_libcamera_picture;

/* Planes of memory; a JPEG has one. */
int sf_libcamera_planes(const sf_libcamera_picture *picture);
/* Bytes of a row of a plane. */
size_t sf_libcamera_stride(const sf_libcamera_picture *picture, int plane);
/* Bytes that a plane must have; of a JPEG 1. */
size_t sf_libcamera_plane_bytes(const sf_libcamera_picture *picture, int plane);

#endif
