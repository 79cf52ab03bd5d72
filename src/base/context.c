/* context.c - allocation, errors and log lines of a context. */
#include "context.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { ALIGNMENT = 64 };

void *sf_allocator_take(const sf_allocator *allocator, size_t size) {
    return allocator->alloc ? allocator->alloc(allocator->user, size) : malloc(size);
}

void sf_allocator_give(const sf_allocator *allocator, void *block) {
    if (allocator->free)
        allocator->free(allocator->user, block);
    else
        free(block);
}

/* The caller's block is kept in the pointer before the aligned one. */
static void *take(sf_context *ctx, size_t count, size_t size, int clear) {
    const size_t extra = ALIGNMENT + sizeof(void *);
    if (size && count > (SIZE_MAX - extra) / size) {
        sf_fail(ctx, SF_ERR_MEMORY, "out of memory: %zu items of %zu bytes", count, size);
        return NULL;
    }
    /* calloc knows which pages are new, and leaves these untouched: they take no memory until they are used
     */
    int untouched = clear && !ctx->allocator.alloc;
    unsigned char *block = untouched ? calloc(1, count * size + extra)
                                     : sf_allocator_take(&ctx->allocator, count * size + extra);
    if (!block) {
        sf_fail(ctx, SF_ERR_MEMORY, "out of memory: %zu bytes", count * size);
        return NULL;
    }
    uintptr_t aligned = ((uintptr_t)block + extra) & ~(uintptr_t)(ALIGNMENT - 1);
    void **user = (void **)aligned;
    user[-1] = block;
    if (clear && !untouched) memset(user, 0, count * size);
    return user;
}

void *sf_alloc(sf_context *ctx, size_t count, size_t size) { return take(ctx, count, size, 0); }
void *sf_calloc(sf_context *ctx, size_t count, size_t size) { return take(ctx, count, size, 1); }

void sf_free(sf_context *ctx, void *block) {
    if (block) sf_allocator_give(&ctx->allocator, ((void **)block)[-1]);
}

sf_status sf_grow(sf_context *ctx, void *block_pointer, size_t *capacity, size_t used, size_t need,
                  size_t size) {
    if (need <= *capacity) return SF_OK;
    size_t more = *capacity + *capacity / 2;
    if (more < need) more = need;
    void *old, *grown = sf_alloc(ctx, more, size);
    if (!grown) return SF_ERR_MEMORY;
    memcpy(&old, block_pointer, sizeof old);
    if (used) memcpy(grown, old, used * size);
    sf_free(ctx, old);
    memcpy(block_pointer, &grown, sizeof grown);
    *capacity = more;
    return SF_OK;
}

sf_status sf_resize(sf_context *ctx, void *block_pointer, size_t used, size_t count, size_t size) {
    char *old, *block = sf_calloc(ctx, count, size);
    if (!block) return SF_ERR_MEMORY;
    memcpy(&old, block_pointer, sizeof old);
    if (used > count) used = count;
    if (used) memcpy(block, old, used * size);
    sf_free(ctx, old);
    memcpy(block_pointer, &block, sizeof block);
    return SF_OK;
}

sf_status sf_grow_together(sf_context *ctx, const sf_array *arrays, size_t n, size_t *capacity, size_t need) {
    size_t grown = *capacity;
    for (size_t i = 0; i < n; i++) {
        grown = *capacity;
        sf_status status = sf_grow(ctx, arrays[i].block_pointer, &grown, 0, need, arrays[i].size);
        if (status) return status;
    }
    *capacity = grown;
    return SF_OK;
}

enum { MESSAGE = sizeof((sf_context *)0)->error };

/* One line, whatever a file put into it. */
static void write_line(char line[MESSAGE], const char *format, va_list args) SF_PRINTF(2, 0);

static void write_line(char line[MESSAGE], const char *format, va_list args) {
    vsnprintf(line, MESSAGE, format, args);
    for (char *c = line; *c; c++)
        if ((unsigned char)*c < ' ' || *c == 127) *c = '?';
}

/* With the archive's name for that of the folder; under the lock. */
static void rename_unpacked(const sf_context *ctx, char line[MESSAGE]) {
    char *at = ctx->unpacked ? strstr(line, ctx->unpacked) : NULL;
    if (!at) return;
    char rest[MESSAGE];
    strcpy(rest, at + strlen(ctx->unpacked));
    snprintf(at, MESSAGE - (size_t)(at - line), "%s%s", ctx->archive, rest);
}

void sf_show_as(sf_context *ctx, const char *unpacked, const char *archive) {
    pthread_mutex_lock(&ctx->lock);
    ctx->unpacked = unpacked;
    ctx->archive = archive;
    pthread_mutex_unlock(&ctx->lock);
}

sf_status sf_fail(sf_context *ctx, sf_status status, const char *format, ...) {
    char message[MESSAGE];
    va_list args;
    va_start(args, format);
    write_line(message, format, args);
    va_end(args);
    pthread_mutex_lock(&ctx->lock);
    rename_unpacked(ctx, message);
    memcpy(ctx->error, message, sizeof message);
    pthread_mutex_unlock(&ctx->lock);
    return status;
}

void sf_log(sf_context *ctx, sf_log_level level, const char *format, ...) {
    if (!ctx->log) return;
    char message[MESSAGE];
    va_list args;
    va_start(args, format);
    write_line(message, format, args);
    va_end(args);
    pthread_mutex_lock(&ctx->lock);
    rename_unpacked(ctx, message);
    ctx->log(ctx->log_user, level, message);
    pthread_mutex_unlock(&ctx->lock);
}

const char *sf_last_error(const sf_context *ctx) { return ctx ? ctx->error : "no context"; }
