/* file.h - the library's way to write files, for programs that use it: whole or not at all. */
#ifndef SPLATFIT_FILE_H
#define SPLATFIT_FILE_H

#include <stddef.h>
#include <stdint.h>

#include "context.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Writes `size` bytes to `path` under a temporary name beside it, syncs, renames. A device, a pipe and "-"
 * (standard output) are written directly. On failure (SF_ERR_IO) what stood at `path` still stands and no
 * temporary file is left; what a writer that was killed left there is removed. */
SF_API sf_status sf_write_file(sf_context *context, const char *path, const void *data, size_t size);

/* The same, but when the bytes reach the disk is left to the operating system: for the many files of a
 * recording, of which a loss of power may take the last. What killed writers left stays. */
SF_API sf_status sf_write_file_unsynced(sf_context *context, const char *path, const void *data, size_t size);

/* A picture ([height][width][3], sRGB values, clamped to 0..1, rounded to 8 bits) as the bytes of a file,
 * JPEG (quality 1..100; chroma is not subsampled) or PNG. sf_encoded_free frees them and sets *file to NULL.
 * SF_ERR_ARGUMENT: a size that is not a picture's, a quality out of range; SF_ERR_UNSUPPORTED: a side too
 * long for a JPEG (more than 65500). */
SF_API sf_status sf_encode_jpeg(sf_context *context, int width, int height, const float *rgb, int quality,
                                uint8_t **file, size_t *size);
SF_API sf_status sf_encode_png(sf_context *context, int width, int height, const float *rgb, uint8_t **file,
                               size_t *size);
SF_API void sf_encoded_free(sf_context *context, uint8_t **file);

/* Writes a picture ([height][width][3], sRGB values, clamped to 0..1, rounded to 8 bits) as PNG, the same
 * way. */
SF_API sf_status sf_write_png(sf_context *context, const char *path, int width, int height, const float *rgb);

/* Writes values ([height][width]) as a grey PNG of 16 bits, the same way. */
SF_API sf_status sf_write_png_grey16(sf_context *context, const char *path, int width, int height,
                                     const uint16_t *values);

#ifdef __cplusplus
}
#endif
#endif
