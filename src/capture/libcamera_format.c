/* libcamera_format.c - see libcamera_format.h. */
#include "libcamera_format.h"

#include <strings.h>

#define FOURCC(a, b, c, d) ((uint32_t)(a) | (uint32_t)(b) << 8 | (uint32_t)(c) << 16 | (uint32_t)(d) << 24)

/* DRM names RGB after a little-endian number: its BGR888, BG24, has R first. */
static const sf_libcamera_format known[] = {
    {FOURCC('Y', 'U', 'Y', 'V'), SF_PIXEL_YUYV, 1, 2, 1, 1},
    {FOURCC('U', 'Y', 'V', 'Y'), SF_PIXEL_UYVY, 1, 2, 1, 1},
    {FOURCC('N', 'V', '1', '2'), SF_PIXEL_NV12, 2, 1, 1, 2},
    {FOURCC('Y', 'U', '1', '2'), SF_PIXEL_YU12, 3, 1, 2, 2},
    {FOURCC('Y', 'U', '1', '6'), SF_PIXEL_422P, 3, 1, 2, 1},
    {FOURCC('B', 'G', '2', '4'), SF_PIXEL_RGB24, 1, 3, 1, 1},
    {FOURCC('R', 'G', '2', '4'), SF_PIXEL_BGR24, 1, 3, 1, 1},
    {FOURCC('M', 'J', 'P', 'G'), SF_PIXEL_MJPEG, 1, 1, 1, 1},
    {FOURCC('R', '8', ' ', ' '), SF_PIXEL_GREY, 1, 1, 1, 1},
};

const sf_libcamera_format *sf_libcamera_format_at(size_t index) {
    return index < sizeof known / sizeof *known ? &known[index] : NULL;
}

const sf_libcamera_format *sf_libcamera_format_of(uint32_t fourcc) {
    const sf_libcamera_format *format;
    for (size_t i = 0; (format = sf_libcamera_format_at(i)); i++)
        if (format->fourcc == fourcc) return format;
    return NULL;
}

const sf_libcamera_format *sf_libcamera_format_named(const char *name) {
    const sf_libcamera_format *format;
    for (size_t i = 0; (format = sf_libcamera_format_at(i)); i++)
        if (strcasecmp(sf_pixel_format_name(format->format), name) == 0) return format;
    return NULL;
}

size_t sf_libcamera_plane_bytes(const sf_libcamera_format *format, size_t stride, int32_t height, int plane) {
    if (format->format == SF_PIXEL_MJPEG) return 1;
    size_t rows = (size_t)height;
    if (!plane) return stride * rows;
    return stride / (size_t)format->across * ((rows + (size_t)format->down - 1) / (size_t)format->down);
}
