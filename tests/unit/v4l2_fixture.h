/* v4l2_fixture.h - a V4L2 driver that is played. */
#ifndef TESTS_UNIT_V4L2_FIXTURE_H
#define TESTS_UNIT_V4L2_FIXTURE_H

#include "testing.h"

#include <poll.h>

#include "capture/v4l2.h"
#include "capture/v4l2_device.h"

#define COUNT(array) (sizeof(array) / sizeof *(array))

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

extern const int64_t v4l2_ms;

void v4l2_set_format(fake_node *n, uint32_t fourcc, uint32_t planes);
void v4l2_fake_unplug(fake_node *n);

/* The camera of one node is at another from now on. */
void v4l2_fake_move(fake *f, int from, int to);
void v4l2_pass_time(fake *f, int64_t ns);
void v4l2_plan_fault(fake *f, unsigned long request, int error, int times);
int v4l2_produce(fake *f, fake_node *n);
fake_control *v4l2_control_of(fake_node *n, uint32_t id);

typedef struct bench {
    fake driver;
    sf_v4l2_sys sys;
    sf_context *ctx;
    sf_source *source;
} bench;

bench *v4l2_bench_start(void);
sf_status v4l2_try_open(bench *b, const char *name);
void v4l2_open_source(bench *b, const char *name);

/* Closes the source; nothing of it may be left. */
void v4l2_close_source(bench *b);
void v4l2_bench_end(bench *b);
sf_frame v4l2_next_frame(bench *b);

/* Takes a frame and gives it back. */
uint64_t v4l2_pass_frame(bench *b);
sf_source_counts v4l2_counts_of(const bench *b);
void v4l2_assert_counts(const bench *b, uint64_t skipped, uint64_t dropped, uint64_t damaged,
                        uint64_t reopened);

/* The first and the last byte of each row of a plane are the driver's. */
void v4l2_assert_plane(const sf_frame *frame, int plane, uint32_t memory, size_t offset, size_t stride,
                       size_t row_bytes, size_t rows);

/* What the two files of the driver share: see there. */
int v4l2_fail_with(int error);
int v4l2_planned_fault(fake *f, unsigned long request);
int v4l2_new_fd(fake *f, int node, int generation);
fake_node *v4l2_node_of(fake *f, int fd);
uint32_t v4l2_memory_stride(const fake_node *n, uint32_t plane);
uint32_t v4l2_memory_bytes(const fake_node *n, uint32_t plane);
fake_buffer *v4l2_first_done(fake_node *n);
int v4l2_fake_ioctl(void *user, int fd, unsigned long request, void *arg);

#endif
