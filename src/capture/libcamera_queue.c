/* libcamera_queue.c - see libcamera_queue.h. */
#include "libcamera_queue.h"

#include <string.h>

#include "../base/clock.h"
#include "../base/wait.h"

enum { BATCH_MS = 5 };

sf_status sf_libcamera_queue_open(sf_context *ctx, size_t buffers, sf_libcamera_queue *queue) {
    memset(queue, 0, sizeof *queue);
    queue->filled = sf_calloc(ctx, buffers, sizeof *queue->filled);
    if (!queue->filled) return SF_ERR_MEMORY;
    queue->ctx = ctx;
    queue->buffers = buffers;
    pthread_mutex_init(&queue->lock, NULL);
    sf_condition_init(&queue->changed);
    return SF_OK;
}

void sf_libcamera_queue_close(sf_libcamera_queue *queue) {
    if (!queue->ctx) return;
    pthread_cond_destroy(&queue->changed);
    pthread_mutex_destroy(&queue->lock);
    sf_free(queue->ctx, queue->filled);
    queue->ctx = NULL;
}

/* 1. libcamera's thread */

void sf_libcamera_queue_put(sf_libcamera_queue *queue, const sf_libcamera_filled *filled) {
    pthread_mutex_lock(&queue->lock);
    queue->filled[queue->count++] = *filled;
    pthread_cond_signal(&queue->changed);
    pthread_mutex_unlock(&queue->lock);
}

void sf_libcamera_queue_cancel(sf_libcamera_queue *queue) {
    pthread_mutex_lock(&queue->lock);
    queue->cancelled++;
    pthread_cond_signal(&queue->changed);
    pthread_mutex_unlock(&queue->lock);
}

void sf_libcamera_queue_lose(sf_libcamera_queue *queue) {
    pthread_mutex_lock(&queue->lock);
    queue->gone = 1;
    pthread_cond_signal(&queue->changed);
    pthread_mutex_unlock(&queue->lock);
}

/* 2. The source's thread; the next three under the lock. */

static int is_broken(const sf_libcamera_queue *queue) {
    return queue->gone || queue->cancelled == queue->buffers;
}

static int32_t ahead(const sf_libcamera_queue *queue, size_t i) {
    return sf_frame_order_ahead(&queue->order, queue->filled[i].driver_sequence);
}

/* The frame with the oldest picture, of at least one. */
static size_t earliest(const sf_libcamera_queue *queue) {
    size_t first = 0;
    for (size_t i = 1; i < queue->count; i++)
        if (ahead(queue, i) < ahead(queue, first)) first = i;
    return first;
}

static sf_status take(sf_libcamera_queue *queue, int64_t deadline_ns, sf_libcamera_filled *filled) {
    while (!queue->count && !is_broken(queue))
        if (!sf_condition_wait(&queue->changed, &queue->lock, deadline_ns)) break;
    if (!queue->count) return is_broken(queue) ? SF_ERR_IO : SF_ERR_TIMEOUT;
    int64_t batch_ns = sf_clock_ns() + BATCH_MS * 1000000;
    while (ahead(queue, earliest(queue)) > 1)
        if (!sf_condition_wait(&queue->changed, &queue->lock, batch_ns)) break;
    size_t first = earliest(queue);
    *filled = queue->filled[first];
    queue->count--;
    memmove(&queue->filled[first], &queue->filled[first + 1], (queue->count - first) * sizeof *filled);
    return SF_OK;
}

sf_status sf_libcamera_queue_take(sf_libcamera_queue *queue, int64_t deadline_ns, sf_libcamera_filled *filled,
                                  uint64_t *dropped) {
    pthread_mutex_lock(&queue->lock);
    sf_status status = take(queue, deadline_ns, filled);
    pthread_mutex_unlock(&queue->lock);
    if (status != SF_OK) return status;
    filled->late = !sf_frame_order_take(&queue->order, filled->driver_sequence, queue->buffers, dropped);
    filled->sequence = queue->order.sequence;
    return SF_OK;
}

int sf_libcamera_queue_has(sf_libcamera_queue *queue) {
    pthread_mutex_lock(&queue->lock);
    int has = queue->count > 0;
    pthread_mutex_unlock(&queue->lock);
    return has;
}
