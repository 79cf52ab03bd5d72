/* libcamera_source.c - see libcamera_source.h. */
#include "libcamera_source.h"

#include <stdio.h>

#include "../base/clock.h"
#include "jpeg_cut.h"

/* 1. Beginning and end */

/* A JPEG has no rows, and is full range whatever the driver says. */
static sf_status settle_picture(const sf_libcamera_device *device, sf_libcamera_picture *p) {
    size_t row, rows;
    sf_pixel_plane(p->format, p->width, p->height, 0, &row, &rows);
    if (p->stride < row)
        return sf_libcamera_fail(device, SF_ERR_UNSUPPORTED, 0, "stride: %zu is too short", p->stride);
    if (p->format == SF_PIXEL_MJPEG) {
        p->stride = 0;
        p->full_range = 1;
    }
    return SF_OK;
}

sf_status sf_libcamera_source_begin(sf_libcamera_source *s, size_t count) {
    sf_status status = settle_picture(&s->device, &s->picture);
    if (status != SF_OK) return status;
    if (count < SF_SOURCE_MAX_LEASES)
        return sf_libcamera_fail(&s->device, SF_ERR_UNSUPPORTED, 0,
                                 "gives fewer buffers than frames may be out");
    s->buffers = sf_calloc(s->device.ctx, count, sizeof *s->buffers);
    if (!s->buffers) return SF_ERR_MEMORY;
    s->count = count;
    return sf_libcamera_queue_open(s->device.ctx, count, &s->queue);
}

void sf_libcamera_source_end(sf_libcamera_source *s) {
    for (size_t i = 0; i < s->count; i++) sf_libcamera_unmap(&s->buffers[i]);
    sf_free(s->device.ctx, s->buffers);
    s->buffers = NULL;
    s->count = 0;
    sf_libcamera_queue_close(&s->queue);
    sf_libcamera_forget(&s->device);
}

static void source_close(void *self) {
    sf_libcamera_source *s = self;
    s->calls->close(s->camera);
}

static void source_describe(const void *self, sf_source_info *info) {
    const sf_libcamera_source *s = self;
    info->width = s->picture.width;
    info->height = s->picture.height;
    info->format = s->picture.format;
    info->frames_per_second = s->asked.fps;
    info->live = 1;
    info->can_lock_exposure = sf_libcamera_can_lock(s->has);
    snprintf(info->name, sizeof info->name, "%s, %dx%d %s", s->model, (int)s->picture.width,
             (int)s->picture.height, sf_pixel_format_name(s->picture.format));
}

/* 2. Buffers that go round */

static sf_status queue_again(sf_libcamera_source *s, size_t buffer) {
    sf_libcamera_controls set = sf_libcamera_controls_none();
    if (s->lock_is_new) set = sf_libcamera_controls_lock(s->has, &s->asked, s->locked);
    s->lock_is_new = 0;
    return s->calls->queue(s->camera, buffer, &set);
}

static void source_release(void *self, sf_frame *frame) {
    sf_libcamera_source *s = self;
    queue_again(s, (size_t)((sf_libcamera_buffer *)frame->lease - s->buffers));
}

static sf_status source_lock(void *self, int locked) {
    sf_libcamera_source *s = self;
    s->locked = locked != 0;
    s->lock_is_new = 1;
    return SF_OK;
}

static sf_status take(sf_libcamera_source *s, int64_t deadline_ns, sf_libcamera_filled *f,
                      sf_source_counts *counts) {
    sf_status status = sf_libcamera_queue_take(&s->queue, deadline_ns, f, &counts->dropped);
    if (status == SF_OK) return SF_OK;
    if (status == SF_ERR_TIMEOUT && !sf_libcamera_present(&s->device)) { /* udev may be slow, or not there */
        sf_libcamera_queue_lose(&s->queue);
        status = SF_ERR_IO;
    }
    if (status == SF_ERR_TIMEOUT) return sf_libcamera_fail(&s->device, status, 0, "no frame came in time");
    if (!s->said_gone) sf_log(s->device.ctx, SF_LOG_WARNING, "libcamera: %s is gone", s->device.id);
    s->said_gone = 1;
    return sf_libcamera_fail(&s->device, SF_ERR_IO, 0, "is gone");
}

/* 3. Frames */

/* Bytes of a JPEG; 0: it is none, or was cut off. */
static size_t jpeg_bytes(const sf_libcamera_source *s, const sf_libcamera_filled *f) {
    const sf_libcamera_buffer *b = &s->buffers[f->buffer];
    return sf_jpeg_end(b->plane[0], f->first_bytes < b->length[0] ? f->first_bytes : b->length[0]);
}

/* Where the driver's buffer has one plane for all, so may have what it says of it. */
static int is_whole(const sf_libcamera_source *s, const sf_libcamera_filled *f) {
    size_t need = 0;
    if (f->damaged) return 0;
    if (s->picture.format == SF_PIXEL_MJPEG) return jpeg_bytes(s, f) != 0;
    for (int i = 0; i < sf_libcamera_planes(&s->picture); i++)
        need += sf_libcamera_plane_bytes(&s->picture, i);
    return f->bytes >= need;
}

/* Late and damaged frames are not *good, and go back at once. */
static sf_status examine(sf_libcamera_source *s, const sf_libcamera_filled *f, sf_source_counts *counts,
                         int *good) {
    *good = !f->late && is_whole(s, f);
    if (*good) return SF_OK;
    if (!f->late) counts->damaged++;
    return queue_again(s, f->buffer);
}

static void fill_frame(const sf_libcamera_source *s, const sf_libcamera_filled *f, sf_frame *frame) {
    const sf_libcamera_picture *p = &s->picture;
    sf_libcamera_buffer *b = &s->buffers[f->buffer];
    for (int i = 0; i < sf_libcamera_planes(p); i++) {
        frame->plane[i] = b->plane[i];
        frame->stride[i] = sf_libcamera_stride(p, i);
    }
    if (p->format == SF_PIXEL_MJPEG) frame->bytes = jpeg_bytes(s, f);
    frame->width = p->width;
    frame->height = p->height;
    frame->format = p->format;
    frame->matrix = p->matrix;
    frame->full_range = p->full_range;
    frame->sequence = f->sequence;
    frame->time_ns = f->time_ns;
    /* Where a pipeline does not say what it did, what was asked for. */
    const double asked_us = s->asked.exposure_us > 0 ? s->asked.exposure_us : 0;
    frame->exposure_s = 1e-6 * (f->exposure_us >= 0 ? f->exposure_us : asked_us);
    frame->gain = f->gain >= 0 ? f->gain : s->asked.gain;
    frame->dmabuf = b->dmabuf;
    frame->lease = b;
}

static sf_status source_next(void *self, int timeout_ms, int newest, sf_frame *frame,
                             sf_source_counts *counts) {
    sf_libcamera_source *s = self;
    int64_t deadline_ns = sf_clock_ns() + (int64_t)timeout_ms * 1000000;
    sf_libcamera_filled kept, newer;
    sf_status status;
    int good = 0;
    do {
        status = take(s, deadline_ns, &kept, counts);
        if (status == SF_OK) status = examine(s, &kept, counts, &good);
    } while (status == SF_OK && !good);
    while (status == SF_OK && newest && sf_libcamera_queue_has(&s->queue)) {
        status = take(s, deadline_ns, &newer, counts);
        if (status == SF_OK) status = examine(s, &newer, counts, &good);
        if (status != SF_OK || !good) continue;
        status = queue_again(s, kept.buffer);
        counts->skipped++;
        kept = newer;
    }
    if (status == SF_OK) fill_frame(s, &kept, frame);
    return status;
}

const sf_source_ops sf_libcamera_source_ops = {.close = source_close,
                                               .describe = source_describe,
                                               .next = source_next,
                                               .release = source_release,
                                               .lock_exposure = source_lock};
