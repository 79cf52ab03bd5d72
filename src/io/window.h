/* window.h - a large file that is read from its start to its end, a part of it in memory at a time. */
#ifndef SF_IO_WINDOW_H
#define SF_IO_WINDOW_H

#include <stdint.h>

#include "../base/context.h"

enum { SF_WINDOW_BYTES = 1 << 20 };

/* Zeros, fd -1: closed. */
typedef struct sf_window {
    sf_context *ctx;
    int fd;
    uint64_t size; /* of the file */
    uint64_t at;   /* of bytes[0] in the file */
    size_t count;
    size_t room;    /* SF_WINDOW_BYTES; less of a small file */
    uint8_t *bytes; /* [room] */
} sf_window;

/* SF_ERR_IO: it is no regular file, or cannot be opened. Closed with sf_window_close, also after a failure.
 */
sf_status sf_window_open(sf_window *window, sf_context *ctx, const char *path);
void sf_window_close(sf_window *window);

/* What sf_window_at does where the bytes are not in memory. */
const uint8_t *sf_window_move(sf_window *window, uint64_t at, size_t n);

/* The n (at most SF_WINDOW_BYTES) bytes at `at`, until the next call. NULL: the file ends before them, or
 * cannot be read. */
static inline const uint8_t *sf_window_at(sf_window *window, uint64_t at, size_t n) {
    if (at >= window->at && at + n <= window->at + window->count) return window->bytes + (at - window->at);
    return sf_window_move(window, at, n);
}

#endif
