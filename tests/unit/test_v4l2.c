/* test_v4l2.c - the V4L2 source on a driver that is played: formats, choices, controls, every fault.
 *
 * The driver stands behind the table of system calls. Its clock moves when somebody waits.
 */
#include "../testing.h"

#ifdef __linux__
#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../../src/base/context.h"
#include "../../src/capture/v4l2.h"
#include "../../src/capture/v4l2_device.h"

#define COUNT(array) (sizeof(array) / sizeof *(array))

/* 1. The driver that is played */

enum { NODES = 4, MOST_FDS = 64, BUFFERS = 8, PLANES = 3, FRAME_MS = 40, FAULTS = 4 };

typedef struct fake_size {
    uint32_t width, height, fps; /* fps 0: not listed */
} fake_size;

typedef struct fake_format {
    uint32_t fourcc, planes;
    fake_size sizes[3]; /* ended by width 0; none: sizes are not listed */
} fake_format;

typedef struct fake_control {
    uint32_t id, type;
    const char *name;
    int32_t least, most, value;
    const char *const *menu; /* NULL entries are missing */
} fake_control;

typedef struct fake_buffer {
    uint8_t *memory[PLANES];
    int queued, done;
    uint32_t sequence, flags;
    size_t used[PLANES];
    int64_t time_ns;
} fake_buffer;

typedef struct fake_node {
    const char *card, *bus, *serial;
    int index, plugged, multi;
    fake_format formats[8];
    fake_control controls[12];
    uint32_t colorspace, ycbcr_enc, quantization, field;
    uint32_t padding;     /* bytes beside each row */
    uint32_t data_offset; /* of planes */
    uint32_t most_buffers;
    int missing_bytes; /* of sizeimage and length */
    fake_size other;   /* what S_FMT gives whatever is asked for; width 0: what is asked for */
    uint32_t other_fourcc;
    uint32_t input_status;
    int no_clock; /* frames carry no time of the monotonic clock */
    int mute;     /* frames do not come */
    int no_wait;  /* ready without a frame */
    int exports;  /* has VIDIOC_EXPBUF */
    /* what becomes of the next frames */
    uint32_t drop, flags, burst;
    int cut;          /* the next frame ends too early */
    const char *jpeg; /* what the frames hold */
    size_t jpeg_size;
    /* state */
    int generation; /* times that it was plugged in */
    int streaming, failed;
    uint32_t fourcc, planes, width, height, fps, count, sequence, input;
    fake_buffer buffers[BUFFERS];
    int maps;
} fake_node;

typedef struct fake {
    fake_node nodes[NODES];
    struct {
        int node, generation; /* node -1: closed; NODES: a DMA buffer */
    } fds[MOST_FDS];
    struct {
        unsigned long request; /* 0: any */
        int error, times;      /* times -1: always */
    } faults[FAULTS];
    long calls, fail_at; /* that call fails with fail_with, or all from then on */
    int fail_with, fail_on;
    int64_t now_ns;
    int interruptions; /* polls that a signal ends */
    int fds_open, maps, queued;
    /* at that time the node changes; 0: never */
    int64_t unplug_ns, plug_ns;
    int unplug_node, plug_node;
} fake;

static const int64_t ms = 1000000;

static const fake_format yuyv_and_jpeg[] = {{V4L2_PIX_FMT_MJPEG, 1, {{64, 48, 30}, {128, 96, 30}}},
                                            {V4L2_PIX_FMT_YUYV, 1, {{64, 48, 30}, {128, 96, 5}}},
                                            {V4L2_PIX_FMT_H264, 1, {{64, 48, 30}}}};

static const char *const exposure_menu[] = {NULL, "Manual Mode", NULL, "Aperture Priority Mode"};

static const fake_control webcam_controls[] = {
    {V4L2_CID_BRIGHTNESS, V4L2_CTRL_TYPE_INTEGER, "Brightness", -64, 64, 0, NULL},
    {V4L2_CID_AUTO_WHITE_BALANCE, V4L2_CTRL_TYPE_BOOLEAN, "White Balance, Automatic", 0, 1, 1, NULL},
    {V4L2_CID_GAIN, V4L2_CTRL_TYPE_INTEGER, "Gain", 0, 100, 7, NULL},
    {V4L2_CID_WHITE_BALANCE_TEMPERATURE, V4L2_CTRL_TYPE_INTEGER, "White Balance Temperature", 2800, 6500,
     4600, NULL},
    {V4L2_CID_EXPOSURE_AUTO, V4L2_CTRL_TYPE_MENU, "Auto Exposure", 0, 3, 3, exposure_menu},
    {V4L2_CID_EXPOSURE_ABSOLUTE, V4L2_CTRL_TYPE_INTEGER, "Exposure Time, Absolute", 3, 2047, 250, NULL},
};

/* One webcam at /dev/video0. */
static void fake_init(fake *f) {
    memset(f, 0, sizeof *f);
    f->now_ns = 1000 * ms;
    for (int i = 0; i < MOST_FDS; i++) f->fds[i].node = -1;
    for (int i = 0; i < NODES; i++)
        f->nodes[i] = (fake_node){.card = "Webcam",
                                  .bus = "usb-1",
                                  .serial = "S1",
                                  .most_buffers = BUFFERS,
                                  .colorspace = V4L2_COLORSPACE_SRGB,
                                  .field = V4L2_FIELD_NONE,
                                  .fourcc = V4L2_PIX_FMT_YUYV,
                                  .planes = 1,
                                  .width = 64,
                                  .height = 48,
                                  .fps = 25};
    fake_node *n = &f->nodes[0];
    n->plugged = 1;
    memcpy(n->formats, yuyv_and_jpeg, sizeof yuyv_and_jpeg);
    memcpy(n->controls, webcam_controls, sizeof webcam_controls);
}

static void set_format(fake_node *n, uint32_t fourcc, uint32_t planes) {
    memset(n->formats, 0, sizeof n->formats);
    n->formats[0] = (fake_format){fourcc, planes, {{64, 48, 30}}};
    n->fourcc = fourcc;
    n->planes = planes;
}

static void fake_unplug(fake_node *n) {
    n->plugged = n->streaming = 0;
    n->generation++;
    n->maps = 0; /* of the new device */
    memset(n->buffers, 0, sizeof n->buffers);
}

/* The camera of one node is at another from now on. */
static void fake_move(fake *f, int from, int to) {
    fake_node n = f->nodes[from];
    n.generation = f->nodes[to].generation + 1;
    n.plugged = 1;
    n.sequence = 0;
    n.failed = 0;
    f->nodes[to] = n;
    if (from != to) f->nodes[from].plugged = 0;
}

static void pass_time(fake *f, int64_t ns) {
    f->now_ns += ns;
    if (f->unplug_ns && f->now_ns >= f->unplug_ns) {
        f->unplug_ns = 0;
        fake_unplug(&f->nodes[f->unplug_node]);
    }
    if (f->plug_ns && f->now_ns >= f->plug_ns) {
        f->plug_ns = 0;
        fake_move(f, f->unplug_node, f->plug_node);
    }
}

static int fail_with(int error) {
    errno = error;
    return -1;
}

/* Whether this call is to fail: errno, or 0. */
static int planned_fault(fake *f, unsigned long request) {
    f->calls++;
    assert_true(f->calls < 200000); /* it goes round in circles */
    if (f->fail_at && (f->calls == f->fail_at || (f->fail_on && f->calls > f->fail_at))) return f->fail_with;
    for (int i = 0; i < FAULTS; i++) {
        if (!f->faults[i].times || (f->faults[i].request && f->faults[i].request != request)) continue;
        if (f->faults[i].times > 0) f->faults[i].times--;
        return f->faults[i].error;
    }
    return 0;
}

static void plan_fault(fake *f, unsigned long request, int error, int times) {
    for (int i = 0; i < FAULTS; i++)
        if (!f->faults[i].times) {
            f->faults[i].request = request;
            f->faults[i].error = error;
            f->faults[i].times = times;
            return;
        }
    fail_msg("too many faults");
}

static int new_fd(fake *f, int node, int generation) {
    for (int i = 0; i < MOST_FDS; i++)
        if (f->fds[i].node < 0) {
            f->fds[i].node = node;
            f->fds[i].generation = generation;
            f->fds_open++;
            return i;
        }
    fail_msg("too many descriptors are open");
    return -1;
}

static int fake_open(void *user, const char *path) {
    fake *f = user;
    int error = planned_fault(f, 1), node;
    if (error) return fail_with(error);
    if (sscanf(path, "/dev/video%d", &node) != 1 || node >= NODES || !f->nodes[node].plugged)
        return fail_with(ENOENT);
    return new_fd(f, node, f->nodes[node].generation);
}

static int fake_close(void *user, int fd) {
    fake *f = user;
    assert_true(fd >= 0 && fd < MOST_FDS && f->fds[fd].node >= 0);
    int node = f->fds[fd].node, last = 1;
    f->fds[fd].node = -1;
    f->fds_open--;
    if (node == NODES || f->fds[fd].generation != f->nodes[node].generation) return 0;
    for (int i = 0; i < MOST_FDS; i++) last = last && f->fds[i].node != node;
    if (last) f->nodes[node].streaming = 0;
    return 0;
}

static fake_node *node_of(fake *f, int fd) {
    assert_true(fd >= 0 && fd < MOST_FDS && f->fds[fd].node >= 0 && f->fds[fd].node < NODES);
    fake_node *n = &f->nodes[f->fds[fd].node];
    return n->plugged && n->generation == f->fds[fd].generation ? n : NULL;
}

/* Rows and bytes of a row of a plane of memory. */
static uint32_t memory_stride(const fake_node *n, uint32_t plane) {
    switch (n->fourcc) {
    case V4L2_PIX_FMT_YUYV:
    case V4L2_PIX_FMT_UYVY:
        return 2 * n->width + n->padding;
    case V4L2_PIX_FMT_RGB24:
    case V4L2_PIX_FMT_BGR24:
        return 3 * n->width + n->padding;
    case V4L2_PIX_FMT_MJPEG:
    case V4L2_PIX_FMT_JPEG:
        return 0;
    case V4L2_PIX_FMT_YUV420M:
    case V4L2_PIX_FMT_YUV422M:
        return (plane ? n->width / 2 : n->width) + n->padding;
    default:
        return n->width + n->padding;
    }
}

static uint32_t memory_bytes(const fake_node *n, uint32_t plane) {
    uint32_t size = n->height * memory_stride(n, plane);
    switch (n->fourcc) {
    case V4L2_PIX_FMT_MJPEG:
    case V4L2_PIX_FMT_JPEG:
        size = 4096;
        break;
    case V4L2_PIX_FMT_NV12:
    case V4L2_PIX_FMT_YUV420:
        size += size / 2;
        break;
    case V4L2_PIX_FMT_YUV422P:
        size *= 2;
        break;
    case V4L2_PIX_FMT_NV12M:
    case V4L2_PIX_FMT_YUV420M:
        size = plane ? size / 2 : size;
        break;
    default:
        break;
    }
    return size + n->data_offset - (uint32_t)n->missing_bytes;
}

/* The byte of a frame at a place: another in each frame, plane of memory and place. */
static uint8_t frame_byte(uint32_t sequence, uint32_t plane, size_t at) {
    return (uint8_t)(sequence * 31 + plane * 101 + at * 7 + at / 251);
}

static void finish_buffer(fake *f, fake_node *n, fake_buffer *b) {
    n->sequence += n->drop;
    b->sequence = n->sequence++;
    b->flags = n->flags | (n->no_clock ? 0 : V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC);
    b->time_ns = n->no_clock ? 77 * ms : f->now_ns;
    b->queued = 0;
    b->done = 1;
    for (uint32_t k = 0; k < n->planes; k++) {
        size_t bytes = memory_bytes(n, k);
        b->used[k] = n->jpeg ? n->jpeg_size : n->cut ? bytes - 2 : bytes;
        if (!b->memory[k]) continue;
        if (n->jpeg) memcpy(b->memory[k], n->jpeg, n->jpeg_size);
        for (size_t i = 0; !n->jpeg && i < bytes - n->data_offset; i++)
            b->memory[k][n->data_offset + i] = frame_byte(b->sequence, k, i);
    }
    n->drop = n->flags = 0;
    n->cut = 0;
}

/* The buffer that has waited longest, as the driver has it: those of lower sequence first. */
static fake_buffer *first_done(fake_node *n) {
    fake_buffer *first = NULL;
    for (uint32_t i = 0; i < n->count; i++)
        if (n->buffers[i].done && (!first || (int32_t)(n->buffers[i].sequence - first->sequence) < 0))
            first = &n->buffers[i];
    return first;
}

static int produce(fake *f, fake_node *n) {
    int produced = 0;
    for (uint32_t left = n->burst ? n->burst : 1, i = 0; i < n->count && left; i++)
        if (n->buffers[i].queued) {
            finish_buffer(f, n, &n->buffers[i]);
            left--;
            produced = 1;
        }
    n->burst = 0;
    return produced;
}

static int fake_poll(void *user, int fd, int timeout_ms, int *events) {
    fake *f = user;
    int error = planned_fault(f, 2);
    *events = 0;
    assert_true(timeout_ms >= 0 && timeout_ms <= 10000);
    if (f->interruptions) {
        f->interruptions--;
        pass_time(f, ms);
        error = EINTR;
    }
    if (error) return fail_with(error);
    fake_node *n = node_of(f, fd);
    if (n && n->streaming && !n->failed && !n->mute && !first_done(n) && timeout_ms >= FRAME_MS) {
        pass_time(f, FRAME_MS * ms);
        n = node_of(f, fd);
        if (n && produce(f, n)) timeout_ms = 0;
    }
    if (!n || !n->streaming || n->failed) {
        *events = POLLERR | POLLIN;
        return 1;
    }
    if (first_done(n) || n->no_wait) {
        *events = POLLIN;
        return 1;
    }
    int64_t until = f->now_ns + timeout_ms * ms;
    while (f->now_ns < until && (n = node_of(f, fd)) != NULL) pass_time(f, ms);
    if (n) return 0;
    *events = POLLERR | POLLHUP;
    return 1;
}

static int get_capability(const fake_node *n, struct v4l2_capability *c) {
    snprintf((char *)c->card, sizeof c->card, "%s", n->card);
    snprintf((char *)c->bus_info, sizeof c->bus_info, "%s", n->bus);
    c->device_caps = V4L2_CAP_STREAMING;
    if (n->formats[0].fourcc)
        c->device_caps |= n->multi ? V4L2_CAP_VIDEO_CAPTURE_MPLANE : V4L2_CAP_VIDEO_CAPTURE;
    c->capabilities = c->device_caps | V4L2_CAP_DEVICE_CAPS | V4L2_CAP_VIDEO_CAPTURE; /* of all its nodes */
    return 0;
}

static int list_format(const fake_node *n, struct v4l2_fmtdesc *e) {
    if (e->index >= COUNT(n->formats) || !n->formats[e->index].fourcc) return fail_with(EINVAL);
    e->pixelformat = n->formats[e->index].fourcc;
    return 0;
}

static const fake_format *format_of(const fake_node *n, uint32_t fourcc) {
    for (size_t i = 0; i < COUNT(n->formats); i++)
        if (n->formats[i].fourcc == fourcc) return &n->formats[i];
    return NULL;
}

static int list_size(const fake_node *n, struct v4l2_frmsizeenum *e) {
    const fake_format *format = format_of(n, e->pixel_format);
    if (!format || e->index >= COUNT(format->sizes) || !format->sizes[e->index].width)
        return fail_with(EINVAL);
    e->type = V4L2_FRMSIZE_TYPE_DISCRETE;
    e->discrete.width = format->sizes[e->index].width;
    e->discrete.height = format->sizes[e->index].height;
    if (e->discrete.width != 1) return 0;
    e->type = V4L2_FRMSIZE_TYPE_STEPWISE; /* for the size 1 */
    e->stepwise = (struct v4l2_frmsize_stepwise){16, 128, 16, 8, 96, 8};
    return 0;
}

static int list_rate(const fake_node *n, struct v4l2_frmivalenum *e) {
    const fake_format *format = format_of(n, e->pixel_format);
    for (size_t i = 0; format && e->index < 2 && i < COUNT(format->sizes); i++) {
        const fake_size *s = &format->sizes[i];
        if ((s->width != e->width || s->height != e->height) && s->width != 1) continue;
        if (!s->fps) break;
        e->type = V4L2_FRMIVAL_TYPE_DISCRETE;
        e->discrete = (struct v4l2_fract){1 + e->index, s->fps}; /* and half of it */
        return 0;
    }
    return fail_with(EINVAL);
}

static void tell_format(const fake_node *n, struct v4l2_format *f) {
    if (n->multi) {
        struct v4l2_pix_format_mplane *p = &f->fmt.pix_mp;
        *p = (struct v4l2_pix_format_mplane){.width = n->width,
                                             .height = n->height,
                                             .pixelformat = n->fourcc,
                                             .field = n->field,
                                             .colorspace = n->colorspace,
                                             .num_planes = (uint8_t)n->planes};
        p->ycbcr_enc = (uint8_t)n->ycbcr_enc;
        p->quantization = (uint8_t)n->quantization;
        for (uint32_t k = 0; k < n->planes; k++) {
            p->plane_fmt[k].bytesperline = memory_stride(n, k);
            p->plane_fmt[k].sizeimage = memory_bytes(n, k);
        }
        return;
    }
    f->fmt.pix = (struct v4l2_pix_format){.width = n->width,
                                          .height = n->height,
                                          .pixelformat = n->fourcc,
                                          .field = n->field,
                                          .bytesperline = memory_stride(n, 0),
                                          .sizeimage = memory_bytes(n, 0),
                                          .colorspace = n->colorspace,
                                          .priv = V4L2_PIX_FMT_PRIV_MAGIC,
                                          .quantization = n->quantization};
    f->fmt.pix.ycbcr_enc = n->ycbcr_enc;
}

/* What is not offered becomes the first that is. */
static int take_format(fake_node *n, struct v4l2_format *f) {
    uint32_t fourcc = n->multi ? f->fmt.pix_mp.pixelformat : f->fmt.pix.pixelformat;
    if (n->maps) return fail_with(EBUSY);
    const fake_format *format = format_of(n, n->other_fourcc ? n->other_fourcc : fourcc);
    if (!format) format = &n->formats[0];
    n->fourcc = format->fourcc;
    n->planes = format->planes;
    n->width = n->multi ? f->fmt.pix_mp.width : f->fmt.pix.width;
    n->height = n->multi ? f->fmt.pix_mp.height : f->fmt.pix.height;
    if (n->other.width) n->width = n->other.width, n->height = n->other.height;
    tell_format(n, f);
    return 0;
}

static int take_rate(fake_node *n, struct v4l2_streamparm *p, int set) {
    struct v4l2_fract *t = &p->parm.capture.timeperframe;
    if (set && t->numerator) n->fps = t->denominator / t->numerator;
    *t = (struct v4l2_fract){1, n->fps};
    return 0;
}

static int give_buffers(fake_node *n, struct v4l2_requestbuffers *r) {
    if (n->maps) return fail_with(EBUSY);
    if (r->count > n->most_buffers) r->count = n->most_buffers;
    n->count = r->count;
    memset(n->buffers, 0, sizeof n->buffers);
    return 0;
}

static int tell_buffer(const fake_node *n, struct v4l2_buffer *q) {
    if (q->index >= n->count) return fail_with(EINVAL);
    uint32_t place = q->index * 65536;
    if (!n->multi) {
        q->length = memory_bytes(n, 0);
        q->m.offset = place;
        return 0;
    }
    assert_true(q->length >= n->planes);
    q->length = n->planes;
    for (uint32_t k = 0; k < n->planes; k++) {
        q->m.planes[k].length = memory_bytes(n, k);
        q->m.planes[k].m.mem_offset = place + k * 16384;
    }
    return 0;
}

static int queue_buffer(fake *f, fake_node *n, const struct v4l2_buffer *q) {
    if (q->index >= n->count || n->buffers[q->index].queued || n->buffers[q->index].done)
        return fail_with(EINVAL);
    n->buffers[q->index].queued = 1;
    f->queued++;
    return 0;
}

static int dequeue_buffer(fake_node *n, struct v4l2_buffer *q) {
    if (n->failed) return fail_with(EIO);
    fake_buffer *b = first_done(n);
    if (!n->streaming) return fail_with(EINVAL);
    if (!b) return fail_with(EAGAIN);
    b->done = 0;
    q->index = (uint32_t)(b - n->buffers);
    q->sequence = b->sequence;
    q->flags = b->flags;
    q->timestamp.tv_sec = (time_t)(b->time_ns / 1000000000);
    q->timestamp.tv_usec = (suseconds_t)(b->time_ns % 1000000000 / 1000);
    q->bytesused = (uint32_t)b->used[0];
    for (uint32_t k = 0; n->multi && k < n->planes; k++) {
        q->m.planes[k].bytesused = (uint32_t)b->used[k];
        q->m.planes[k].data_offset = n->data_offset;
    }
    return 0;
}

static int stream(fake_node *n, int on) {
    for (uint32_t i = 0; i < n->count && !on; i++) n->buffers[i].queued = n->buffers[i].done = 0;
    n->streaming = on;
    n->failed = on ? n->failed : 0;
    n->sequence = on ? n->sequence : 0;
    return 0;
}

static fake_control *control_of(fake_node *n, uint32_t id) {
    for (size_t i = 0; i < COUNT(n->controls); i++)
        if (n->controls[i].id && n->controls[i].id == id) return &n->controls[i];
    return NULL;
}

static fake_control *control_after(fake_node *n, uint32_t id) {
    fake_control *next = NULL;
    for (size_t i = 0; i < COUNT(n->controls); i++)
        if (n->controls[i].id > id && (!next || n->controls[i].id < next->id)) next = &n->controls[i];
    return next;
}

static int tell_control(fake_node *n, struct v4l2_queryctrl *q) {
    uint32_t id = q->id & ~V4L2_CTRL_FLAG_NEXT_CTRL;
    const fake_control *c = q->id & V4L2_CTRL_FLAG_NEXT_CTRL ? control_after(n, id) : control_of(n, id);
    if (!c) return fail_with(EINVAL);
    q->id = c->id;
    q->type = c->type;
    q->minimum = c->least;
    q->maximum = c->most;
    snprintf((char *)q->name, sizeof q->name, "%s", c->name);
    return 0;
}

static int tell_entry(fake_node *n, struct v4l2_querymenu *q) {
    const fake_control *c = control_of(n, q->id);
    if (!c || !c->menu || (int32_t)q->index > c->most || !c->menu[q->index]) return fail_with(EINVAL);
    snprintf((char *)q->name, sizeof q->name, "%s", c->menu[q->index]);
    return 0;
}

static int take_control(fake_node *n, struct v4l2_control *v, int set) {
    fake_control *c = control_of(n, v->id);
    if (!c) return fail_with(EINVAL);
    if (set) c->value = v->value;
    v->value = c->value;
    return 0;
}

static int take_input(fake_node *n, int *input, int set) {
    if (set && *input > 1) return fail_with(EINVAL);
    if (set) n->input = (uint32_t)*input;
    *input = (int)n->input;
    return 0;
}

static int list_input(const fake_node *n, struct v4l2_input *e) {
    if (e->index > 1) return fail_with(EINVAL);
    e->status = n->input_status;
    return 0;
}

static int list_timings(struct v4l2_enum_dv_timings *e) {
    static const uint32_t sizes[3][3] = {
        {128, 96, 1}, {128, 96, 0}, {64, 48, 0}}; /* the first is interlaced */
    if (e->index >= 3) return fail_with(EINVAL);
    e->timings.bt.width = sizes[e->index][0];
    e->timings.bt.height = sizes[e->index][1];
    e->timings.bt.interlaced = sizes[e->index][2];
    return 0;
}

/* The picture becomes what the timings are. */
static int take_timings(fake_node *n, const struct v4l2_dv_timings *t) {
    assert_false(t->bt.interlaced);
    n->width = t->bt.width;
    n->height = t->bt.height;
    return 0;
}

static int export_buffer(fake *f, const fake_node *n, struct v4l2_exportbuffer *e) {
    if (!n->exports) return fail_with(ENOTTY);
    e->fd = new_fd(f, NODES, 0);
    return 0;
}

static int fake_ioctl(void *user, int fd, unsigned long request, void *arg) {
    fake *f = user;
    int error = planned_fault(f, request);
    fake_node *n = node_of(f, fd);
    if (!n) return fail_with(ENODEV);
    if (error) return fail_with(error);
    switch (request) {
    case VIDIOC_QUERYCAP:
        return get_capability(n, arg);
    case VIDIOC_ENUM_FMT:
        return list_format(n, arg);
    case VIDIOC_ENUM_FRAMESIZES:
        return list_size(n, arg);
    case VIDIOC_ENUM_FRAMEINTERVALS:
        return list_rate(n, arg);
    case VIDIOC_G_FMT:
        tell_format(n, arg);
        return 0;
    case VIDIOC_S_FMT:
        return take_format(n, arg);
    case VIDIOC_G_PARM:
    case VIDIOC_S_PARM:
        return take_rate(n, arg, request == VIDIOC_S_PARM);
    case VIDIOC_REQBUFS:
        return give_buffers(n, arg);
    case VIDIOC_QUERYBUF:
        return tell_buffer(n, arg);
    case VIDIOC_QBUF:
        return queue_buffer(f, n, arg);
    case VIDIOC_DQBUF:
        return dequeue_buffer(n, arg);
    case VIDIOC_EXPBUF:
        return export_buffer(f, n, arg);
    case VIDIOC_STREAMON:
        return stream(n, 1);
    case VIDIOC_STREAMOFF:
        return stream(n, 0);
    case VIDIOC_QUERYCTRL:
        return tell_control(n, arg);
    case VIDIOC_QUERYMENU:
        return tell_entry(n, arg);
    case VIDIOC_G_CTRL:
    case VIDIOC_S_CTRL:
        return take_control(n, arg, request == VIDIOC_S_CTRL);
    case VIDIOC_G_INPUT:
    case VIDIOC_S_INPUT:
        return take_input(n, arg, request == VIDIOC_S_INPUT);
    case VIDIOC_ENUMINPUT:
        return list_input(n, arg);
    case VIDIOC_ENUM_DV_TIMINGS:
        return list_timings(arg);
    case VIDIOC_S_DV_TIMINGS:
        return take_timings(n, arg);
    default:
        return fail_with(ENOTTY);
    }
}

static void *fake_map(void *user, int fd, size_t offset, size_t length) {
    fake *f = user;
    int error = planned_fault(f, 3);
    fake_node *n = node_of(f, fd);
    if (!n) error = ENODEV;
    if (error) {
        errno = error;
        return NULL;
    }
    size_t index = offset / 65536, plane = offset % 65536 / 16384;
    assert_true(index < n->count && plane < n->planes && length == memory_bytes(n, (uint32_t)plane));
    f->maps++;
    n->maps++;
    n->buffers[index].memory[plane] = malloc(length);
    assert_non_null(n->buffers[index].memory[plane]);
    return n->buffers[index].memory[plane];
}

static int fake_unmap(void *user, void *memory, size_t length) {
    fake *f = user;
    assert_true(length > 0);
    f->maps--;
    for (int i = 0; i < NODES; i++)
        for (int b = 0; b < BUFFERS; b++)
            for (int k = 0; k < PLANES; k++)
                if (f->nodes[i].buffers[b].memory[k] == memory) {
                    f->nodes[i].buffers[b].memory[k] = NULL;
                    f->nodes[i].maps--;
                }
    free(memory);
    return 0;
}

static size_t fake_list(void *user, int *numbers, size_t most) {
    const fake *f = user;
    size_t count = 0;
    for (int i = 0; i < NODES && count < most; i++)
        if (f->nodes[i].plugged) numbers[count++] = i;
    return count;
}

static void fake_identify(void *user, int fd, char *serial, size_t size, int *index) {
    const fake_node *n = node_of(user, fd);
    snprintf(serial, size, "%s", n ? n->serial : "");
    *index = n ? n->index : 0;
}

static int64_t fake_now(void *user) { return ((fake *)user)->now_ns; }

static void fake_sleep(void *user, int sleep_ms) {
    assert_true(sleep_ms > 0 && sleep_ms <= 10000);
    for (int i = 0; i < sleep_ms; i++) pass_time(user, ms);
}

/* 2. What the tests share */

typedef struct bench {
    fake driver;
    sf_v4l2_sys sys;
    sf_context *ctx;
    sf_source *source;
} bench;

static bench *bench_start(void) {
    static bench b;
    fake_init(&b.driver);
    b.sys = (sf_v4l2_sys){&b.driver,  fake_open, fake_close,    fake_ioctl, fake_poll, fake_map,
                          fake_unmap, fake_list, fake_identify, fake_now,   fake_sleep};
    b.ctx = test_context_threads(1);
    b.source = NULL;
    test_log_clear();
    return &b;
}

static sf_status try_open(bench *b, const char *name) {
    b->source = sf_calloc(b->ctx, 1, sizeof *b->source);
    if (!b->source) return SF_ERR_MEMORY;
    b->source->ctx = b->ctx;
    sf_status status = sf_v4l2_open_with(b->ctx, &b->sys, name, b->source);
    if (status == SF_OK) return status;
    sf_free(b->ctx, b->source);
    b->source = NULL;
    return status;
}

static void open_source(bench *b, const char *name) { assert_ok(b->ctx, try_open(b, name)); }

/* Closes the source; nothing of it may be left. */
static void close_source(bench *b) {
    sf_source_close(&b->source);
    assert_int_equal(b->driver.fds_open, 0);
    assert_int_equal(b->driver.maps, 0);
}

static void bench_end(bench *b) {
    close_source(b);
    sf_context_destroy(&b->ctx);
}

static sf_frame next_frame(bench *b) {
    sf_frame frame;
    assert_ok(b->ctx, sf_source_next(b->source, 1000, &frame));
    return frame;
}

/* Takes a frame and gives it back. */
static uint64_t pass_frame(bench *b) {
    sf_frame frame = next_frame(b);
    uint64_t sequence = frame.sequence;
    sf_source_release(b->source, &frame);
    return sequence;
}

static sf_source_counts counts_of(const bench *b) {
    sf_source_counts counts;
    sf_source_count(b->source, &counts);
    return counts;
}

static void assert_counts(const bench *b, uint64_t skipped, uint64_t dropped, uint64_t damaged,
                          uint64_t reopened) {
    sf_source_counts c = counts_of(b);
    assert_int_equal(c.skipped, skipped);
    assert_int_equal(c.dropped, dropped);
    assert_int_equal(c.damaged, damaged);
    assert_int_equal(c.reopened, reopened);
}

static void assert_refused(bench *b, const char *name, sf_status status, const char *part) {
    assert_status(b->ctx, try_open(b, name), status);
    assert_error_names(b->ctx, part);
    assert_int_equal(b->driver.fds_open, 0);
    assert_int_equal(b->driver.maps, 0);
}

/* The first and the last byte of each row of a plane are the driver's. */
static void assert_plane(const sf_frame *frame, int plane, uint32_t memory, size_t offset, size_t stride,
                         size_t row_bytes, size_t rows) {
    assert_non_null(frame->plane[plane]);
    assert_int_equal(frame->stride[plane], stride);
    for (size_t y = 0; y < rows; y++)
        for (size_t x = 0; x < row_bytes; x += row_bytes - 1)
            assert_int_equal(frame->plane[plane][y * stride + x],
                             frame_byte((uint32_t)frame->sequence, memory, offset + y * stride + x));
}

/* 3. Frames */

/* Each format, in one plane of memory or several, with rows as long as they need be and longer. */
static void test_formats(void **state) {
    (void)state;
    static const struct {
        uint32_t fourcc, planes;
        int multi; /* 2: on both kinds of nodes */
        sf_pixel_format format;
        const char *name;
        size_t row[PLANES], rows[PLANES];
    } cases[] = {
        {V4L2_PIX_FMT_YUYV, 1, 2, SF_PIXEL_YUYV, "yuyv", {128}, {48}},
        {V4L2_PIX_FMT_UYVY, 1, 2, SF_PIXEL_UYVY, "UYVY", {128}, {48}},
        {V4L2_PIX_FMT_RGB24, 1, 2, SF_PIXEL_RGB24, "RGB3", {192}, {48}},
        {V4L2_PIX_FMT_BGR24, 1, 2, SF_PIXEL_BGR24, "BGR24", {192}, {48}},
        {V4L2_PIX_FMT_GREY, 1, 2, SF_PIXEL_GREY, "grey", {64}, {48}},
        {V4L2_PIX_FMT_NV12, 1, 2, SF_PIXEL_NV12, "NV12", {64, 64}, {48, 24}},
        {V4L2_PIX_FMT_YUV420, 1, 2, SF_PIXEL_YU12, "YUV420", {64, 32, 32}, {48, 24, 24}},
        {V4L2_PIX_FMT_YUV422P, 1, 2, SF_PIXEL_422P, "422P", {64, 32, 32}, {48, 48, 48}},
        {V4L2_PIX_FMT_NV12M, 2, 1, SF_PIXEL_NV12, "NV12", {64, 64}, {48, 24}},
        {V4L2_PIX_FMT_NV12M, 2, 1, SF_PIXEL_NV12, "NV12M", {64, 64}, {48, 24}},
        {V4L2_PIX_FMT_YUV420M, 3, 1, SF_PIXEL_YU12, "YM12", {64, 32, 32}, {48, 24, 24}},
        {V4L2_PIX_FMT_YUV422M, 3, 1, SF_PIXEL_422P, "YM16", {64, 32, 32}, {48, 48, 48}},
        {V4L2_PIX_FMT_YUV444M, 3, 1, SF_PIXEL_444P, "444P", {64, 64, 64}, {48, 48, 48}},
    };
    for (size_t i = 0; i < 4 * COUNT(cases); i++) {
        size_t which = i / 4, padding = i & 1 ? 16 : 0;
        int multi = i & 2 ? 1 : 0;
        if (cases[which].multi != 2 && cases[which].multi != multi) continue;
        bench *b = bench_start();
        fake_node *n = &b->driver.nodes[0];
        char name[64];
        n->multi = multi;
        n->padding = (uint32_t)padding;
        n->data_offset = multi ? 24 : 0;
        set_format(n, cases[which].fourcc, cases[which].planes);
        snprintf(name, sizeof name, "v4l2:/dev/video0?size=64x48&format=%s", cases[which].name);
        open_source(b, name);
        for (uint64_t k = 0; k < 6; k++) {
            sf_frame frame = next_frame(b);
            size_t offset = 0;
            assert_int_equal(frame.sequence, k);
            assert_int_equal(frame.format, cases[which].format);
            assert_int_equal(frame.width, 64);
            assert_int_equal(frame.height, 48);
            assert_int_equal(frame.dmabuf, -1);
            for (int p = 0; p < PLANES; p++) {
                size_t row = cases[which].row[p], stride = row + padding;
                if (!row) {
                    assert_null(frame.plane[p]);
                    continue;
                }
                int together = cases[which].planes == 1;
                if (together && p && row < 64) stride = (64 + padding) / 2;
                assert_plane(&frame, p, together ? 0 : (uint32_t)p, together ? offset : 0, stride, row,
                             cases[which].rows[p]);
                offset += stride * cases[which].rows[p];
            }
            sf_source_release(b->source, &frame);
        }
        assert_counts(b, 0, 0, 0, 0);
        bench_end(b);
    }
}

static void test_describe(void **state) {
    (void)state;
    bench *b = bench_start();
    sf_source_info info;
    open_source(b, "v4l2:0?fps=10&format=YUYV");
    sf_source_describe(b->source, &info);
    assert_int_equal(info.width, 64);
    assert_int_equal(info.height, 48);
    assert_int_equal(info.format, SF_PIXEL_YUYV);
    assert_true(info.frames_per_second == 10);
    assert_int_equal(info.frames, 0);
    assert_true(info.live && !info.has_poses);
    test_assert_contains(info.name, "Webcam", __FILE__, __LINE__);
    sf_frame a = next_frame(b), c = next_frame(b);
    assert_true(a.time_ns == 1000 * ms + FRAME_MS * ms);
    assert_true(c.time_ns == a.time_ns + FRAME_MS * ms);
    bench_end(b); /* with both still out */

    b = bench_start();
    b->driver.nodes[0].no_clock = 1;
    open_source(b, "v4l2:/dev/video0?format=YUYV");
    a = next_frame(b);
    assert_true(a.time_ns == b->driver.now_ns);
    bench_end(b);
}

/* What is chosen where no format is asked for. */
static void test_choice(void **state) {
    (void)state;
    static const struct {
        fake_format formats[4];
        const char *options;
        uint32_t fourcc, fps;
    } cases[] = {
        {{{0}}, "size=64x48", V4L2_PIX_FMT_YUYV, 25},
        {{{0}}, "", V4L2_PIX_FMT_YUYV, 25},
        {{{0}}, "size=128x96", V4L2_PIX_FMT_MJPEG, 25}, /* 5 frames a second are too few */
        {{{0}}, "size=128x96&fps=5", V4L2_PIX_FMT_YUYV, 5},
        {{{0}}, "size=128x96&fps=10", V4L2_PIX_FMT_MJPEG, 10},
        {{{0}}, "size=64x48&fps=60", V4L2_PIX_FMT_YUYV, 60}, /* neither can */
        {{{0}}, "format=MJPEG", V4L2_PIX_FMT_MJPEG, 25},
        {{{V4L2_PIX_FMT_GREY, 1, {{64, 48, 90}}}, {V4L2_PIX_FMT_YUYV, 1, {{64, 48, 9}}}},
         "",
         V4L2_PIX_FMT_YUYV,
         25},
        {{{V4L2_PIX_FMT_H264, 1, {{64, 48, 90}}}, {V4L2_PIX_FMT_GREY, 1, {{64, 48, 9}}}},
         "",
         V4L2_PIX_FMT_GREY,
         25},
        {{{V4L2_PIX_FMT_RGB24, 1, {{64, 48, 30}}}, {V4L2_PIX_FMT_NV12, 1, {{64, 48, 30}}}},
         "",
         V4L2_PIX_FMT_NV12,
         25},
        {{{V4L2_PIX_FMT_UYVY, 1, {{64, 48, 5}}}, {V4L2_PIX_FMT_NV12, 1, {{64, 48, 10}}}},
         "",
         V4L2_PIX_FMT_NV12,
         25},
        {{{V4L2_PIX_FMT_UYVY, 1, {{0}}}, {V4L2_PIX_FMT_NV12, 1, {{0}}}}, "", V4L2_PIX_FMT_UYVY, 25},
        {{{V4L2_PIX_FMT_YUYV, 1, {{1, 1, 30}}}}, "size=48x40", V4L2_PIX_FMT_YUYV, 25},
    };
    for (size_t i = 0; i < COUNT(cases); i++) {
        bench *b = bench_start();
        fake_node *n = &b->driver.nodes[0];
        char name[64];
        if (cases[i].formats[0].fourcc) {
            memset(n->formats, 0, sizeof n->formats);
            memcpy(n->formats, cases[i].formats, sizeof cases[i].formats);
        }
        snprintf(name, sizeof name, "v4l2:0%s%s", *cases[i].options ? "?" : "", cases[i].options);
        open_source(b, name);
        assert_int_equal(n->fourcc, cases[i].fourcc);
        assert_int_equal(n->fps, cases[i].fps);
        bench_end(b);
    }
}

static void test_refused(void **state) {
    (void)state;
    static const struct {
        const char *name, *part;
        sf_status status;
    } cases[] = {
        {"v4l2:", "names no device", SF_ERR_ARGUMENT},
        {"v4l2:?size=64x48", "names no device", SF_ERR_ARGUMENT},
        {"v4l2:1", "/dev/video1: cannot be opened: No such file", SF_ERR_IO},
        {"v4l2:/dev/null", "/dev/null: cannot be opened", SF_ERR_IO},
        {"v4l2:0?colour=1", "unknown option \"colour\"", SF_ERR_ARGUMENT},
        {"v4l2:0?size=64", "size: \"64\" is not WIDTHxHEIGHT", SF_ERR_ARGUMENT},
        {"v4l2:0?size=64x", "size: \"64x\"", SF_ERR_ARGUMENT},
        {"v4l2:0?size=64x48x2", "size: \"64x48x2\"", SF_ERR_ARGUMENT},
        {"v4l2:0?size=0x48", "size: \"0x48\"", SF_ERR_ARGUMENT},
        {"v4l2:0?size=-64x48", "size: \"-64x48\"", SF_ERR_ARGUMENT},
        {"v4l2:0?size=99999x48", "size: \"99999x48\"", SF_ERR_ARGUMENT},
        {"v4l2:0?size=63x48", "size: 63x48 cannot be had; MJPG has: 64x48, 128x96", SF_ERR_UNSUPPORTED},
        {"v4l2:0?size=63x48&format=YUYV", "YUYV has: 64x48, 128x96", SF_ERR_UNSUPPORTED},
        {"v4l2:0?format=NV12", "format: NV12 is not offered; offered: MJPG, YUYV, H264", SF_ERR_UNSUPPORTED},
        {"v4l2:0?format=H264", "format: \"H264\" is none that splatfit reads: YUYV", SF_ERR_ARGUMENT},
        {"v4l2:0?fps=-1", "fps: -1 is not", SF_ERR_ARGUMENT},
        {"v4l2:0?buffers=1", "buffers: 1 is not", SF_ERR_ARGUMENT},
        {"v4l2:0?buffers=33", "buffers: 33 is not", SF_ERR_ARGUMENT},
        {"v4l2:0?input=2", "input: 2 is not there; there are 2", SF_ERR_UNSUPPORTED},
        {"v4l2:0?timings=1x1", "timings: the input has none of 1x1", SF_ERR_UNSUPPORTED},
        {"v4l2:0?timings=hd", "timings: \"hd\" is neither", SF_ERR_ARGUMENT},
        {"v4l2:0?timings=auto", "timings: auto: none are found", SF_ERR_IO},
        {"v4l2:0?exposure=manual:2", "exposure: 2: \"Exposure Time, Absolute\" is from 3 to 2047",
         SF_ERR_ARGUMENT},
        {"v4l2:0?exposure=bright", "exposure: \"bright\" is neither", SF_ERR_ARGUMENT},
        {"v4l2:0?exposure=manual:", "exposure: \"\" is neither", SF_ERR_ARGUMENT},
        {"v4l2:0?gain=101", "gain: 101: \"Gain\" is from 0 to 100", SF_ERR_ARGUMENT},
        {"v4l2:0?gain=auto", "no control \"Gain, Automatic\"; it has: \"Brightness\", ", SF_ERR_UNSUPPORTED},
        {"v4l2:0?focus=3", "focus: the camera has no control \"Focus, Absolute\"", SF_ERR_UNSUPPORTED},
        {"v4l2:0?focus=auto", "focus: the camera has no control", SF_ERR_UNSUPPORTED},
        {"v4l2:0?white_balance=99999", "white_balance: 99999: ", SF_ERR_ARGUMENT},
        {"v4l2:0?ctrl.sharpness=1", "no control \"sharpness\"; it has: \"Brightness\"", SF_ERR_UNSUPPORTED},
        {"v4l2:0?ctrl.=1", "no control \"\"", SF_ERR_UNSUPPORTED},
        {"v4l2:0?ctrl.brightness=65", "ctrl.brightness: 65: \"Brightness\" is from -64 to 64",
         SF_ERR_ARGUMENT},
        {"v4l2:0?ctrl.brightness=dark", "ctrl.brightness: \"dark\" is neither", SF_ERR_ARGUMENT},
        {"v4l2:0?ctrl.brightness", "ctrl.brightness: \"\" is neither", SF_ERR_ARGUMENT},
        {"v4l2:0?ctrl.auto_exposure=2", "ctrl.auto_exposure: 2: ", SF_ERR_ARGUMENT},
    };
    bench *b = bench_start();
    for (size_t i = 0; i < COUNT(cases); i++)
        assert_refused(b, cases[i].name, cases[i].status, cases[i].part);
    plan_fault(&b->driver, 1, EACCES, 1);
    assert_refused(b, "v4l2:0", SF_ERR_IO, "is the user in the group video?");
    plan_fault(&b->driver, VIDIOC_S_FMT, EBUSY, 1);
    assert_refused(b, "v4l2:0", SF_ERR_IO, "/dev/video0: format: Device or resource busy: in use by another");
    plan_fault(&b->driver, VIDIOC_QUERYCAP, ENOTTY, 1);
    assert_refused(b, "v4l2:0", SF_ERR_UNSUPPORTED, "/dev/video0: is no V4L2 device");
    plan_fault(&b->driver, VIDIOC_STREAMON, ENOSPC, 1);
    assert_refused(b, "v4l2:0", SF_ERR_IO, "more than the bus carries");
    bench_end(b);
}

/* The driver's own mind: sizes, strides, buffers, fields, formats. */
static void test_driver_gives_other(void **state) {
    (void)state;
    bench *b = bench_start();
    fake_node *n = &b->driver.nodes[0];
    n->other = (fake_size){128, 96, 0};
    assert_refused(b, "v4l2:0?size=64x48", SF_ERR_UNSUPPORTED,
                   "size: 64x48 cannot be had (the driver gives 128x96); YUYV has: 64x48");
    open_source(b, "v4l2:0?format=YUYV"); /* no size was asked for */
    sf_frame frame = next_frame(b);
    assert_int_equal(frame.width, 128);
    assert_plane(&frame, 0, 0, 0, 256, 256, 96);
    sf_source_release(b->source, &frame);
    close_source(b);
    n->other.width = 0;
    n->width = 64, n->height = 48;

    n->missing_bytes = 1;
    assert_refused(b, "v4l2:0?format=YUYV", SF_ERR_UNSUPPORTED, "sizeimage: 6143 bytes");
    n->missing_bytes = 0;
    n->padding = (uint32_t)-2;
    assert_refused(b, "v4l2:0?format=YUYV", SF_ERR_UNSUPPORTED, "stride: 126 bytes are too few");
    n->padding = 0;
    n->most_buffers = 1;
    assert_refused(b, "v4l2:0?format=YUYV", SF_ERR_UNSUPPORTED, "buffers: the driver gives 1, 2 are needed");
    n->most_buffers = 2;
    open_source(b, "v4l2:0?format=YUYV&buffers=4");
    assert_int_equal(n->count, 2);
    for (uint64_t i = 0; i < 5; i++) assert_int_equal(pass_frame(b), i);
    close_source(b);
    n->most_buffers = BUFFERS;
    n->other_fourcc = V4L2_PIX_FMT_MJPEG;
    assert_refused(b, "v4l2:0?format=YUYV", SF_ERR_UNSUPPORTED, "format: the driver gives MJPG instead");
    n->other_fourcc = V4L2_PIX_FMT_H264;
    assert_refused(b, "v4l2:0", SF_ERR_UNSUPPORTED, "format: the driver gives H264 instead");
    n->other_fourcc = 0;
    n->field = V4L2_FIELD_ALTERNATE;
    assert_refused(b, "v4l2:0", SF_ERR_UNSUPPORTED, "field: 7");
    n->field = V4L2_FIELD_INTERLACED;
    open_source(b, "v4l2:0");
    test_assert_contains(test_log, "interlaced", __FILE__, __LINE__);
    close_source(b);
    memset(n->formats, 0, sizeof n->formats);
    assert_refused(b, "v4l2:0", SF_ERR_UNSUPPORTED, "is no camera that streams");
    bench_end(b);
}

static void test_input(void **state) {
    (void)state;
    bench *b = bench_start();
    fake_node *n = &b->driver.nodes[0];
    n->input_status = V4L2_IN_ST_NO_SIGNAL;
    open_source(b, "v4l2:0?input=1&timings=128x96&format=YUYV");
    assert_int_equal(n->input, 1);
    assert_int_equal(next_frame(b).width, 128);
    test_assert_contains(test_log, "the input has no signal", __FILE__, __LINE__);
    bench_end(b);
}

static void test_colors(void **state) {
    (void)state;
    static const struct {
        uint32_t colorspace, encoding, range;
        sf_yuv_matrix matrix;
        int full;
    } cases[] = {
        {V4L2_COLORSPACE_SRGB, 0, 0, SF_YUV_601, 0},
        {V4L2_COLORSPACE_DEFAULT, 0, 0, SF_YUV_601, 0},
        {V4L2_COLORSPACE_JPEG, 0, 0, SF_YUV_601, 1},
        {V4L2_COLORSPACE_REC709, 0, 0, SF_YUV_709, 0},
        {V4L2_COLORSPACE_BT2020, 0, 0, SF_YUV_2020, 0},
        {V4L2_COLORSPACE_SMPTE170M, 0, V4L2_QUANTIZATION_FULL_RANGE, SF_YUV_601, 1},
        {V4L2_COLORSPACE_SRGB, V4L2_YCBCR_ENC_709, V4L2_QUANTIZATION_LIM_RANGE, SF_YUV_709, 0},
        {V4L2_COLORSPACE_JPEG, V4L2_YCBCR_ENC_BT2020, V4L2_QUANTIZATION_LIM_RANGE, SF_YUV_2020, 0},
        {V4L2_COLORSPACE_SMPTE240M, 0, 0, SF_YUV_709, 0},
    };
    for (size_t i = 0; i < 2 * COUNT(cases); i++) {
        bench *b = bench_start();
        fake_node *n = &b->driver.nodes[0];
        n->multi = i & 1;
        n->colorspace = cases[i / 2].colorspace;
        n->ycbcr_enc = cases[i / 2].encoding;
        n->quantization = cases[i / 2].range;
        open_source(b, "v4l2:0?format=YUYV");
        sf_frame frame = next_frame(b);
        assert_int_equal(frame.matrix, cases[i / 2].matrix);
        assert_int_equal(frame.full_range, cases[i / 2].full);
        bench_end(b);
    }
}

static void test_limited_rgb(void **state) {
    (void)state;
    static const uint32_t ranges[] = {0, V4L2_QUANTIZATION_FULL_RANGE, V4L2_QUANTIZATION_LIM_RANGE};
    for (size_t i = 0; i < COUNT(ranges); i++) {
        bench *b = bench_start();
        fake_node *n = &b->driver.nodes[0];
        n->colorspace = V4L2_COLORSPACE_SRGB;
        n->quantization = ranges[i];
        open_source(b, "v4l2:0?format=YUYV");
        assert_int_equal(next_frame(b).limited_rgb, 0);
        close_source(b);
        set_format(n, V4L2_PIX_FMT_RGB24, 1);
        open_source(b, "v4l2:0?format=RGB24");
        assert_int_equal(next_frame(b).limited_rgb, i == 2);
        bench_end(b);
    }
}

static int32_t control_value(bench *b, uint32_t id) { return control_of(&b->driver.nodes[0], id)->value; }

static void assert_chooses(bench *b, int exposure, int white) {
    assert_int_equal(control_value(b, V4L2_CID_EXPOSURE_AUTO), exposure ? 3 : 1);
    assert_int_equal(control_value(b, V4L2_CID_AUTO_WHITE_BALANCE), white);
}

/* What the camera chose stays as it is; what the user chose is the user's after, too. */
static void test_lock(void **state) {
    (void)state;
    bench *b = bench_start();
    sf_source_info info;
    open_source(b, "v4l2:0?exposure=auto&white_balance=auto");
    sf_source_describe(b->source, &info);
    assert_true(info.can_lock_exposure);
    int32_t time = control_value(b, V4L2_CID_EXPOSURE_ABSOLUTE);
    for (int i = 0; i < 2; i++) {
        assert_ok(b->ctx, sf_source_lock_exposure(b->source, 1));
        assert_chooses(b, 0, 0);
    }
    assert_int_equal(control_value(b, V4L2_CID_EXPOSURE_ABSOLUTE), time);
    assert_ok(b->ctx, sf_source_lock_exposure(b->source, 0));
    assert_chooses(b, 1, 1);
    close_source(b);
    open_source(b, "v4l2:0?exposure=manual:120&white_balance=auto");
    assert_ok(b->ctx, sf_source_lock_exposure(b->source, 1));
    assert_chooses(b, 0, 0);
    assert_ok(b->ctx, sf_source_lock_exposure(b->source, 0));
    assert_chooses(b, 0, 1);
    close_source(b);
    bench_end(b);
}

static void test_controls(void **state) {
    static const char *const full_menu[] = {"Auto Mode", "Manual Mode", "Shutter Priority Mode",
                                            "Aperture Priority Mode"};
    (void)state;
    bench *b = bench_start();
    open_source(b, "v4l2:0?format=YUYV");
    sf_frame frame = next_frame(b);
    assert_true(frame.exposure_s == 0); /* the camera chooses */
    assert_true(frame.gain == 7);
    assert_int_equal(control_value(b, V4L2_CID_EXPOSURE_AUTO), 3); /* left alone */
    close_source(b);

    open_source(b, "v4l2:0?format=YUYV&exposure=manual:120&gain=33&white_balance=5000&ctrl.brightness=-5");
    frame = next_frame(b);
    assert_true(frame.exposure_s > 0.01199 && frame.exposure_s < 0.01201);
    assert_true(frame.gain == 33);
    assert_int_equal(control_value(b, V4L2_CID_EXPOSURE_AUTO), 1);
    assert_int_equal(control_value(b, V4L2_CID_EXPOSURE_ABSOLUTE), 120);
    assert_int_equal(control_value(b, V4L2_CID_AUTO_WHITE_BALANCE), 0);
    assert_int_equal(control_value(b, V4L2_CID_WHITE_BALANCE_TEMPERATURE), 5000);
    assert_int_equal(control_value(b, V4L2_CID_BRIGHTNESS), -5);
    close_source(b);

    open_source(b, "v4l2:0?exposure=auto&white_balance=auto");
    assert_int_equal(control_value(b, V4L2_CID_EXPOSURE_AUTO), 3); /* the menu has no 0 */
    assert_int_equal(control_value(b, V4L2_CID_AUTO_WHITE_BALANCE), 1);
    close_source(b);

    open_source(b, "v4l2:0?ctrl.Auto Exposure=manual mode&ctrl.exposure-time_absolute=77&exposure=auto");
    assert_int_equal(control_value(b, V4L2_CID_EXPOSURE_AUTO), 1);
    assert_int_equal(control_value(b, V4L2_CID_EXPOSURE_ABSOLUTE), 77);
    close_source(b);

    control_of(&b->driver.nodes[0], V4L2_CID_EXPOSURE_AUTO)->menu = full_menu;
    open_source(b, "v4l2:0?exposure=auto");
    assert_int_equal(control_value(b, V4L2_CID_EXPOSURE_AUTO), 0);
    close_source(b);

    plan_fault(&b->driver, VIDIOC_S_CTRL, EIO, 2); /* for a moment */
    open_source(b, "v4l2:0?gain=12");
    assert_int_equal(control_value(b, V4L2_CID_GAIN), 12);
    close_source(b);
    plan_fault(&b->driver, VIDIOC_S_CTRL, EIO, -1);
    assert_refused(b, "v4l2:0?gain=13", SF_ERR_IO, "gain: \"Gain\" cannot be set to 13");
    bench_end(b);
}

static void test_dmabuf(void **state) {
    (void)state;
    bench *b = bench_start();
    b->driver.nodes[0].exports = 1;
    open_source(b, "v4l2:0?format=YUYV&dmabuf=1");
    assert_int_equal(b->driver.fds_open, 5);
    sf_frame a = next_frame(b), c = next_frame(b);
    assert_true(a.dmabuf >= 0 && c.dmabuf >= 0 && a.dmabuf != c.dmabuf);
    close_source(b);
    b->driver.nodes[0].exports = 0;
    open_source(b, "v4l2:0?format=YUYV&dmabuf=1");
    test_assert_contains(test_log, "dmabuf: the driver gives none", __FILE__, __LINE__);
    assert_int_equal(next_frame(b).dmabuf, -1);
    bench_end(b);
}

/* 4. What is lost */

static void test_sequence(void **state) {
    (void)state;
    bench *b = bench_start();
    fake_node *n = &b->driver.nodes[0];
    n->sequence = 0xfffffffd;
    open_source(b, "v4l2:0?format=YUYV");
    for (uint64_t i = 0; i < 6; i++) assert_int_equal(pass_frame(b), 0xfffffffd + i);
    assert_counts(b, 0, 0, 0, 0);
    n->drop = 5;
    assert_int_equal(pass_frame(b), 0xfffffffd + 11ull);
    assert_counts(b, 0, 5, 0, 0);
    n->sequence = 3; /* a driver that begins anew, or stands still */
    assert_int_equal(pass_frame(b), 0xfffffffd + 12ull);
    n->sequence = 3;
    assert_int_equal(pass_frame(b), 0xfffffffd + 13ull);
    assert_int_equal(pass_frame(b), 0xfffffffd + 14ull);
    assert_counts(b, 0, 5, 0, 0);
    bench_end(b);
}

static void test_damaged(void **state) {
    (void)state;
    bench *b = bench_start();
    fake_node *n = &b->driver.nodes[0];
    open_source(b, "v4l2:0?format=YUYV");
    assert_int_equal(pass_frame(b), 0);
    n->flags = V4L2_BUF_FLAG_ERROR;
    assert_int_equal(pass_frame(b), 2);
    assert_counts(b, 0, 0, 1, 0);
    n->cut = 1;
    assert_int_equal(pass_frame(b), 4);
    assert_counts(b, 0, 0, 2, 0);
    assert_int_equal(counts_of(b).given, 3);
    for (int i = 0; i < 10; i++) { /* no buffer is lost by it */
        n->cut = 1;
        pass_frame(b);
    }
    assert_counts(b, 0, 0, 12, 0);
    bench_end(b);

    b = bench_start();
    n->multi = 1;
    n->data_offset = 64;
    set_format(n, V4L2_PIX_FMT_NV12M, 2);
    open_source(b, "v4l2:0");
    n->cut = 1;
    assert_int_equal(pass_frame(b), 1);
    assert_counts(b, 0, 0, 1, 0);
    bench_end(b);
}

static void test_jpeg(void **state) {
    (void)state;
    static const struct {
        const char *data;
        size_t size, bytes; /* bytes 0: refused */
    } cases[] = {
        {"\xff\xd8 picture \xff\xd9", 13, 13},
        {"\xff\xd8 picture \xff\xd9\0\0\0", 16, 13},
        {"\xff\xd8 picture \xff\xd9 junk", 18, 13},
        {"\xff\xd8 picture \xff", 12, 0},
        {"\xff\xd8 picture ", 11, 0},
        {"\xff\xd9 picture \xff\xd9", 13, 0},
        {"\xff\xd8\xff\xd9", 4, 4},
        {"\xff\xd8\xd9", 3, 0},
        {"", 0, 0},
    };
    bench *b = bench_start();
    fake_node *n = &b->driver.nodes[0];
    uint64_t damaged = 0;
    n->jpeg = cases[0].data;
    n->jpeg_size = cases[0].size;
    open_source(b, "v4l2:0?format=MJPEG");
    for (size_t i = 0; i < COUNT(cases); i++) {
        sf_frame frame;
        n->jpeg = cases[i].data;
        n->jpeg_size = cases[i].size;
        sf_status status = sf_source_next(b->source, FRAME_MS, &frame);
        assert_int_equal(status, cases[i].bytes ? SF_OK : SF_ERR_TIMEOUT);
        damaged += !cases[i].bytes;
        assert_counts(b, 0, 0, damaged, 0);
        if (status != SF_OK) continue;
        assert_int_equal(frame.bytes, cases[i].bytes);
        assert_int_equal(frame.stride[0], 0);
        assert_true(frame.full_range && frame.matrix == SF_YUV_601);
        assert_memory_equal(frame.plane[0], cases[i].data, cases[i].bytes);
        sf_source_release(b->source, &frame);
    }
    bench_end(b);
}

static void test_newest(void **state) {
    (void)state;
    bench *b = bench_start();
    fake_node *n = &b->driver.nodes[0];
    sf_frame frame, other;
    open_source(b, "v4l2:0?format=YUYV&buffers=4");
    n->burst = 4;
    assert_ok(b->ctx, sf_source_newest(b->source, 100, &frame));
    assert_int_equal(frame.sequence, 3);
    assert_plane(&frame, 0, 0, 0, 128, 128, 48);
    assert_counts(b, 3, 0, 0, 0);
    n->burst = 3;
    n->flags = V4L2_BUF_FLAG_ERROR; /* the first of them */
    assert_ok(b->ctx, sf_source_newest(b->source, 100, &other));
    assert_int_equal(other.sequence, 6);
    assert_counts(b, 4, 0, 1, 0);
    assert_plane(&frame, 0, 0, 0, 128, 128, 48); /* still whole */
    sf_source_release(b->source, &frame);
    n->burst = 3;
    assert_ok(b->ctx, sf_source_next(b->source, 100, &frame));
    assert_int_equal(frame.sequence, 7); /* in order, none skipped */
    sf_source_release(b->source, &frame);
    sf_source_release(b->source, &other);
    assert_int_equal(pass_frame(b), 8);
    assert_int_equal(pass_frame(b), 9);
    assert_counts(b, 4, 0, 1, 0);
    assert_int_equal(counts_of(b).given, 5);
    bench_end(b);
}

/* 5. Waiting */

static void test_waits(void **state) {
    (void)state;
    bench *b = bench_start();
    fake *f = &b->driver;
    fake_node *n = &f->nodes[0];
    sf_frame frame;
    open_source(b, "v4l2:0?format=YUYV");
    n->mute = 1;
    int64_t since = f->now_ns;
    assert_status(b->ctx, sf_source_next(b->source, 300, &frame), SF_ERR_TIMEOUT);
    assert_error_names(b->ctx, "/dev/video0: no frame within 300 ms");
    assert_true(f->now_ns - since == 300 * ms);
    since = f->now_ns;
    assert_status(b->ctx, sf_source_next(b->source, -1, &frame), SF_ERR_TIMEOUT);
    assert_true(f->now_ns - since == 10000 * ms);
    since = f->now_ns;
    assert_status(b->ctx, sf_source_next(b->source, 0, &frame), SF_ERR_TIMEOUT);
    assert_true(f->now_ns == since);
    n->no_wait = 1; /* a driver that says ready and has nothing: no busy waiting */
    long calls = f->calls;
    assert_status(b->ctx, sf_source_next(b->source, 100, &frame), SF_ERR_TIMEOUT);
    assert_true(f->calls - calls < 250 && f->now_ns - since < 110 * ms);
    n->no_wait = n->mute = 0;

    f->interruptions = 7;
    assert_int_equal(pass_frame(b), 0);
    f->interruptions = 1000; /* a signal every millisecond */
    since = f->now_ns;
    assert_status(b->ctx, sf_source_next(b->source, 50, &frame), SF_ERR_TIMEOUT);
    assert_true(f->now_ns - since <= 52 * ms);
    f->interruptions = 0;
    plan_fault(f, VIDIOC_DQBUF, EINTR, 3);
    assert_int_equal(pass_frame(b), 1);
    assert_null(strstr(test_log, "started again"));
    n->burst = 1;
    produce(f, n); /* it has already arrived */
    assert_ok(b->ctx, sf_source_next(b->source, 0, &frame));
    bench_end(b);
}

/* 6. Faults */

/* What drivers refuse for a moment, or for good. */
static void test_transient_errors(void **state) {
    (void)state;
    static const unsigned long requests[] = {VIDIOC_REQBUFS, VIDIOC_QUERYBUF, VIDIOC_QBUF, VIDIOC_STREAMON};
    static const int errors[] = {EINVAL, EIO, EAGAIN};
    for (size_t i = 0; i < COUNT(requests) * COUNT(errors); i++) {
        bench *b = bench_start();
        fake *f = &b->driver;
        unsigned long request = requests[i / COUNT(errors)];
        int error = errors[i % COUNT(errors)];
        plan_fault(f, request, error, 2);
        open_source(b, "v4l2:0?format=YUYV");
        assert_int_equal(pass_frame(b), 0);
        assert_counts(b, 0, 0, 0, 0);
        close_source(b);
        plan_fault(f, request, error, -1);
        int64_t since = f->now_ns;
        assert_status(b->ctx, try_open(b, "v4l2:0?format=YUYV"), SF_ERR_IO);
        assert_error_names(b->ctx, strerror(error));
        assert_true(f->now_ns - since <= 200 * ms);
        bench_end(b);
    }
}

/* While it streams. */
static void test_errors_of_the_stream(void **state) {
    (void)state;
    bench *b = bench_start();
    fake *f = &b->driver;
    fake_node *n = &f->nodes[0];
    open_source(b, "v4l2:0?format=YUYV&buffers=2");
    assert_int_equal(pass_frame(b), 0);
    for (int error = 0; error < 3; error++) {
        plan_fault(f, VIDIOC_QBUF, error == 0 ? EINVAL : error == 1 ? EIO : EAGAIN, 2);
        for (int i = 0; i < 5; i++) pass_frame(b);
    }
    assert_int_equal(pass_frame(b), 16);
    assert_null(strstr(test_log, "started again"));
    plan_fault(f, VIDIOC_QBUF, EINVAL, 12); /* longer than is waited for: it is started again */
    for (int i = 0; i < 5; i++) pass_frame(b);
    test_assert_contains(test_log, "the stream failed and is started again", __FILE__, __LINE__);
    assert_int_equal(pass_frame(b), 22);

    sf_frame held = next_frame(b);
    test_log_clear();
    n->failed = 1; /* POLLERR, and EIO until it is stopped */
    n->drop = 100; /* what it counts from then on says nothing */
    sf_frame frame = next_frame(b);
    assert_int_equal(frame.sequence, 24);
    assert_plane(&held, 0, 0, 0, 128, 1 + 127, 0); /* its memory is still there */
    test_assert_contains(test_log, "started again", __FILE__, __LINE__);
    sf_source_release(b->source, &held);
    sf_source_release(b->source, &frame);
    for (uint64_t i = 0; i < 5; i++) assert_int_equal(pass_frame(b), 25 + i);
    plan_fault(f, VIDIOC_DQBUF, EIO, 1);
    pass_frame(b);
    plan_fault(f, 2, EINVAL, 1); /* poll itself */
    pass_frame(b);
    plan_fault(f, VIDIOC_STREAMON, EIO, 6);
    n->failed = 1;
    pass_frame(b);
    assert_counts(b, 0, 0, 0, 0);

    plan_fault(f, VIDIOC_DQBUF, EIO, -1); /* for good */
    int64_t since = f->now_ns;
    assert_status(b->ctx, sf_source_next(b->source, 5000, &frame), SF_ERR_IO);
    assert_error_names(b->ctx, "was started 4 times without a frame");
    assert_true(f->now_ns - since < 3000 * ms);
    assert_status(b->ctx, sf_source_next(b->source, 5000, &frame), SF_ERR_IO);
    bench_end(b);
}

static sf_status next_status(bench *b, int timeout_ms) {
    sf_frame frame;
    sf_status status = sf_source_next(b->source, timeout_ms, &frame);
    if (status == SF_OK) sf_source_release(b->source, &frame);
    return status;
}

/* Pulled out in the middle of a frame, plugged in again: at its number or another. */
static void test_unplugged(void **state) {
    (void)state;
    for (int to = 0; to < NODES; to += 2) {
        bench *b = bench_start();
        fake *f = &b->driver;
        open_source(b, "v4l2:/dev/video0?format=YUYV&exposure=manual:99&fps=20");
        assert_int_equal(pass_frame(b), 0);
        f->unplug_ns = f->now_ns + 10 * ms;
        f->plug_ns = f->now_ns + 2000 * ms;
        f->plug_node = to;
        int64_t since = f->now_ns;
        assert_int_equal(next_status(b, 500), SF_ERR_TIMEOUT);
        assert_true(f->now_ns - since >= 500 * ms && f->now_ns - since < 600 * ms);
        assert_error_names(b->ctx, "/dev/video0: Webcam is gone and not back yet");
        test_assert_contains(test_log, "/dev/video0: Webcam is gone; it is waited for\n", __FILE__, __LINE__);
        assert_int_equal(f->fds_open, 0);
        assert_int_equal(f->maps, 0);
        assert_int_equal(next_status(b, 0), SF_ERR_TIMEOUT);
        assert_counts(b, 0, 0, 0, 0);
        control_of(&f->nodes[0], V4L2_CID_EXPOSURE_ABSOLUTE)->value = 1234; /* it has forgotten */
        f->nodes[0].fps = 1;
        f->nodes[0].width = 128;
        f->nodes[0].padding = 16; /* and lays frames out in another way */
        test_log_clear();
        assert_int_equal(next_status(b, 5000), SF_OK);
        assert_counts(b, 0, 0, 0, 1);
        test_assert_contains(test_log, "Webcam is back\n", __FILE__, __LINE__);
        assert_int_equal(f->nodes[to].width, 64);
        assert_int_equal(f->nodes[to].fps, 20);
        assert_int_equal(control_of(&f->nodes[to], V4L2_CID_EXPOSURE_ABSOLUTE)->value, 99);
        for (uint64_t i = 0; i < 5; i++) {
            sf_frame frame = next_frame(b);
            assert_int_equal(frame.sequence, 2 + i);
            assert_int_equal(frame.stride[0], 128 + 16);
            sf_source_release(b->source, &frame);
        }
        assert_counts(b, 0, 0, 0, 1);
        bench_end(b);
    }
}

/* It comes back without the caller asking for long: with a timeout of 0 alone. */
static void test_unplugged_without_waiting(void **state) {
    (void)state;
    bench *b = bench_start();
    fake *f = &b->driver;
    open_source(b, "v4l2:0?format=YUYV");
    pass_frame(b);
    fake_unplug(&f->nodes[0]);
    assert_int_equal(next_status(b, 0), SF_ERR_TIMEOUT);
    long calls = f->calls;
    for (int i = 0; i < 99; i++) {
        pass_time(f, ms);
        assert_int_equal(next_status(b, 0), SF_ERR_TIMEOUT);
    }
    assert_true(f->calls - calls < 10); /* not looked for each time */
    fake_move(f, 0, 0);
    pass_time(f, 200 * ms);
    assert_int_equal(next_status(b, 0), SF_ERR_TIMEOUT); /* it is back, and no frame has come */
    assert_counts(b, 0, 0, 0, 1);
    pass_frame(b);
    bench_end(b);
}

/* Frames that are out while the camera goes stay readable; closing and giving back go in any order. */
static void test_unplugged_with_leases(void **state) {
    (void)state;
    for (int order = 0; order < 4; order++) {
        bench *b = bench_start();
        fake *f = &b->driver;
        f->nodes[0].exports = order & 1;
        open_source(b, "v4l2:0?format=YUYV&dmabuf=1");
        sf_frame a = next_frame(b), c = next_frame(b);
        sf_source_release(b->source, &c);
        c = next_frame(b);
        fake_unplug(&f->nodes[0]);
        sf_source_release(b->source, &a); /* before anybody has noticed */
        assert_int_equal(next_status(b, 100), SF_ERR_TIMEOUT);
        assert_error_names(b->ctx, "frames of it are still out");
        assert_int_equal(f->maps, 1);
        assert_plane(&c, 0, 0, 0, 128, 128, 48);
        fake_move(f, 0, 1);
        if (order == 0) {
            sf_source_release(b->source, &c);
            assert_int_equal(f->maps, 0);
        }
        pass_frame(b);
        assert_counts(b, 0, 0, 0, 1);
        if (order == 2) assert_plane(&c, 0, 0, 0, 128, 128, 48);
        if (order == 2) sf_source_release(b->source, &c);
        if (order == 3) { /* twice, with a frame of each out */
            a = next_frame(b);
            fake_unplug(&f->nodes[1]);
            assert_int_equal(sf_source_next(b->source, 100, &a), SF_ERR_ARGUMENT);
            assert_int_equal(f->fds_open, 1 + 1 + 4); /* the node, the DMA buffers of c and of all now */
            sf_source_release(b->source, &c);
            assert_int_equal(next_status(b, 100), SF_ERR_TIMEOUT);
        }
        bench_end(b);
    }
}

/* The old mapping, where the driver is the same as before, keeps it busy until the frame is given back. */
static void test_busy_until_given_back(void **state) {
    (void)state;
    bench *b = bench_start();
    fake *f = &b->driver;
    open_source(b, "v4l2:0?format=YUYV");
    sf_frame held = next_frame(b);
    fake_unplug(&f->nodes[0]);
    assert_int_equal(next_status(b, 100), SF_ERR_TIMEOUT);
    fake_move(f, 0, 0);
    plan_fault(f, VIDIOC_S_FMT, EBUSY, -1);
    assert_int_equal(next_status(b, 1000), SF_ERR_TIMEOUT);
    assert_error_names(b->ctx, "frames of it are still out");
    sf_source_release(b->source, &held);
    f->faults[0].times = 0;
    pass_frame(b);
    assert_counts(b, 0, 0, 0, 1);
    bench_end(b);
}

/* Only the same camera is taken. */
static void test_other_cameras(void **state) {
    (void)state;
    bench *b = bench_start();
    fake *f = &b->driver;
    fake_node *n = &f->nodes[0], other = *n;
    open_source(b, "v4l2:0?format=YUYV");
    pass_frame(b);
    fake_unplug(n);
    assert_int_equal(next_status(b, 0), SF_ERR_TIMEOUT);
    for (int i = 0; i < 3; i++) { /* at its place: another name, number, node of the camera */
        int generation = n->generation + 1;
        *n = other;
        n->generation = generation;
        if (i == 0) n->card = "Other";
        if (i == 1) n->serial = "S2";
        if (i == 2) n->index = 1;
        assert_int_equal(next_status(b, 500), SF_ERR_TIMEOUT);
        assert_int_equal(f->fds_open, 0);
    }
    f->nodes[2] = other;
    f->nodes[2].bus = "usb-2"; /* at another socket: the number is enough */
    assert_int_equal(next_status(b, 500), SF_OK);
    assert_counts(b, 0, 0, 0, 1);
    bench_end(b);

    for (int with_twin = 0; with_twin < 2;
         with_twin++) { /* no number, or one that two have: the socket counts */
        b = bench_start();
        n = &f->nodes[0];
        other = *n;
        if (!with_twin) n->serial = other.serial = "";
        other.bus = "usb-2";
        if (with_twin) f->nodes[1] = other;
        open_source(b, "v4l2:0?format=YUYV");
        fake_unplug(n);
        assert_int_equal(next_status(b, 300), SF_ERR_TIMEOUT);
        f->nodes[1] = other;
        assert_int_equal(next_status(b, 300), SF_ERR_TIMEOUT);
        fake_move(f, 0, 3);
        assert_int_equal(next_status(b, 300), SF_OK);
        assert_true(f->nodes[3].streaming && !f->nodes[1].streaming);
        bench_end(b);
    }
}

/* It comes back and is not what it was. */
static void test_back_with_other_frames(void **state) {
    (void)state;
    bench *b = bench_start();
    fake *f = &b->driver;
    open_source(b, "v4l2:0?format=YUYV");
    fake_unplug(&f->nodes[0]);
    assert_int_equal(next_status(b, 0), SF_ERR_TIMEOUT);
    fake_move(f, 0, 0);
    f->nodes[0].other = (fake_size){128, 96, 0};
    for (int i = 0; i < 2; i++) {
        assert_int_equal(next_status(b, 300), SF_ERR_IO);
        assert_error_names(b->ctx, "size: 64x48 cannot be had (the driver gives 128x96)");
    }
    bench_end(b);
}

/* Signs of a camera that is gone: every call may be the one that says it. */
static void test_gone_at_any_call(void **state) {
    (void)state;
    static const unsigned long requests[] = {VIDIOC_DQBUF, VIDIOC_QBUF, VIDIOC_STREAMOFF, VIDIOC_STREAMON};
    for (size_t i = 0; i < COUNT(requests); i++) {
        bench *b = bench_start();
        fake *f = &b->driver;
        open_source(b, "v4l2:0?format=YUYV");
        pass_frame(b);
        plan_fault(f, requests[i], ENODEV, 1);
        if (i >= 2) f->nodes[0].failed = 1;
        for (int k = 0; k < 4; k++) pass_frame(b); /* the node is still there, and opened again */
        assert_counts(b, 0, 0, 0, 1);
        bench_end(b);
    }
}

/* Every call fails in turn, once or from then on: it works or says why, ends, and leaves nothing behind. */
static void test_any_call_fails(void **state) {
    (void)state;
    static const int errors[] = {EIO, ENODEV, EBUSY, EINVAL};
    int quick = getenv("SPLATFIT_QUICK") != NULL, failed = 0, worked = 0;
    for (size_t e = 0; e < 2 * COUNT(errors); e++) {
        long calls = 1000;
        for (long at = 1; at <= calls; at += quick ? 7 : 1) {
            bench *b = bench_start();
            fake *f = &b->driver;
            f->nodes[0].multi = (int)(e & 1);
            f->nodes[0].exports = 1;
            f->fail_at = at;
            f->fail_with = errors[e / 2];
            f->fail_on = (int)(e & 1);
            sf_status status = try_open(b, "v4l2:0?format=YUYV&exposure=manual:50&dmabuf=1&input=0");
            sf_frame held = {.lease = NULL};
            for (int i = 0; i < 6 && status == SF_OK; i++) {
                status = i == 3 ? sf_source_next(b->source, 1000, &held) : next_status(b, 1000);
            }
            if (b->source) sf_source_release(b->source, &held);
            if (status != SF_OK) assert_true(*sf_last_error(b->ctx));
            failed += status != SF_OK;
            worked += status == SF_OK;
            calls = f->calls < at ? 0 : calls; /* the last call was before */
            bench_end(b);
        }
    }
    assert_true(failed > 20 && worked > 20);
}

static void test_memory_ends(void **state) {
    (void)state;
    bench *b = bench_start();
    test_allocations counted = {.fail_at = 0};
    sf_allocator allocator = {test_count_alloc, test_count_free, &counted};
    sf_context_options options = {.allocator = &allocator, .threads = 1};
    sf_context_destroy(&b->ctx);
    assert_int_equal(sf_context_create(&b->ctx, &options), SF_OK);
    long live = counted.live, before = counted.calls;
    int failures = 0;
    for (sf_status status = SF_ERR_MEMORY; status != SF_OK; failures++) {
        before = counted.calls;
        counted.fail_at = before + 1 + failures;
        status = try_open(b, "v4l2:0?format=YUYV");
        if (status == SF_OK) break;
        assert_int_equal(status, SF_ERR_MEMORY);
        assert_int_equal(counted.live, live);
        assert_int_equal(b->driver.fds_open, 0);
    }
    assert_int_equal(failures, 4); /* the source, its own, the name, the stream */
    counted.fail_at = 0;
    bench_end(b);
    assert_int_equal(counted.live, 0);
}

/* 7. The list of cameras */

static void test_devices(void **state) {
    (void)state;
    bench *b = bench_start();
    fake *f = &b->driver;
    sf_devices *devices;
    sf_device_info info;
    sf_device_mode mode;
    size_t before = 0;
    f->nodes[1].plugged = 1; /* metadata: no camera */
    f->nodes[2] = f->nodes[0];
    f->nodes[2].card = "Sensor";
    f->nodes[2].serial = "";
    f->nodes[2].multi = 1;
    set_format(&f->nodes[2], V4L2_PIX_FMT_NV12M, 2);
    f->nodes[2].formats[0].sizes[0] = (fake_size){1, 1, 60};
    f->nodes[3] = f->nodes[0];
    assert_ok(b->ctx, sf_devices_find(b->ctx, &devices));
    while (!sf_devices_get(devices, before, &info)) before++; /* of this machine itself */
    plan_fault(f, 1, 0, 0);
    assert_ok(b->ctx, sf_v4l2_find_with(b->ctx, &b->sys, devices));
    assert_int_equal(f->fds_open, 0);
    assert_ok(b->ctx, sf_devices_get(devices, before, &info));
    assert_string_equal(info.source, "v4l2:/dev/video0");
    assert_string_equal(info.name, "Webcam");
    assert_string_equal(info.bus, "usb-1");
    assert_string_equal(info.serial, "S1");
    assert_int_equal(info.modes, 5);
    assert_ok(b->ctx, sf_devices_get_mode(devices, before, 3, &mode));
    assert_string_equal(mode.fourcc, "YUYV");
    assert_true(mode.supported && mode.format == SF_PIXEL_YUYV);
    assert_int_equal(mode.width, 128);
    assert_int_equal(mode.height, 96);
    assert_int_equal(mode.width_most, 0);
    assert_true(mode.fps_least == 2.5 && mode.fps_most == 5);
    assert_ok(b->ctx, sf_devices_get_mode(devices, before, 4, &mode));
    assert_string_equal(mode.fourcc, "H264");
    assert_false(mode.supported);
    assert_int_equal(sf_devices_get_mode(devices, before, 5, &mode), SF_ERR_END);
    assert_ok(b->ctx, sf_devices_get(devices, before + 1, &info));
    assert_string_equal(info.source, "v4l2:/dev/video2");
    assert_int_equal(info.modes, 1);
    assert_ok(b->ctx, sf_devices_get_mode(devices, before + 1, 0, &mode));
    assert_string_equal(mode.fourcc, "NM12");
    assert_int_equal(mode.width, 16);
    assert_int_equal(mode.width_most, 128);
    assert_int_equal(mode.height_most, 96);
    assert_int_equal(mode.width_step, 16);
    assert_true(mode.fps_most == 60);
    assert_ok(b->ctx, sf_devices_get(devices, before + 2, &info));
    assert_int_equal(sf_devices_get(devices, before + 3, &info), SF_ERR_END);
    assert_int_equal(sf_devices_get_mode(devices, before + 3, 0, &mode), SF_ERR_END);

    plan_fault(f, 1, EACCES, 1); /* one that may not be opened is said, and passed over */
    test_log_clear();
    assert_ok(b->ctx, sf_v4l2_find_with(b->ctx, &b->sys, devices));
    test_assert_contains(test_log, "/dev/video0: cannot be opened: Permission denied", __FILE__, __LINE__);
    assert_ok(b->ctx, sf_devices_get(devices, before + 4, &info));
    assert_int_equal(sf_devices_get(devices, before + 5, &info), SF_ERR_END);
    sf_devices_free(&devices);
    assert_null(devices);
    bench_end(b);
}

/* The system's own calls, on what is no camera. */
static void test_system(void **state) {
    (void)state;
    sf_context *ctx = test_context_threads(1);
    sf_source *source;
    assert_status(ctx, sf_source_open(ctx, "v4l2:/dev/null", &source), SF_ERR_UNSUPPORTED);
    assert_error_names(ctx, "/dev/null: is no V4L2 device");
    assert_status(ctx, sf_source_open(ctx, "v4l2:/dev/absent", &source), SF_ERR_IO);
    assert_error_names(ctx, "/dev/absent: cannot be opened: No such file");
    assert_null(source);
    int64_t since = sf_v4l2_system.now_ns(NULL);
    sf_v4l2_system.sleep_ms(NULL, 2);
    assert_true(sf_v4l2_system.now_ns(NULL) - since >= 2 * ms);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_formats),
        cmocka_unit_test(test_describe),
        cmocka_unit_test(test_choice),
        cmocka_unit_test(test_refused),
        cmocka_unit_test(test_driver_gives_other),
        cmocka_unit_test(test_input),
        cmocka_unit_test(test_colors),
        cmocka_unit_test(test_limited_rgb),
        cmocka_unit_test(test_controls),
        cmocka_unit_test(test_lock),
        cmocka_unit_test(test_dmabuf),
        cmocka_unit_test(test_sequence),
        cmocka_unit_test(test_damaged),
        cmocka_unit_test(test_jpeg),
        cmocka_unit_test(test_newest),
        cmocka_unit_test(test_waits),
        cmocka_unit_test(test_transient_errors),
        cmocka_unit_test(test_errors_of_the_stream),
        cmocka_unit_test(test_unplugged),
        cmocka_unit_test(test_unplugged_without_waiting),
        cmocka_unit_test(test_unplugged_with_leases),
        cmocka_unit_test(test_busy_until_given_back),
        cmocka_unit_test(test_other_cameras),
        cmocka_unit_test(test_back_with_other_frames),
        cmocka_unit_test(test_gone_at_any_call),
        cmocka_unit_test(test_any_call_fails),
        cmocka_unit_test(test_memory_ends),
        cmocka_unit_test(test_devices),
        cmocka_unit_test(test_system),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

#else

int main(void) { return 0; }
#endif
