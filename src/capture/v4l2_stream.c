/* v4l2_stream.c - the buffers of a V4L2 node: mapped, queued, taken, given back. */
#ifdef __linux__
#include "v4l2_stream.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <string.h>

#include "jpeg_cut.h"

/* What the driver is told of a buffer, for both kinds of nodes. */
typedef struct request {
    struct v4l2_buffer buffer;
    struct v4l2_plane planes[VIDEO_MAX_PLANES];
} request;

static struct v4l2_buffer *prepare(const sf_v4l2_stream *s, uint32_t index, request *r) {
    memset(r, 0, sizeof *r);
    r->buffer.index = index;
    r->buffer.type = s->device.type;
    r->buffer.memory = V4L2_MEMORY_MMAP;
    if (s->device.type == V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE) {
        r->buffer.m.planes = r->planes;
        r->buffer.length = VIDEO_MAX_PLANES;
    }
    return &r->buffer;
}

/* 1. Memory */

static int is_multi(const sf_v4l2_stream *s) { return s->device.type == V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE; }

static sf_status map_plane(sf_v4l2_stream *s, sf_v4l2_buffer *b, uint32_t plane, size_t offset,
                           size_t length) {
    const sf_v4l2_sys *sys = s->device.sys;
    if (length < s->picture.need[plane])
        return sf_fail(s->device.ctx, SF_ERR_UNSUPPORTED,
                       "%s: buffers: %zu bytes are too few for %dx%d, which take %zu", s->device.path, length,
                       (int)s->picture.width, (int)s->picture.height, s->picture.need[plane]);
    b->memory[plane] = sys->map(sys->user, s->device.fd, offset, length);
    if (!b->memory[plane]) return sf_v4l2_fail(&s->device, "buffers: cannot be mapped");
    b->length[plane] = length;
    return SF_OK;
}

static sf_status map_buffer(sf_v4l2_stream *s, sf_v4l2_buffer *b) {
    request r;
    struct v4l2_buffer *q = prepare(s, b->index, &r);
    if (sf_v4l2_ioctl_again(&s->device, VIDIOC_QUERYBUF, q))
        return sf_v4l2_fail(&s->device, "buffers: cannot be asked for");
    if (!is_multi(s)) return map_plane(s, b, 0, q->m.offset, q->length);
    if (q->length < s->picture.pixels->planes)
        return sf_fail(s->device.ctx, SF_ERR_UNSUPPORTED, "%s: buffers: of %u planes, not %u", s->device.path,
                       (unsigned)q->length, (unsigned)s->picture.pixels->planes);
    sf_status status = SF_OK;
    for (uint32_t k = 0; k < s->picture.pixels->planes && status == SF_OK; k++)
        status = map_plane(s, b, k, r.planes[k].m.mem_offset, r.planes[k].length);
    return status;
}

static void unmap_buffer(sf_v4l2_buffer *b) {
    const sf_v4l2_sys *sys = b->stream->device.sys;
    for (int k = 0; k < SF_FRAME_PLANES; k++) {
        if (b->memory[k]) sys->unmap(sys->user, b->memory[k], b->length[k]);
        b->memory[k] = NULL;
    }
    if (b->dmabuf >= 0) sys->close(sys->user, b->dmabuf);
    b->dmabuf = -1;
}

/* As a DMA buffer, of its first plane of memory. */
static void export_buffer(sf_v4l2_stream *s, sf_v4l2_buffer *b) {
    struct v4l2_exportbuffer e = {.type = s->device.type, .index = b->index, .flags = O_CLOEXEC};
    if (sf_v4l2_ioctl(&s->device, VIDIOC_EXPBUF, &e) == 0)
        b->dmabuf = e.fd;
    else if (b->index == 0)
        sf_log(s->device.ctx, SF_LOG_WARNING, "%s: dmabuf: the driver gives none: %s", s->device.path,
               strerror(errno));
}

static sf_status request_buffers(sf_v4l2_stream *s, uint32_t wanted) {
    struct v4l2_requestbuffers r = {.count = wanted, .type = s->device.type, .memory = V4L2_MEMORY_MMAP};
    if (sf_v4l2_ioctl_again(&s->device, VIDIOC_REQBUFS, &r))
        return sf_v4l2_fail(&s->device, "buffers: cannot be had");
    if (r.count < SF_V4L2_LEAST_BUFFERS)
        return sf_fail(s->device.ctx, SF_ERR_UNSUPPORTED, "%s: buffers: the driver gives %u, %d are needed",
                       s->device.path, (unsigned)r.count, SF_V4L2_LEAST_BUFFERS);
    if (r.count < wanted)
        sf_log(s->device.ctx, SF_LOG_INFO, "%s: buffers: the driver gives %u, not %u", s->device.path,
               (unsigned)r.count, (unsigned)wanted);
    s->count = r.count < SF_V4L2_MOST_BUFFERS ? r.count : SF_V4L2_MOST_BUFFERS;
    return SF_OK;
}

static sf_status map_all(sf_v4l2_stream *s, const sf_v4l2_settings *settings) {
    sf_status status = request_buffers(s, settings->buffers);
    for (uint32_t i = 0; i < s->count && status == SF_OK; i++) {
        status = map_buffer(s, &s->buffers[i]);
        if (status == SF_OK && settings->dmabuf) export_buffer(s, &s->buffers[i]);
    }
    return status;
}

/* 2. Opening and closing */

sf_status sf_v4l2_stream_open(const sf_v4l2_device *device, const sf_v4l2_settings *settings,
                              sf_v4l2_stream **stream) {
    sf_v4l2_stream *s = sf_calloc(device->ctx, 1, sizeof *s);
    if (!s) {
        sf_v4l2_device closing = *device;
        sf_v4l2_device_close(&closing);
        return SF_ERR_MEMORY;
    }
    s->device = *device;
    for (uint32_t i = 0; i < SF_V4L2_MOST_BUFFERS; i++)
        s->buffers[i] = (sf_v4l2_buffer){.stream = s, .index = i, .dmabuf = -1};
    sf_status status = sf_v4l2_set_picture(&s->device, settings, &s->picture);
    if (status == SF_OK) status = sf_v4l2_set_controls(&s->device, settings, &s->exposure_s, &s->gain);
    if (status == SF_OK) status = map_all(s, settings);
    if (status == SF_OK) status = sf_v4l2_stream_start(s);
    if (status != SF_OK) {
        sf_v4l2_stream_close(s);
        sf_v4l2_stream_free(s);
        return status;
    }
    *stream = s;
    return SF_OK;
}

void sf_v4l2_stream_close(sf_v4l2_stream *s) {
    if (s->device.fd >= 0) sf_v4l2_stream_stop(s);
    for (uint32_t i = 0; i < s->count; i++)
        if (s->buffers[i].state != SF_V4L2_OUT) unmap_buffer(&s->buffers[i]);
    sf_v4l2_device_close(&s->device);
}

int sf_v4l2_stream_is_out(const sf_v4l2_stream *s) {
    for (uint32_t i = 0; i < s->count; i++)
        if (s->buffers[i].state == SF_V4L2_OUT) return 1;
    return 0;
}

void sf_v4l2_stream_free(sf_v4l2_stream *s) {
    for (uint32_t i = 0; i < s->count; i++) unmap_buffer(&s->buffers[i]);
    sf_free(s->device.ctx, s);
}

/* 3. Streaming */

void sf_v4l2_stream_stop(sf_v4l2_stream *s) {
    int type = (int)s->device.type;
    if (!s->device.gone) sf_v4l2_ioctl(&s->device, VIDIOC_STREAMOFF, &type);
    for (uint32_t i = 0; i < s->count; i++)
        if (s->buffers[i].state == SF_V4L2_QUEUED) s->buffers[i].state = SF_V4L2_IDLE;
}

void sf_v4l2_stream_queue(sf_v4l2_stream *s, int patient) {
    for (uint32_t i = 0; i < s->count; i++) {
        sf_v4l2_buffer *b = &s->buffers[i];
        request r;
        if (b->state != SF_V4L2_IDLE || s->device.gone) continue;
        struct v4l2_buffer *q = prepare(s, b->index, &r);
        if (is_multi(s)) q->length = s->picture.pixels->planes;
        int failed = patient ? sf_v4l2_ioctl_again(&s->device, VIDIOC_QBUF, q)
                             : sf_v4l2_ioctl(&s->device, VIDIOC_QBUF, q);
        if (!failed)
            b->state = SF_V4L2_QUEUED;
        else if (patient)
            s->broken = 1;
    }
}

sf_status sf_v4l2_stream_start(sf_v4l2_stream *s) {
    int type = (int)s->device.type;
    s->broken = 0;
    sf_v4l2_stream_queue(s, 1);
    if (s->broken || s->device.gone) return sf_v4l2_fail(&s->device, "a buffer cannot be queued");
    if (sf_v4l2_ioctl_again(&s->device, VIDIOC_STREAMON, &type) == 0) return SF_OK;
    s->broken = 1;
    return sf_v4l2_fail(&s->device, "cannot be started");
}

void sf_v4l2_stream_give_back(sf_v4l2_buffer *b) {
    sf_v4l2_stream *s = b->stream;
    b->state = SF_V4L2_IDLE;
    if (s->device.fd >= 0 && !s->broken)
        sf_v4l2_stream_queue(s, 0); /* what fails now is tried again before the next wait */
}

int sf_v4l2_stream_wait(sf_v4l2_stream *s, int timeout_ms) {
    const sf_v4l2_sys *sys = s->device.sys;
    int events = 0;
    int ready = sys->poll(sys->user, s->device.fd, timeout_ms, &events);
    if (ready < 0 && errno != EINTR && errno != EAGAIN) s->broken = 1;
    if (ready > 0 && events & (POLLERR | POLLHUP | POLLNVAL)) s->broken = 1;
    if (s->broken) sf_v4l2_device_answers(&s->device);
    return ready > 0;
}

/* 4. Frames */

static void take_plane(const sf_v4l2_stream *s, uint32_t k, size_t used, size_t offset, sf_v4l2_arrival *a) {
    const sf_v4l2_buffer *b = a->buffer;
    if (used > b->length[k]) used = b->length[k];
    if (offset > used) offset = used;
    a->start[k] = b->memory[k] + offset;
    a->bytes[k] = used - offset;
    if (a->bytes[k] < s->picture.need[k]) a->damaged = 1;
}

static int64_t time_of(const sf_v4l2_stream *s, const struct v4l2_buffer *q) {
    int64_t t = (int64_t)q->timestamp.tv_sec * 1000000000 + (int64_t)q->timestamp.tv_usec * 1000;
    int monotonic = (q->flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) == V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
    return monotonic && t > 0 ? t : s->device.sys->now_ns(s->device.sys->user);
}

static void take_arrival(sf_v4l2_stream *s, const request *r, sf_v4l2_arrival *a) {
    const struct v4l2_buffer *q = &r->buffer;
    *a = (sf_v4l2_arrival){.buffer = &s->buffers[q->index],
                           .sequence = q->sequence,
                           .time_ns = time_of(s, q),
                           .damaged = (q->flags & V4L2_BUF_FLAG_ERROR) != 0};
    a->buffer->state = SF_V4L2_OUT;
    for (uint32_t k = 0; k < s->picture.pixels->planes; k++) {
        if (is_multi(s))
            take_plane(s, k, r->planes[k].bytesused, r->planes[k].data_offset, a);
        else
            take_plane(s, k, q->bytesused, 0, a);
    }
    if (s->picture.pixels->format != SF_PIXEL_MJPEG || a->damaged) return;
    size_t end = sf_jpeg_end(a->start[0], a->bytes[0]);
    if (end) a->bytes[0] = end;
    a->damaged = !end;
}

int sf_v4l2_stream_take(sf_v4l2_stream *s, sf_v4l2_arrival *a) {
    request r;
    struct v4l2_buffer *q = prepare(s, 0, &r);
    if (sf_v4l2_ioctl(&s->device, VIDIOC_DQBUF, q)) {
        if (errno != EAGAIN) {
            s->broken = 1;
            sf_v4l2_device_answers(&s->device); /* some say EIO for what is gone */
        }
        return 0;
    }
    if (q->index >= s->count || s->buffers[q->index].state != SF_V4L2_QUEUED) {
        s->broken = 1; /* a buffer that the driver has not */
        return 0;
    }
    take_arrival(s, &r, a);
    return 1;
}
#endif
