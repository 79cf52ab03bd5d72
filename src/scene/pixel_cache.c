/* pixel_cache.c - see pixel_cache.h.
 *
 * Buffers are filled by pread: a mapping's pages would count as the process's memory. The pages of the file
 * are the system's, which drops them when it needs the memory.
 */
#define _GNU_SOURCE /* O_TMPFILE, fallocate */
#include "pixel_cache.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>

enum {
    FEWEST_BUFFERS = 4,
    MOST_BUFFERS = 32,
    BUFFERS_PART = 16,       /* of the budget, a 16th is for buffers where that is more than the fewest */
    PAGE = 4096,             /* pictures begin at multiples of it */
    EXPECTED_PIECE = 1 << 17 /* the system reads no more ahead at one call */
};
#define NOTHING UINT64_MAX

typedef struct buffer {
    struct buffer *next;
    uint64_t at;    /* the picture that it holds, or is going to; NOTHING: none */
    size_t readers; /* that have it open */
    uint64_t used;  /* when it was opened last */
    uint8_t *bytes;
    size_t room;             /* of bytes */
    pthread_mutex_t filling; /* held while it is filled; guards status */
    sf_status status;
} buffer;

struct sf_pixel_cache {
    sf_context *ctx;
    atomic_int references;
    int fd;
    char *what, folder[512];
    size_t largest, most; /* bytes of a buffer; buffers that stay */
    atomic_int fault;     /* the errno of a write that failed; 0: none has */
    pthread_mutex_t lock; /* guards all below, and the buffers' but their bytes and status */
    uint64_t end, opened; /* of the file; count of openings */
    size_t count;
    buffer *buffers;
};

int sf_pixels_exceed(double bytes, double budget) { return budget > 0 && bytes > budget / 2; }

size_t sf_pixel_buffers(double budget, double largest) {
    double count = budget / BUFFERS_PART / (largest > 1 ? largest : 1);
    return count < FEWEST_BUFFERS ? FEWEST_BUFFERS : count > MOST_BUFFERS ? MOST_BUFFERS : (size_t)count;
}

/* The file. */

/* A file of a file system that is in memory itself would take the memory that it is to spare. */
static int is_in_memory(int fd) {
    const unsigned long tmpfs = 0x01021994, ramfs = 0x858458f6;
    struct statfs disk;
    if (fstatfs(fd, &disk)) return 0;
    unsigned long type = (unsigned long)disk.f_type & 0xffffffff;
    return type == tmpfs || type == ramfs;
}

static int open_nameless(const char *folder) {
    char name[1024];
    int fd = open(folder, O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
    if (fd >= 0) return fd;
    snprintf(name, sizeof name, "%s/splatfit-pixels-XXXXXX", folder);
    fd = mkostemp(name, O_CLOEXEC);
    if (fd >= 0) unlink(name);
    return fd;
}

/* The file in a folder, or -1 and why not. */
static int open_in(const char *folder, uint64_t bytes, const char **why) {
    int fd = open_nameless(folder);
    if (fd < 0) {
        *why = strerror(errno);
        return -1;
    }
    *why = is_in_memory(fd) ? "is in memory itself" : NULL;
    if (!*why && fallocate(fd, 0, 0, (off_t)bytes) && errno != EOPNOTSUPP && errno != ENOSYS)
        *why = strerror(errno);
    if (!*why) return fd;
    close(fd);
    return -1;
}

static sf_status choose_folder(sf_pixel_cache *c, uint64_t bytes) {
    const char *named = getenv("TMPDIR"), *folders[] = {named && *named ? named : NULL, "/var/tmp", "/tmp"};
    char said[400] = "";
    for (int i = 0; i < 3; i++) {
        const char *why;
        if (!folders[i] || (i && folders[0] && !strcmp(folders[i], folders[0]))) continue;
        c->fd = open_in(folders[i], bytes, &why);
        snprintf(c->folder, sizeof c->folder, "%s", folders[i]);
        if (c->fd >= 0) return SF_OK;
        size_t used = strlen(said);
        snprintf(said + used, sizeof said - used, "%s%s: %s", used ? "; " : "", folders[i], why);
    }
    return sf_fail(
        c->ctx, SF_ERR_IO,
        "%s: no folder takes the %.0f MB of pictures that are too many for the memory (TMPDIR names "
        "one; downscale makes them smaller): %s",
        c->what, (double)bytes / 1048576, said);
}

sf_status sf_pixel_cache_create(sf_context *ctx, const char *what, uint64_t bytes, size_t largest,
                                size_t buffers, sf_pixel_cache **out) {
    size_t length = strlen(what) + 1;
    sf_pixel_cache *c = *out = sf_calloc(ctx, 1, sizeof *c);
    if (!c) return SF_ERR_MEMORY;
    c->ctx = ctx, c->fd = -1, c->largest = largest, c->most = buffers;
    atomic_init(&c->references, 1);
    atomic_init(&c->fault, 0);
    pthread_mutex_init(&c->lock, NULL);
    c->what = sf_alloc(ctx, length, 1);
    if (c->what) memcpy(c->what, what, length);
    sf_status status = c->what ? choose_folder(c, bytes) : SF_ERR_MEMORY;
    if (!status) return SF_OK;
    sf_pixel_cache_release(c);
    *out = NULL;
    return status;
}

static void free_buffer(sf_pixel_cache *c, buffer *b) {
    pthread_mutex_destroy(&b->filling);
    sf_free(c->ctx, b->bytes);
    sf_free(c->ctx, b);
}

sf_pixel_cache *sf_pixel_cache_retain(sf_pixel_cache *c) {
    atomic_fetch_add(&c->references, 1);
    return c;
}

void sf_pixel_cache_release(sf_pixel_cache *c) {
    if (!c || atomic_fetch_sub(&c->references, 1) > 1) return;
    for (buffer *b = c->buffers, *next; b; b = next) {
        next = b->next;
        free_buffer(c, b);
    }
    if (c->fd >= 0) close(c->fd);
    pthread_mutex_destroy(&c->lock);
    sf_free(c->ctx, c->what);
    sf_free(c->ctx, c);
}

const char *sf_pixel_cache_folder(const sf_pixel_cache *c) { return c->folder; }

uint64_t sf_pixel_cache_missing(sf_pixel_cache *c) {
    pthread_mutex_lock(&c->lock);
    size_t missing = c->count < c->most ? c->most - c->count : 0;
    pthread_mutex_unlock(&c->lock);
    return (uint64_t)missing * c->largest;
}

/* Writing. */

sf_status sf_pixel_cache_fault(sf_pixel_cache *c) {
    int fault = atomic_load(&c->fault);
    if (!fault) return SF_OK;
    return sf_fail(c->ctx, SF_ERR_IO,
                   "%s: the pictures, too many for the memory, cannot be written to %s (TMPDIR names another "
                   "folder; downscale makes them smaller): %s",
                   c->what, c->folder, strerror(fault));
}

/* errno, or 0 */
static int write_whole(int fd, const uint8_t *bytes, size_t size, uint64_t at) {
    while (size) {
        ssize_t n = pwrite(fd, bytes, size, (off_t)at);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) return n ? errno : EIO;
        bytes += n, size -= (size_t)n, at += (uint64_t)n;
    }
    return 0;
}

sf_status sf_pixel_cache_add(sf_pixel_cache *c, const uint8_t *rgb, const uint8_t *weight, size_t pixels,
                             uint64_t *at) {
    size_t size = (weight ? 4 : 3) * pixels;
    pthread_mutex_lock(&c->lock);
    *at = c->end;
    c->end += (size + PAGE - 1) / PAGE * PAGE;
    if (size > c->largest) c->largest = size;
    pthread_mutex_unlock(&c->lock);
    int fault = atomic_load(&c->fault);
    if (!fault) fault = write_whole(c->fd, rgb, 3 * pixels, *at);
    if (!fault && weight) fault = write_whole(c->fd, weight, pixels, *at + 3 * pixels);
    if (fault) atomic_store(&c->fault, fault);
    return sf_pixel_cache_fault(c);
}

/* Reading. */

static sf_status read_whole(sf_pixel_cache *c, uint8_t *bytes, size_t size, uint64_t at) {
    while (size) {
        ssize_t n = pread(c->fd, bytes, size, (off_t)at);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0)
            return sf_fail(c->ctx, SF_ERR_IO, "%s: its pictures cannot be read again from %s: %s", c->what,
                           c->folder, n ? strerror(errno) : "the file ends too early");
        bytes += n, size -= (size_t)n, at += (uint64_t)n;
    }
    return SF_OK;
}

/* The buffer that holds a picture; NULL: none does. */
static buffer *holder(const sf_pixel_cache *c, uint64_t at) {
    buffer *b = c->buffers;
    while (b && b->at != at) b = b->next;
    return b;
}

static buffer *make_buffer(sf_pixel_cache *c) {
    buffer *b = sf_calloc(c->ctx, 1, sizeof *b);
    if (!b) return NULL;
    b->bytes = sf_alloc(c->ctx, c->largest, 1);
    if (!b->bytes) {
        sf_free(c->ctx, b);
        return NULL;
    }
    b->room = c->largest;
    b->at = NOTHING;
    pthread_mutex_init(&b->filling, NULL);
    b->next = c->buffers;
    c->buffers = b;
    c->count++;
    return b;
}

/* The buffer for a picture that none holds: of those that nobody reads the one that was used longest ago,
 * where there are as many as may be, or no memory for another. */
static buffer *free_one(sf_pixel_cache *c) {
    buffer *oldest = NULL, *made = NULL;
    for (buffer *b = c->buffers; b; b = b->next)
        if (!b->readers && b->room >= c->largest && (!oldest || b->used < oldest->used)) oldest = b;
    if (!oldest || c->count < c->most) made = make_buffer(c);
    return made ? made : oldest;
}

/* With the lock held. A buffer beyond those that may be is given back when nobody reads it any longer. */
static void leave(sf_pixel_cache *c, buffer *b) {
    if (--b->readers || c->count <= c->most) return;
    buffer **link = &c->buffers;
    while (*link != b) link = &(*link)->next;
    *link = b->next;
    c->count--;
    free_buffer(c, b);
}

sf_status sf_pixel_cache_open(sf_pixel_cache *c, uint64_t at, size_t size, const uint8_t **bytes) {
    pthread_mutex_lock(&c->lock);
    buffer *b = holder(c, at);
    int fills = !b;
    if (fills) b = free_one(c);
    if (!b) {
        pthread_mutex_unlock(&c->lock);
        return SF_ERR_MEMORY;
    }
    b->readers++;
    b->used = ++c->opened;
    b->at = at;
    if (fills) pthread_mutex_lock(&b->filling); /* free: nobody has it open */
    pthread_mutex_unlock(&c->lock);
    if (fills)
        b->status = read_whole(c, b->bytes, size, at);
    else
        pthread_mutex_lock(&b->filling); /* until it is filled */
    sf_status status = b->status;
    pthread_mutex_unlock(&b->filling);
    if (!status) {
        *bytes = b->bytes;
        return SF_OK;
    }
    pthread_mutex_lock(&c->lock);
    if (fills) b->at = NOTHING; /* who opens it next tries again */
    leave(c, b);
    pthread_mutex_unlock(&c->lock);
    return status;
}

void sf_pixel_cache_close(sf_pixel_cache *c, uint64_t at) {
    pthread_mutex_lock(&c->lock);
    buffer *b = holder(c, at);
    if (b) leave(c, b);
    pthread_mutex_unlock(&c->lock);
}

sf_status sf_pixel_cache_peek(sf_pixel_cache *c, uint64_t at, size_t offset, uint8_t *bytes, size_t size) {
    return read_whole(c, bytes, size, at + offset);
}

void sf_pixel_cache_expect(sf_pixel_cache *c, uint64_t at, size_t size) {
    pthread_mutex_lock(&c->lock);
    int held = holder(c, at) != NULL;
    pthread_mutex_unlock(&c->lock);
    for (size_t from = 0; !held && from < size; from += EXPECTED_PIECE)
        (void)posix_fadvise(c->fd, (off_t)(at + from), EXPECTED_PIECE, POSIX_FADV_WILLNEED);
}
