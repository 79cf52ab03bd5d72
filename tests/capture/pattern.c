/* pattern.c - fills pictures with numbered noise and recognises them. */
#include "pattern.h"

#include <stdlib.h>
#include <string.h>

#include <turbojpeg.h>
#include <zlib.h>

enum { MARK = 8 }; /* id and CRC, little-endian */

static void put32(uint8_t *to, uint32_t v) {
    for (int i = 0; i < 4; i++) to[i] = (uint8_t)(v >> 8 * i);
}

static uint32_t get32(const uint8_t *from) {
    return from[0] | (uint32_t)from[1] << 8 | (uint32_t)from[2] << 16 | (uint32_t)from[3] << 24;
}

int pattern_planes(sf_pixel_format format, int width, int height, pattern_plane planes[SF_FRAME_PLANES]) {
    /* Bytes a pixel of plane 0, planes, and by how much the others are smaller. */
    static const struct {
        uint8_t bytes, count, across, down;
    } shape[SF_PIXEL_FORMATS] = {
        [SF_PIXEL_RGB24] = {3, 1, 1, 1}, [SF_PIXEL_BGR24] = {3, 1, 1, 1}, [SF_PIXEL_GREY] = {1, 1, 1, 1},
        [SF_PIXEL_YUYV] = {2, 1, 1, 1},  [SF_PIXEL_UYVY] = {2, 1, 1, 1},  [SF_PIXEL_NV12] = {1, 2, 1, 2},
        [SF_PIXEL_YU12] = {1, 3, 2, 2},  [SF_PIXEL_422P] = {1, 3, 2, 1},  [SF_PIXEL_444P] = {1, 3, 1, 1}};
    for (int i = 0; i < shape[format].count; i++) {
        planes[i].width = (size_t)(width * shape[format].bytes / (i ? shape[format].across : 1));
        planes[i].rows = (size_t)(height / (i ? shape[format].down : 1));
    }
    return shape[format].count;
}

/* The CRC-32 of all but the mark. */
static uint32_t plane_crc(const pattern_plane *plane) {
    uLong crc = crc32(0, plane->data + MARK, (uInt)(plane->width - MARK));
    for (size_t y = 1; y < plane->rows; y++)
        crc = crc32(crc, plane->data + y * plane->stride, (uInt)plane->width);
    return (uint32_t)crc;
}

static uint64_t xorshift(uint64_t *state) {
    *state ^= *state << 13;
    *state ^= *state >> 7;
    *state ^= *state << 17;
    return *state;
}

static void fill_noise(uint8_t *to, size_t bytes, uint64_t *state) {
    for (size_t i = 0; i < bytes; i += 8) {
        uint64_t noise = xorshift(state);
        memcpy(to + i, &noise, bytes - i < 8 ? bytes - i : 8);
    }
}

void pattern_fill(const pattern_plane *planes, int count, uint32_t id) {
    for (int i = 0; i < count; i++) {
        const pattern_plane *p = &planes[i];
        uint32_t name = id * SF_FRAME_PLANES + (uint32_t)i;
        uint64_t state = (name + 1) * UINT64_C(0x9E3779B97F4A7C15);
        for (size_t y = 0; y < p->rows; y++) fill_noise(p->data + y * p->stride, p->width, &state);
        put32(p->data, name);
        put32(p->data + 4, plane_crc(p));
    }
}

static int64_t plane_id(const pattern_plane *plane, uint32_t index) {
    uint32_t name = get32(plane->data);
    if (name % SF_FRAME_PLANES != index || get32(plane->data + 4) != plane_crc(plane)) return -1;
    return name / SF_FRAME_PLANES;
}

/* Start of image, a comment of 10 bytes with its length. */
static const uint8_t jpeg_head[] = {0xFF, 0xD8, 0xFF, 0xFE, 0, 2 + MARK};
enum { JPEG_HEAD = sizeof jpeg_head, JPEG_BODY = JPEG_HEAD + MARK };

static int64_t jpeg_id(const uint8_t *jpeg, size_t bytes) {
    if (bytes < JPEG_BODY || memcmp(jpeg, jpeg_head, JPEG_HEAD) != 0) return -1;
    uLong crc = crc32(0, jpeg + JPEG_BODY, (uInt)(bytes - JPEG_BODY));
    return get32(jpeg + JPEG_HEAD + 4) == crc ? (int64_t)get32(jpeg + JPEG_HEAD) : -1;
}

int64_t pattern_id(const sf_frame *frame) {
    if (frame->format == SF_PIXEL_MJPEG) return jpeg_id(frame->plane[0], frame->bytes);
    pattern_plane planes[SF_FRAME_PLANES];
    int count = pattern_planes(frame->format, frame->width, frame->height, planes);
    int64_t id = -1;
    for (int i = 0; i < count; i++) {
        if (!frame->plane[i] || frame->stride[i] < planes[i].width) return -1;
        planes[i].data = (uint8_t *)(uintptr_t)frame->plane[i];
        planes[i].stride = frame->stride[i];
        int64_t found = plane_id(&planes[i], (uint32_t)i);
        if (found < 0 || (i > 0 && found != id)) return -1;
        id = found;
    }
    return id;
}

void pattern_mark_jpeg(uint8_t *jpeg, size_t size, uint32_t id) {
    put32(jpeg + JPEG_HEAD, id);
    put32(jpeg + JPEG_HEAD + 4, (uint32_t)crc32(0, jpeg + JPEG_BODY, (uInt)(size - JPEG_BODY)));
}

int pattern_jpeg(uint8_t *jpeg, size_t capacity, int width, int height, uint32_t id, size_t *size) {
    uint8_t *grey = malloc((size_t)width * (size_t)height), *file = NULL;
    unsigned long bytes = 0;
    tjhandle compressor = tjInitCompress();
    int made = 0;
    if (grey && compressor) {
        pattern_plane plane = {grey, (size_t)width, (size_t)width, (size_t)height};
        pattern_fill(&plane, 1, id);
        made = tjCompress2(compressor, grey, width, 0, height, TJPF_GRAY, &file, &bytes, TJSAMP_GRAY, 75,
                           0) == 0 &&
               bytes + JPEG_BODY <= capacity;
    }
    if (made) {
        memcpy(jpeg, jpeg_head, JPEG_HEAD);
        memcpy(jpeg + JPEG_BODY, file + 2, bytes - 2);
        *size = JPEG_BODY + bytes - 2;
        pattern_mark_jpeg(jpeg, *size, id);
    }
    tjFree(file);
    if (compressor) tjDestroy(compressor);
    free(grey);
    return made;
}
