/* libcamera_format.h - pixel formats that libcamera and this library share. */
#ifndef SF_CAPTURE_LIBCAMERA_FORMAT_H
#define SF_CAPTURE_LIBCAMERA_FORMAT_H

#include <stddef.h>
#include <stdint.h>

#include <splatfit/source.h>

typedef struct sf_libcamera_format {
    uint32_t fourcc; /* of DRM, without a modifier */
    sf_pixel_format format;
    int planes;
    int bytes;        /* a pixel of plane 0 */
    int across, down; /* by how much the other planes are smaller, in bytes of a row and in rows */
} sf_libcamera_format;

/* The formats in the order in which to choose one; NULL: there are no more. */
const sf_libcamera_format *sf_libcamera_format_at(size_t index);

/* NULL: there is none. A name is that of sf_pixel_format_name, in letters of either case. */
const sf_libcamera_format *sf_libcamera_format_of(uint32_t fourcc);
const sf_libcamera_format *sf_libcamera_format_named(const char *name);

/* Bytes that a plane must have; of a JPEG 1. stride: of plane 0. */
size_t sf_libcamera_plane_bytes(const sf_libcamera_format *format, size_t stride, int32_t height, int plane);

#endif
