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

#include "capture/dma_heaps.h"
#include "capture/frame_order.h"
#include "capture/libcamera_controls.h"
#include "capture/libcamera_format.h"
#include "capture/libcamera_name.h"

static void assert_switches(sf_libcamera_controls set, int enable, int exposure_mode, int gain_mode) {
    assert_int_equal(set.enable, enable);
    assert_int_equal(set.exposure_mode, exposure_mode);
    assert_int_equal(set.gain_mode, gain_mode);
}

/* A switch of each kind of camera: one for all until 0.4, one for each from 0.5 on, a webcam's of 0.5. */
static const sf_libcamera_has none, old = {.enable = 1, .white_balance = 1},
                                    both = {.enable = 1, .exposure_mode = 1, .gain_mode = 1},
                                    webcam = {.enable = 1, .exposure_mode = 1};

static const sf_libcamera_request nothing, automatic = {.exposure_us = -1}, manual = {.exposure_us = 10000},
                                           gain = {.gain = 2}, mixed = {.exposure_us = -1, .gain = 2},
                                           fixed = {.exposure_us = 10000, .gain = 2};

static void test_controls_open(void **state) {
    (void)state;
    assert_switches(sf_libcamera_controls_open(none, &fixed), -1, -1, -1);
    assert_switches(sf_libcamera_controls_open(old, &nothing), -1, -1, -1);
    assert_switches(sf_libcamera_controls_open(old, &automatic), 1, -1, -1);
    assert_switches(sf_libcamera_controls_open(old, &manual), 0, -1, -1);
    assert_switches(sf_libcamera_controls_open(old, &gain), -1, -1, -1);
    assert_switches(sf_libcamera_controls_open(both, &nothing), -1, -1, -1);
    assert_switches(sf_libcamera_controls_open(both, &automatic), -1, 1, -1);
    assert_switches(sf_libcamera_controls_open(both, &manual), -1, 0, -1);
    assert_switches(sf_libcamera_controls_open(both, &gain), -1, -1, 0);
    assert_switches(sf_libcamera_controls_open(both, &mixed), -1, 1, 0);
    assert_switches(sf_libcamera_controls_open(both, &fixed), -1, 0, 0);
    assert_switches(sf_libcamera_controls_open(webcam, &fixed), -1, 0, -1);
}

static void test_controls_values(void **state) {
    (void)state;
    sf_libcamera_controls set = sf_libcamera_controls_open(none, &nothing);
    assert_true(set.exposure_us == 0 && set.gain == 0 && set.frame_us == 0);
    set = sf_libcamera_controls_open(both, &mixed); /* automatic: no time is set */
    assert_true(set.exposure_us == 0 && set.gain == 2);
    const sf_libcamera_request all = {.exposure_us = 10000, .gain = 2.5, .fps = 30};
    set = sf_libcamera_controls_open(none, &all);
    assert_true(set.exposure_us == 10000 && set.gain == 2.5 && set.frame_us == 33333);
    assert_int_equal(set.white_balance, -1);
    set = sf_libcamera_controls_lock(old, &all, 1);
    assert_true(set.exposure_us == 0 && set.gain == 0 && set.frame_us == 0);
}

static void test_controls_lock(void **state) {
    (void)state;
    assert_switches(sf_libcamera_controls_lock(none, &nothing, 1), -1, -1, -1);
    assert_switches(sf_libcamera_controls_lock(old, &nothing, 1), 0, -1, -1);
    assert_switches(sf_libcamera_controls_lock(old, &automatic, 0), 1, -1, -1);
    assert_switches(sf_libcamera_controls_lock(old, &manual, 1), -1, -1, -1);
    assert_switches(sf_libcamera_controls_lock(both, &nothing, 1), -1, 0, 0);
    assert_switches(sf_libcamera_controls_lock(both, &automatic, 0), -1, 1, 1);
    assert_switches(sf_libcamera_controls_lock(both, &manual, 1), -1, -1, 0);
    assert_switches(sf_libcamera_controls_lock(both, &gain, 0), -1, 1, -1);
    assert_switches(sf_libcamera_controls_lock(both, &fixed, 0), -1, -1, -1);
    assert_switches(sf_libcamera_controls_lock(webcam, &nothing, 1), -1, 0, -1);
    assert_int_equal(sf_libcamera_controls_lock(old, &fixed, 1).white_balance, 0);
    assert_int_equal(sf_libcamera_controls_lock(old, &fixed, 0).white_balance, 1);
    assert_int_equal(sf_libcamera_controls_lock(both, &nothing, 1).white_balance, -1);
    const sf_libcamera_has balance = {.white_balance = 1}, gains = {.gain_mode = 1};
    assert_true(sf_libcamera_can_lock(balance) && sf_libcamera_can_lock(gains) &&
                sf_libcamera_can_lock(webcam));
    assert_false(sf_libcamera_can_lock(none));
}

static void test_check_auto(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const sf_libcamera_device device = {.ctx = ctx, .id = "played"};
    const sf_libcamera_has gains = {.gain_mode = 1, .white_balance = 1}, modes = {.exposure_mode = 1};
    assert_ok(ctx, sf_libcamera_check_auto(&device, none, &fixed));
    assert_ok(ctx, sf_libcamera_check_auto(&device, old, &automatic));
    assert_ok(ctx, sf_libcamera_check_auto(&device, modes, &automatic));
    assert_status(ctx, sf_libcamera_check_auto(&device, gains, &automatic), SF_ERR_UNSUPPORTED);
    assert_error_names(ctx, "played: exposure: has no automatic exposure");
    sf_context_destroy(&ctx);
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

/* By its number, or by its id. */
static void test_meant(void **state) {
    (void)state;
    const sf_libcamera_request by_number = {.camera = "1"}, by_id = {.camera = "/base/i2c@1"};
    assert_true(sf_libcamera_is_meant(&by_number, 1, "/base/i2c@1"));
    assert_false(sf_libcamera_is_meant(&by_number, 0, "1"));
    assert_true(sf_libcamera_is_meant(&by_id, 7, "/base/i2c@1"));
    assert_false(sf_libcamera_is_meant(&by_id, 7, "/base/i2c@10"));
    char name[24];
    sf_libcamera_write_name(3, "/base/i2c@1", name, sizeof name);
    assert_string_equal(name, "libcamera:/base/i2c@1");
    sf_libcamera_write_name(3, "/base/i2c@1234", name, sizeof name); /* one byte too many */
    assert_string_equal(name, "libcamera:3");
    sf_libcamera_write_name(3, "what?", name, sizeof name); /* an option begins */
    assert_string_equal(name, "libcamera:3");
}

static uint32_t fourcc_of(const char *text) {
    uint32_t code = 0;
    for (int i = 0; i < 4; i++) code |= (uint32_t)(uint8_t)text[i] << 8 * i;
    return code;
}

static void test_formats(void **state) {
    (void)state;
    const uint32_t nv12 = fourcc_of("NV12");
    const sf_libcamera_format *f = sf_libcamera_format_of(nv12);
    assert_non_null(f);
    assert_int_equal(f->format, SF_PIXEL_NV12);
    assert_ptr_equal(f, sf_libcamera_format_named("NV12"));
    assert_null(sf_libcamera_format_of(nv12 + 1));
    assert_null(sf_libcamera_format_of(0));
    assert_null(sf_libcamera_format_named("444p"));
    assert_int_equal(sf_libcamera_format_at(0)->format, SF_PIXEL_YUYV);
    assert_int_equal(sf_libcamera_format_named("mjpeg")->format, SF_PIXEL_MJPEG);
    assert_int_equal(sf_libcamera_format_of(fourcc_of("BG24"))->format, SF_PIXEL_RGB24);
}

static void test_planes(void **state) {
    (void)state;
    const struct {
        sf_pixel_format format;
        int planes;
        size_t bytes[3], stride[3];
    } cases[] = {
        {SF_PIXEL_NV12, 2, {640 * 481, 640 * 241}, {640, 640}},
        {SF_PIXEL_YU12, 3, {640 * 481, 320 * 241, 320 * 241}, {640, 320, 320}},
        {SF_PIXEL_422P, 3, {640 * 481, 320 * 481, 320 * 481}, {640, 320, 320}},
        {SF_PIXEL_GREY, 1, {640 * 481}, {640}},
        {SF_PIXEL_MJPEG, 1, {1}, {640}},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const sf_libcamera_picture p = {cases[i].format, 600, 481, 640, SF_YUV_601, 0};
        assert_int_equal(sf_libcamera_planes(&p), cases[i].planes);
        for (int k = 0; k < cases[i].planes; k++) {
            assert_int_equal(sf_libcamera_plane_bytes(&p, k), cases[i].bytes[k]);
            assert_int_equal(sf_libcamera_stride(&p, k), cases[i].stride[k]);
        }
    }
}

static void test_choice(void **state) {
    (void)state;
    const uint32_t codes[] = {fourcc_of("pRAA"), 0, fourcc_of("MJPG"), fourcc_of("NV12")};
    sf_libcamera_offer offer = {codes[0], codes, 4};
    char text[64];
    assert_int_equal(sf_libcamera_format_choose(&offer, "")->format, SF_PIXEL_NV12);
    offer.own = fourcc_of("MJPG");
    assert_int_equal(sf_libcamera_format_choose(&offer, "")->format, SF_PIXEL_MJPEG);
    assert_int_equal(sf_libcamera_format_choose(&offer, "nv12")->format, SF_PIXEL_NV12);
    assert_null(sf_libcamera_format_choose(&offer, "YUYV"));
    assert_null(sf_libcamera_format_choose(&offer, "444P"));
    sf_libcamera_format_list(&offer, text, sizeof text);
    assert_string_equal(text, "MJPEG, NV12");
    sf_libcamera_format_list(&offer, text, 9); /* as much as there is room for */
    assert_string_equal(text, "MJPEG, N");

    offer = (sf_libcamera_offer){codes[0], codes, 2}; /* nothing of ours */
    assert_null(sf_libcamera_format_choose(&offer, ""));
    sf_libcamera_format_list(&offer, text, sizeof text);
    assert_string_equal(text, "no format that splatfit reads");
    offer.count = 0; /* not told: it is tried */
    assert_int_equal(sf_libcamera_format_choose(&offer, "YUYV")->format, SF_PIXEL_YUYV);
}

static void test_modes(void **state) {
    (void)state;
    sf_device_mode mode = sf_libcamera_mode(fourcc_of("NV12"), 0, 1920, 1080);
    assert_string_equal(mode.fourcc, "NV12");
    assert_true(mode.supported && mode.format == SF_PIXEL_NV12 && mode.width == 1920 && mode.height == 1080);
    mode = sf_libcamera_mode(fourcc_of("NV12"), 1, 1920, 1080);
    assert_string_equal(mode.fourcc, "NV12");
    assert_false(mode.supported);
    assert_false(sf_libcamera_mode(fourcc_of("pRAA"), 0, 1920, 1080).supported);
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
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_controls_open), cmocka_unit_test(test_controls_values),
        cmocka_unit_test(test_controls_lock), cmocka_unit_test(test_check_auto),
        cmocka_unit_test(test_heaps),         cmocka_unit_test(test_request),
        cmocka_unit_test(test_meant),         cmocka_unit_test(test_formats),
        cmocka_unit_test(test_planes),        cmocka_unit_test(test_choice),
        cmocka_unit_test(test_modes),         cmocka_unit_test(test_frame_order),
        cmocka_unit_test(test_names),         cmocka_unit_test(test_absent)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
