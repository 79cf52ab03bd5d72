/* libcamera_format.c - see libcamera_format.h. */
#include "libcamera_format.h"

#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "convert.h"
#include "format.h"

#define FOURCC(a, b, c, d) ((uint32_t)(a) | (uint32_t)(b) << 8 | (uint32_t)(c) << 16 | (uint32_t)(d) << 24)

/* DRM names RGB after a little-endian number: its BGR888, BG24, has R first. */
static const sf_libcamera_format known[] = {
    {FOURCC('Y', 'U', 'Y', 'V'), SF_PIXEL_YUYV},  {FOURCC('U', 'Y', 'V', 'Y'), SF_PIXEL_UYVY},
    {FOURCC('N', 'V', '1', '2'), SF_PIXEL_NV12},  {FOURCC('Y', 'U', '1', '2'), SF_PIXEL_YU12},
    {FOURCC('Y', 'U', '1', '6'), SF_PIXEL_422P},  {FOURCC('B', 'G', '2', '4'), SF_PIXEL_RGB24},
    {FOURCC('R', 'G', '2', '4'), SF_PIXEL_BGR24}, {FOURCC('M', 'J', 'P', 'G'), SF_PIXEL_MJPEG},
    {FOURCC('R', '8', ' ', ' '), SF_PIXEL_GREY},
};

/* 1. Formats */

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

/* 2. What a camera offers */

static int offers(const sf_libcamera_offer *offer, const sf_libcamera_format *format) {
    for (size_t i = 0; i < offer->count; i++)
        if (offer->fourccs[i] == format->fourcc) return 1;
    return 0;
}

const sf_libcamera_format *sf_libcamera_format_choose(const sf_libcamera_offer *offer, const char *asked) {
    const sf_libcamera_format *format = sf_libcamera_format_named(asked);
    if (*asked) return format && (!offer->count || offers(offer, format)) ? format : NULL;
    format = sf_libcamera_format_of(offer->own);
    for (size_t i = 0; !format && sf_libcamera_format_at(i); i++)
        if (offers(offer, sf_libcamera_format_at(i))) format = sf_libcamera_format_at(i);
    return format;
}

void sf_libcamera_format_list(const sf_libcamera_offer *offer, char *text, size_t bytes) {
    size_t used = 0;
    for (size_t i = 0; i < offer->count && used < bytes; i++) {
        const sf_libcamera_format *format = sf_libcamera_format_of(offer->fourccs[i]);
        if (!format) continue;
        used += (size_t)snprintf(text + used, bytes - used, "%s%s", used ? ", " : "",
                                 sf_pixel_format_name(format->format));
    }
    if (!used) snprintf(text, bytes, "no format that splatfit reads");
}

sf_device_mode sf_libcamera_mode(uint32_t fourcc, int has_modifier, int32_t width, int32_t height) {
    const sf_libcamera_format *format = has_modifier ? NULL : sf_libcamera_format_of(fourcc);
    sf_device_mode mode = {.supported = format != NULL, .width = width, .height = height};
    for (int i = 0; i < 4; i++) mode.fourcc[i] = (char)(fourcc >> 8 * i);
    if (format) mode.format = format->format;
    return mode;
}

/* 3. Memory */

int sf_libcamera_planes(const sf_libcamera_picture *picture) {
    return picture->format == SF_PIXEL_MJPEG ? 1 : sf_format_planes(picture->format);
}

size_t sf_libcamera_stride(const sf_libcamera_picture *picture, int plane) {
    return picture->stride / sf_pixel_stride_part(picture->format, plane);
}

size_t sf_libcamera_plane_bytes(const sf_libcamera_picture *picture, int plane) {
    size_t row, rows;
    if (picture->format == SF_PIXEL_MJPEG) return 1;
    sf_pixel_plane(picture->format, picture->width, picture->height, plane, &row, &rows);
    return sf_libcamera_stride(picture, plane) * rows;
}
