/* gzip.h - gzip streams: one being written to a file, and one in memory being read with a bound. */
#ifndef SF_IO_GZIP_H
#define SF_IO_GZIP_H

#include <zlib.h>

#include "../base/file.h"

/* A stream being compressed into an open file. */
typedef struct sf_gzip_out {
    z_stream z;
    sf_writer *writer;
    sf_status status;
    uint8_t buffer[1 << 15];
} sf_gzip_out;

sf_status sf_gzip_begin(sf_gzip_out *out, sf_writer *writer);
void sf_gzip_put(sf_gzip_out *out, const uint8_t *data, size_t size);
/* What follows is noise around few values rather than text: fewer repeats are looked for. */
void sf_gzip_expect_noise(sf_gzip_out *out);
/* Ends the stream, not the file. */
sf_status sf_gzip_end(sf_gzip_out *out);

/* A stream being read from memory. */
typedef struct sf_gzip_in {
    z_stream z;
    sf_context *ctx;
    const char *path;
    size_t left; /* bytes that zlib has not been shown yet */
    int ended;   /* the stream has, and its sum is right */
} sf_gzip_in;

sf_status sf_gzip_open(sf_gzip_in *in, sf_context *ctx, const char *path, const uint8_t *data, size_t size);
/* Unpacks up to `size` bytes; *got is less where the stream or the data ends. SF_ERR_FORMAT: it is damaged.
 */
sf_status sf_gzip_take(sf_gzip_in *in, uint8_t *to, size_t size, size_t *got);
/* Bytes behind the stream. */
size_t sf_gzip_rest(const sf_gzip_in *in);
void sf_gzip_close(sf_gzip_in *in);

#endif
