/* test_libcamera_source.c - the source behind libcamera:, with a camera that is played: frames, what is kept
 * from the caller, the newest, exposure that is locked, a camera that goes. */
#include "../testing.h"

#include <fcntl.h>
#include <string.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include "capture/libcamera_source.h"

enum { BUFFERS = 4, WIDTH = 6, HEIGHT = 4, STRIDE = 8, MOST_BYTES = 64 };

/* A camera whose buffers lie behind each other in a file; byte i of buffer b is 64 b + i. */
typedef struct played {
    sf_context *ctx;
    sf_source *source;
    sf_libcamera_source s;
    int fd;
    int queued[BUFFERS], closed;
    sf_libcamera_controls set; /* with the last buffer that was queued */
    sf_status answer;          /* of `queue` */
    size_t bytes;              /* of a frame */
} played;

static sf_status queue(void *camera, size_t buffer, const sf_libcamera_controls *set) {
    played *p = camera;
    assert_true(buffer < BUFFERS);
    assert_false(p->queued[buffer]);
    p->queued[buffer] = 1;
    p->set = *set;
    return p->answer;
}

static void close_camera(void *camera) {
    played *p = camera;
    sf_libcamera_source_end(&p->s);
    p->closed++;
}

static const sf_libcamera_calls calls = {queue, close_camera};

static void fill_file(const char *path) {
    uint8_t content[BUFFERS * MOST_BYTES];
    for (size_t i = 0; i < sizeof content; i++) content[i] = (uint8_t)i;
    test_write(path, content, sizeof content);
}

/* The planes of buffer b, one behind the other. */
static void map_buffer(played *p, size_t b) {
    sf_libcamera_plane planes[SF_FRAME_PLANES];
    size_t offset = b * MOST_BYTES;
    int count = sf_libcamera_planes(&p->s.picture);
    for (int i = 0; i < count; i++) {
        size_t bytes =
            p->s.picture.format == SF_PIXEL_MJPEG ? MOST_BYTES : sf_libcamera_plane_bytes(&p->s.picture, i);
        planes[i] = (sf_libcamera_plane){p->fd, offset, bytes};
        offset += bytes;
    }
    p->bytes = offset - b * MOST_BYTES;
    assert_ok(p->ctx, sf_libcamera_map(&p->s.device, &p->s.picture, planes, (size_t)count, &p->s.buffers[b]));
    p->queued[b] = 1;
}

static void open_camera(played *p, sf_pixel_format format, const sf_libcamera_request *asked) {
    memset(p, 0, sizeof *p);
    p->ctx = test_context();
    fill_file(test_path("memory"));
    p->fd = open(test_path("memory"), O_RDWR);
    assert_true(p->fd >= 0);
    p->s.device.ctx = p->ctx;
    p->s.device.id = "played";
    p->s.calls = &calls;
    p->s.camera = p;
    p->s.asked = *asked;
    p->s.has = (sf_libcamera_has){.enable = 1, .white_balance = 1};
    strcpy(p->s.model, "Model");
    p->s.picture = (sf_libcamera_picture){format, WIDTH, HEIGHT, STRIDE, SF_YUV_709, 0};
    assert_ok(p->ctx, sf_libcamera_source_begin(&p->s, BUFFERS));
    for (size_t b = 0; b < BUFFERS; b++) map_buffer(p, b);
    p->source = sf_calloc(p->ctx, 1, sizeof *p->source);
    assert_non_null(p->source);
    *p->source = (sf_source){.ctx = p->ctx, .ops = &sf_libcamera_source_ops, .self = &p->s};
    test_log_clear();
}

static const sf_libcamera_request nothing;

static void close_all(played *p) {
    sf_source_close(&p->source);
    assert_int_equal(p->closed, 1);
    close(p->fd);
    sf_context_destroy(&p->ctx);
}

/* A whole frame, as libcamera tells of it. */
static sf_libcamera_filled filled(const played *p, size_t buffer, uint32_t sequence) {
    return (sf_libcamera_filled){.buffer = buffer,
                                 .driver_sequence = sequence,
                                 .first_bytes = p->s.buffers[buffer].length[0],
                                 .bytes = p->bytes,
                                 .time_ns = 1000 * (int64_t)sequence,
                                 .exposure_us = -1,
                                 .gain = -1};
}

static void send(played *p, sf_libcamera_filled frame) {
    assert_true(p->queued[frame.buffer]);
    p->queued[frame.buffer] = 0;
    sf_libcamera_queue_put(&p->s.queue, &frame);
}

static void send_good(played *p, size_t buffer, uint32_t sequence) { send(p, filled(p, buffer, sequence)); }

/* The next frame, which must be there, is this one, and goes back. */
static void assert_next(played *p, size_t buffer, uint64_t sequence) {
    sf_frame frame;
    assert_ok(p->ctx, sf_source_next(p->source, 0, &frame));
    assert_int_equal(frame.sequence, sequence);
    assert_int_equal(frame.plane[0][0], buffer * MOST_BYTES);
    assert_false(p->queued[buffer]);
    sf_source_release(p->source, &frame);
    assert_true(p->queued[buffer]);
}

static void assert_none(played *p, sf_status expected, const char *part) {
    sf_frame frame;
    assert_status(p->ctx, sf_source_next(p->source, 1, &frame), expected);
    assert_error_names(p->ctx, part);
}

static sf_source_counts counts_of(const played *p) {
    sf_source_counts counts;
    sf_source_count(p->source, &counts);
    return counts;
}

/* 1. Frames */

static void test_frame(void **state) {
    (void)state;
    played p;
    sf_frame frame;
    const sf_libcamera_request asked = {.exposure_us = 5000, .gain = 3, .fps = 25};
    open_camera(&p, SF_PIXEL_YU12, &asked);
    sf_libcamera_filled told = filled(&p, 2, 7);
    told.exposure_us = 8000;
    told.gain = 1.5;
    send(&p, told);
    assert_ok(p.ctx, sf_source_next(p.source, 0, &frame));
    assert_true(frame.width == WIDTH && frame.height == HEIGHT && frame.format == SF_PIXEL_YU12);
    assert_true(frame.matrix == SF_YUV_709 && !frame.full_range && frame.bytes == 0);
    assert_true(frame.sequence == 7 && frame.time_ns == 7000 && frame.dmabuf == p.fd);
    assert_true(frame.stride[0] == STRIDE && frame.stride[1] == STRIDE / 2 && frame.stride[2] == STRIDE / 2);
    assert_int_equal(frame.plane[0][1], 2 * MOST_BYTES + 1);
    assert_int_equal(frame.plane[1][0], 2 * MOST_BYTES + STRIDE * HEIGHT);
    assert_int_equal(frame.plane[2][0], 2 * MOST_BYTES + STRIDE * HEIGHT + STRIDE * HEIGHT / 4);
    assert_float_equal(frame.exposure_s, 0.008, 1e-12);
    assert_true(frame.gain == 1.5);
    sf_source_release(p.source, &frame);

    /* What is not told is as it was asked for. */
    send_good(&p, 3, 8);
    assert_ok(p.ctx, sf_source_next(p.source, 0, &frame));
    assert_float_equal(frame.exposure_s, 0.005, 1e-12);
    assert_true(frame.gain == 3);
    sf_source_release(p.source, &frame);

    sf_source_info info;
    sf_source_describe(p.source, &info);
    assert_string_equal(info.name, "Model, 6x4 YU12");
    assert_true(info.width == WIDTH && info.height == HEIGHT && info.live && info.can_lock_exposure);
    assert_true(info.format == SF_PIXEL_YU12 && info.frames_per_second == 25);
    close_all(&p);
}

/* Automatic: what is not told is unknown. */
static void test_automatic(void **state) {
    (void)state;
    played p;
    sf_frame frame;
    const sf_libcamera_request asked = {.exposure_us = -1};
    open_camera(&p, SF_PIXEL_NV12, &asked);
    send_good(&p, 0, 0);
    assert_ok(p.ctx, sf_source_next(p.source, 0, &frame));
    assert_true(frame.exposure_s == 0 && frame.gain == 0);
    close_all(&p);
}

static void test_order(void **state) {
    (void)state;
    played p;
    open_camera(&p, SF_PIXEL_NV12, &nothing);
    send_good(&p, 0, 5);
    assert_next(&p, 0, 5);
    send_good(&p, 2, 7);
    send_good(&p, 1, 6);
    assert_next(&p, 1, 6);
    assert_next(&p, 2, 7);
    assert_int_equal(counts_of(&p).dropped, 0);
    send_good(&p, 3, 10); /* 8 and 9 lack */
    assert_next(&p, 3, 10);
    send_good(&p, 0, 9); /* it comes after all: neither given nor damaged, and not lost to the camera */
    assert_none(&p, SF_ERR_TIMEOUT, "no frame came in time");
    assert_true(p.queued[0]);
    const sf_source_counts counts = counts_of(&p);
    assert_true(counts.given == 4 && counts.dropped == 2 && counts.damaged == 0);
    close_all(&p);
}

/* A frame that is marked, and one a byte too short; both go back at once. */
static void test_damaged(void **state) {
    (void)state;
    played p;
    open_camera(&p, SF_PIXEL_NV12, &nothing);
    sf_libcamera_filled marked = filled(&p, 0, 0), cut = filled(&p, 1, 1);
    marked.damaged = 1;
    cut.bytes--;
    send(&p, marked);
    send(&p, cut);
    send_good(&p, 2, 2);
    assert_next(&p, 2, 2);
    assert_true(p.queued[0] && p.queued[1]);
    assert_true(counts_of(&p).damaged == 2 && counts_of(&p).given == 1 && counts_of(&p).dropped == 0);
    close_all(&p);
}

/* What lies behind the end is no part of a JPEG; more than the buffer holds is not believed. */
static void test_jpeg(void **state) {
    (void)state;
    static const uint8_t jpeg[] = {0xff, 0xd8, 1, 2, 3, 0xff, 0xd9, 0, 0};
    played p;
    sf_frame frame;
    open_camera(&p, SF_PIXEL_MJPEG, &nothing);
    for (size_t b = 0; b < BUFFERS; b++)
        assert_int_equal(pwrite(p.fd, jpeg, sizeof jpeg, (off_t)(b * MOST_BYTES)), sizeof jpeg);
    sf_libcamera_filled cut = filled(&p, 0, 0), whole = filled(&p, 1, 1), boastful = filled(&p, 2, 2);
    cut.first_bytes = cut.bytes = 6;
    whole.first_bytes = whole.bytes = 9;
    boastful.first_bytes = 1 << 20;
    send(&p, cut);
    send(&p, whole);
    send(&p, boastful);
    for (uint64_t i = 1; i <= 2; i++) {
        assert_ok(p.ctx, sf_source_next(p.source, 0, &frame));
        assert_true(frame.sequence == i && frame.bytes == 7 && frame.stride[0] == 0 && frame.full_range);
        sf_source_release(p.source, &frame);
    }
    assert_int_equal(counts_of(&p).damaged, 1);
    close_all(&p);
}

/* 2. The newest */

static void test_newest(void **state) {
    (void)state;
    played p;
    sf_frame frame;
    open_camera(&p, SF_PIXEL_NV12, &nothing);
    for (uint32_t i = 0; i < 3; i++) send_good(&p, i, i);
    assert_ok(p.ctx, sf_source_newest(p.source, 0, &frame));
    assert_int_equal(frame.sequence, 2);
    assert_int_equal(frame.plane[0][0], 2 * MOST_BYTES);
    assert_true(p.queued[0] && p.queued[1] && !p.queued[2]);
    assert_true(counts_of(&p).skipped == 2 && counts_of(&p).given == 1);
    sf_source_release(p.source, &frame);

    /* A damaged one that is newer does not lend its number to the one that is given. */
    sf_libcamera_filled marked = filled(&p, 0, 4);
    marked.damaged = 1;
    send_good(&p, 3, 3);
    send(&p, marked);
    assert_ok(p.ctx, sf_source_newest(p.source, 0, &frame));
    assert_int_equal(frame.sequence, 3);
    assert_int_equal(frame.plane[0][0], 3 * MOST_BYTES);
    assert_true(p.queued[0] && counts_of(&p).damaged == 1 && counts_of(&p).skipped == 2);
    close_all(&p);
}

/* 3. Controls and faults */

/* With the next buffer, once. */
static void test_lock(void **state) {
    (void)state;
    played p;
    open_camera(&p, SF_PIXEL_NV12, &nothing);
    uint32_t number = 0;
    for (int locked = 1; locked >= 0; locked--) {
        send_good(&p, 0, number);
        assert_next(&p, 0, number++);
        assert_true(p.set.enable == SF_AUTO_LEAVE && p.set.white_balance == SF_AUTO_LEAVE);
        assert_ok(p.ctx, sf_source_lock_exposure(p.source, locked));
        send_good(&p, 1, number);
        assert_next(&p, 1, number++);
        assert_int_equal(p.set.enable, locked ? SF_AUTO_OFF : SF_AUTO_ON);
        assert_int_equal(p.set.white_balance, locked ? SF_AUTO_OFF : SF_AUTO_ON);
    }
    close_all(&p);
}

static int times_gone(void) {
    int times = 0;
    for (const char *at = test_log; (at = strstr(at, "played is gone")); at++) times++;
    return times;
}

/* One warning; a frame that is out stays readable, and what came before is given first. */
static void test_gone(void **state) {
    (void)state;
    played p;
    sf_frame frame;
    open_camera(&p, SF_PIXEL_NV12, &nothing);
    send_good(&p, 0, 0);
    assert_ok(p.ctx, sf_source_next(p.source, 0, &frame));
    send_good(&p, 1, 1);
    sf_libcamera_queue_lose(&p.s.queue);
    assert_next(&p, 1, 1);
    assert_int_equal(times_gone(), 0);
    assert_none(&p, SF_ERR_IO, "libcamera: played: is gone");
    assert_none(&p, SF_ERR_IO, "libcamera: played: is gone");
    assert_int_equal(times_gone(), 1);
    assert_int_equal(frame.plane[0][9], 9);
    sf_source_release(p.source, &frame);
    close_all(&p);
}

/* Nobody says that it is gone, but the kernel lacks a device behind it. */
static void test_device_gone(void **state) {
    (void)state;
    played p;
    open_camera(&p, SF_PIXEL_NV12, &nothing);
    assert_none(&p, SF_ERR_TIMEOUT, "no frame came in time");
    assert_ok(p.ctx, sf_libcamera_add_node(&p.s.device, makedev(4095, 1000000)));
    send_good(&p, 0, 0);
    assert_next(&p, 0, 0);
    assert_none(&p, SF_ERR_IO, "is gone");
    assert_int_equal(times_gone(), 1);
    close_all(&p);
}

/* What fails in the camera as a buffer is given to it ends the call, wherever that happens. */
static void test_queue_fails(void **state) {
    (void)state;
    played p;
    sf_frame frame;
    open_camera(&p, SF_PIXEL_NV12, &nothing);
    p.answer = SF_ERR_MEMORY;
    sf_libcamera_filled marked = filled(&p, 0, 0);
    marked.damaged = 1;
    send(&p, marked);
    assert_int_equal(sf_source_next(p.source, 0, &frame), SF_ERR_MEMORY);
    send_good(&p, 1, 1);
    send_good(&p, 2, 2);
    assert_int_equal(sf_source_newest(p.source, 0, &frame), SF_ERR_MEMORY);
    p.answer = SF_OK;
    send_good(&p, 3, 3);
    assert_next(&p, 3, 3);
    close_all(&p);
}

static void test_begin_refused(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_libcamera_source s = {.device = {.ctx = ctx, .id = "played"}};
    s.picture = (sf_libcamera_picture){.format = SF_PIXEL_YUYV, .width = 5, .height = 4, .stride = 11};
    assert_status(ctx, sf_libcamera_source_begin(&s, BUFFERS), SF_ERR_UNSUPPORTED);
    assert_error_names(ctx, "played: stride: 11 is too short");
    s.picture.stride = 12; /* YUYV has pixels by twos */
    assert_status(ctx, sf_libcamera_source_begin(&s, SF_SOURCE_MAX_LEASES - 1), SF_ERR_UNSUPPORTED);
    assert_error_names(ctx, "played: gives fewer buffers than frames may be out");
    assert_ok(ctx, sf_libcamera_source_begin(&s, SF_SOURCE_MAX_LEASES));
    sf_libcamera_source_end(&s);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_frame),        cmocka_unit_test(test_automatic),
        cmocka_unit_test(test_order),        cmocka_unit_test(test_damaged),
        cmocka_unit_test(test_jpeg),         cmocka_unit_test(test_newest),
        cmocka_unit_test(test_lock),         cmocka_unit_test(test_gone),
        cmocka_unit_test(test_device_gone),  cmocka_unit_test(test_queue_fails),
        cmocka_unit_test(test_begin_refused)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
