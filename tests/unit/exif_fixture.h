/* exif_fixture.h - JPEGs that tell of their camera. */
#ifndef TESTS_UNIT_EXIF_FIXTURE_H
#define TESTS_UNIT_EXIF_FIXTURE_H

#include "testing.h"

/* What a JPEG is to tell; 0 or NULL: not told. */
typedef struct exif_wish {
    const char *make, *model;
    double focal_mm, pixels_per_mm;
    unsigned focal_35, width, height, orientation;
} exif_wish;

/* Writes rgb, [height][width][3], as a JPEG of quality 95 with that EXIF. */
void write_exif_jpeg(sf_context *ctx, const char *path, int width, int height, const float *rgb,
                     const exif_wish *wish);

#endif
