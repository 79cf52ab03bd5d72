/* test_v4l2.c - the V4L2 source on a driver that is played: formats, choices, controls. */
#include "testing.h"

#ifdef __linux__
#include "v4l2_fixture.h"

#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>

static void assert_refused(bench *b, const char *name, sf_status status, const char *part) {
    assert_status(b->ctx, v4l2_try_open(b, name), status);
    assert_error_names(b->ctx, part);
    assert_int_equal(b->driver.fds_open, 0);
    assert_int_equal(b->driver.maps, 0);
}

static const struct {
    uint32_t fourcc, planes;
    int multi; /* 2: on both kinds of nodes */
    sf_pixel_format format;
    const char *name;
    size_t row[PLANES], rows[PLANES];
} formats[] = {
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

/* Each format, in one plane of memory or several, with rows as long as they need be and longer. */
static void test_formats(void **state) {
    (void)state;
    for (size_t i = 0; i < 4 * COUNT(formats); i++) {
        size_t which = i / 4, padding = i & 1 ? 16 : 0;
        int multi = i & 2 ? 1 : 0;
        if (formats[which].multi != 2 && formats[which].multi != multi) continue;
        bench *b = v4l2_bench_start();
        fake_node *n = &b->driver.nodes[0];
        char name[64];
        n->multi = multi;
        n->padding = (uint32_t)padding;
        n->data_offset = multi ? 24 : 0;
        v4l2_set_format(n, formats[which].fourcc, formats[which].planes);
        snprintf(name, sizeof name, "v4l2:/dev/video0?size=64x48&format=%s", formats[which].name);
        v4l2_open_source(b, name);
        for (uint64_t k = 0; k < 6; k++) {
            sf_frame frame = v4l2_next_frame(b);
            size_t offset = 0;
            assert_int_equal(frame.sequence, k);
            assert_int_equal(frame.format, formats[which].format);
            assert_int_equal(frame.width, 64);
            assert_int_equal(frame.height, 48);
            assert_int_equal(frame.dmabuf, -1);
            for (int p = 0; p < PLANES; p++) {
                size_t row = formats[which].row[p], stride = row + padding;
                if (!row) {
                    assert_null(frame.plane[p]);
                    continue;
                }
                int together = formats[which].planes == 1;
                if (together && p && row < 64) stride = (64 + padding) / 2;
                v4l2_assert_plane(&frame, p, together ? 0 : (uint32_t)p, together ? offset : 0, stride, row,
                                  formats[which].rows[p]);
                offset += stride * formats[which].rows[p];
            }
            sf_source_release(b->source, &frame);
        }
        v4l2_assert_counts(b, 0, 0, 0, 0);
        v4l2_bench_end(b);
    }
}

static void test_describe(void **state) {
    (void)state;
    bench *b = v4l2_bench_start();
    sf_source_info info;
    v4l2_open_source(b, "v4l2:0?fps=10&format=YUYV");
    sf_source_describe(b->source, &info);
    assert_int_equal(info.width, 64);
    assert_int_equal(info.height, 48);
    assert_int_equal(info.format, SF_PIXEL_YUYV);
    assert_true(info.frames_per_second == 10);
    assert_int_equal(info.frames, 0);
    assert_true(info.live && !info.has_poses);
    test_assert_contains(info.name, "Webcam", __FILE__, __LINE__);
    sf_frame a = v4l2_next_frame(b), c = v4l2_next_frame(b);
    assert_true(a.time_ns == 1000 * v4l2_ms + FRAME_MS * v4l2_ms);
    assert_true(c.time_ns == a.time_ns + FRAME_MS * v4l2_ms);
    v4l2_bench_end(b); /* with both still out */

    b = v4l2_bench_start();
    b->driver.nodes[0].no_clock = 1;
    v4l2_open_source(b, "v4l2:/dev/video0?format=YUYV");
    a = v4l2_next_frame(b);
    assert_true(a.time_ns == b->driver.now_ns);
    v4l2_bench_end(b);
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
        bench *b = v4l2_bench_start();
        fake_node *n = &b->driver.nodes[0];
        char name[64];
        if (cases[i].formats[0].fourcc) {
            memset(n->formats, 0, sizeof n->formats);
            memcpy(n->formats, cases[i].formats, sizeof cases[i].formats);
        }
        snprintf(name, sizeof name, "v4l2:0%s%s", *cases[i].options ? "?" : "", cases[i].options);
        v4l2_open_source(b, name);
        assert_int_equal(n->fourcc, cases[i].fourcc);
        assert_int_equal(n->fps, cases[i].fps);
        v4l2_bench_end(b);
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
    bench *b = v4l2_bench_start();
    for (size_t i = 0; i < COUNT(cases); i++)
        assert_refused(b, cases[i].name, cases[i].status, cases[i].part);
    v4l2_plan_fault(&b->driver, 1, EACCES, 1);
    assert_refused(b, "v4l2:0", SF_ERR_IO, "is the user in the group video?");
    v4l2_plan_fault(&b->driver, VIDIOC_S_FMT, EBUSY, 1);
    assert_refused(b, "v4l2:0", SF_ERR_IO, "/dev/video0: format: Device or resource busy: in use by another");
    v4l2_plan_fault(&b->driver, VIDIOC_QUERYCAP, ENOTTY, 1);
    assert_refused(b, "v4l2:0", SF_ERR_UNSUPPORTED, "/dev/video0: is no V4L2 device");
    v4l2_plan_fault(&b->driver, VIDIOC_STREAMON, ENOSPC, 1);
    assert_refused(b, "v4l2:0", SF_ERR_IO, "more than the bus carries");
    v4l2_bench_end(b);
}

/* The driver's own mind: sizes, strides, buffers, fields, formats. */
static void test_driver_gives_other(void **state) {
    (void)state;
    bench *b = v4l2_bench_start();
    fake_node *n = &b->driver.nodes[0];
    n->other = (fake_size){128, 96, 0};
    assert_refused(b, "v4l2:0?size=64x48", SF_ERR_UNSUPPORTED,
                   "size: 64x48 cannot be had (the driver gives 128x96); YUYV has: 64x48");
    v4l2_open_source(b, "v4l2:0?format=YUYV"); /* no size was asked for */
    sf_frame frame = v4l2_next_frame(b);
    assert_int_equal(frame.width, 128);
    v4l2_assert_plane(&frame, 0, 0, 0, 256, 256, 96);
    sf_source_release(b->source, &frame);
    v4l2_close_source(b);
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
    v4l2_open_source(b, "v4l2:0?format=YUYV&buffers=4");
    assert_int_equal(n->count, 2);
    for (uint64_t i = 0; i < 5; i++) assert_int_equal(v4l2_pass_frame(b), i);
    v4l2_close_source(b);
    n->most_buffers = BUFFERS;
    n->other_fourcc = V4L2_PIX_FMT_MJPEG;
    assert_refused(b, "v4l2:0?format=YUYV", SF_ERR_UNSUPPORTED, "format: the driver gives MJPG instead");
    n->other_fourcc = V4L2_PIX_FMT_H264;
    assert_refused(b, "v4l2:0", SF_ERR_UNSUPPORTED, "format: the driver gives H264 instead");
    n->other_fourcc = 0;
    n->field = V4L2_FIELD_ALTERNATE;
    assert_refused(b, "v4l2:0", SF_ERR_UNSUPPORTED, "field: 7");
    n->field = V4L2_FIELD_INTERLACED;
    v4l2_open_source(b, "v4l2:0");
    test_assert_contains(test_log, "interlaced", __FILE__, __LINE__);
    v4l2_close_source(b);
    memset(n->formats, 0, sizeof n->formats);
    assert_refused(b, "v4l2:0", SF_ERR_UNSUPPORTED, "is no camera that streams");
    v4l2_bench_end(b);
}

static void test_input(void **state) {
    (void)state;
    bench *b = v4l2_bench_start();
    fake_node *n = &b->driver.nodes[0];
    n->input_status = V4L2_IN_ST_NO_SIGNAL;
    v4l2_open_source(b, "v4l2:0?input=1&timings=128x96&format=YUYV");
    assert_int_equal(n->input, 1);
    assert_int_equal(v4l2_next_frame(b).width, 128);
    test_assert_contains(test_log, "the input has no signal", __FILE__, __LINE__);
    v4l2_bench_end(b);
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
        bench *b = v4l2_bench_start();
        fake_node *n = &b->driver.nodes[0];
        n->multi = i & 1;
        n->colorspace = cases[i / 2].colorspace;
        n->ycbcr_enc = cases[i / 2].encoding;
        n->quantization = cases[i / 2].range;
        v4l2_open_source(b, "v4l2:0?format=YUYV");
        sf_frame frame = v4l2_next_frame(b);
        assert_int_equal(frame.matrix, cases[i / 2].matrix);
        assert_int_equal(frame.full_range, cases[i / 2].full);
        v4l2_bench_end(b);
    }
}

static void test_limited_rgb(void **state) {
    (void)state;
    static const uint32_t ranges[] = {0, V4L2_QUANTIZATION_FULL_RANGE, V4L2_QUANTIZATION_LIM_RANGE};
    for (size_t i = 0; i < COUNT(ranges); i++) {
        bench *b = v4l2_bench_start();
        fake_node *n = &b->driver.nodes[0];
        n->colorspace = V4L2_COLORSPACE_SRGB;
        n->quantization = ranges[i];
        v4l2_open_source(b, "v4l2:0?format=YUYV");
        assert_int_equal(v4l2_next_frame(b).limited_rgb, 0);
        v4l2_close_source(b);
        v4l2_set_format(n, V4L2_PIX_FMT_RGB24, 1);
        v4l2_open_source(b, "v4l2:0?format=RGB24");
        assert_int_equal(v4l2_next_frame(b).limited_rgb, i == 2);
        v4l2_bench_end(b);
    }
}

static int32_t control_value(bench *b, uint32_t id) {
    return v4l2_control_of(&b->driver.nodes[0], id)->value;
}

static void assert_chooses(bench *b, int exposure, int white) {
    assert_int_equal(control_value(b, V4L2_CID_EXPOSURE_AUTO), exposure ? 3 : 1);
    assert_int_equal(control_value(b, V4L2_CID_AUTO_WHITE_BALANCE), white);
}

/* What the camera chose stays as it is; what the user chose is the user's after, too. */
static void test_lock(void **state) {
    (void)state;
    bench *b = v4l2_bench_start();
    sf_source_info info;
    v4l2_open_source(b, "v4l2:0?exposure=auto&white_balance=auto");
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
    v4l2_close_source(b);
    v4l2_open_source(b, "v4l2:0?exposure=manual:120&white_balance=auto");
    assert_ok(b->ctx, sf_source_lock_exposure(b->source, 1));
    assert_chooses(b, 0, 0);
    assert_ok(b->ctx, sf_source_lock_exposure(b->source, 0));
    assert_chooses(b, 0, 1);
    v4l2_close_source(b);
    v4l2_bench_end(b);
}

static void test_controls(void **state) {
    static const char *const full_menu[] = {"Auto Mode", "Manual Mode", "Shutter Priority Mode",
                                            "Aperture Priority Mode"};
    (void)state;
    bench *b = v4l2_bench_start();
    v4l2_open_source(b, "v4l2:0?format=YUYV");
    sf_frame frame = v4l2_next_frame(b);
    assert_true(frame.exposure_s == 0); /* the camera chooses */
    assert_true(frame.gain == 7);
    assert_int_equal(control_value(b, V4L2_CID_EXPOSURE_AUTO), 3); /* left alone */
    v4l2_close_source(b);

    v4l2_open_source(b,
                     "v4l2:0?format=YUYV&exposure=manual:120&gain=33&white_balance=5000&ctrl.brightness=-5");
    frame = v4l2_next_frame(b);
    assert_true(frame.exposure_s > 0.01199 && frame.exposure_s < 0.01201);
    assert_true(frame.gain == 33);
    assert_int_equal(control_value(b, V4L2_CID_EXPOSURE_AUTO), 1);
    assert_int_equal(control_value(b, V4L2_CID_EXPOSURE_ABSOLUTE), 120);
    assert_int_equal(control_value(b, V4L2_CID_AUTO_WHITE_BALANCE), 0);
    assert_int_equal(control_value(b, V4L2_CID_WHITE_BALANCE_TEMPERATURE), 5000);
    assert_int_equal(control_value(b, V4L2_CID_BRIGHTNESS), -5);
    v4l2_close_source(b);

    v4l2_open_source(b, "v4l2:0?exposure=auto&white_balance=auto");
    assert_int_equal(control_value(b, V4L2_CID_EXPOSURE_AUTO), 3); /* the menu has no 0 */
    assert_int_equal(control_value(b, V4L2_CID_AUTO_WHITE_BALANCE), 1);
    v4l2_close_source(b);

    v4l2_open_source(b, "v4l2:0?ctrl.Auto Exposure=manual mode&ctrl.exposure-time_absolute=77&exposure=auto");
    assert_int_equal(control_value(b, V4L2_CID_EXPOSURE_AUTO), 1);
    assert_int_equal(control_value(b, V4L2_CID_EXPOSURE_ABSOLUTE), 77);
    v4l2_close_source(b);

    v4l2_control_of(&b->driver.nodes[0], V4L2_CID_EXPOSURE_AUTO)->menu = full_menu;
    v4l2_open_source(b, "v4l2:0?exposure=auto");
    assert_int_equal(control_value(b, V4L2_CID_EXPOSURE_AUTO), 0);
    v4l2_close_source(b);

    v4l2_plan_fault(&b->driver, VIDIOC_S_CTRL, EIO, 2); /* for a moment */
    v4l2_open_source(b, "v4l2:0?gain=12");
    assert_int_equal(control_value(b, V4L2_CID_GAIN), 12);
    v4l2_close_source(b);
    v4l2_plan_fault(&b->driver, VIDIOC_S_CTRL, EIO, -1);
    assert_refused(b, "v4l2:0?gain=13", SF_ERR_IO, "gain: \"Gain\" cannot be set to 13");
    v4l2_bench_end(b);
}

static void test_dmabuf(void **state) {
    (void)state;
    bench *b = v4l2_bench_start();
    b->driver.nodes[0].exports = 1;
    v4l2_open_source(b, "v4l2:0?format=YUYV&dmabuf=1");
    assert_int_equal(b->driver.fds_open, 5);
    sf_frame a = v4l2_next_frame(b), c = v4l2_next_frame(b);
    assert_true(a.dmabuf >= 0 && c.dmabuf >= 0 && a.dmabuf != c.dmabuf);
    v4l2_close_source(b);
    b->driver.nodes[0].exports = 0;
    v4l2_open_source(b, "v4l2:0?format=YUYV&dmabuf=1");
    test_assert_contains(test_log, "dmabuf: the driver gives none", __FILE__, __LINE__);
    assert_int_equal(v4l2_next_frame(b).dmabuf, -1);
    v4l2_bench_end(b);
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
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

#else

int main(void) { return 0; }
#endif
