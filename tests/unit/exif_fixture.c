/* exif_fixture.c - see exif_fixture.h. */
#include "exif_fixture.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* Behind the marker: "Exif", a TIFF header, a directory with make, model and a link, and the linked
 * directory. */
enum {
    ROOM = 512,
    TIFF = 6,
    FIRST = 8,
    SECOND = 80,
    VALUES = 200,
    SHORT = 3,
    LONG = 4,
    RATIONAL = 5,
    ASCII = 2
};

typedef struct block {
    uint8_t bytes[ROOM];
    size_t directory, values; /* where the next entry and the next value go, from the TIFF header */
    unsigned entries;
} block;

static void put(block *b, size_t at, unsigned long value, int bytes) {
    for (int i = 0; i < bytes; i++) b->bytes[TIFF + at + (size_t)i] = (uint8_t)(value >> (8 * i));
}

static void begin_directory(block *b, size_t at) { b->directory = at + 2, b->entries = 0; }

static void end_directory(block *b, size_t at) { put(b, at, b->entries, 2); }

static void entry(block *b, unsigned tag, unsigned format, unsigned long count, unsigned long value) {
    put(b, b->directory, tag, 2);
    put(b, b->directory + 2, format, 2);
    put(b, b->directory + 4, count, 4);
    put(b, b->directory + 8, value, 4);
    b->directory += 12, b->entries++;
}

static void text(block *b, unsigned tag, const char *value) {
    if (!value) return;
    size_t size = strlen(value) + 1;
    assert_true(size > 4 && TIFF + b->values + size <= ROOM);
    entry(b, tag, ASCII, size, b->values);
    memcpy(b->bytes + TIFF + b->values, value, size);
    b->values += size + size % 2;
}

static void rational(block *b, unsigned tag, double value) {
    if (!(value > 0)) return;
    entry(b, tag, RATIONAL, 1, b->values);
    put(b, b->values, (unsigned long)lround(1000 * value), 4);
    put(b, b->values + 4, 1000, 4);
    b->values += 8;
}

static size_t make_block(block *b, const exif_wish *w) {
    memcpy(b->bytes, "Exif\0\0II*\0\10\0\0", 14);
    b->values = VALUES;
    begin_directory(b, FIRST);
    text(b, 0x010f, w->make);
    text(b, 0x0110, w->model);
    if (w->orientation) entry(b, 0x0112, SHORT, 1, w->orientation);
    entry(b, 0x8769, LONG, 1, SECOND);
    end_directory(b, FIRST);
    begin_directory(b, SECOND);
    rational(b, 0x920a, w->focal_mm);
    if (w->width) entry(b, 0xa002, LONG, 1, w->width);
    if (w->height) entry(b, 0xa003, SHORT, 1, w->height);
    rational(b, 0xa20e, w->pixels_per_mm);
    if (w->pixels_per_mm > 0) entry(b, 0xa210, SHORT, 1, 4); /* a mm */
    if (w->focal_35) entry(b, 0xa405, SHORT, 1, w->focal_35);
    end_directory(b, SECOND);
    return TIFF + b->values;
}

void write_exif_jpeg(sf_context *ctx, const char *path, int width, int height, const float *rgb,
                     const exif_wish *wish) {
    block b = {.bytes = {0}};
    size_t size = make_block(&b, wish), jpeg_size;
    uint8_t *jpeg;
    assert_ok(ctx, sf_encode_jpeg(ctx, width, height, rgb, 95, &jpeg, &jpeg_size));
    const uint8_t head[] = {0xff, 0xd8, 0xff, 0xe1, (uint8_t)((size + 2) >> 8), (uint8_t)(size + 2)};
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(head, 1, sizeof head, file), sizeof head);
    assert_int_equal(fwrite(b.bytes, 1, size, file), size);
    assert_int_equal(fwrite(jpeg + 2, 1, jpeg_size - 2, file), jpeg_size - 2);
    assert_int_equal(fclose(file), 0);
    sf_encoded_free(ctx, &jpeg);
}
