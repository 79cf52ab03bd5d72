/* window.c - see window.h. */
#include "window.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

sf_status sf_window_open(sf_window *w, sf_context *ctx, const char *path) {
    struct stat st;
    *w = (sf_window){.ctx = ctx, .fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK)};
    if (w->fd < 0) return sf_fail(ctx, SF_ERR_IO, "%s: cannot be opened: %s", path, strerror(errno));
    if (fstat(w->fd, &st) || !S_ISREG(st.st_mode))
        return sf_fail(ctx, SF_ERR_IO, "%s: is not a regular file", path);
    w->size = (uint64_t)st.st_size;
    w->room = w->size < SF_WINDOW_BYTES ? (size_t)w->size : SF_WINDOW_BYTES;
    w->bytes = sf_alloc(ctx, w->room + 1, 1);
    return w->bytes ? SF_OK : SF_ERR_MEMORY;
}

void sf_window_close(sf_window *w) {
    if (w->fd >= 0) close(w->fd);
    sf_free(w->ctx, w->bytes);
    w->fd = -1;
    w->bytes = NULL;
}

const uint8_t *sf_window_move(sf_window *w, uint64_t at, size_t n) {
    if (at > w->size || n > w->size - at || n > w->room) return NULL;
    w->at = at, w->count = 0;
    while (w->count < n) {
        ssize_t got = pread(w->fd, w->bytes + w->count, w->room - w->count, (off_t)(at + w->count));
        if (got < 0 && errno == EINTR) continue;
        if (got <= 0) return NULL;
        w->count += (size_t)got;
    }
    return w->bytes;
}
