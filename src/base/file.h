/* file.h - whole files in, whole files out. */
#ifndef SF_BASE_FILE_H
#define SF_BASE_FILE_H

#include <stdint.h>

#include "context.h"

#include <splatfit/file.h>

/* Reads a regular file of at most `limit` bytes; *data (sf_free it) is followed by a 0 byte that *size does
 * not count. SF_ERR_IO: cannot be opened or read, is a folder; SF_ERR_FORMAT: larger than limit;
 * SF_ERR_MEMORY: larger than what is left. */
sf_status sf_read_file(sf_context *ctx, const char *path, uint64_t limit, uint8_t **data, size_t *size);

/* The same of a file of text: a byte order mark (UTF-8's EF BB BF) at its start is left out. */
sf_status sf_read_text(sf_context *ctx, const char *path, uint64_t limit, uint8_t **data, size_t *size);
/* The length of a byte order mark at the start of the bytes: 3 or 0. */
size_t sf_text_mark(const uint8_t *data, size_t size);

/* The first bytes of a regular file, at most `most`; returns how many, 0 also where it cannot be read. */
size_t sf_read_start(const char *path, uint8_t *data, size_t most);

/* A file being written: to a temporary name, buffered; nothing is at `path` before sf_writer_commit. */
typedef struct sf_writer {
    sf_context *ctx;
    int fd;
    int lock;     /* a lock that is held while the writer lives, -1: not locked (temporary.h) */
    int unsynced; /* the commit does not wait for the disk */
    int direct;   /* a device, a pipe or standard output: written as it is */
    char *path, *temporary;
    uint8_t *buffer;
    size_t used;
    sf_status status; /* the first failure; later calls do nothing */
} sf_writer;

sf_status sf_writer_open(sf_writer *w, sf_context *ctx, const char *path);
void sf_writer_put(sf_writer *w, const void *data, size_t size);
void sf_writer_printf(sf_writer *w, const char *format, ...) SF_PRINTF(2, 3);
/* Flushes, syncs and renames; or, after any failure (also of an earlier put), removes the temporary file.
 * Ends the writer in both cases and returns its status. */
sf_status sf_writer_commit(sf_writer *w);
/* Ends the writer and removes the temporary file. */
void sf_writer_abandon(sf_writer *w);

#endif
