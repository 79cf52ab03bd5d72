/* vivid.c - sets the kernel's simulated capture devices up, and feeds them. */
#include "vivid.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <linux/videodev2.h>

#include "guest.h"
#include "pattern.h"

/* 1. Knobs */

static int try_ioctl(int fd, unsigned long request, void *argument) {
    int result;
    do result = ioctl(fd, request, argument);
    while (result < 0 && errno == EINTR);
    return result;
}

static int open_node(const char *node) {
    int fd = open(node, O_RDWR | O_NONBLOCK | O_CLOEXEC);
    check(fd >= 0, "%s: %s", node, strerror(errno));
    return fd;
}

static int find_control(int fd, const char *name, uint32_t *id) {
    struct v4l2_queryctrl query = {.id = V4L2_CTRL_FLAG_NEXT_CTRL};
    for (; try_ioctl(fd, VIDIOC_QUERYCTRL, &query) == 0; query.id |= V4L2_CTRL_FLAG_NEXT_CTRL)
        if (strcmp((const char *)query.name, name) == 0) {
            *id = query.id;
            return 1;
        }
    return 0;
}

static int has_control(const char *node, const char *name) {
    uint32_t id;
    int fd = open_node(node), found = find_control(fd, name, &id);
    close(fd);
    return found;
}

void vivid_set(const char *node, const char *control, int value) {
    struct v4l2_control c = {.value = value};
    int fd = open_node(node);
    check(find_control(fd, control, &c.id), "%s: no control \"%s\"", node, control);
    check(try_ioctl(fd, VIDIOC_S_CTRL, &c) == 0, "%s: %s = %d: %s", node, control, value, strerror(errno));
    close(fd);
}

int vivid_get(const char *node, const char *control) {
    struct v4l2_control c = {0};
    int fd = open_node(node);
    check(find_control(fd, control, &c.id), "%s: no control \"%s\"", node, control);
    check(try_ioctl(fd, VIDIOC_G_CTRL, &c) == 0, "%s: %s: %s", node, control, strerror(errno));
    close(fd);
    return c.value;
}

void vivid_set_input(const char *node, int input) {
    int fd = open_node(node);
    check(try_ioctl(fd, VIDIOC_S_INPUT, &input) == 0, "%s: input %d: %s", node, input, strerror(errno));
    close(fd);
}

void vivid_set_timings(const char *node, int width, int height) {
    int fd = open_node(node), set = 0;
    struct v4l2_enum_dv_timings list = {0};
    for (; !set && try_ioctl(fd, VIDIOC_ENUM_DV_TIMINGS, &list) == 0; list.index++) {
        const struct v4l2_bt_timings *bt = &list.timings.bt;
        if ((int)bt->width == width && (int)bt->height == height && !bt->interlaced)
            set = try_ioctl(fd, VIDIOC_S_DV_TIMINGS, &list.timings) == 0;
    }
    check(set, "%s: no timings of %dx%d", node, width, height);
    close(fd);
}

void vivid_bind(const char *device, int bind) {
    char path[64];
    snprintf(path, sizeof path, "/sys/bus/platform/drivers/vivid/%s", bind ? "bind" : "unbind");
    int fd = open(path, O_WRONLY | O_CLOEXEC);
    check(fd >= 0, "%s: %s", path, strerror(errno));
    check(write(fd, device, strlen(device)) > 0, "%s: %s: %s", path, device, strerror(errno));
    close(fd);
}

static void set_where_known(const char *node, const char *control, int value) {
    if (has_control(node, control)) vivid_set(node, control, value);
}

enum { TEXT_OFF = 2 };

void vivid_loop(const char *capture, const char *output, int width, int height) {
    vivid_set_input(capture, VIVID_HDMI);
    vivid_set_timings(capture, width, height);
    vivid_set_timings(output, width, height);
    vivid_set(capture, "Loop Video", 1);
    set_where_known(output, "Loop Video", 1);
    vivid_set(capture, "OSD Text Mode", TEXT_OFF);
}

void vivid_webcam(const char *capture) {
    static const char *const off[] = {"Loop Video", "Percentage of Dropped Buffers", "Wrap Sequence Number",
                                      "DV Timings Signal Mode"};
    for (size_t i = 0; i < sizeof off / sizeof *off; i++) set_where_known(capture, off[i], 0);
    vivid_set_input(capture, VIVID_WEBCAM);
    int fd = open_node(capture);
    struct v4l2_capability capability = {0};
    check(try_ioctl(fd, VIDIOC_QUERYCAP, &capability) == 0, "%s: %s", capture, strerror(errno));
    struct v4l2_streamparm rate = {.type = capability.device_caps & V4L2_CAP_VIDEO_CAPTURE_MPLANE
                                               ? V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE
                                               : V4L2_BUF_TYPE_VIDEO_CAPTURE};
    rate.parm.capture.timeperframe = (struct v4l2_fract){1, 25};
    check(try_ioctl(fd, VIDIOC_S_PARM, &rate) == 0, "%s: 25 frames a second: %s", capture, strerror(errno));
    close(fd);
}

/* 2. Frames */

enum { BUFFERS = 4 };

struct vivid_feed {
    int fd, multiplanar;
    uint32_t type, count;
    uint32_t memory_planes; /* of a buffer */
    size_t bytes[SF_FRAME_PLANES];
    pattern_plane planes[BUFFERS][SF_FRAME_PLANES]; /* of the picture */
    int plane_count;
    uint32_t put, done; /* frames that went in, buffers that came back */
};

static void set_format(vivid_feed *feed, const char *node, uint32_t fourcc, int width, int height,
                       struct v4l2_format *format) {
    struct v4l2_capability capability = {0};
    check(try_ioctl(feed->fd, VIDIOC_QUERYCAP, &capability) == 0, "%s: %s", node, strerror(errno));
    feed->multiplanar = (capability.device_caps & V4L2_CAP_VIDEO_OUTPUT_MPLANE) != 0;
    feed->type = feed->multiplanar ? V4L2_BUF_TYPE_VIDEO_OUTPUT_MPLANE : V4L2_BUF_TYPE_VIDEO_OUTPUT;
    *format = (struct v4l2_format){.type = feed->type};
    check(try_ioctl(feed->fd, VIDIOC_G_FMT, format) == 0, "%s: format: %s", node, strerror(errno));
    if (feed->multiplanar) {
        struct v4l2_pix_format_mplane *pix = &format->fmt.pix_mp;
        pix->width = (uint32_t)width, pix->height = (uint32_t)height, pix->pixelformat = fourcc;
        memset(pix->plane_fmt, 0, sizeof pix->plane_fmt);
    } else {
        struct v4l2_pix_format *pix = &format->fmt.pix;
        pix->width = (uint32_t)width, pix->height = (uint32_t)height, pix->pixelformat = fourcc;
        pix->bytesperline = pix->sizeimage = 0;
    }
    check(try_ioctl(feed->fd, VIDIOC_S_FMT, format) == 0, "%s: format: %s", node, strerror(errno));
    uint32_t set = feed->multiplanar ? format->fmt.pix_mp.pixelformat : format->fmt.pix.pixelformat;
    check(set == fourcc, "%s: takes no %.4s", node, (const char *)&fourcc);
}

static uint8_t *map_plane(const vivid_feed *feed, uint32_t index, uint32_t plane, size_t *bytes) {
    struct v4l2_plane planes[VIDEO_MAX_PLANES] = {{0}};
    struct v4l2_buffer buffer = {.index = index, .type = feed->type, .memory = V4L2_MEMORY_MMAP};
    if (feed->multiplanar) buffer.m.planes = planes, buffer.length = VIDEO_MAX_PLANES;
    check(try_ioctl(feed->fd, VIDIOC_QUERYBUF, &buffer) == 0, "output: buffer %u: %s", index,
          strerror(errno));
    *bytes = feed->multiplanar ? planes[plane].length : buffer.length;
    off_t offset = feed->multiplanar ? planes[plane].m.mem_offset : buffer.m.offset;
    void *memory = mmap(NULL, *bytes, PROT_READ | PROT_WRITE, MAP_SHARED, feed->fd, offset);
    check(memory != MAP_FAILED, "output: buffer %u: %s", index, strerror(errno));
    return memory;
}

/* Where the picture's planes lie in a buffer whose memory has one plane for all, or one for each. */
static void place_planes(vivid_feed *feed, uint32_t index, const struct v4l2_format *format) {
    uint8_t *memory = NULL;
    for (int i = 0; i < feed->plane_count; i++) {
        pattern_plane *p = &feed->planes[index][i];
        size_t first =
            feed->multiplanar ? format->fmt.pix_mp.plane_fmt[0].bytesperline : format->fmt.pix.bytesperline;
        if ((uint32_t)i < feed->memory_planes) {
            memory = map_plane(feed, index, (uint32_t)i, &feed->bytes[i]);
            if (i > 0) first = format->fmt.pix_mp.plane_fmt[i].bytesperline;
            p->stride = first;
        } else
            p->stride = first * p->width / feed->planes[index][0].width;
        p->data = memory;
        memory += p->stride * p->rows;
    }
}

vivid_feed *vivid_feed_open(const char *node, uint32_t fourcc, sf_pixel_format format, int width,
                            int height) {
    vivid_feed *feed = calloc(1, sizeof *feed);
    check(feed != NULL, "out of memory");
    feed->fd = open_node(node);
    struct v4l2_format set;
    set_format(feed, node, fourcc, width, height, &set);
    feed->memory_planes = feed->multiplanar ? set.fmt.pix_mp.num_planes : 1;
    struct v4l2_requestbuffers request = {.count = BUFFERS, .type = feed->type, .memory = V4L2_MEMORY_MMAP};
    check(try_ioctl(feed->fd, VIDIOC_REQBUFS, &request) == 0 && request.count >= BUFFERS,
          "%s: no buffers: %s", node, strerror(errno));
    for (uint32_t i = 0; i < BUFFERS; i++) {
        feed->plane_count = pattern_planes(format, width, height, feed->planes[i]);
        place_planes(feed, i, &set);
    }
    vivid_feed_put(feed);
    vivid_feed_put(feed);
    check(try_ioctl(feed->fd, VIDIOC_STREAMON, &feed->type) == 0, "%s: start: %s", node, strerror(errno));
    return feed;
}

/* Buffers come back in the order in which they were put. */
static void wait_for_buffer(vivid_feed *feed) {
    struct pollfd ready = {feed->fd, POLLOUT, 0};
    check(poll(&ready, 1, 5000) == 1, "output: no buffer comes back");
    struct v4l2_plane planes[VIDEO_MAX_PLANES] = {{0}};
    struct v4l2_buffer buffer = {.type = feed->type, .memory = V4L2_MEMORY_MMAP};
    if (feed->multiplanar) buffer.m.planes = planes, buffer.length = VIDEO_MAX_PLANES;
    check(try_ioctl(feed->fd, VIDIOC_DQBUF, &buffer) == 0, "output: %s", strerror(errno));
    check(buffer.index == feed->done % BUFFERS, "output: buffer %u came back out of turn", buffer.index);
    feed->done++;
}

/* The buffer that is put next. */
static uint32_t free_buffer(vivid_feed *feed) {
    while (feed->put - feed->done >= BUFFERS) wait_for_buffer(feed);
    return feed->put % BUFFERS;
}

static uint32_t put_buffer(vivid_feed *feed, uint32_t index) {
    struct v4l2_plane planes[VIDEO_MAX_PLANES] = {{0}};
    struct v4l2_buffer buffer = {.index = index,
                                 .type = feed->type,
                                 .memory = V4L2_MEMORY_MMAP,
                                 .field = V4L2_FIELD_NONE,
                                 .bytesused = (uint32_t)feed->bytes[0]};
    if (feed->multiplanar) buffer.m.planes = planes, buffer.length = feed->memory_planes;
    for (uint32_t i = 0; feed->multiplanar && i < feed->memory_planes; i++)
        planes[i].bytesused = (uint32_t)feed->bytes[i];
    check(try_ioctl(feed->fd, VIDIOC_QBUF, &buffer) == 0, "output: %s", strerror(errno));
    return feed->put++;
}

uint32_t vivid_feed_put(vivid_feed *feed) {
    uint32_t index = free_buffer(feed);
    pattern_fill(feed->planes[index], feed->plane_count, feed->put);
    return put_buffer(feed, index);
}

void vivid_feed_show(vivid_feed *feed, const uint8_t *rgb) {
    uint32_t index = free_buffer(feed);
    const pattern_plane *p = &feed->planes[index][0];
    for (size_t y = 0; y < p->rows; y++) memcpy(p->data + y * p->stride, rgb + y * p->width, p->width);
    put_buffer(feed, index);
}

uint32_t vivid_feed_count(const vivid_feed *feed) { return feed->put; }

void vivid_feed_close(vivid_feed *feed) {
    try_ioctl(feed->fd, VIDIOC_STREAMOFF, &feed->type);
    close(feed->fd);
    free(feed);
}
