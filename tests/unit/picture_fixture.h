/* picture_fixture.h - JPEG and PNG files in memory, and what is expected of their pixels. */
#ifndef TESTS_UNIT_PICTURE_FIXTURE_H
#define TESTS_UNIT_PICTURE_FIXTURE_H

#include "testing.h"

#include <spng.h>

enum { WIDTH = 13, HEIGHT = 7, PIXELS = WIDTH * HEIGHT };

typedef struct file {
    uint8_t *data;
    size_t size;
} file;

/* Writes the bytes under a name without an ending: only their content tells what they are. */
const char *picture_put(const void *data, size_t size);

/* Reading fails with this status, and the error names `part`. */
void picture_assert_refused(sf_context *ctx, const void *data, size_t size, sf_status expected,
                            const char *part);

typedef struct png_kind {
    int color_type, depth, interlaced;
    const struct spng_plte *palette;
    const struct spng_trns *transparency;
} png_kind;

/* The caller frees the data. */
file picture_make_png(const png_kind *kind, const void *pixels, size_t size);

/* What the tests put into channel c of pixel i. */
uint8_t picture_value(int c, int i);

typedef void (*expect_fn)(int i, uint8_t rgb[3], uint8_t *weight);

/* channels values a pixel, 8 or 16 bits; the last of 2 or 4 is alpha, picture_value(3, i). */
void picture_fill(uint8_t *data, int channels, int depth, int opaque);

/* Of TurboJPEG's pixel format, subsampling and flags; the caller frees the data. */
file picture_make_jpeg(const uint8_t *pixels, int format, int sampling, int flags);

/* What is expected of pixel i: the colour, and how much it weighs. */
void picture_expect_slope(int i, uint8_t rgb[3], uint8_t *weight);

/* A JPEG of a slope, of the colours of picture_expect_slope. */
file picture_some_jpeg(int sampling, int flags);

#endif
