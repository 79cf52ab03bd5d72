/* libcamera_manager.c - see libcamera_manager.h. */
#include "libcamera_manager.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

/* A context's, under its lock. */
struct sf_libcamera {
    const sf_libcamera_maker *maker;
    void *manager;
    int lock; /* of the process */
    int users;
};

/* The process's lock; -1: another context has it. */
static int lock_process(void) {
    int fd = open("/proc/self/stat", O_RDONLY | O_CLOEXEC);
    if (fd >= 0 && flock(fd, LOCK_EX | LOCK_NB) != 0) {
        close(fd);
        fd = -1;
    }
    return fd;
}

static const char *make(sf_context *ctx, const sf_libcamera_maker *maker) {
    int lock = lock_process();
    if (lock < 0) return "libcamera is in use by another context of this program";
    /* sf_alloc would record an error, under the lock that is held. */
    struct sf_libcamera *made = sf_allocator_take(&ctx->allocator, sizeof *made);
    void *manager;
    const char *trouble = made ? maker->start(&manager) : "out of memory";
    if (trouble) {
        if (made) sf_allocator_give(&ctx->allocator, made);
        close(lock);
        return trouble;
    }
    *made = (struct sf_libcamera){maker, manager, lock, 0};
    ctx->libcamera = made;
    return NULL;
}

const char *sf_libcamera_share(sf_context *ctx, const sf_libcamera_maker *maker, void **manager) {
    const char *trouble = NULL;
    pthread_mutex_lock(&ctx->lock);
    if (!ctx->libcamera) trouble = make(ctx, maker);
    if (!trouble) {
        ctx->libcamera->users++;
        *manager = ctx->libcamera->manager;
    }
    pthread_mutex_unlock(&ctx->lock);
    return trouble;
}

void sf_libcamera_unshare(sf_context *ctx) {
    pthread_mutex_lock(&ctx->lock);
    struct sf_libcamera *made = ctx->libcamera;
    if (--made->users == 0) {
        ctx->libcamera = NULL;
        made->maker->stop(made->manager);
        close(made->lock);
        sf_allocator_give(&ctx->allocator, made);
    }
    pthread_mutex_unlock(&ctx->lock);
}
