/* film.c - see film.h. The first frame is read when the source is opened: it tells the size, and what is
 * wrong. */
#include "film.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "../base/query.h"
#include "../io/ffmpeg.h"
#include "pace.h"

enum {
    SIDE = 640,
    FAULT = 256,
    RATE = 30,    /* frames a second, of a video that does not say it */
    TICKS = 90000 /* a second, of ffmpeg's times */
};

typedef struct film_source {
    sf_context *ctx;
    char *path;
    sf_film_facts facts;
    sf_frame_pipe pipe;
    double rate;   /* frames a second that are given */
    int waits;     /* the first frame is in the pipe, and was not given yet */
    uint64_t next; /* the frame that follows */
    int32_t width, height;
    uint8_t *buffer[SF_SOURCE_MAX_LEASES];
    int taken[SF_SOURCE_MAX_LEASES];
} film_source;

static void film_close(void *self) {
    film_source *f = self;
    char fault[FAULT];
    sf_frame_pipe_close(&f->pipe, fault, sizeof fault);
    for (int i = 0; i < SF_SOURCE_MAX_LEASES; i++) sf_free(f->ctx, f->buffer[i]);
    sf_free(f->ctx, f->path);
    sf_free(f->ctx, f);
}

static void film_describe(const void *self, sf_source_info *info) {
    const film_source *f = self;
    double all = f->facts.rate > 0 ? f->facts.frames * f->rate / f->facts.rate : f->facts.frames;
    info->width = f->width;
    info->height = f->height;
    info->format = SF_PIXEL_RGB24;
    info->frames = (uint64_t)(all + 0.5);
    snprintf(info->name, sizeof info->name, "%.80s, %.4g frames a second", f->path, f->rate);
}

/* The end of the video; a damaged one ends early. */
static sf_status end(film_source *f) {
    char fault[FAULT];
    sf_frame_pipe_close(&f->pipe, fault, sizeof fault);
    if (!f->next && !f->waits)
        return sf_fail(f->ctx, SF_ERR_FORMAT, "%s: no frame can be read%s%s", f->path, *fault ? ": " : "",
                       fault);
    if (*fault) sf_log(f->ctx, SF_LOG_WARNING, "%s: is damaged: %s", f->path, fault);
    return sf_fail(f->ctx, SF_ERR_END, "%s: no more frames after %llu", f->path, (unsigned long long)f->next);
}

static sf_status read_frame(film_source *f) {
    if (!f->pipe.frames) return end(f);
    sf_status status = sf_frame_pipe_next(&f->pipe);
    if (status == SF_ERR_END) return end(f);
    if (!status && f->width && (f->pipe.width != f->width || f->pipe.height != f->height))
        return sf_fail(f->ctx, SF_ERR_FORMAT, "%s: frame %llu: is %dx%d, those before %dx%d", f->path,
                       (unsigned long long)f->next, f->pipe.width, f->pipe.height, (int)f->width,
                       (int)f->height);
    return status;
}

static sf_status film_next(void *self, int timeout_ms, int newest, sf_frame *frame,
                           sf_source_counts *counts) {
    film_source *f = self;
    int slot = f->taken[0] ? 1 : 0;
    (void)timeout_ms, (void)newest, (void)counts;
    sf_status status = f->waits ? SF_OK : read_frame(f);
    if (status) return status;
    f->waits = 0;
    memcpy(f->buffer[slot], f->pipe.pixels, 3 * (size_t)f->width * (size_t)f->height);
    frame->plane[0] = f->buffer[slot];
    frame->stride[0] = 3 * (size_t)f->width;
    frame->width = f->width;
    frame->height = f->height;
    frame->format = SF_PIXEL_RGB24;
    frame->sequence = f->next;
    frame->time_ns = sf_pace_after(f->rate, f->next);
    frame->lease = &f->taken[slot];
    f->taken[slot] = 1;
    f->next++;
    return SF_OK;
}

static void film_release(void *self, sf_frame *frame) {
    (void)self;
    *(int *)frame->lease = 0;
}

/* Frames of an even rate: at each time the newest that the video has by then. So that times that a container
 * has rounded count as theirs, all are taken as a part of a frame earlier. */
static sf_status start(film_source *f, int side) {
    char filters[512];
    double early = 0.4 * TICKS / f->facts.rate;
    int n = 0;
    if (f->facts.rate > 0)
        n = snprintf(filters, sizeof filters, "settb=1/%d,setpts=PTS-%.0f,fps=%.6f:round=up,", TICKS, early,
                     f->rate);
    /* without these flags a picture comes out darker by two levels */
    sf_ffmpeg_scale(&f->facts, side, "area+accurate_rnd+full_chroma_int", filters + n,
                    sizeof filters - (size_t)n);
    sf_status status = sf_frame_pipe_open(&f->pipe, f->ctx, f->path, &f->facts, filters, 3);
    if (!status) status = read_frame(f);
    if (status) return status;
    f->waits = 1, f->width = f->pipe.width, f->height = f->pipe.height;
    for (int i = 0; i < SF_SOURCE_MAX_LEASES; i++)
        if (!(f->buffer[i] = sf_alloc(f->ctx, (size_t)f->width * (size_t)f->height, 3))) return SF_ERR_MEMORY;
    return SF_OK;
}

static sf_status open_film(film_source *f, const char *name) {
    enum { RATE_OPTION, SIDE_OPTION, OPTIONS };
    sf_query_option options[OPTIONS] = {
        [RATE_OPTION] = {.name = "rate", .most = 1000},
        [SIDE_OPTION] = {.name = "side", .value = SIDE, .least = 64, .most = 28000, .whole = 1},
    };
    sf_status status = sf_query_parse(f->ctx, name, options, OPTIONS);
    if (status) return status;
    if (!strncmp(name, "video:", 6)) name += 6;
    size_t length = strcspn(name, "?");
    f->path = sf_calloc(f->ctx, length + 1, 1);
    if (!f->path) return SF_ERR_MEMORY;
    memcpy(f->path, name, length);
    status = sf_ffmpeg_probe(f->ctx, f->path, &f->facts);
    if (status) return status;
    if (f->facts.is_hdr)
        sf_log(f->ctx, SF_LOG_WARNING, "%s: is of high dynamic range: colours will look pale", f->path);
    double wanted = options[RATE_OPTION].value, own = f->facts.rate > 0 ? f->facts.rate : RATE;
    f->rate = wanted > 0 && f->facts.rate > 0 ? fmin(wanted, own) : own;
    return start(f, (int)options[SIDE_OPTION].value);
}

sf_status sf_film_open(sf_context *ctx, const char *name, sf_source *source) {
    static const sf_source_ops ops = {film_close, film_describe, film_next, film_release, NULL};
    film_source *f = sf_calloc(ctx, 1, sizeof *f);
    if (!f) return SF_ERR_MEMORY;
    f->ctx = ctx;
    sf_status status = open_film(f, name);
    if (status) {
        film_close(f);
        return status;
    }
    source->ops = &ops;
    source->self = f;
    return SF_OK;
}
