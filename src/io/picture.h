/* picture.h - JPEG and PNG files as 8-bit planes, and back. */
#ifndef SF_IO_PICTURE_H
#define SF_IO_PICTURE_H

#include "../base/context.h"

/* Beyond these a file is refused from its header, before anything is allocated for its pixels. */
enum { SF_PICTURE_MAX_SIDE = 65535, SF_PICTURE_MAX_PIXELS = 1 << 28, SF_PICTURE_FAULT_BYTES = 192 };

typedef struct sf_picture {
    int width, height;           /* px; of what was decoded */
    int file_width, file_height; /* px; of the file */
    int divided;                 /* sides are those of the file divided by 1, 2, 4 or 8, rounded up */
    uint8_t *rgb;                /* [3][height][width], sRGB values */
    uint8_t *weight; /* [height][width], from an alpha channel; NULL if there is none or all is opaque */
    int has_alpha;   /* sf_picture_look: the file states that pixels may be transparent */
    int orientation; /* EXIF 1..8 as the file says, 1 if it does not; never applied */
    char fault[SF_PICTURE_FAULT_BYTES]; /* where loading failed: why, without the path (threads share
                                           sf_last_error) */
} sf_picture;

/* Pixels that a file may hold: so many, or so many a byte where that is more. What compresses better is no
 * picture: 8 bits of one value take 1/1032 of their size as PNG. A JPEG holds 512 a byte at most. */
enum { SF_PNG_PIXELS = 1 << 24, SF_PNG_PIXELS_A_BYTE = 1032, SF_JPEG_PIXELS_A_BYTE = 512 };

/* Reads a JPEG (grey, YCbCr, RGB) or PNG (any kind), told apart by their content. SF_ERR_IO: cannot be read;
 * SF_ERR_FORMAT: neither of the two, damaged or cut off; SF_ERR_UNSUPPORTED: a CMYK JPEG, a size beyond the
 * limits. On failure only `fault` is set. Free with sf_picture_free. */
sf_status sf_picture_load(sf_context *ctx, const char *path, sf_picture *picture);
void sf_picture_free(sf_context *ctx, sf_picture *picture);

/* The same for who will divide its sides by the least whole number that makes none longer than `side`: of a
 * JPEG, where that number is even, a part of 2, 4 or 8 is done while decoding, which takes less memory and
 * time. */
sf_status sf_picture_load_reduced(sf_context *ctx, const char *path, int side, sf_picture *picture);

/* The same for who will divide its sides by `factor`. */
sf_status sf_picture_load_divided(sf_context *ctx, const char *path, int factor, sf_picture *picture);

/* What the header says of what sf_picture_load_divided decodes, as a rule from the first part of the file:
 * all but rgb and weight. Fails as sf_picture_load does, but sees no damage beyond the header. */
sf_status sf_picture_look(sf_context *ctx, const char *path, int factor, sf_picture *picture);

/* Whether so many bytes of JPEG can hold a picture of that size: a block of 64 pixels takes a bit at least,
 * and a file of many passes over the picture is longer. What cannot is not worth its pixels' memory. */
int sf_jpeg_can_hold(const uint8_t *data, size_t size, int width, int height);

/* As sf_encode_jpeg (file.h), of 8-bit values, [height][width][3]. */
sf_status sf_encode_jpeg_8(sf_context *ctx, int width, int height, const uint8_t *rgb, int quality,
                           uint8_t **file, size_t *size);

/* The size alone, as a rule from the first part of the file. Fails as sf_picture_load does. */
sf_status sf_picture_size(sf_context *ctx, const char *path, int *width, int *height);

/* The size of what sf_picture_load_reduced decodes. */
sf_status sf_picture_size_reduced(sf_context *ctx, const char *path, int side, int *width, int *height);

#endif
