/* pipe.c - frames from a pipe or file: YUV4MPEG2, JPEGs one after another, or plain pixels.
 *
 * One thread reads frames into slots and hands them over in a short queue. Where the queue is full it waits,
 * and with it whoever writes into the pipe, so that nothing is lost; from a live pipe it reads on, and the
 * oldest frame in the queue is lost and counted.
 */
#include "pipe.h"

#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "../base/clock.h"
#include "../base/wait.h"
#include "format.h"
#include "pace.h"
#include "pipe_source.h"

enum {
    QUEUE = 1,               /* one is read while another is worked on */
    FIRST_BYTES = 1 << 16,   /* of a frame, that are taken on its header's word */
    MAX_JPEG_BYTES = 1 << 26 /* of one JPEG, and between two */
};

/* 1. Reading frames: on the thread */

static sf_status end_with(sf_pipe_source *p, sf_status status, uint64_t offset, const char *what) {
    snprintf(p->fault, sizeof p->fault, "offset %llu: %s", (unsigned long long)offset, what);
    return status;
}

static void count_damaged(sf_pipe_source *p) {
    p->sequence++;
    pthread_mutex_lock(&p->lock);
    p->damaged++;
    pthread_mutex_unlock(&p->lock);
}

/* What a stream says when it is over, in words; a frame that it cut short was damaged. */
static sf_status stream_over(sf_pipe_source *p, sf_status status, int cut_short) {
    if (status == SF_ERR_END) {
        if (cut_short) count_damaged(p);
        snprintf(p->fault, sizeof p->fault, "no more frames after %llu", (unsigned long long)p->sequence);
    } else if (status == SF_ERR_IO) {
        snprintf(p->fault, sizeof p->fault, "cannot be read: %s", strerror(p->stream.error));
    }
    return status;
}

static sf_status hold(sf_pipe_source *p, sf_pipe_slot *s, size_t bytes) {
    sf_status status = sf_grow(p->ctx, &s->data, &s->capacity, s->bytes, bytes, 1);
    if (status != SF_OK) snprintf(p->fault, sizeof p->fault, "out of memory for a frame of %zu bytes", bytes);
    return status;
}

static sf_status read_pixels(sf_pipe_source *p, sf_pipe_slot *s, int begun) {
    size_t bytes = sf_pixel_bytes(p->format, p->width, p->height), got;
    s->bytes = 0;
    /* A header may promise more than comes: memory is taken as the frame grows. */
    while (s->bytes < bytes) {
        size_t room = s->bytes ? 2 * s->bytes : FIRST_BYTES;
        if (room < s->capacity) room = s->capacity;
        if (room > bytes) room = bytes;
        sf_status status = hold(p, s, room);
        if (status != SF_OK) return status;
        status = sf_stream_read(&p->stream, SF_STREAM_FOREVER, s->data + s->bytes, room - s->bytes, &got);
        s->bytes += got;
        if (status != SF_OK) return stream_over(p, status, begun || s->bytes);
    }
    s->width = p->width;
    s->height = p->height;
    return SF_OK;
}

static sf_status read_y4m(sf_pipe_source *p, sf_pipe_slot *s) {
    char line[SF_PIPE_LINE], what[64];
    uint64_t offset = p->stream.offset;
    sf_status status = sf_stream_line(&p->stream, SF_STREAM_FOREVER, line, sizeof line);
    if (status != SF_OK && status != SF_ERR_FORMAT) return stream_over(p, status, line[0]);
    if (status == SF_OK && !strncmp(line, "FRAME", 5) && (!line[5] || line[5] == ' '))
        return read_pixels(p, s, 1);
    for (char *c = line; *c; c++)
        if (*c < ' ' || *c > '~') *c = '?';
    snprintf(what, sizeof what, "\"%.20s\" is no FRAME header", line);
    return end_with(p, SF_ERR_FORMAT, offset, what);
}

static sf_status append(sf_pipe_source *p, sf_pipe_slot *s, const uint8_t *data, size_t size) {
    sf_status status = hold(p, s, s->bytes + size);
    if (status != SF_OK) return status;
    memcpy(s->data + s->bytes, data, size);
    s->bytes += size;
    return SF_OK;
}

/* Takes what came with an event. */
static sf_status follow_jpeg(sf_pipe_source *p, sf_pipe_slot *s, sf_jpeg_event event, int inside,
                             const uint8_t *data, size_t size) {
    static const uint8_t first[2] = {0xff, 0xd8};
    if (event == SF_JPEG_BEGIN) {
        s->bytes = 0;
        return append(p, s, first, sizeof first);
    }
    if (event == SF_JPEG_BROKEN) {
        count_damaged(p);
        s->bytes = 0;
        return SF_OK;
    }
    return inside ? append(p, s, data, size) : SF_OK;
}

static sf_status read_jpeg(sf_pipe_source *p, sf_pipe_slot *s) {
    uint64_t since = p->stream.offset; /* of the JPEG, or of what is none */
    s->bytes = 0;
    for (;;) {
        const uint8_t *data;
        size_t size, taken;
        sf_status status = sf_stream_peek(&p->stream, SF_STREAM_FOREVER, &data, &size);
        if (status != SF_OK) return stream_over(p, status, sf_jpeg_inside(&p->cutter));
        int inside = sf_jpeg_inside(&p->cutter);
        sf_jpeg_event event = sf_jpeg_cut(&p->cutter, data, size, &taken);
        status = follow_jpeg(p, s, event, inside, data, taken);
        sf_stream_take(&p->stream, taken);
        if (status != SF_OK) return status;
        if (event == SF_JPEG_WHOLE) break;
        if (event != SF_JPEG_MORE) since = p->stream.offset;
        if (p->stream.offset - since > MAX_JPEG_BYTES)
            return end_with(p, SF_ERR_FORMAT, since, "no JPEG ends within 64 MiB");
    }
    s->width = p->cutter.width;
    s->height = p->cutter.height;
    return SF_OK;
}

static sf_status read_frame(sf_pipe_source *p, sf_pipe_slot *s) {
    sf_status status = p->kind == SF_PIPE_Y4M    ? read_y4m(p, s)
                       : p->kind == SF_PIPE_JPEG ? read_jpeg(p, s)
                                                 : read_pixels(p, s, 0);
    if (status != SF_OK) return status;
    s->sequence = p->sequence++;
    s->time_ns = p->live ? sf_clock_ns() : sf_pace_after(p->fps > 0 ? p->fps : 30, s->sequence);
    return SF_OK;
}

/* 2. The queue */

/* Waits for room; NULL: the source is being closed. */
static sf_pipe_slot *slot_to_fill(sf_pipe_source *p) {
    pthread_mutex_lock(&p->lock);
    while (!p->closing && !p->live && p->queued == QUEUE) pthread_cond_wait(&p->changed, &p->lock);
    sf_pipe_slot *s = p->slots;
    while (s->state != SF_PIPE_FREE) s++; /* there are enough of them */
    if (p->closing)
        s = NULL;
    else
        s->state = SF_PIPE_FILLING;
    pthread_mutex_unlock(&p->lock);
    return s;
}

/* Takes the oldest out of the queue. */
static sf_pipe_slot *take_oldest(sf_pipe_source *p) {
    sf_pipe_slot *s = p->queue[0];
    memmove(p->queue, p->queue + 1, (size_t)--p->queued * sizeof *p->queue);
    return s;
}

static void hand_over(sf_pipe_source *p, sf_pipe_slot *s, sf_status status) {
    pthread_mutex_lock(&p->lock);
    if (status == SF_OK) {
        if (p->queued == SF_PIPE_QUEUE_LIVE) {
            take_oldest(p)->state = SF_PIPE_FREE;
            p->dropped++;
        }
        s->state = SF_PIPE_QUEUED;
        p->queue[p->queued++] = s;
    } else {
        s->state = SF_PIPE_FREE;
        p->ended = status;
    }
    pthread_cond_broadcast(&p->changed);
    pthread_mutex_unlock(&p->lock);
}

static void *read_all(void *arg) {
    sf_pipe_source *p = arg;
    sf_status status = SF_OK;
    while (status == SF_OK) {
        sf_pipe_slot *s = slot_to_fill(p);
        if (!s) break;
        status = read_frame(p, s);
        hand_over(p, s, status);
    }
    return NULL;
}

/* Signals are for the threads of the program. */
sf_status sf_pipe_start(sf_pipe_source *p) {
    sigset_t all, old;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &old);
    int error = pthread_create(&p->thread, NULL, read_all, p);
    pthread_sigmask(SIG_SETMASK, &old, NULL);
    if (error)
        return sf_fail(p->ctx, SF_ERR_MEMORY, "%s: no thread to read it: %s", p->name, strerror(error));
    p->running = 1;
    return SF_OK;
}

void sf_pipe_wait(sf_pipe_source *p, int timeout_ms) {
    int64_t deadline = sf_clock_ns() + (int64_t)timeout_ms * 1000000;
    while (!p->queued && !p->ended)
        if (!sf_condition_wait(&p->changed, &p->lock, deadline)) return;
}

static void move_counts(sf_pipe_source *p, sf_source_counts *counts) {
    counts->damaged += p->damaged;
    counts->dropped += p->dropped;
    p->damaged = p->dropped = 0;
}

sf_status sf_pipe_no_frame(sf_pipe_source *p, sf_status ended, int timeout_ms) {
    if (!ended) return sf_fail(p->ctx, SF_ERR_TIMEOUT, "%s: no frame within %d ms", p->name, timeout_ms);
    return sf_fail(p->ctx, ended, "%s: %s", p->name, p->fault);
}

static void fill_frame(const sf_pipe_source *p, sf_pipe_slot *s, sf_frame *frame) {
    frame->format = p->format;
    frame->width = s->width;
    frame->height = s->height;
    frame->matrix = p->matrix;
    frame->full_range = p->full_range;
    frame->sequence = s->sequence;
    frame->time_ns = s->time_ns;
    frame->lease = s;
    sf_frame_set_planes(frame, s->data);
    if (p->format != SF_PIXEL_MJPEG) return;
    frame->plane[0] = s->data;
    frame->bytes = s->bytes;
}

static sf_status pipe_next(void *self, int timeout_ms, int newest, sf_frame *frame,
                           sf_source_counts *counts) {
    sf_pipe_source *p = self;
    sf_pipe_slot *s = NULL;
    pthread_mutex_lock(&p->lock);
    sf_pipe_wait(p, timeout_ms);
    move_counts(p, counts);
    while (newest && p->live && p->queued > 1) {
        take_oldest(p)->state = SF_PIPE_FREE;
        counts->skipped++;
    }
    if (p->queued) {
        s = take_oldest(p);
        s->state = SF_PIPE_OUT;
    }
    sf_status ended = p->ended;
    pthread_cond_broadcast(&p->changed);
    pthread_mutex_unlock(&p->lock);
    if (!s) return sf_pipe_no_frame(p, ended, timeout_ms);
    fill_frame(p, s, frame);
    return SF_OK;
}

static void pipe_release(void *self, sf_frame *frame) {
    sf_pipe_source *p = self;
    pthread_mutex_lock(&p->lock);
    ((sf_pipe_slot *)frame->lease)->state = SF_PIPE_FREE;
    pthread_mutex_unlock(&p->lock);
}

static void pipe_describe(const void *self, sf_source_info *info) {
    const sf_pipe_source *p = self;
    static const char *const kinds[] = {"pixels", "YUV4MPEG2", "JPEGs"};
    info->width = p->width;
    info->height = p->height;
    info->format = p->format;
    info->frames_per_second = p->fps;
    info->live = p->live;
    snprintf(info->name, sizeof info->name, "%s in %.80s, %dx%d", kinds[p->kind], p->name, (int)p->width,
             (int)p->height);
}

static void stop_thread(sf_pipe_source *p) {
    if (!p->running) return;
    pthread_mutex_lock(&p->lock);
    p->closing = 1;
    pthread_cond_broadcast(&p->changed);
    pthread_mutex_unlock(&p->lock);
    close(p->stop[1]); /* a wait for bytes ends */
    p->stop[1] = -1;
    pthread_join(p->thread, NULL);
}

static void close_fd(int fd) {
    if (fd >= 0) close(fd);
}

void sf_pipe_close(void *self) {
    sf_pipe_source *p = self;
    stop_thread(p);
    if (p->owned) close_fd(p->stream.fd);
    close_fd(p->stop[0]);
    close_fd(p->stop[1]);
    for (int i = 0; i < SF_PIPE_SLOTS; i++) sf_free(p->ctx, p->slots[i].data);
    pthread_cond_destroy(&p->changed);
    pthread_mutex_destroy(&p->lock);
    sf_free(p->ctx, p->stream.buffer);
    sf_free(p->ctx, p->name);
    sf_free(p->ctx, p);
}

const sf_source_ops sf_pipe_ops = {sf_pipe_close, pipe_describe, pipe_next, pipe_release, NULL};
