/* test_libcamera.c - names of libcamera's cameras, what is set of them and what is said, where there is no
 * camera. */
#include "../testing.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "capture/auto_exposure.h"
#include "capture/dma_heaps.h"
#include "capture/frame_order.h"
#include "capture/libcamera_format.h"
#include "capture/libcamera_name.h"

static void assert_set(sf_auto_set set, int enable, int exposure_mode, int gain_mode) {
    assert_int_equal(set.enable, enable);
    assert_int_equal(set.exposure_mode, exposure_mode);
    assert_int_equal(set.gain_mode, gain_mode);
}

/* A switch of each kind of camera: one for all until 0.4, one for each from 0.5 on, a webcam's of 0.5. */
static const sf_auto_has none, old = {1, 0, 0}, both = {1, 1, 1}, webcam = {1, 1, 0};

static void test_auto_open(void **state) {
    (void)state;
    const sf_auto_asked nothing = {0, 0}, automatic = {-1, 0}, manual = {10000, 0}, gain = {0, 2},
                        mixed = {-1, 2}, fixed = {10000, 2};
    assert_set(sf_auto_open(none, fixed), -1, -1, -1);
    assert_set(sf_auto_open(old, nothing), -1, -1, -1);
    assert_set(sf_auto_open(old, automatic), 1, -1, -1);
    assert_set(sf_auto_open(old, manual), 0, -1, -1);
    assert_set(sf_auto_open(old, gain), -1, -1, -1);
    assert_set(sf_auto_open(both, nothing), -1, -1, -1);
    assert_set(sf_auto_open(both, automatic), -1, 1, -1);
    assert_set(sf_auto_open(both, manual), -1, 0, -1);
    assert_set(sf_auto_open(both, gain), -1, -1, 0);
    assert_set(sf_auto_open(both, mixed), -1, 1, 0);
    assert_set(sf_auto_open(both, fixed), -1, 0, 0);
    assert_set(sf_auto_open(webcam, fixed), -1, 0, -1);
}

static void test_auto_lock(void **state) {
    (void)state;
    const sf_auto_asked nothing = {0, 0}, automatic = {-1, 0}, manual = {10000, 0}, gain = {0, 2},
                        fixed = {10000, 2};
    assert_set(sf_auto_lock(none, nothing, 1), -1, -1, -1);
    assert_set(sf_auto_lock(old, nothing, 1), 0, -1, -1);
    assert_set(sf_auto_lock(old, automatic, 0), 1, -1, -1);
    assert_set(sf_auto_lock(old, manual, 1), -1, -1, -1);
    assert_set(sf_auto_lock(both, nothing, 1), -1, 0, 0);
    assert_set(sf_auto_lock(both, automatic, 0), -1, 1, 1);
    assert_set(sf_auto_lock(both, manual, 1), -1, -1, 0);
    assert_set(sf_auto_lock(both, gain, 0), -1, 1, -1);
    assert_set(sf_auto_lock(both, fixed, 0), -1, -1, -1);
    assert_set(sf_auto_lock(webcam, nothing, 1), -1, 0, -1);
}

static void make_file(const char *path, mode_t mode) {
    int fd = open(path, O_CREAT | O_WRONLY, 0600);
    assert_true(fd >= 0);
    close(fd);
    assert_int_equal(chmod(path, mode), 0);
}

/* As a user who is not root, whom no permission holds. */
static void explain(const char *dev, char text[512]) {
    int root = geteuid() == 0;
    if (root) assert_int_equal(seteuid(65534), 0);
    sf_dma_heaps_explain(dev, text, 512);
    if (root) assert_int_equal(seteuid(0), 0);
}

static void test_heaps(void **state) {
    (void)state;
    char dev[64] = "/tmp/splatfit-heaps-XXXXXX", heaps[96], system_heap[128], udmabuf[96], text[512];
    assert_non_null(mkdtemp(dev));
    assert_int_equal(chmod(dev, 0755), 0);
    snprintf(heaps, sizeof heaps, "%s/dma_heap", dev);
    snprintf(system_heap, sizeof system_heap, "%s/system", heaps);
    snprintf(udmabuf, sizeof udmabuf, "%s/udmabuf", dev);

    explain(dev, text);
    assert_non_null(strstr(text, "no DMA heap: "));
    assert_non_null(strstr(text, "are missing"));
    assert_non_null(strstr(text, "modprobe udmabuf"));

    /* Not those that are missing are named, but the one that cannot be opened. */
    assert_int_equal(mkdir(heaps, 0755), 0);
    make_file(system_heap, 0);
    explain(dev, text);
    assert_non_null(strstr(text, system_heap));
    assert_non_null(strstr(text, strerror(EACCES)));
    assert_non_null(strstr(text, "GROUP="));

    /* Of a group that is not root's; only root can make one. */
    if (geteuid() == 0) {
        assert_int_equal(chown(system_heap, 0, 12345), 0);
        assert_int_equal(chmod(system_heap, 0660), 0);
        explain(dev, text);
        assert_non_null(strstr(text, "add yourself to its group"));
    }

    make_file(udmabuf, 0666);
    explain(dev, text);
    assert_string_equal(text, "");

    unlink(udmabuf);
    unlink(system_heap);
    rmdir(heaps);
    rmdir(dev);
}

static void expect(sf_context *ctx, const char *name, sf_status expected, const char *part) {
    sf_source *source;
    assert_status(ctx, sf_source_open(ctx, name, &source), expected);
    assert_null(source);
    assert_error_names(ctx, part);
}

static void test_request(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_libcamera_request r;
    assert_ok(ctx, sf_libcamera_read_name(ctx, "libcamera:0", &r));
    assert_string_equal(r.camera, "0");
    assert_true(r.width == 0 && r.height == 0 && r.exposure_us == 0 && r.buffers == 4 && !*r.format);
    assert_true(r.fps == 0 && r.gain == 0);
    assert_ok(ctx, sf_libcamera_read_name(ctx,
                                          "libcamera:/base/i2c@1?size=640x480&format=nv12&fps=30&gain=2.5&"
                                          "buffers=6&exposure=manual:10000",
                                          &r));
    assert_string_equal(r.camera, "/base/i2c@1");
    assert_true(r.width == 640 && r.height == 480 && r.exposure_us == 10000 && r.buffers == 6);
    assert_true(r.fps == 30 && r.gain == 2.5);
    assert_ok(ctx, sf_libcamera_read_name(ctx, "libcamera:0?exposure=auto", &r));
    assert_true(r.exposure_us == -1 && r.width == 0);
    assert_status(ctx, sf_libcamera_read_name(ctx, "libcamera:0?format=444p", &r), SF_ERR_ARGUMENT);
    sf_context_destroy(&ctx);
}

static void test_formats(void **state) {
    (void)state;
    const uint32_t nv12 = 'N' | 'V' << 8 | '1' << 16 | '2' << 24;
    const sf_libcamera_format *f = sf_libcamera_format_of(nv12);
    assert_non_null(f);
    assert_int_equal(f->format, SF_PIXEL_NV12);
    assert_ptr_equal(f, sf_libcamera_format_named("NV12"));
    assert_null(sf_libcamera_format_of(nv12 + 1));
    assert_null(sf_libcamera_format_named("444p"));
    assert_int_equal(sf_libcamera_format_at(0)->format, SF_PIXEL_YUYV);
    assert_int_equal(sf_libcamera_format_named("mjpeg")->format, SF_PIXEL_MJPEG);
    assert_int_equal(sf_libcamera_plane_bytes(f, 640, 481, 0), 640 * 481);
    assert_int_equal(sf_libcamera_plane_bytes(f, 640, 481, 1), 640 * 241);
    f = sf_libcamera_format_named("yu12");
    assert_int_equal(sf_libcamera_plane_bytes(f, 640, 480, 2), 320 * 240);
    f = sf_libcamera_format_named("422p");
    assert_int_equal(sf_libcamera_plane_bytes(f, 640, 480, 1), 320 * 480);
    assert_int_equal(sf_libcamera_plane_bytes(sf_libcamera_format_named("mjpeg"), 0, 480, 0), 1);
}

static void test_frame_order(void **state) {
    (void)state;
    sf_frame_order order = {0};
    uint64_t dropped = 0;
    assert_true(sf_frame_order_take(&order, 7, 4, &dropped)); /* the first is where it begins */
    assert_true(order.sequence == 7 && dropped == 0);
    assert_int_equal(sf_frame_order_ahead(&order, 8), 1);
    assert_true(sf_frame_order_take(&order, 10, 4, &dropped));
    assert_true(order.sequence == 10 && dropped == 2);
    assert_false(sf_frame_order_take(&order, 9, 4, &dropped)); /* late */
    assert_true(sf_frame_order_take(&order, 11, 4, &dropped));
    assert_true(order.sequence == 11 && dropped == 2 && order.late == 0);
    for (int i = 0; i < 3; i++) assert_false(sf_frame_order_take(&order, 0, 4, &dropped));
    assert_true(sf_frame_order_take(&order, 1, 4, &dropped)); /* the driver counts anew */
    assert_true(order.sequence == 12 && order.driver_sequence == 1 && dropped == 2);
    order.driver_sequence = UINT32_MAX;
    assert_true(sf_frame_order_take(&order, 1, 4, &dropped)); /* it wraps */
    assert_true(order.sequence == 14 && dropped == 3);
    sf_frame_order_restart(&order);
    assert_true(sf_frame_order_take(&order, 0, 4, &dropped)); /* neither late nor a gap */
    assert_true(order.sequence == 15 && order.driver_sequence == 0 && dropped == 3);
    assert_true(sf_frame_order_take(&order, 0, 1, &dropped)); /* a driver that does not count */
    assert_true(order.sequence == 16 && dropped == 3);
}

#ifdef SF_HAVE_LIBCAMERA

static void test_names(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    expect(ctx, "libcamera:", SF_ERR_ARGUMENT, "names no camera");
    expect(ctx, "libcamera:0?size=640", SF_ERR_ARGUMENT, "\"640\"");
    expect(ctx, "libcamera:0?size=0x480", SF_ERR_ARGUMENT, "\"0x480\"");
    expect(ctx, "libcamera:0?size=640x480x2", SF_ERR_ARGUMENT, "\"640x480x2\"");
    expect(ctx, "libcamera:0?format=P010", SF_ERR_ARGUMENT, "\"P010\"");
    expect(ctx, "libcamera:0?exposure=long", SF_ERR_ARGUMENT, "\"long\"");
    expect(ctx, "libcamera:0?exposure=manual:0", SF_ERR_ARGUMENT, "\"manual:0\"");
    expect(ctx, "libcamera:0?gain=-1", SF_ERR_ARGUMENT, "gain");
    expect(ctx, "libcamera:0?buffers=2", SF_ERR_ARGUMENT, "buffers");
    expect(ctx, "libcamera:0?colour=red", SF_ERR_ARGUMENT, "\"colour\"");
    sf_context_destroy(&ctx);
}

/* libcamera is started for each, and stopped again, in one context after the other. */
static void test_absent(void **state) {
    (void)state;
    for (int i = 0; i < 2; i++) {
        sf_context *ctx = test_context();
        expect(ctx, "libcamera:no such camera", SF_ERR_IO, "\"no such camera\"");
        expect(ctx, "libcamera:1000?size=640x480", SF_ERR_IO, "\"1000\"");
        sf_devices *devices;
        assert_ok(ctx, sf_devices_find(ctx, &devices));
        sf_devices_free(&devices);
        sf_context_destroy(&ctx);
    }
}

#else

static void test_names(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    expect(ctx, "libcamera:0", SF_ERR_UNSUPPORTED, "without libcamera");
    sf_context_destroy(&ctx);
}

static void test_absent(void **state) {
    (void)state;
    test_skip("built without libcamera");
}

#endif

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_auto_open), cmocka_unit_test(test_auto_lock),
                                       cmocka_unit_test(test_heaps),     cmocka_unit_test(test_request),
                                       cmocka_unit_test(test_formats),   cmocka_unit_test(test_frame_order),
                                       cmocka_unit_test(test_names),     cmocka_unit_test(test_absent)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
