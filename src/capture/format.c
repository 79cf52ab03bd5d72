/* format.c - pixel formats by name, and what a picture of one takes. */
#include "format.h"

#include <stdlib.h>
#include <string.h>

#include "convert.h"

static const char *const names[SF_PIXEL_FORMATS] = {
    [SF_PIXEL_RGB24] = "RGB24", [SF_PIXEL_BGR24] = "BGR24", [SF_PIXEL_GREY] = "GREY",
    [SF_PIXEL_YUYV] = "YUYV",   [SF_PIXEL_UYVY] = "UYVY",   [SF_PIXEL_NV12] = "NV12",
    [SF_PIXEL_YU12] = "YU12",   [SF_PIXEL_422P] = "422P",   [SF_PIXEL_444P] = "444P",
    [SF_PIXEL_MJPEG] = "MJPEG"};

const char *sf_pixel_format_name(sf_pixel_format format) {
    return (unsigned)format < SF_PIXEL_FORMATS ? names[format] : NULL;
}

sf_pixel_format sf_pixel_format_find(const char *name) {
    int format = 0;
    while (format < SF_PIXEL_FORMATS && strcmp(name, names[format]) != 0) format++;
    return (sf_pixel_format)format;
}

void sf_pixel_plane(sf_pixel_format format, int32_t width, int32_t height, int plane, size_t *bytes,
                    size_t *rows) {
    *bytes = *rows = 0;
    if (plane < 0 || plane >= sf_format_planes(format) || width < 1 || height < 1) return;
    *bytes = sf_plane_row_bytes(format, plane, width);
    *rows = (size_t)sf_plane_rows(format, plane, height);
}

size_t sf_pixel_bytes(sf_pixel_format format, int32_t width, int32_t height) {
    size_t sum = 0, bytes, rows;
    for (int i = 0; i < SF_FRAME_PLANES; i++) {
        sf_pixel_plane(format, width, height, i, &bytes, &rows);
        sum += bytes * rows;
    }
    return sum;
}

size_t sf_pixel_stride_part(sf_pixel_format format, int plane) {
    return plane && (format == SF_PIXEL_YU12 || format == SF_PIXEL_422P) ? 2 : 1;
}

void sf_frame_set_planes(sf_frame *frame, const uint8_t *data) {
    for (int i = 0; i < SF_FRAME_PLANES; i++) {
        size_t rows;
        sf_pixel_plane(frame->format, frame->width, frame->height, i, &frame->stride[i], &rows);
        frame->plane[i] = rows ? data : NULL;
        data += frame->stride[i] * rows;
    }
}

static const char *parse_side(const char *text, int32_t *side) {
    char *end;
    if (*text < '0' || *text > '9') return NULL;
    unsigned long value = strtoul(text, &end, 10);
    if (value < 1 || value > SF_FRAME_MAX_SIDE) return NULL;
    *side = (int32_t)value;
    return end;
}

int sf_frame_parse_size(const char *text, int32_t *width, int32_t *height) {
    text = parse_side(text, width);
    if (!text || *text != 'x') return 0;
    text = parse_side(text + 1, height);
    return text && !*text && (int64_t)*width * *height <= SF_FRAME_MAX_PIXELS;
}
