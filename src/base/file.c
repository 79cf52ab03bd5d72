/* file.c - whole files in, whole files out. */
#define _XOPEN_SOURCE 700 /* realpath */
#include "file.h"
#include "memory.h"

#include "temporary.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum {
    BUFFER_SIZE = 1 << 16,
    LINE_SIZE = 4096 /* longest text of one sf_writer_printf */
};

/* Reading. */

static sf_status check_readable(sf_context *ctx, const char *path, int fd, uint64_t limit, uint64_t *size) {
    struct stat st;
    if (fstat(fd, &st)) return sf_fail(ctx, SF_ERR_IO, "%s: cannot be read: %s", path, strerror(errno));
    if (S_ISDIR(st.st_mode)) return sf_fail(ctx, SF_ERR_IO, "%s: is a folder, not a file", path);
    if (!S_ISREG(st.st_mode)) return sf_fail(ctx, SF_ERR_IO, "%s: is not a regular file", path);
    *size = (uint64_t)st.st_size;
    if (*size > limit || *size >= SIZE_MAX)
        return sf_fail(ctx, SF_ERR_FORMAT, "%s: size: %llu bytes are more than the %llu allowed", path,
                       (unsigned long long)*size, (unsigned long long)limit);
    return SF_OK;
}

static sf_status read_all(sf_context *ctx, const char *path, int fd, uint8_t *data, size_t size) {
    for (size_t at = 0; at < size;) {
        ssize_t got = read(fd, data + at, size - at);
        if (got < 0 && errno == EINTR) continue;
        if (got < 0) return sf_fail(ctx, SF_ERR_IO, "%s: cannot be read: %s", path, strerror(errno));
        if (got == 0) return sf_fail(ctx, SF_ERR_IO, "%s: became shorter while it was read", path);
        at += (size_t)got;
    }
    return SF_OK;
}

static sf_status read_open_file(sf_context *ctx, const char *path, int fd, uint64_t limit, uint8_t **data,
                                size_t *size) {
    uint64_t bytes = 0;
    sf_status status = check_readable(ctx, path, fd, limit, &bytes);
    if (!status) status = sf_memory_check(ctx, path, "size", bytes); /* a file of nothing has any size */
    if (status) return status;
    uint8_t *block = sf_alloc(ctx, (size_t)bytes + 1, 1);
    if (!block) return SF_ERR_MEMORY;
    status = read_all(ctx, path, fd, block, (size_t)bytes);
    if (status) {
        sf_free(ctx, block);
        return status;
    }
    block[bytes] = 0;
    *data = block;
    *size = (size_t)bytes;
    return SF_OK;
}

sf_status sf_read_file(sf_context *ctx, const char *path, uint64_t limit, uint8_t **data, size_t *size) {
    *data = NULL;
    *size = 0;
    /* Not blocking: a pipe is refused, not waited for. */
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (fd < 0) return sf_fail(ctx, SF_ERR_IO, "%s: cannot be opened: %s", path, strerror(errno));
    sf_status status = read_open_file(ctx, path, fd, limit, data, size);
    close(fd);
    return status;
}

size_t sf_text_mark(const uint8_t *data, size_t size) {
    return size >= 3 && !memcmp(data, "\xEF\xBB\xBF", 3) ? 3 : 0;
}

sf_status sf_read_text(sf_context *ctx, const char *path, uint64_t limit, uint8_t **data, size_t *size) {
    sf_status status = sf_read_file(ctx, path, limit, data, size);
    if (status) return status;
    size_t mark = sf_text_mark(*data, *size);
    *size -= mark;
    memmove(*data, *data + mark, *size + 1);
    return SF_OK;
}

size_t sf_read_start(const char *path, uint8_t *data, size_t most) {
    struct stat st;
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (fd < 0) return 0;
    ssize_t got = !fstat(fd, &st) && S_ISREG(st.st_mode) ? read(fd, data, most) : 0;
    close(fd);
    return got > 0 ? (size_t)got : 0;
}

/* Writing. */

static sf_status writer_fail(sf_writer *w, const char *doing, int error) {
    if (w->status) return w->status;
    return w->status = sf_fail(w->ctx, SF_ERR_IO, "%s: cannot be %s: %s", w->path, doing, strerror(error));
}

static char *copy_text(sf_context *ctx, const char *text) {
    size_t size = strlen(text) + 1;
    char *copy = sf_alloc(ctx, size, 1);
    if (copy) memcpy(copy, text, size);
    return copy;
}

/* The lock goes last: the name is the writer's until then. */
static void release(sf_writer *w) {
    if (w->lock >= 0) close(w->lock);
    sf_free(w->ctx, w->path);
    sf_free(w->ctx, w->temporary);
    sf_free(w->ctx, w->buffer);
    w->path = w->temporary = NULL;
    w->buffer = NULL;
    w->fd = w->lock = -1;
}

/* A file that a symbolic link names is replaced where it stands, so that the link goes on naming it. */
static sf_status follow_link(sf_writer *w) {
    struct stat st;
    if (lstat(w->path, &st) || !S_ISLNK(st.st_mode)) return SF_OK;
    char *target = realpath(w->path, NULL);
    if (!target) return writer_fail(w, "followed", errno);
    sf_free(w->ctx, w->path);
    w->path = copy_text(w->ctx, target);
    free(target);
    return w->path ? SF_OK : (w->status = SF_ERR_MEMORY);
}

static sf_status open_direct(sf_writer *w) {
    w->direct = 1;
    w->fd = open(w->path, O_WRONLY | O_CLOEXEC | O_NOCTTY);
    return w->fd < 0 ? writer_fail(w, "opened", errno) : SF_OK;
}

static sf_status open_temporary(sf_writer *w, mode_t mode) {
    size_t size = strlen(w->path) + SF_TEMPORARY_EXTRA;
    w->temporary = sf_alloc(w->ctx, size, 1);
    if (!w->temporary) return w->status = SF_ERR_MEMORY;
    if (!w->unsynced) sf_temporary_clear(w->path);
    w->fd = sf_temporary_open(w->path, mode, w->temporary, size, &w->lock);
    return w->fd < 0 ? writer_fail(w, "created", errno) : SF_OK;
}

static sf_status open_target(sf_writer *w) {
    struct stat st;
    if (!stat(w->path, &st)) {
        if (S_ISDIR(st.st_mode)) return writer_fail(w, "written", EISDIR);
        if (!S_ISREG(st.st_mode)) return open_direct(w);
        sf_status status = follow_link(w);
        /* A private file stays private. */
        return status ? status : open_temporary(w, st.st_mode & 0777);
    }
    if (errno != ENOENT) return writer_fail(w, "written", errno);
    sf_status status = follow_link(w);
    return status ? status : open_temporary(w, 0666);
}

static sf_status open_writer(sf_writer *w, sf_context *ctx, const char *path, int unsynced) {
    *w = (sf_writer){.ctx = ctx, .fd = -1, .lock = -1, .unsynced = unsynced};
    w->path = copy_text(ctx, path);
    w->buffer = sf_alloc(ctx, BUFFER_SIZE, 1);
    if (!w->path || !w->buffer) {
        w->status = SF_ERR_MEMORY;
    } else if (!strcmp(path, "-")) {
        w->direct = 1;
        w->fd = STDOUT_FILENO;
    } else {
        open_target(w);
    }
    if (w->status) release(w);
    return w->status;
}

sf_status sf_writer_open(sf_writer *w, sf_context *ctx, const char *path) {
    return open_writer(w, ctx, path, 0);
}

static void write_out(sf_writer *w, const uint8_t *data, size_t size) {
    while (size && !w->status) {
        ssize_t done = write(w->fd, data, size);
        if (done < 0 && errno == EINTR) continue;
        if (done <= 0) {
            writer_fail(w, "written", done < 0 ? errno : ENOSPC);
            return;
        }
        data += done;
        size -= (size_t)done;
    }
}

static void flush(sf_writer *w) {
    write_out(w, w->buffer, w->used);
    w->used = 0;
}

void sf_writer_put(sf_writer *w, const void *data, size_t size) {
    if (w->status) return;
    if (size > BUFFER_SIZE - w->used) flush(w);
    if (size >= BUFFER_SIZE) {
        write_out(w, data, size);
    } else if (size) {
        memcpy(w->buffer + w->used, data, size);
        w->used += size;
    }
}

void sf_writer_printf(sf_writer *w, const char *format, ...) {
    char line[LINE_SIZE];
    va_list arguments;
    va_start(arguments, format);
    int size = vsnprintf(line, sizeof line, format, arguments);
    va_end(arguments);
    if (size >= 0 && (size_t)size < sizeof line)
        sf_writer_put(w, line, (size_t)size);
    else if (!w->status)
        writer_fail(w, "written", EOVERFLOW);
}

/* The new name itself must survive a loss of power; not every file system can promise it, so nothing fails
 * here: the file is in place. */
static void sync_folder(const char *path) {
    const char *slash = strrchr(path, '/');
    char folder[PATH_MAX] = ".";
    if (slash) snprintf(folder, sizeof folder, "%.*s", (int)(slash - path + 1), path);
    int fd = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd < 0) return;
    fsync(fd);
    close(fd);
}

static void close_file(sf_writer *w) {
    if (!strcmp(w->path, "-")) return; /* standard output stays open */
    if (close(w->fd)) writer_fail(w, "closed", errno);
    w->fd = -1;
}

static void put_in_place(sf_writer *w) {
    if (!w->status && rename(w->temporary, w->path)) writer_fail(w, "renamed into place", errno);
    if (w->status)
        unlink(w->temporary);
    else if (!w->unsynced)
        sync_folder(w->path);
}

sf_status sf_writer_commit(sf_writer *w) {
    if (w->fd < 0) return w->status;
    flush(w);
    if (!w->status && !w->direct && !w->unsynced && fsync(w->fd)) writer_fail(w, "synced", errno);
    close_file(w);
    if (!w->direct) put_in_place(w);
    release(w);
    return w->status;
}

void sf_writer_abandon(sf_writer *w) {
    if (w->fd < 0) return;
    close_file(w);
    if (!w->direct) unlink(w->temporary);
    release(w);
}

static sf_status write_file(sf_context *ctx, const char *path, const void *data, size_t size, int unsynced) {
    sf_writer w;
    sf_status status = open_writer(&w, ctx, path, unsynced);
    if (status) return status;
    sf_writer_put(&w, data, size);
    return sf_writer_commit(&w);
}

sf_status sf_write_file(sf_context *ctx, const char *path, const void *data, size_t size) {
    return write_file(ctx, path, data, size, 0);
}

sf_status sf_write_file_unsynced(sf_context *ctx, const char *path, const void *data, size_t size) {
    return write_file(ctx, path, data, size, 1);
}
