/* test_v4l2_stream.c - the V4L2 source on a driver that is played: frames, damaged ones, waiting, errors. */
#include "testing.h"

#ifdef __linux__
#include "v4l2_fixture.h"

#include <errno.h>
#include <poll.h>
#include <string.h>

/* 4. What is lost */

static void test_sequence(void **state) {
    (void)state;
    bench *b = v4l2_bench_start();
    fake_node *n = &b->driver.nodes[0];
    n->sequence = 0xfffffffd;
    v4l2_open_source(b, "v4l2:0?format=YUYV");
    for (uint64_t i = 0; i < 6; i++) assert_int_equal(v4l2_pass_frame(b), 0xfffffffd + i);
    v4l2_assert_counts(b, 0, 0, 0, 0);
    n->drop = 5;
    assert_int_equal(v4l2_pass_frame(b), 0xfffffffd + 11ull);
    v4l2_assert_counts(b, 0, 5, 0, 0);
    n->sequence = 3; /* a driver that begins anew, or stands still */
    assert_int_equal(v4l2_pass_frame(b), 0xfffffffd + 12ull);
    n->sequence = 3;
    assert_int_equal(v4l2_pass_frame(b), 0xfffffffd + 13ull);
    assert_int_equal(v4l2_pass_frame(b), 0xfffffffd + 14ull);
    v4l2_assert_counts(b, 0, 5, 0, 0);
    v4l2_bench_end(b);
}

static void test_damaged(void **state) {
    (void)state;
    bench *b = v4l2_bench_start();
    fake_node *n = &b->driver.nodes[0];
    v4l2_open_source(b, "v4l2:0?format=YUYV");
    assert_int_equal(v4l2_pass_frame(b), 0);
    n->flags = V4L2_BUF_FLAG_ERROR;
    assert_int_equal(v4l2_pass_frame(b), 2);
    v4l2_assert_counts(b, 0, 0, 1, 0);
    n->cut = 1;
    assert_int_equal(v4l2_pass_frame(b), 4);
    v4l2_assert_counts(b, 0, 0, 2, 0);
    assert_int_equal(v4l2_counts_of(b).given, 3);
    for (int i = 0; i < 10; i++) { /* no buffer is lost by it */
        n->cut = 1;
        v4l2_pass_frame(b);
    }
    v4l2_assert_counts(b, 0, 0, 12, 0);
    v4l2_bench_end(b);

    b = v4l2_bench_start();
    n->multi = 1;
    n->data_offset = 64;
    v4l2_set_format(n, V4L2_PIX_FMT_NV12M, 2);
    v4l2_open_source(b, "v4l2:0");
    n->cut = 1;
    assert_int_equal(v4l2_pass_frame(b), 1);
    v4l2_assert_counts(b, 0, 0, 1, 0);
    v4l2_bench_end(b);
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
    bench *b = v4l2_bench_start();
    fake_node *n = &b->driver.nodes[0];
    uint64_t damaged = 0;
    n->jpeg = cases[0].data;
    n->jpeg_size = cases[0].size;
    v4l2_open_source(b, "v4l2:0?format=MJPEG");
    for (size_t i = 0; i < COUNT(cases); i++) {
        sf_frame frame;
        n->jpeg = cases[i].data;
        n->jpeg_size = cases[i].size;
        sf_status status = sf_source_next(b->source, FRAME_MS, &frame);
        assert_int_equal(status, cases[i].bytes ? SF_OK : SF_ERR_TIMEOUT);
        damaged += !cases[i].bytes;
        v4l2_assert_counts(b, 0, 0, damaged, 0);
        if (status != SF_OK) continue;
        assert_int_equal(frame.bytes, cases[i].bytes);
        assert_int_equal(frame.stride[0], 0);
        assert_true(frame.full_range && frame.matrix == SF_YUV_601);
        assert_memory_equal(frame.plane[0], cases[i].data, cases[i].bytes);
        sf_source_release(b->source, &frame);
    }
    v4l2_bench_end(b);
}

static void test_newest(void **state) {
    (void)state;
    bench *b = v4l2_bench_start();
    fake_node *n = &b->driver.nodes[0];
    sf_frame frame, other;
    v4l2_open_source(b, "v4l2:0?format=YUYV&buffers=4");
    n->burst = 4;
    assert_ok(b->ctx, sf_source_newest(b->source, 100, &frame));
    assert_int_equal(frame.sequence, 3);
    v4l2_assert_plane(&frame, 0, 0, 0, 128, 128, 48);
    v4l2_assert_counts(b, 3, 0, 0, 0);
    n->burst = 3;
    n->flags = V4L2_BUF_FLAG_ERROR; /* the first of them */
    assert_ok(b->ctx, sf_source_newest(b->source, 100, &other));
    assert_int_equal(other.sequence, 6);
    v4l2_assert_counts(b, 4, 0, 1, 0);
    v4l2_assert_plane(&frame, 0, 0, 0, 128, 128, 48); /* still whole */
    sf_source_release(b->source, &frame);
    n->burst = 3;
    assert_ok(b->ctx, sf_source_next(b->source, 100, &frame));
    assert_int_equal(frame.sequence, 7); /* in order, none skipped */
    sf_source_release(b->source, &frame);
    sf_source_release(b->source, &other);
    assert_int_equal(v4l2_pass_frame(b), 8);
    assert_int_equal(v4l2_pass_frame(b), 9);
    v4l2_assert_counts(b, 4, 0, 1, 0);
    assert_int_equal(v4l2_counts_of(b).given, 5);
    v4l2_bench_end(b);
}

/* 5. Waiting */

static void test_waits(void **state) {
    (void)state;
    bench *b = v4l2_bench_start();
    fake *f = &b->driver;
    fake_node *n = &f->nodes[0];
    sf_frame frame;
    v4l2_open_source(b, "v4l2:0?format=YUYV");
    n->mute = 1;
    int64_t since = f->now_ns;
    assert_status(b->ctx, sf_source_next(b->source, 300, &frame), SF_ERR_TIMEOUT);
    assert_error_names(b->ctx, "/dev/video0: no frame within 300 ms");
    assert_true(f->now_ns - since == 300 * v4l2_ms);
    since = f->now_ns;
    assert_status(b->ctx, sf_source_next(b->source, -1, &frame), SF_ERR_TIMEOUT);
    assert_true(f->now_ns - since == 10000 * v4l2_ms);
    since = f->now_ns;
    assert_status(b->ctx, sf_source_next(b->source, 0, &frame), SF_ERR_TIMEOUT);
    assert_true(f->now_ns == since);
    n->no_wait = 1; /* a driver that says ready and has nothing: no busy waiting */
    long calls = f->calls;
    assert_status(b->ctx, sf_source_next(b->source, 100, &frame), SF_ERR_TIMEOUT);
    assert_true(f->calls - calls < 250 && f->now_ns - since < 110 * v4l2_ms);
    n->no_wait = n->mute = 0;

    f->interruptions = 7;
    assert_int_equal(v4l2_pass_frame(b), 0);
    f->interruptions = 1000; /* a signal every millisecond */
    since = f->now_ns;
    assert_status(b->ctx, sf_source_next(b->source, 50, &frame), SF_ERR_TIMEOUT);
    assert_true(f->now_ns - since <= 52 * v4l2_ms);
    f->interruptions = 0;
    v4l2_plan_fault(f, VIDIOC_DQBUF, EINTR, 3);
    assert_int_equal(v4l2_pass_frame(b), 1);
    assert_null(strstr(test_log, "started again"));
    n->burst = 1;
    v4l2_produce(f, n); /* it has already arrived */
    assert_ok(b->ctx, sf_source_next(b->source, 0, &frame));
    v4l2_bench_end(b);
}

/* 6. Faults */

/* What drivers refuse for a moment, or for good. */
static void test_transient_errors(void **state) {
    (void)state;
    static const unsigned long requests[] = {VIDIOC_REQBUFS, VIDIOC_QUERYBUF, VIDIOC_QBUF, VIDIOC_STREAMON};
    static const int errors[] = {EINVAL, EIO, EAGAIN};
    for (size_t i = 0; i < COUNT(requests) * COUNT(errors); i++) {
        bench *b = v4l2_bench_start();
        fake *f = &b->driver;
        unsigned long request = requests[i / COUNT(errors)];
        int error = errors[i % COUNT(errors)];
        v4l2_plan_fault(f, request, error, 2);
        v4l2_open_source(b, "v4l2:0?format=YUYV");
        assert_int_equal(v4l2_pass_frame(b), 0);
        v4l2_assert_counts(b, 0, 0, 0, 0);
        v4l2_close_source(b);
        v4l2_plan_fault(f, request, error, -1);
        int64_t since = f->now_ns;
        assert_status(b->ctx, v4l2_try_open(b, "v4l2:0?format=YUYV"), SF_ERR_IO);
        assert_error_names(b->ctx, strerror(error));
        assert_true(f->now_ns - since <= 200 * v4l2_ms);
        v4l2_bench_end(b);
    }
}

/* While it streams. */
static void test_errors_of_the_stream(void **state) {
    (void)state;
    bench *b = v4l2_bench_start();
    fake *f = &b->driver;
    fake_node *n = &f->nodes[0];
    v4l2_open_source(b, "v4l2:0?format=YUYV&buffers=2");
    assert_int_equal(v4l2_pass_frame(b), 0);
    for (int error = 0; error < 3; error++) {
        v4l2_plan_fault(f, VIDIOC_QBUF, error == 0 ? EINVAL : error == 1 ? EIO : EAGAIN, 2);
        for (int i = 0; i < 5; i++) v4l2_pass_frame(b);
    }
    assert_int_equal(v4l2_pass_frame(b), 16);
    assert_null(strstr(test_log, "started again"));
    v4l2_plan_fault(f, VIDIOC_QBUF, EINVAL, 12); /* longer than is waited for: it is started again */
    for (int i = 0; i < 5; i++) v4l2_pass_frame(b);
    test_assert_contains(test_log, "the stream failed and is started again", __FILE__, __LINE__);
    assert_int_equal(v4l2_pass_frame(b), 22);

    sf_frame held = v4l2_next_frame(b);
    test_log_clear();
    n->failed = 1; /* POLLERR, and EIO until it is stopped */
    n->drop = 100; /* what it counts from then on says nothing */
    sf_frame frame = v4l2_next_frame(b);
    assert_int_equal(frame.sequence, 24);
    v4l2_assert_plane(&held, 0, 0, 0, 128, 1 + 127, 0); /* its memory is still there */
    test_assert_contains(test_log, "started again", __FILE__, __LINE__);
    sf_source_release(b->source, &held);
    sf_source_release(b->source, &frame);
    for (uint64_t i = 0; i < 5; i++) assert_int_equal(v4l2_pass_frame(b), 25 + i);
    v4l2_plan_fault(f, VIDIOC_DQBUF, EIO, 1);
    v4l2_pass_frame(b);
    v4l2_plan_fault(f, 2, EINVAL, 1); /* poll itself */
    v4l2_pass_frame(b);
    v4l2_plan_fault(f, VIDIOC_STREAMON, EIO, 6);
    n->failed = 1;
    v4l2_pass_frame(b);
    v4l2_assert_counts(b, 0, 0, 0, 0);

    v4l2_plan_fault(f, VIDIOC_DQBUF, EIO, -1); /* for good */
    int64_t since = f->now_ns;
    assert_status(b->ctx, sf_source_next(b->source, 5000, &frame), SF_ERR_IO);
    assert_error_names(b->ctx, "was started 4 times without a frame");
    assert_true(f->now_ns - since < 3000 * v4l2_ms);
    assert_status(b->ctx, sf_source_next(b->source, 5000, &frame), SF_ERR_IO);
    v4l2_bench_end(b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_sequence),
        cmocka_unit_test(test_damaged),
        cmocka_unit_test(test_jpeg),
        cmocka_unit_test(test_newest),
        cmocka_unit_test(test_waits),
        cmocka_unit_test(test_transient_errors),
        cmocka_unit_test(test_errors_of_the_stream),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

#else

int main(void) { return 0; }
#endif
