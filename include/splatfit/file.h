/* file.h - the library's way to write files, for programs that use it: whole or not at all. */
#ifndef SPLATFIT_FILE_H
#define SPLATFIT_FILE_H

#include "context.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Writes `size` bytes to `path` under a temporary name beside it, syncs, renames. A device, a pipe and "-"
 * (standard output) are written directly. On failure (SF_ERR_IO) what stood at `path` still stands and no
 * temporary file is left. */
SF_API sf_status sf_write_file(sf_context *context, const char *path, const void *data, size_t size);

/* Writes a picture ([height][width][3], sRGB values, clamped to 0..1, rounded to 8 bits) as PNG, the same
 * way. */
SF_API sf_status sf_write_png(sf_context *context, const char *path, int width, int height, const float *rgb);

#ifdef __cplusplus
}
#endif
#endif
