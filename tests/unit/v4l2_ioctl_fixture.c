/* v4l2_ioctl_fixture.c - the requests of the V4L2 driver that is played. */
#ifdef __linux__
#include "v4l2_fixture.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

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
    if (e->index >= COUNT(n->formats) || !n->formats[e->index].fourcc) return v4l2_fail_with(EINVAL);
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
        return v4l2_fail_with(EINVAL);
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
    return v4l2_fail_with(EINVAL);
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
            p->plane_fmt[k].bytesperline = v4l2_memory_stride(n, k);
            p->plane_fmt[k].sizeimage = v4l2_memory_bytes(n, k);
        }
        return;
    }
    f->fmt.pix = (struct v4l2_pix_format){.width = n->width,
                                          .height = n->height,
                                          .pixelformat = n->fourcc,
                                          .field = n->field,
                                          .bytesperline = v4l2_memory_stride(n, 0),
                                          .sizeimage = v4l2_memory_bytes(n, 0),
                                          .colorspace = n->colorspace,
                                          .priv = V4L2_PIX_FMT_PRIV_MAGIC,
                                          .quantization = n->quantization};
    f->fmt.pix.ycbcr_enc = n->ycbcr_enc;
}

/* What is not offered becomes the first that is. */
static int take_format(fake_node *n, struct v4l2_format *f) {
    uint32_t fourcc = n->multi ? f->fmt.pix_mp.pixelformat : f->fmt.pix.pixelformat;
    if (n->maps) return v4l2_fail_with(EBUSY);
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
    if (n->maps) return v4l2_fail_with(EBUSY);
    if (r->count > n->most_buffers) r->count = n->most_buffers;
    n->count = r->count;
    memset(n->buffers, 0, sizeof n->buffers);
    return 0;
}

static int tell_buffer(const fake_node *n, struct v4l2_buffer *q) {
    if (q->index >= n->count) return v4l2_fail_with(EINVAL);
    uint32_t place = q->index * 65536;
    if (!n->multi) {
        q->length = v4l2_memory_bytes(n, 0);
        q->m.offset = place;
        return 0;
    }
    assert_true(q->length >= n->planes);
    q->length = n->planes;
    for (uint32_t k = 0; k < n->planes; k++) {
        q->m.planes[k].length = v4l2_memory_bytes(n, k);
        q->m.planes[k].m.mem_offset = place + k * 16384;
    }
    return 0;
}

static int queue_buffer(fake *f, fake_node *n, const struct v4l2_buffer *q) {
    if (q->index >= n->count || n->buffers[q->index].queued || n->buffers[q->index].done)
        return v4l2_fail_with(EINVAL);
    n->buffers[q->index].queued = 1;
    f->queued++;
    return 0;
}

static int dequeue_buffer(fake_node *n, struct v4l2_buffer *q) {
    if (n->failed) return v4l2_fail_with(EIO);
    fake_buffer *b = v4l2_first_done(n);
    if (!n->streaming) return v4l2_fail_with(EINVAL);
    if (!b) return v4l2_fail_with(EAGAIN);
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

fake_control *v4l2_control_of(fake_node *n, uint32_t id) {
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
    const fake_control *c = q->id & V4L2_CTRL_FLAG_NEXT_CTRL ? control_after(n, id) : v4l2_control_of(n, id);
    if (!c) return v4l2_fail_with(EINVAL);
    q->id = c->id;
    q->type = c->type;
    q->minimum = c->least;
    q->maximum = c->most;
    snprintf((char *)q->name, sizeof q->name, "%s", c->name);
    return 0;
}

static int tell_entry(fake_node *n, struct v4l2_querymenu *q) {
    const fake_control *c = v4l2_control_of(n, q->id);
    if (!c || !c->menu || (int32_t)q->index > c->most || !c->menu[q->index]) return v4l2_fail_with(EINVAL);
    snprintf((char *)q->name, sizeof q->name, "%s", c->menu[q->index]);
    return 0;
}

static int take_control(fake_node *n, struct v4l2_control *v, int set) {
    fake_control *c = v4l2_control_of(n, v->id);
    if (!c) return v4l2_fail_with(EINVAL);
    if (set) c->value = v->value;
    v->value = c->value;
    return 0;
}

static int take_input(fake_node *n, int *input, int set) {
    if (set && *input > 1) return v4l2_fail_with(EINVAL);
    if (set) n->input = (uint32_t)*input;
    *input = (int)n->input;
    return 0;
}

static int list_input(const fake_node *n, struct v4l2_input *e) {
    if (e->index > 1) return v4l2_fail_with(EINVAL);
    e->status = n->input_status;
    return 0;
}

static int list_timings(struct v4l2_enum_dv_timings *e) {
    static const uint32_t sizes[3][3] = {
        {128, 96, 1}, {128, 96, 0}, {64, 48, 0}}; /* the first is interlaced */
    if (e->index >= 3) return v4l2_fail_with(EINVAL);
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
    if (!n->exports) return v4l2_fail_with(ENOTTY);
    e->fd = v4l2_new_fd(f, NODES, 0);
    return 0;
}

int v4l2_fake_ioctl(void *user, int fd, unsigned long request, void *arg) {
    fake *f = user;
    int error = v4l2_planned_fault(f, request);
    fake_node *n = v4l2_node_of(f, fd);
    if (!n) return v4l2_fail_with(ENODEV);
    if (error) return v4l2_fail_with(error);
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
        return v4l2_fail_with(ENOTTY);
    }
}
#endif
