/* pipe_open.c - opens a pipe: its options, and what its first bytes begin. */
#include "pipe.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "../base/clock.h"
#include "../base/hd.h"
#include "../base/query.h"
#include "../base/wait.h"
#include "format.h"
#include "pipe_source.h"
#include "y4m.h"

enum { TEXT_BYTES = 32 };

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
static void assume_matrix(sf_pipe_source *p) {
    if (p->kind != SF_PIPE_Y4M || p->format == SF_PIXEL_GREY || !sf_is_hd(p->width, p->height)) return;
    p->matrix = SF_YUV_709;
    sf_log(p->ctx, SF_LOG_INFO,
           "%s: YUV4MPEG2 does not say how its colours are coded: BT.709 is taken, as in most videos of %d "
           "columns or more than %d lines (otherwise ?matrix=601)",
           p->name, SF_HD_WIDTH, SF_SD_HEIGHT);
}

/* Matrix and range where they were asked for. */
static sf_status choose_colours(sf_pipe_source *p, const char *name, const asked *a) {
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
static sf_status take_raw(sf_pipe_source *p, const char *name, const asked *a) {
    p->format = sf_pixel_format_find(a->format);
    if (!*a->format || p->format == SF_PIXEL_FORMATS)
        return sf_fail(
            p->ctx, SF_ERR_ARGUMENT,
            "%s: format: \"%s\" is none of RGB24, BGR24, GREY, YUYV, UYVY, NV12, YU12, 422P, 444P, MJPEG",
            name, a->format);
    p->kind = p->format == SF_PIXEL_MJPEG ? SF_PIPE_JPEG : SF_PIPE_RAW;
    p->full_range = p->kind == SF_PIPE_JPEG;
    if (p->kind == SF_PIPE_JPEG && !*a->size) return SF_OK;
    if (sf_frame_parse_size(a->size, &p->width, &p->height)) return SF_OK;
    return sf_fail(p->ctx, SF_ERR_ARGUMENT,
                   "%s: size: \"%s\" is not WIDTHxHEIGHT, each 1..%d, at most %d pixels", name, a->size,
                   SF_FRAME_MAX_SIDE, SF_FRAME_MAX_PIXELS);
}

static sf_status first_failed(sf_pipe_source *p, sf_status status) {
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

static sf_status take_y4m(sf_pipe_source *p, char *line) {
    sf_y4m header;
    char fault[SF_PIPE_FAULT];
    sf_status status = sf_y4m_parse(line, &header, fault, sizeof fault);
    if (status != SF_OK) return sf_fail(p->ctx, status, "%s: %s", p->name, fault);
    p->kind = SF_PIPE_Y4M;
    p->format = header.format;
    p->width = header.width;
    p->height = header.height;
    p->full_range = header.full_range;
    if (p->fps == 0) p->fps = header.fps;
    return SF_OK;
}

/* Waits for the first bytes, which tell what they begin. */
static sf_status recognise(sf_pipe_source *p, int64_t deadline_ns) {
    char line[SF_PIPE_LINE];
    const uint8_t *data;
    size_t size;
    sf_status status = sf_stream_peek(&p->stream, deadline_ns, &data, &size);
    if (status != SF_OK) return first_failed(p, status);
    if (data[0] == 0xff) {
        p->kind = SF_PIPE_JPEG;
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
static sf_status wait_for_size(sf_pipe_source *p) {
    pthread_mutex_lock(&p->lock);
    sf_pipe_wait(p, SF_SOURCE_LONGEST_WAIT_MS);
    sf_status ended = p->ended;
    int came = p->queued;
    if (came) {
        p->width = p->queue[0]->width;
        p->height = p->queue[0]->height;
    }
    pthread_mutex_unlock(&p->lock);
    if (came) return SF_OK;
    if (ended == SF_ERR_END) return sf_fail(p->ctx, SF_ERR_EMPTY, "%s: holds no whole JPEG", p->name);
    return ended ? sf_pipe_no_frame(p, ended, 0) : first_failed(p, SF_ERR_TIMEOUT);
}

static sf_status open_fd(sf_pipe_source *p) {
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

static sf_status open_stop(sf_pipe_source *p) {
    if (pipe(p->stop)) {
        p->stop[0] = p->stop[1] = -1;
        return sf_fail(p->ctx, SF_ERR_IO, "%s: no pipe to stop it: %s", p->name, strerror(errno));
    }
    for (int i = 0; i < 2; i++) fcntl(p->stop[i], F_SETFD, FD_CLOEXEC);
    p->stream.stop = p->stop[0];
    return SF_OK;
}

static sf_status open_pipe(sf_pipe_source *p, const char *name) {
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
    if (status == SF_OK) status = sf_pipe_start(p);
    if (status == SF_OK && !p->width) status = wait_for_size(p);
    return status;
}

static sf_status init(sf_pipe_source *p, const char *name) {
    size_t length = strcspn(name, "?");
    p->stream.fd = p->stream.stop = p->stop[0] = p->stop[1] = -1;
    pthread_mutex_init(&p->lock, NULL);
    sf_condition_init(&p->changed);
    p->name = sf_calloc(p->ctx, length + 1, 1);
    p->stream.buffer = sf_alloc(p->ctx, SF_STREAM_BUFFER, 1);
    if (!p->name || !p->stream.buffer) return SF_ERR_MEMORY;
    memcpy(p->name, name, length);
    return SF_OK;
}

sf_status sf_pipe_open(sf_context *ctx, const char *name, sf_source *source) {
    sf_pipe_source *p = sf_calloc(ctx, 1, sizeof *p);
    if (!p) return SF_ERR_MEMORY;
    p->ctx = ctx;
    sf_status status = init(p, name);
    if (status == SF_OK) status = open_pipe(p, name);
    if (status != SF_OK) {
        sf_pipe_close(p);
        return status;
    }
    source->ops = &sf_pipe_ops;
    source->self = p;
    return SF_OK;
}
