/* libcamera_queue.h - frames that a camera filled and nobody took yet.
 *
 * libcamera's thread puts them in, the source's takes them out. libcamera hands requests over in the order in
 * which they were queued, a whole batch at once if the first came last. That is not the order of the pictures
 * where a driver threw a bad one away and put its buffer behind the others: where a frame seems to lack, the
 * rest of the batch is awaited.
 */
#ifndef SF_CAPTURE_LIBCAMERA_QUEUE_H
#define SF_CAPTURE_LIBCAMERA_QUEUE_H

#include <pthread.h>

#include "../base/context.h"
#include "frame_order.h"

/* A frame, as libcamera tells of it. */
typedef struct sf_libcamera_filled {
    size_t buffer;            /* which of the camera's */
    uint32_t driver_sequence; /* its number */
    int damaged;              /* it is marked so, or nothing is told of its planes */
    size_t first_bytes;       /* used in the first plane of memory */
    size_t bytes;             /* and in all */
    int64_t time_ns;          /* monotonic clock */
    double exposure_us, gain; /* -1: not told */
    uint64_t sequence;        /* as the source tells it: sf_libcamera_queue_take sets it */
    int late;                 /* the last one taken is younger: so is this */
} sf_libcamera_filled;

typedef struct sf_libcamera_queue {
    sf_context *ctx;      /* NULL: there is no queue */
    size_t buffers;       /* of the camera */
    sf_frame_order order; /* the taker's */
    pthread_mutex_t lock; /* guards the following, which libcamera's thread changes */
    pthread_cond_t changed;
    sf_libcamera_filled *filled; /* in the order in which they came; each buffer is in it at most once */
    size_t count, cancelled;
    int gone;
} sf_libcamera_queue;

/* An empty queue of a camera that has so many buffers. SF_ERR_MEMORY. */
sf_status sf_libcamera_queue_open(sf_context *ctx, size_t buffers, sf_libcamera_queue *queue);
void sf_libcamera_queue_close(sf_libcamera_queue *queue);

/* Of libcamera's thread: a frame came; a buffer came back without one; the camera is gone. */
void sf_libcamera_queue_put(sf_libcamera_queue *queue, const sf_libcamera_filled *filled);
void sf_libcamera_queue_cancel(sf_libcamera_queue *queue);
void sf_libcamera_queue_lose(sf_libcamera_queue *queue);

/* Takes the frame with the oldest picture, waiting until the deadline on the monotonic clock, and adds what
 * was lost before it to *dropped. SF_ERR_TIMEOUT; SF_ERR_IO: none comes any more. Both without a message. */
sf_status sf_libcamera_queue_take(sf_libcamera_queue *queue, int64_t deadline_ns, sf_libcamera_filled *filled,
                                  uint64_t *dropped);
/* Whether a frame is there now. */
int sf_libcamera_queue_has(sf_libcamera_queue *queue);

#endif
