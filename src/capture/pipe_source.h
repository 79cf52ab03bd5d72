/* pipe_source.h - the inside of a pipe: opened by pipe_open.c, read by pipe.c. */
#ifndef SF_CAPTURE_PIPE_SOURCE_H
#define SF_CAPTURE_PIPE_SOURCE_H

#include <pthread.h>

#include "jpeg_cut.h"
#include "source_ops.h"
#include "stream.h"

enum {
    SF_PIPE_QUEUE_LIVE = 4,                                        /* frames, as many as a driver's buffers */
    SF_PIPE_SLOTS = SF_SOURCE_MAX_LEASES + SF_PIPE_QUEUE_LIVE + 1, /* and one that is filled */
    SF_PIPE_LINE = 1024,                                           /* bytes of a header */
    SF_PIPE_FAULT = 192                                            /* bytes of a message */
};

typedef enum sf_pipe_kind { SF_PIPE_RAW, SF_PIPE_Y4M, SF_PIPE_JPEG } sf_pipe_kind;

/* Memory for one frame. */
typedef struct sf_pipe_slot {
    enum { SF_PIPE_FREE, SF_PIPE_FILLING, SF_PIPE_QUEUED, SF_PIPE_OUT } state;
    uint8_t *data;
    size_t capacity, bytes;
    int32_t width, height;
    uint64_t sequence;
    int64_t time_ns;
} sf_pipe_slot;

typedef struct sf_pipe_source {
    sf_context *ctx;
    char *name; /* without options: "pipe:-" */
    sf_pipe_kind kind;
    sf_pixel_format format;
    int32_t width, height; /* px, of the first frame */
    sf_yuv_matrix matrix;
    int full_range, live;
    double fps; /* 0: unknown */

    /* The reading thread's, once it runs. */
    sf_stream stream;
    sf_jpeg_cutter cutter;
    uint64_t sequence;
    char fault[SF_PIPE_FAULT]; /* why it ended */
    pthread_t thread;
    int running;
    int owned;   /* the stream's file is closed with the source */
    int stop[2]; /* a pipe: closing [1] stops the thread; -1: none */

    /* Shared, under `lock`. */
    pthread_mutex_t lock;
    pthread_cond_t changed;
    sf_pipe_slot slots[SF_PIPE_SLOTS];
    sf_pipe_slot *queue[SF_PIPE_QUEUE_LIVE]; /* oldest first */
    int queued, closing;
    uint64_t damaged, dropped; /* not yet added to the source's counts */
    sf_status ended;           /* why the thread has ended; SF_OK: it has not */
} sf_pipe_source;

extern const sf_source_ops sf_pipe_ops;

/* Starts the reading thread. SF_ERR_MEMORY. */
sf_status sf_pipe_start(sf_pipe_source *p);

/* Under the lock: waits until a frame is queued or none will be. */
void sf_pipe_wait(sf_pipe_source *p, int timeout_ms);

/* Fails as `ended` says, with why the thread has ended; SF_OK: it has not, SF_ERR_TIMEOUT. */
sf_status sf_pipe_no_frame(sf_pipe_source *p, sf_status ended, int timeout_ms);

/* Ends the thread and frees the source, opened or not. */
void sf_pipe_close(void *self);

#endif
