/* jpeg_cut.c - finds where the JPEGs of a stream begin and end. */
#include "jpeg_cut.h"

#include <string.h>

#include "../io/picture.h"
#include "format.h"

/* What the next byte is. */
enum {
    OUTSIDE,    /* anything */
    OUTSIDE_FF, /* the second byte of a first marker, or anything */
    MARKER_FF,  /* the first byte of a marker */
    MARKER,     /* the second one, or one more FF before it */
    LENGTH_HIGH,
    LENGTH_LOW,
    SEGMENT,  /* of a segment after its length */
    PIXELS,   /* coded pixels */
    PIXELS_FF /* after an FF there: 0, a restart, or the second byte of a marker */
};

enum { SOI = 0xd8, EOI = 0xd9, SOS = 0xda, DHT = 0xc4, JPG = 0xc8, DAC = 0xcc, RST0 = 0xd0, RST7 = 0xd7 };

int sf_jpeg_inside(const sf_jpeg_cutter *c) { return c->state > OUTSIDE_FF; }

static int is_frame_header(int marker) {
    return marker >= 0xc0 && marker <= 0xcf && marker != DHT && marker != JPG && marker != DAC;
}

static sf_jpeg_event begin(sf_jpeg_cutter *c) {
    *c = (sf_jpeg_cutter){.state = MARKER_FF, .bytes = 2};
    return SF_JPEG_BEGIN;
}

static sf_jpeg_event end(sf_jpeg_cutter *c) {
    c->state = OUTSIDE;
    uint64_t pixels = (uint64_t)c->width * (uint64_t)c->height;
    int whole =
        c->pixels && pixels && pixels <= SF_FRAME_MAX_PIXELS && pixels / SF_JPEG_PIXELS_A_BYTE <= c->bytes;
    return whole ? SF_JPEG_WHOLE : SF_JPEG_BROKEN;
}

/* A marker's second byte. */
static sf_jpeg_event take_marker(sf_jpeg_cutter *c, int byte) {
    c->marker = byte;
    c->state = LENGTH_HIGH;
    if (byte == EOI) return end(c);
    if (byte >= RST0 && byte <= SOI) { /* a restart without pixels: no JPEG; FF D8: cut off, another begins */
        c->state = byte == SOI ? OUTSIDE_FF : OUTSIDE;
        return SF_JPEG_BROKEN;
    }
    if (byte > 1) return SF_JPEG_MORE;
    c->state = byte ? MARKER_FF : OUTSIDE; /* FF 01 stands alone, FF 00 is none */
    return byte ? SF_JPEG_MORE : SF_JPEG_BROKEN;
}

static void segment_done(sf_jpeg_cutter *c) {
    c->state = c->marker == SOS ? PIXELS : MARKER_FF;
    if (c->marker == SOS) c->pixels = 1;
}

static sf_jpeg_event take_length(sf_jpeg_cutter *c, int byte) {
    c->length += (size_t)byte;
    if (c->length < 2) {
        c->state = OUTSIDE;
        return SF_JPEG_BROKEN;
    }
    c->length -= 2;
    c->at = 0;
    c->state = SEGMENT;
    if (!c->length) segment_done(c);
    return SF_JPEG_MORE;
}

/* Byte `at` of a frame header: precision, height, width, ... */
static void take_frame_header(sf_jpeg_cutter *c, size_t at, int byte) {
    if (at == 1) c->height = byte << 8;
    if (at == 2) c->height += byte;
    if (at == 3) c->width = byte << 8;
    if (at == 4) c->width += byte;
}

/* As much of a segment as there is. */
static size_t take_segment(sf_jpeg_cutter *c, const uint8_t *data, size_t size) {
    size_t n = c->length - c->at < size ? c->length - c->at : size;
    for (size_t i = 0; is_frame_header(c->marker) && i < n && c->at + i < 5; i++)
        take_frame_header(c, c->at + i, data[i]);
    c->at += n;
    if (c->at == c->length) segment_done(c);
    return n;
}

/* Bytes up to and with the next FF, or all. */
static size_t up_to_ff(const uint8_t *data, size_t size, int *found) {
    const uint8_t *ff = memchr(data, 0xff, size);
    *found = ff != NULL;
    return ff ? (size_t)(ff - data) + 1 : size;
}

static sf_jpeg_event take_byte(sf_jpeg_cutter *c, int byte) {
    switch (c->state) {
    case OUTSIDE_FF:
        if (byte == SOI) return begin(c);
        c->state = byte == 0xff ? OUTSIDE_FF : OUTSIDE;
        return SF_JPEG_MORE;
    case MARKER_FF:
        c->state = byte == 0xff ? MARKER : OUTSIDE;
        return byte == 0xff ? SF_JPEG_MORE : SF_JPEG_BROKEN;
    case MARKER:
        return byte == 0xff ? SF_JPEG_MORE : take_marker(c, byte);
    case LENGTH_HIGH:
        c->length = (size_t)byte << 8;
        c->state = LENGTH_LOW;
        return SF_JPEG_MORE;
    case LENGTH_LOW:
        return take_length(c, byte);
    default: /* PIXELS_FF */
        if (byte == 0xff) return SF_JPEG_MORE;
        if (byte && (byte < RST0 || byte > RST7)) return take_marker(c, byte);
        c->state = PIXELS;
        return SF_JPEG_MORE;
    }
}

sf_jpeg_event sf_jpeg_cut(sf_jpeg_cutter *c, const uint8_t *data, size_t size, size_t *taken) {
    size_t at = 0, counted = 0;
    for (; at < size; c->bytes += at - counted, counted = at) {
        int found;
        if (c->state == OUTSIDE || c->state == PIXELS) {
            at += up_to_ff(data + at, size - at, &found);
            if (found) c->state = c->state == OUTSIDE ? OUTSIDE_FF : PIXELS_FF;
        } else if (c->state == SEGMENT) {
            at += take_segment(c, data + at, size - at);
        } else {
            sf_jpeg_event event = take_byte(c, data[at]);
            /* FF D8 within a JPEG is the begin of the next: the D8 is taken again. */
            at += !(event == SF_JPEG_BROKEN && c->state == OUTSIDE_FF);
            if (event != SF_JPEG_MORE) {
                *taken = at;
                return event;
            }
        }
    }
    *taken = size;
    return SF_JPEG_MORE;
}

int sf_jpeg_size(const uint8_t *data, size_t size, int32_t *width, int32_t *height) {
    sf_jpeg_cutter cutter = {0};
    size_t taken = 0, rest = 0;
    if (sf_jpeg_cut(&cutter, data, size, &taken) != SF_JPEG_BEGIN || taken != 2) return 0;
    if (sf_jpeg_cut(&cutter, data + taken, size - taken, &rest) != SF_JPEG_WHOLE) return 0;
    *width = cutter.width;
    *height = cutter.height;
    return 1;
}

/* Coded pixels hold no FF D9: the last one is the picture's end unless the padding holds one. */
size_t sf_jpeg_end(const uint8_t *data, size_t size) {
    if (size < 4 || data[0] != 0xff || data[1] != SOI) return 0;
    while (size >= 4 && (data[size - 2] != 0xff || data[size - 1] != EOI)) size--;
    return size >= 4 ? size : 0;
}
