/* pipe.c - frames from a pipe or file: YUV4MPEG2, JPEGs one after another, or plain pixels.
 *
 * One thread reads frames into slots and hands them over in a short queue. Where the queue is full it waits,
 * and with it whoever writes into the pipe, so that nothing is lost; from a live pipe it reads on, and the
 * oldest frame in the queue is lost and counted.
 */
#include "pipe.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "../base/clock.h"
#include "../base/query.h"
#include "format.h"
#include "jpeg_cut.h"
#include "pace.h"
#include "stream.h"
#include "y4m.h"

enum {
    QUEUE_LIVE = 4,                                /* as many as a driver's buffers */
    QUEUE = 1,                                     /* one is read while another is worked on */
    SLOTS = SF_SOURCE_MAX_LEASES + QUEUE_LIVE + 1, /* and one that is filled */
    LINE_BYTES = 1024,                             /* of a header */
    FIRST_BYTES = 1 << 16,                         /* of a frame, that are taken on its header's word */
    MAX_JPEG_BYTES = 1 << 26,                      /* of one JPEG, and between two */
    FAULT_BYTES = 192,
    TEXT_BYTES = 32
};

typedef enum kind { KIND_RAW, KIND_Y4M, KIND_JPEG } kind;

/* Memory for one frame. */
typedef struct slot {
    enum { SLOT_FREE, SLOT_FILLING, SLOT_QUEUED, SLOT_OUT } state;
    uint8_t *data;
    size_t capacity, bytes;
    int32_t width, height;
    uint64_t sequence;
    int64_t time_ns;
} slot;

typedef struct pipe_source {
    sf_context *ctx;
    char *name; /* without options: "pipe:-" */
    kind kind;
    sf_pixel_format format;
    int32_t width, height; /* px, of the first frame */
    sf_yuv_matrix matrix;
    int full_range, live;
    double fps; /* 0: unknown */

    /* The reading thread's, once it runs. */
    sf_stream stream;
    sf_jpeg_cutter cutter;
    uint64_t sequence;
    char fault[FAULT_BYTES]; /* why it ended */
    pthread_t thread;
    int running;
    int owned;   /* the stream's file is closed with the source */
    int stop[2]; /* a pipe: closing [1] stops the thread; -1: none */

    /* Shared, under `lock`. */
    pthread_mutex_t lock;
    pthread_cond_t changed;
    slot slots[SLOTS];
    slot *queue[QUEUE_LIVE]; /* oldest first */
    int queued, closing;
    uint64_t damaged, dropped; /* not yet added to the source's counts */
    sf_status ended;           /* why the thread has ended; SF_OK: it has not */
} pipe_source;

/* 1. Reading frames: on the thread */

static sf_status end_with(pipe_source *p, sf_status status, uint64_t offset, const char *what) {
    snprintf(p->fault, sizeof p->fault, "offset %llu: %s", (unsigned long long)offset, what);
    return status;
}

static void count_damaged(pipe_source *p) {
    p->sequence++;
    pthread_mutex_lock(&p->lock);
    p->damaged++;
    pthread_mutex_unlock(&p->lock);
}

/* What a stream says when it is over, in words; a frame that it cut short was damaged. */
static sf_status stream_over(pipe_source *p, sf_status status, int cut_short) {
    if (status == SF_ERR_END) {
        if (cut_short) count_damaged(p);
        snprintf(p->fault, sizeof p->fault, "no more frames after %llu", (unsigned long long)p->sequence);
    } else if (status == SF_ERR_IO) {
        snprintf(p->fault, sizeof p->fault, "cannot be read: %s", strerror(p->stream.error));
    }
    return status;
}

static sf_status hold(pipe_source *p, slot *s, size_t bytes) {
    sf_status status = sf_grow(p->ctx, &s->data, &s->capacity, s->bytes, bytes, 1);
    if (status != SF_OK) snprintf(p->fault, sizeof p->fault, "out of memory for a frame of %zu bytes", bytes);
    return status;
}

static sf_status read_pixels(pipe_source *p, slot *s, int begun) {
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

static sf_status read_y4m(pipe_source *p, slot *s) {
    char line[LINE_BYTES], what[64];
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

static sf_status append(pipe_source *p, slot *s, const uint8_t *data, size_t size) {
    sf_status status = hold(p, s, s->bytes + size);
    if (status != SF_OK) return status;
    memcpy(s->data + s->bytes, data, size);
    s->bytes += size;
    return SF_OK;
}

/* Takes what came with an event. */
static sf_status follow_jpeg(pipe_source *p, slot *s, sf_jpeg_event event, int inside, const uint8_t *data,
                             size_t size) {
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

static sf_status read_jpeg(pipe_source *p, slot *s) {
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

static sf_status read_frame(pipe_source *p, slot *s) {
    sf_status status = p->kind == KIND_Y4M    ? read_y4m(p, s)
                       : p->kind == KIND_JPEG ? read_jpeg(p, s)
                                              : read_pixels(p, s, 0);
    if (status != SF_OK) return status;
    s->sequence = p->sequence++;
    s->time_ns = p->live ? sf_clock_ns() : sf_pace_after(p->fps > 0 ? p->fps : 30, s->sequence);
    return SF_OK;
}

/* 2. The queue */

/* Waits for room; NULL: the source is being closed. */
static slot *slot_to_fill(pipe_source *p) {
    pthread_mutex_lock(&p->lock);
    while (!p->closing && !p->live && p->queued == QUEUE) pthread_cond_wait(&p->changed, &p->lock);
    slot *s = p->slots;
    while (s->state != SLOT_FREE) s++; /* there are enough of them */
    if (p->closing)
        s = NULL;
    else
        s->state = SLOT_FILLING;
    pthread_mutex_unlock(&p->lock);
    return s;
}

/* Takes the oldest out of the queue. */
static slot *take_oldest(pipe_source *p) {
    slot *s = p->queue[0];
    memmove(p->queue, p->queue + 1, (size_t)--p->queued * sizeof *p->queue);
    return s;
}

static void hand_over(pipe_source *p, slot *s, sf_status status) {
    pthread_mutex_lock(&p->lock);
    if (status == SF_OK) {
        if (p->queued == QUEUE_LIVE) {
            take_oldest(p)->state = SLOT_FREE;
            p->dropped++;
        }
        s->state = SLOT_QUEUED;
        p->queue[p->queued++] = s;
    } else {
        s->state = SLOT_FREE;
        p->ended = status;
    }
    pthread_cond_broadcast(&p->changed);
    pthread_mutex_unlock(&p->lock);
}

static void *read_all(void *arg) {
    pipe_source *p = arg;
    sf_status status = SF_OK;
    while (status == SF_OK) {
        slot *s = slot_to_fill(p);
        if (!s) break;
        status = read_frame(p, s);
        hand_over(p, s, status);
    }
    return NULL;
}

/* Signals are for the threads of the program. */
static sf_status start(pipe_source *p) {
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

/* Under the lock: waits until a frame is queued or none will be. */
static void wait_for_frame(pipe_source *p, int timeout_ms) {
    int64_t deadline = sf_clock_ns() + (int64_t)timeout_ms * 1000000;
    struct timespec until = {(time_t)(deadline / 1000000000), (long)(deadline % 1000000000)};
    while (!p->queued && !p->ended)
        if (pthread_cond_timedwait(&p->changed, &p->lock, &until) == ETIMEDOUT) return;
}

static void move_counts(pipe_source *p, sf_source_counts *counts) {
    counts->damaged += p->damaged;
    counts->dropped += p->dropped;
    p->damaged = p->dropped = 0;
}

static sf_status no_frame(pipe_source *p, sf_status ended, int timeout_ms) {
    if (!ended) return sf_fail(p->ctx, SF_ERR_TIMEOUT, "%s: no frame within %d ms", p->name, timeout_ms);
    return sf_fail(p->ctx, ended, "%s: %s", p->name, p->fault);
}

static void fill_frame(const pipe_source *p, slot *s, sf_frame *frame) {
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
    pipe_source *p = self;
    slot *s = NULL;
    pthread_mutex_lock(&p->lock);
    wait_for_frame(p, timeout_ms);
    move_counts(p, counts);
    while (newest && p->live && p->queued > 1) {
        take_oldest(p)->state = SLOT_FREE;
        counts->skipped++;
    }
    if (p->queued) {
        s = take_oldest(p);
        s->state = SLOT_OUT;
    }
    sf_status ended = p->ended;
    pthread_cond_broadcast(&p->changed);
    pthread_mutex_unlock(&p->lock);
    if (!s) return no_frame(p, ended, timeout_ms);
    fill_frame(p, s, frame);
    return SF_OK;
}

static void pipe_release(void *self, sf_frame *frame) {
    pipe_source *p = self;
    pthread_mutex_lock(&p->lock);
    ((slot *)frame->lease)->state = SLOT_FREE;
    pthread_mutex_unlock(&p->lock);
}

static void pipe_describe(const void *self, sf_source_info *info) {
    const pipe_source *p = self;
    static const char *const kinds[] = {"pixels", "YUV4MPEG2", "JPEGs"};
    info->width = p->width;
    info->height = p->height;
    info->format = p->format;
    info->frames_per_second = p->fps;
    info->live = p->live;
    snprintf(info->name, sizeof info->name, "%s in %.80s, %dx%d", kinds[p->kind], p->name, (int)p->width,
             (int)p->height);
}

static void stop_thread(pipe_source *p) {
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

static void pipe_close(void *self) {
    pipe_source *p = self;
    stop_thread(p);
    if (p->owned) close_fd(p->stream.fd);
    close_fd(p->stop[0]);
    close_fd(p->stop[1]);
    for (int i = 0; i < SLOTS; i++) sf_free(p->ctx, p->slots[i].data);
    pthread_cond_destroy(&p->changed);
    pthread_mutex_destroy(&p->lock);
    sf_free(p->ctx, p->stream.buffer);
    sf_free(p->ctx, p->name);
    sf_free(p->ctx, p);
}

/* 3. Opening */

typedef struct asked {
    char size[TEXT_BYTES], format[TEXT_BYTES], matrix[TEXT_BYTES], range[TEXT_BYTES];
    double fps;
    int live;
} asked;

static sf_status parse_options(sf_context *ctx, const char *name, asked *a) {
    enum { FPS, LIVE, SIZE, FORMAT, MATRIX, RANGE, OPTIONS };
    sf_query_option options[OPTIONS] = {
        [FPS] = {.name = "fps", .most = 1000},
        [LIVE] = {.name = "live", .most = 1, .whole = 1},
        [SIZE] = {.name = "size", .text = a->size, .text_size = TEXT_BYTES},
        [FORMAT] = {.name = "format", .text = a->format, .text_size = TEXT_BYTES},
        [MATRIX] = {.name = "matrix", .text = a->matrix, .text_size = TEXT_BYTES},
        [RANGE] = {.name = "range", .text = a->range, .text_size = TEXT_BYTES},
    };
    sf_status status = sf_query_parse(ctx, name, options, OPTIONS);
    a->fps = options[FPS].value;
    a->live = options[LIVE].value != 0;
    return status;
}

/* Which of the words it is, from 0; -1 where nothing was asked for. */
static sf_status choose(sf_context *ctx, const char *name, const char *option, const char *value,
                        const char *const *words, int *choice) {
    char known[64] = "";
    *choice = -1;
    if (!*value) return SF_OK;
    for (int i = 0; words[i]; i++) {
        if (!strcmp(value, words[i])) *choice = i;
        snprintf(known + strlen(known), sizeof known - strlen(known), " %s", words[i]);
    }
    if (*choice >= 0) return SF_OK;
    return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: %s: \"%s\" is none of%s", name, option, value, known);
}

/* YUV4MPEG2 has no field for the matrix: videos of HD and more are in BT.709 as a rule, smaller ones in
 * BT.601. */
static void assume_matrix(pipe_source *p) {
    enum { HD_HEIGHT = 720 };
    if (p->kind != KIND_Y4M || p->format == SF_PIXEL_GREY || p->height < HD_HEIGHT) return;
    p->matrix = SF_YUV_709;
    sf_log(p->ctx, SF_LOG_INFO,
           "%s: YUV4MPEG2 does not say how its colours are coded: BT.709 is taken, as in most videos of %d "
           "lines "
           "and more (otherwise ?matrix=601)",
           p->name, HD_HEIGHT);
}

/* Matrix and range where they were asked for. */
static sf_status choose_colours(pipe_source *p, const char *name, const asked *a) {
    static const char *const matrices[] = {"601", "709", "2020", NULL}, *const ranges[] = {"limited", "full",
                                                                                           NULL};
    int matrix, range;
    sf_status status = choose(p->ctx, name, "matrix", a->matrix, matrices, &matrix);
    if (status == SF_OK) status = choose(p->ctx, name, "range", a->range, ranges, &range);
    if (status != SF_OK) return status;
    if (matrix >= 0)
        p->matrix = (sf_yuv_matrix)matrix;
    else
        assume_matrix(p);
    if (range >= 0) p->full_range = range;
    return SF_OK;
}

/* What was asked for, where the pipe does not say it itself. */
static sf_status take_raw(pipe_source *p, const char *name, const asked *a) {
    p->format = sf_pixel_format_find(a->format);
    if (!*a->format || p->format == SF_PIXEL_FORMATS)
        return sf_fail(
            p->ctx, SF_ERR_ARGUMENT,
            "%s: format: \"%s\" is none of RGB24, BGR24, GREY, YUYV, UYVY, NV12, YU12, 422P, 444P, MJPEG",
            name, a->format);
    p->kind = p->format == SF_PIXEL_MJPEG ? KIND_JPEG : KIND_RAW;
    p->full_range = p->kind == KIND_JPEG;
    if (p->kind == KIND_JPEG && !*a->size) return SF_OK;
    if (sf_frame_parse_size(a->size, &p->width, &p->height)) return SF_OK;
    return sf_fail(p->ctx, SF_ERR_ARGUMENT,
                   "%s: size: \"%s\" is not WIDTHxHEIGHT, each 1..%d, at most %d pixels", name, a->size,
                   SF_FRAME_MAX_SIDE, SF_FRAME_MAX_PIXELS);
}

static sf_status first_failed(pipe_source *p, sf_status status) {
    if (status == SF_ERR_TIMEOUT)
        return sf_fail(p->ctx, status, "%s: nothing came within %d s", p->name,
                       SF_SOURCE_LONGEST_WAIT_MS / 1000);
    if (status == SF_ERR_END)
        return sf_fail(p->ctx, SF_ERR_EMPTY, "%s: ends before the first frame", p->name);
    if (status == SF_ERR_IO)
        return sf_fail(p->ctx, status, "%s: cannot be read: %s", p->name, strerror(p->stream.error));
    return sf_fail(p->ctx, SF_ERR_FORMAT,
                   "%s: begins with neither YUV4MPEG2 nor a JPEG: for plain pixels name size=WxH&format=NAME",
                   p->name);
}

static sf_status take_y4m(pipe_source *p, char *line) {
    sf_y4m header;
    char fault[FAULT_BYTES];
    sf_status status = sf_y4m_parse(line, &header, fault, sizeof fault);
    if (status != SF_OK) return sf_fail(p->ctx, status, "%s: %s", p->name, fault);
    p->kind = KIND_Y4M;
    p->format = header.format;
    p->width = header.width;
    p->height = header.height;
    p->full_range = header.full_range;
    if (p->fps == 0) p->fps = header.fps;
    return SF_OK;
}

/* Waits for the first bytes, which tell what they begin. */
static sf_status recognise(pipe_source *p, int64_t deadline_ns) {
    char line[LINE_BYTES];
    const uint8_t *data;
    size_t size;
    sf_status status = sf_stream_peek(&p->stream, deadline_ns, &data, &size);
    if (status != SF_OK) return first_failed(p, status);
    if (data[0] == 0xff) {
        p->kind = KIND_JPEG;
        p->format = SF_PIXEL_MJPEG;
        p->full_range = 1;
        return SF_OK;
    }
    status = data[0] == SF_Y4M_MAGIC[0] ? sf_stream_line(&p->stream, deadline_ns, line, sizeof line)
                                        : SF_ERR_FORMAT;
    if (status == SF_OK && strncmp(line, SF_Y4M_MAGIC, strlen(SF_Y4M_MAGIC)) != 0) status = SF_ERR_FORMAT;
    return status == SF_OK ? take_y4m(p, line) : first_failed(p, status);
}

/* A JPEG itself says its size. */
static sf_status wait_for_size(pipe_source *p) {
    pthread_mutex_lock(&p->lock);
    wait_for_frame(p, SF_SOURCE_LONGEST_WAIT_MS);
    sf_status ended = p->ended;
    int came = p->queued;
    if (came) {
        p->width = p->queue[0]->width;
        p->height = p->queue[0]->height;
    }
    pthread_mutex_unlock(&p->lock);
    if (came) return SF_OK;
    if (ended == SF_ERR_END) return sf_fail(p->ctx, SF_ERR_EMPTY, "%s: holds no whole JPEG", p->name);
    return ended ? no_frame(p, ended, 0) : first_failed(p, SF_ERR_TIMEOUT);
}

static sf_status open_fd(pipe_source *p) {
    const char *path = p->name + strlen("pipe:");
    struct stat st;
    if (!strcmp(path, "-")) {
        if (fcntl(STDIN_FILENO, F_GETFD) < 0)
            return sf_fail(p->ctx, SF_ERR_IO, "%s: standard input is closed", p->name);
        p->stream.fd = STDIN_FILENO;
        return SF_OK;
    }
    /* Not blocking: a named pipe is opened before somebody writes into it. */
    p->owned = 1;
    p->stream.fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
    if (p->stream.fd < 0)
        return sf_fail(p->ctx, SF_ERR_IO, "%s: cannot be opened: %s", p->name, strerror(errno));
    if (!fstat(p->stream.fd, &st) && S_ISDIR(st.st_mode))
        return sf_fail(p->ctx, SF_ERR_IO, "%s: is a folder, not a file or pipe", p->name);
    return SF_OK;
}

static sf_status open_stop(pipe_source *p) {
    if (pipe(p->stop)) {
        p->stop[0] = p->stop[1] = -1;
        return sf_fail(p->ctx, SF_ERR_IO, "%s: no pipe to stop it: %s", p->name, strerror(errno));
    }
    for (int i = 0; i < 2; i++) fcntl(p->stop[i], F_SETFD, FD_CLOEXEC);
    p->stream.stop = p->stop[0];
    return SF_OK;
}

static sf_status open_pipe(pipe_source *p, const char *name) {
    asked a = {.fps = 0};
    int64_t deadline = sf_clock_ns() + (int64_t)SF_SOURCE_LONGEST_WAIT_MS * 1000000;
    sf_status status = parse_options(p->ctx, name, &a);
    if (status != SF_OK) return status;
    p->fps = a.fps;
    p->live = a.live;
    int raw = *a.size || *a.format;
    if (raw) status = take_raw(p, name, &a);
    if (status == SF_OK) status = open_fd(p);
    if (status == SF_OK) status = open_stop(p);
    if (status == SF_OK && !raw) status = recognise(p, deadline);
    if (status == SF_OK) status = choose_colours(p, name, &a);
    if (status == SF_OK) status = start(p);
    if (status == SF_OK && !p->width) status = wait_for_size(p);
    return status;
}

static sf_status init(pipe_source *p, const char *name) {
    pthread_condattr_t attributes;
    size_t length = strcspn(name, "?");
    p->stream.fd = p->stream.stop = p->stop[0] = p->stop[1] = -1;
    pthread_mutex_init(&p->lock, NULL);
    pthread_condattr_init(&attributes);
    pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
    pthread_cond_init(&p->changed, &attributes);
    pthread_condattr_destroy(&attributes);
    p->name = sf_calloc(p->ctx, length + 1, 1);
    p->stream.buffer = sf_alloc(p->ctx, SF_STREAM_BUFFER, 1);
    if (!p->name || !p->stream.buffer) return SF_ERR_MEMORY;
    memcpy(p->name, name, length);
    return SF_OK;
}

sf_status sf_pipe_open(sf_context *ctx, const char *name, sf_source *source) {
    static const sf_source_ops ops = {pipe_close, pipe_describe, pipe_next, pipe_release, NULL};
    pipe_source *p = sf_calloc(ctx, 1, sizeof *p);
    if (!p) return SF_ERR_MEMORY;
    p->ctx = ctx;
    sf_status status = init(p, name);
    if (status == SF_OK) status = open_pipe(p, name);
    if (status != SF_OK) {
        pipe_close(p);
        return status;
    }
    source->ops = &ops;
    source->self = p;
    return SF_OK;
}
