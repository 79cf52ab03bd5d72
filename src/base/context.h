/* context.h - the inside of sf_context, and what every module does with it: allocate, fail, log. */
#ifndef SF_BASE_CONTEXT_H
#define SF_BASE_CONTEXT_H

#include <pthread.h>
#include <stddef.h>
#include <stdint.h>
#ifndef __cplusplus
#include <stdatomic.h>
#endif

#include <splatfit/context.h>

struct sf_pool;
struct sf_kernels;
struct sf_libcamera;
struct sf_cluster;

struct sf_context {
    sf_allocator allocator;
    sf_log_fn log;
    void *log_user;
    pthread_mutex_t lock; /* guards error and log calls: tasks of the pool fail and log too */
    char error[1024];
    const char *unpacked, *archive; /* see sf_show_as; under `lock` */
    struct sf_pool *pool;
    struct sf_kernels *kernels;     /* const after creation; src/kernels */
    struct sf_libcamera *libcamera; /* src/capture/libcamera_manager.c's, under `lock`; NULL: not in use */
    struct sf_cluster *cluster;     /* src/cluster; NULL: this process fits alone */
#ifndef __cplusplus                 /* whose atomics have other names */
    atomic_int loads_cancelled;     /* sf_scene_cancel_loads */
    atomic_uint_least64_t versions; /* of models, handed out so far */
#endif
};

#if defined(__GNUC__)
#define SF_PRINTF(f, a) __attribute__((format(printf, f, a)))
#else
#define SF_PRINTF(f, a)
#endif

/* Records "message" for sf_last_error and returns `status`: return sf_fail(ctx, SF_ERR_FORMAT, "%s: ...",
 * path). */
sf_status sf_fail(sf_context *ctx, sf_status status, const char *format, ...) SF_PRINTF(3, 4);
void sf_log(sf_context *ctx, sf_log_level level, const char *format, ...) SF_PRINTF(3, 4);

/* From now on, errors and log lines say `archive` where they would say `unpacked`, the folder for a while
 * that the caller knows nothing of. Both are kept, not copied; NULL, NULL: as it is. */
void sf_show_as(sf_context *ctx, const char *unpacked, const char *archive);

/* 64-byte aligned memory through the context's allocator. sf_alloc leaves it as it comes, sf_calloc clears
 * it; `count * size` is checked for overflow. NULL on failure, with the message set. sf_free(NULL) is
 * allowed. */
void *sf_alloc(sf_context *ctx, size_t count, size_t size);
void *sf_calloc(sf_context *ctx, size_t count, size_t size);
void sf_free(sf_context *ctx, void *block);

/* Grows *block to at least `need` items, by half at least, keeping the first `used`; *capacity is updated.
 * SF_ERR_MEMORY leaves both as they were. */
sf_status sf_grow(sf_context *ctx, void *block_pointer, size_t *capacity, size_t used, size_t need,
                  size_t size);

/* Puts a block of `count` items in the place of *block: the first `used` of them as they were, the others 0.
 * SF_ERR_MEMORY leaves it. */
sf_status sf_resize(sf_context *ctx, void *block_pointer, size_t used, size_t count, size_t size);

/* Arrays of one capacity; what they held is lost. SF_ERR_MEMORY leaves *capacity as it was, each array with
 * at least that. */
typedef struct sf_array {
    void *block_pointer;
    size_t size; /* bytes of an item */
} sf_array;

sf_status sf_grow_together(sf_context *ctx, const sf_array *arrays, size_t n, size_t *capacity, size_t need);

/* The allocator alone, before a context exists. */
void *sf_allocator_take(const sf_allocator *allocator, size_t size);
void sf_allocator_give(const sf_allocator *allocator, void *block);

#endif
