/* v4l2_fixture.c - see the header. */
#ifdef __linux__
#include "v4l2_fixture.h"

#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/context.h"
#include "capture/v4l2.h"
#include "capture/v4l2_device.h"

const int64_t v4l2_ms = 1000000;

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
    f->now_ns = 1000 * v4l2_ms;
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

void v4l2_set_format(fake_node *n, uint32_t fourcc, uint32_t planes) {
    memset(n->formats, 0, sizeof n->formats);
    n->formats[0] = (fake_format){fourcc, planes, {{64, 48, 30}}};
    n->fourcc = fourcc;
    n->planes = planes;
}

void v4l2_fake_unplug(fake_node *n) {
    n->plugged = n->streaming = 0;
    n->generation++;
    n->maps = 0; /* of the new device */
    memset(n->buffers, 0, sizeof n->buffers);
}

void v4l2_fake_move(fake *f, int from, int to) {
    fake_node n = f->nodes[from];
    n.generation = f->nodes[to].generation + 1;
    n.plugged = 1;
    n.sequence = 0;
    n.failed = 0;
    f->nodes[to] = n;
    if (from != to) f->nodes[from].plugged = 0;
}

void v4l2_pass_time(fake *f, int64_t ns) {
    f->now_ns += ns;
    if (f->unplug_ns && f->now_ns >= f->unplug_ns) {
        f->unplug_ns = 0;
        v4l2_fake_unplug(&f->nodes[f->unplug_node]);
    }
    if (f->plug_ns && f->now_ns >= f->plug_ns) {
        f->plug_ns = 0;
        v4l2_fake_move(f, f->unplug_node, f->plug_node);
    }
}

int v4l2_fail_with(int error) {
    errno = error;
    return -1;
}

/* Whether this call is to fail: errno, or 0. */
int v4l2_planned_fault(fake *f, unsigned long request) {
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

void v4l2_plan_fault(fake *f, unsigned long request, int error, int times) {
    for (int i = 0; i < FAULTS; i++)
        if (!f->faults[i].times) {
            f->faults[i].request = request;
            f->faults[i].error = error;
            f->faults[i].times = times;
            return;
        }
    fail_msg("too many faults");
}

int v4l2_new_fd(fake *f, int node, int generation) {
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
    int error = v4l2_planned_fault(f, 1), node;
    if (error) return v4l2_fail_with(error);
    if (sscanf(path, "/dev/video%d", &node) != 1 || node >= NODES || !f->nodes[node].plugged)
        return v4l2_fail_with(ENOENT);
    return v4l2_new_fd(f, node, f->nodes[node].generation);
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

fake_node *v4l2_node_of(fake *f, int fd) {
    assert_true(fd >= 0 && fd < MOST_FDS && f->fds[fd].node >= 0 && f->fds[fd].node < NODES);
    fake_node *n = &f->nodes[f->fds[fd].node];
    return n->plugged && n->generation == f->fds[fd].generation ? n : NULL;
}

/* Rows and bytes of a row of a plane of memory. */
uint32_t v4l2_memory_stride(const fake_node *n, uint32_t plane) {
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

uint32_t v4l2_memory_bytes(const fake_node *n, uint32_t plane) {
    uint32_t size = n->height * v4l2_memory_stride(n, plane);
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
    b->time_ns = n->no_clock ? 77 * v4l2_ms : f->now_ns;
    b->queued = 0;
    b->done = 1;
    for (uint32_t k = 0; k < n->planes; k++) {
        size_t bytes = v4l2_memory_bytes(n, k);
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
fake_buffer *v4l2_first_done(fake_node *n) {
    fake_buffer *first = NULL;
    for (uint32_t i = 0; i < n->count; i++)
        if (n->buffers[i].done && (!first || (int32_t)(n->buffers[i].sequence - first->sequence) < 0))
            first = &n->buffers[i];
    return first;
}

int v4l2_produce(fake *f, fake_node *n) {
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
    int error = v4l2_planned_fault(f, 2);
    *events = 0;
    assert_true(timeout_ms >= 0 && timeout_ms <= 10000);
    if (f->interruptions) {
        f->interruptions--;
        v4l2_pass_time(f, v4l2_ms);
        error = EINTR;
    }
    if (error) return v4l2_fail_with(error);
    fake_node *n = v4l2_node_of(f, fd);
    if (n && n->streaming && !n->failed && !n->mute && !v4l2_first_done(n) && timeout_ms >= FRAME_MS) {
        v4l2_pass_time(f, FRAME_MS * v4l2_ms);
        n = v4l2_node_of(f, fd);
        if (n && v4l2_produce(f, n)) timeout_ms = 0;
    }
    if (!n || !n->streaming || n->failed) {
        *events = POLLERR | POLLIN;
        return 1;
    }
    if (v4l2_first_done(n) || n->no_wait) {
        *events = POLLIN;
        return 1;
    }
    int64_t until = f->now_ns + timeout_ms * v4l2_ms;
    while (f->now_ns < until && (n = v4l2_node_of(f, fd)) != NULL) v4l2_pass_time(f, v4l2_ms);
    if (n) return 0;
    *events = POLLERR | POLLHUP;
    return 1;
}

static void *fake_map(void *user, int fd, size_t offset, size_t length) {
    fake *f = user;
    int error = v4l2_planned_fault(f, 3);
    fake_node *n = v4l2_node_of(f, fd);
    if (!n) error = ENODEV;
    if (error) {
        errno = error;
        return NULL;
    }
    size_t index = offset / 65536, plane = offset % 65536 / 16384;
    assert_true(index < n->count && plane < n->planes && length == v4l2_memory_bytes(n, (uint32_t)plane));
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
    const fake_node *n = v4l2_node_of(user, fd);
    snprintf(serial, size, "%s", n ? n->serial : "");
    *index = n ? n->index : 0;
}

static int64_t fake_now(void *user) { return ((fake *)user)->now_ns; }

static void fake_sleep(void *user, int sleep_ms) {
    assert_true(sleep_ms > 0 && sleep_ms <= 10000);
    for (int i = 0; i < sleep_ms; i++) v4l2_pass_time(user, v4l2_ms);
}

bench *v4l2_bench_start(void) {
    static bench b;
    fake_init(&b.driver);
    b.sys = (sf_v4l2_sys){&b.driver,  fake_open, fake_close,    v4l2_fake_ioctl, fake_poll, fake_map,
                          fake_unmap, fake_list, fake_identify, fake_now,        fake_sleep};
    b.ctx = test_context_threads(1);
    b.source = NULL;
    test_log_clear();
    return &b;
}

sf_status v4l2_try_open(bench *b, const char *name) {
    b->source = sf_calloc(b->ctx, 1, sizeof *b->source);
    if (!b->source) return SF_ERR_MEMORY;
    b->source->ctx = b->ctx;
    sf_status status = sf_v4l2_open_with(b->ctx, &b->sys, name, b->source);
    if (status == SF_OK) return status;
    sf_free(b->ctx, b->source);
    b->source = NULL;
    return status;
}

void v4l2_open_source(bench *b, const char *name) { assert_ok(b->ctx, v4l2_try_open(b, name)); }

void v4l2_close_source(bench *b) {
    sf_source_close(&b->source);
    assert_int_equal(b->driver.fds_open, 0);
    assert_int_equal(b->driver.maps, 0);
}

void v4l2_bench_end(bench *b) {
    v4l2_close_source(b);
    sf_context_destroy(&b->ctx);
}

sf_frame v4l2_next_frame(bench *b) {
    sf_frame frame;
    assert_ok(b->ctx, sf_source_next(b->source, 1000, &frame));
    return frame;
}

uint64_t v4l2_pass_frame(bench *b) {
    sf_frame frame = v4l2_next_frame(b);
    uint64_t sequence = frame.sequence;
    sf_source_release(b->source, &frame);
    return sequence;
}

sf_source_counts v4l2_counts_of(const bench *b) {
    sf_source_counts counts;
    sf_source_count(b->source, &counts);
    return counts;
}

void v4l2_assert_counts(const bench *b, uint64_t skipped, uint64_t dropped, uint64_t damaged,
                        uint64_t reopened) {
    sf_source_counts c = v4l2_counts_of(b);
    assert_int_equal(c.skipped, skipped);
    assert_int_equal(c.dropped, dropped);
    assert_int_equal(c.damaged, damaged);
    assert_int_equal(c.reopened, reopened);
}

void v4l2_assert_plane(const sf_frame *frame, int plane, uint32_t memory, size_t offset, size_t stride,
                       size_t row_bytes, size_t rows) {
    assert_non_null(frame->plane[plane]);
    assert_int_equal(frame->stride[plane], stride);
    for (size_t y = 0; y < rows; y++)
        for (size_t x = 0; x < row_bytes; x += row_bytes - 1)
            assert_int_equal(frame->plane[plane][y * stride + x],
                             frame_byte((uint32_t)frame->sequence, memory, offset + y * stride + x));
}
#endif
