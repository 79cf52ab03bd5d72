/* test_v4l2_unplugged.c - the V4L2 source on a driver that is played: cameras that go and come back, calls
 * that fail, devices. */
#include "testing.h"

#ifdef __linux__
#include "v4l2_fixture.h"

#include <errno.h>
#include <poll.h>
#include <stdlib.h>

#include "capture/v4l2.h"
#include "capture/v4l2_device.h"

/* 6. Faults */

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
        bench *b = v4l2_bench_start();
        fake *f = &b->driver;
        v4l2_open_source(b, "v4l2:/dev/video0?format=YUYV&exposure=manual:99&fps=20");
        assert_int_equal(v4l2_pass_frame(b), 0);
        f->unplug_ns = f->now_ns + 10 * v4l2_ms;
        f->plug_ns = f->now_ns + 2000 * v4l2_ms;
        f->plug_node = to;
        int64_t since = f->now_ns;
        assert_int_equal(next_status(b, 500), SF_ERR_TIMEOUT);
        assert_true(f->now_ns - since >= 500 * v4l2_ms && f->now_ns - since < 600 * v4l2_ms);
        assert_error_names(b->ctx, "/dev/video0: Webcam is gone and not back yet");
        test_assert_contains(test_log, "/dev/video0: Webcam is gone; it is waited for\n", __FILE__, __LINE__);
        assert_int_equal(f->fds_open, 0);
        assert_int_equal(f->maps, 0);
        assert_int_equal(next_status(b, 0), SF_ERR_TIMEOUT);
        v4l2_assert_counts(b, 0, 0, 0, 0);
        v4l2_control_of(&f->nodes[0], V4L2_CID_EXPOSURE_ABSOLUTE)->value = 1234; /* it has forgotten */
        f->nodes[0].fps = 1;
        f->nodes[0].width = 128;
        f->nodes[0].padding = 16; /* and lays frames out in another way */
        test_log_clear();
        assert_int_equal(next_status(b, 5000), SF_OK);
        v4l2_assert_counts(b, 0, 0, 0, 1);
        test_assert_contains(test_log, "Webcam is back\n", __FILE__, __LINE__);
        assert_int_equal(f->nodes[to].width, 64);
        assert_int_equal(f->nodes[to].fps, 20);
        assert_int_equal(v4l2_control_of(&f->nodes[to], V4L2_CID_EXPOSURE_ABSOLUTE)->value, 99);
        for (uint64_t i = 0; i < 5; i++) {
            sf_frame frame = v4l2_next_frame(b);
            assert_int_equal(frame.sequence, 2 + i);
            assert_int_equal(frame.stride[0], 128 + 16);
            sf_source_release(b->source, &frame);
        }
        v4l2_assert_counts(b, 0, 0, 0, 1);
        v4l2_bench_end(b);
    }
}

/* It comes back without the caller asking for long: with a timeout of 0 alone. */
static void test_unplugged_without_waiting(void **state) {
    (void)state;
    bench *b = v4l2_bench_start();
    fake *f = &b->driver;
    v4l2_open_source(b, "v4l2:0?format=YUYV");
    v4l2_pass_frame(b);
    v4l2_fake_unplug(&f->nodes[0]);
    assert_int_equal(next_status(b, 0), SF_ERR_TIMEOUT);
    long calls = f->calls;
    for (int i = 0; i < 99; i++) {
        v4l2_pass_time(f, v4l2_ms);
        assert_int_equal(next_status(b, 0), SF_ERR_TIMEOUT);
    }
    assert_true(f->calls - calls < 10); /* not looked for each time */
    v4l2_fake_move(f, 0, 0);
    v4l2_pass_time(f, 200 * v4l2_ms);
    assert_int_equal(next_status(b, 0), SF_ERR_TIMEOUT); /* it is back, and no frame has come */
    v4l2_assert_counts(b, 0, 0, 0, 1);
    v4l2_pass_frame(b);
    v4l2_bench_end(b);
}

/* Frames that are out while the camera goes stay readable; closing and giving back go in any order. */
static void test_unplugged_with_leases(void **state) {
    (void)state;
    for (int order = 0; order < 4; order++) {
        bench *b = v4l2_bench_start();
        fake *f = &b->driver;
        f->nodes[0].exports = order & 1;
        v4l2_open_source(b, "v4l2:0?format=YUYV&dmabuf=1");
        sf_frame a = v4l2_next_frame(b), c = v4l2_next_frame(b);
        sf_source_release(b->source, &c);
        c = v4l2_next_frame(b);
        v4l2_fake_unplug(&f->nodes[0]);
        sf_source_release(b->source, &a); /* before anybody has noticed */
        assert_int_equal(next_status(b, 100), SF_ERR_TIMEOUT);
        assert_error_names(b->ctx, "frames of it are still out");
        assert_int_equal(f->maps, 1);
        v4l2_assert_plane(&c, 0, 0, 0, 128, 128, 48);
        v4l2_fake_move(f, 0, 1);
        if (order == 0) {
            sf_source_release(b->source, &c);
            assert_int_equal(f->maps, 0);
        }
        v4l2_pass_frame(b);
        v4l2_assert_counts(b, 0, 0, 0, 1);
        if (order == 2) v4l2_assert_plane(&c, 0, 0, 0, 128, 128, 48);
        if (order == 2) sf_source_release(b->source, &c);
        if (order == 3) { /* twice, with a frame of each out */
            a = v4l2_next_frame(b);
            v4l2_fake_unplug(&f->nodes[1]);
            assert_int_equal(sf_source_next(b->source, 100, &a), SF_ERR_ARGUMENT);
            assert_int_equal(f->fds_open, 1 + 1 + 4); /* the node, the DMA buffers of c and of all now */
            sf_source_release(b->source, &c);
            assert_int_equal(next_status(b, 100), SF_ERR_TIMEOUT);
        }
        v4l2_bench_end(b);
    }
}

/* The old mapping, where the driver is the same as before, keeps it busy until the frame is given back. */
static void test_busy_until_given_back(void **state) {
    (void)state;
    bench *b = v4l2_bench_start();
    fake *f = &b->driver;
    v4l2_open_source(b, "v4l2:0?format=YUYV");
    sf_frame held = v4l2_next_frame(b);
    v4l2_fake_unplug(&f->nodes[0]);
    assert_int_equal(next_status(b, 100), SF_ERR_TIMEOUT);
    v4l2_fake_move(f, 0, 0);
    v4l2_plan_fault(f, VIDIOC_S_FMT, EBUSY, -1);
    assert_int_equal(next_status(b, 1000), SF_ERR_TIMEOUT);
    assert_error_names(b->ctx, "frames of it are still out");
    sf_source_release(b->source, &held);
    f->faults[0].times = 0;
    v4l2_pass_frame(b);
    v4l2_assert_counts(b, 0, 0, 0, 1);
    v4l2_bench_end(b);
}

/* Only the same camera is taken. */
static void test_other_cameras(void **state) {
    (void)state;
    bench *b = v4l2_bench_start();
    fake *f = &b->driver;
    fake_node *n = &f->nodes[0], other = *n;
    v4l2_open_source(b, "v4l2:0?format=YUYV");
    v4l2_pass_frame(b);
    v4l2_fake_unplug(n);
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
    v4l2_assert_counts(b, 0, 0, 0, 1);
    v4l2_bench_end(b);

    for (int with_twin = 0; with_twin < 2;
         with_twin++) { /* no number, or one that two have: the socket counts */
        b = v4l2_bench_start();
        n = &f->nodes[0];
        other = *n;
        if (!with_twin) n->serial = other.serial = "";
        other.bus = "usb-2";
        if (with_twin) f->nodes[1] = other;
        v4l2_open_source(b, "v4l2:0?format=YUYV");
        v4l2_fake_unplug(n);
        assert_int_equal(next_status(b, 300), SF_ERR_TIMEOUT);
        f->nodes[1] = other;
        assert_int_equal(next_status(b, 300), SF_ERR_TIMEOUT);
        v4l2_fake_move(f, 0, 3);
        assert_int_equal(next_status(b, 300), SF_OK);
        assert_true(f->nodes[3].streaming && !f->nodes[1].streaming);
        v4l2_bench_end(b);
    }
}

/* It comes back and is not what it was. */
static void test_back_with_other_frames(void **state) {
    (void)state;
    bench *b = v4l2_bench_start();
    fake *f = &b->driver;
    v4l2_open_source(b, "v4l2:0?format=YUYV");
    v4l2_fake_unplug(&f->nodes[0]);
    assert_int_equal(next_status(b, 0), SF_ERR_TIMEOUT);
    v4l2_fake_move(f, 0, 0);
    f->nodes[0].other = (fake_size){128, 96, 0};
    for (int i = 0; i < 2; i++) {
        assert_int_equal(next_status(b, 300), SF_ERR_IO);
        assert_error_names(b->ctx, "size: 64x48 cannot be had (the driver gives 128x96)");
    }
    v4l2_bench_end(b);
}

/* Signs of a camera that is gone: every call may be the one that says it. */
static void test_gone_at_any_call(void **state) {
    (void)state;
    static const unsigned long requests[] = {VIDIOC_DQBUF, VIDIOC_QBUF, VIDIOC_STREAMOFF, VIDIOC_STREAMON};
    for (size_t i = 0; i < COUNT(requests); i++) {
        bench *b = v4l2_bench_start();
        fake *f = &b->driver;
        v4l2_open_source(b, "v4l2:0?format=YUYV");
        v4l2_pass_frame(b);
        v4l2_plan_fault(f, requests[i], ENODEV, 1);
        if (i >= 2) f->nodes[0].failed = 1;
        for (int k = 0; k < 4; k++) v4l2_pass_frame(b); /* the node is still there, and opened again */
        v4l2_assert_counts(b, 0, 0, 0, 1);
        v4l2_bench_end(b);
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
            bench *b = v4l2_bench_start();
            fake *f = &b->driver;
            f->nodes[0].multi = (int)(e & 1);
            f->nodes[0].exports = 1;
            f->fail_at = at;
            f->fail_with = errors[e / 2];
            f->fail_on = (int)(e & 1);
            sf_status status = v4l2_try_open(b, "v4l2:0?format=YUYV&exposure=manual:50&dmabuf=1&input=0");
            sf_frame held = {.lease = NULL};
            for (int i = 0; i < 6 && status == SF_OK; i++) {
                status = i == 3 ? sf_source_next(b->source, 1000, &held) : next_status(b, 1000);
            }
            if (b->source) sf_source_release(b->source, &held);
            if (status != SF_OK) assert_true(*sf_last_error(b->ctx));
            failed += status != SF_OK;
            worked += status == SF_OK;
            calls = f->calls < at ? 0 : calls; /* the last call was before */
            v4l2_bench_end(b);
        }
    }
    assert_true(failed > 20 && worked > 20);
}

static void test_memory_ends(void **state) {
    (void)state;
    bench *b = v4l2_bench_start();
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
        status = v4l2_try_open(b, "v4l2:0?format=YUYV");
        if (status == SF_OK) break;
        assert_int_equal(status, SF_ERR_MEMORY);
        assert_int_equal(counted.live, live);
        assert_int_equal(b->driver.fds_open, 0);
    }
    assert_int_equal(failures, 4); /* the source, its own, the name, the stream */
    counted.fail_at = 0;
    v4l2_bench_end(b);
    assert_int_equal(counted.live, 0);
}

/* 7. The list of cameras */

/* Beside the webcam a sensor of any size and a second webcam. */
static void plug_in_others(fake *f) {
    f->nodes[1].plugged = 1; /* metadata: no camera */
    f->nodes[2] = f->nodes[0];
    f->nodes[2].card = "Sensor";
    f->nodes[2].serial = "";
    f->nodes[2].multi = 1;
    v4l2_set_format(&f->nodes[2], V4L2_PIX_FMT_NV12M, 2);
    f->nodes[2].formats[0].sizes[0] = (fake_size){1, 1, 60};
    f->nodes[3] = f->nodes[0];
}

static void test_devices(void **state) {
    (void)state;
    bench *b = v4l2_bench_start();
    fake *f = &b->driver;
    sf_devices *devices;
    sf_device_info info;
    sf_device_mode mode;
    size_t before = 0;
    plug_in_others(f);
    assert_ok(b->ctx, sf_devices_find(b->ctx, &devices));
    while (!sf_devices_get(devices, before, &info)) before++; /* of this machine itself */
    v4l2_plan_fault(f, 1, 0, 0);
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

    v4l2_plan_fault(f, 1, EACCES, 1); /* one that may not be opened is said, and passed over */
    test_log_clear();
    assert_ok(b->ctx, sf_v4l2_find_with(b->ctx, &b->sys, devices));
    test_assert_contains(test_log, "/dev/video0: cannot be opened: Permission denied", __FILE__, __LINE__);
    assert_ok(b->ctx, sf_devices_get(devices, before + 4, &info));
    assert_int_equal(sf_devices_get(devices, before + 5, &info), SF_ERR_END);
    sf_devices_free(&devices);
    assert_null(devices);
    v4l2_bench_end(b);
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
    assert_true(sf_v4l2_system.now_ns(NULL) - since >= 2 * v4l2_ms);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
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
