/* stream.h - bytes from a pipe or file, with bounded waits. */
#ifndef SF_CAPTURE_STREAM_H
#define SF_CAPTURE_STREAM_H

#include <stddef.h>
#include <stdint.h>

#include <splatfit/status.h>

enum { SF_STREAM_BUFFER = 1 << 16 }; /* what a pipe of Linux holds */

/* Longer than any wait. */
#define SF_STREAM_FOREVER INT64_MAX

typedef struct sf_stream {
    int fd;
    int stop;        /* readable: waits end with SF_ERR_CANCELLED; -1: none */
    int error;       /* errno, after SF_ERR_IO */
    uint64_t offset; /* of the next byte, from the first one read */
    size_t at, end;  /* of `buffer`: what was read and not taken */
    uint8_t *buffer; /* SF_STREAM_BUFFER bytes, the caller's */
} sf_stream;

/* Looks at the bytes that come next, at least one; waits for them until the deadline on the monotonic clock.
 * SF_ERR_TIMEOUT, SF_ERR_END, SF_ERR_IO, SF_ERR_CANCELLED, all without a message. */
sf_status sf_stream_peek(sf_stream *stream, int64_t deadline_ns, const uint8_t **data, size_t *size);

/* Takes `size` of the bytes that peek showed. */
void sf_stream_take(sf_stream *stream, size_t size);

/* Reads `size` bytes; *got is less only after a failure, those that sf_stream_peek has. */
sf_status sf_stream_read(sf_stream *stream, int64_t deadline_ns, uint8_t *data, size_t size, size_t *got);

/* Reads a line of less than `room` bytes, its newline replaced by 0. SF_ERR_FORMAT: it is longer, or holds a
 * 0; what is in `line` then, and after SF_ERR_END, is its beginning. */
sf_status sf_stream_line(sf_stream *stream, int64_t deadline_ns, char *line, size_t room);

#endif
