/* test_pipe.c - frames from pipes and files: YUV4MPEG2, JPEGs one after another, plain pixels. */
#include "pipe_fixture.h"

#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/time.h>

#include "capture/jpeg_cut.h"

/* Plain pixels. */

static void test_raw_formats(void **state) {
    (void)state;
    /* Bytes of a picture of 5 x 3 px: shared chroma is rounded up. */
    static const size_t sizes[SF_PIXEL_FORMATS] = {45, 45, 15, 36, 36, 27, 27, 33, 45, 0};
    sf_context *ctx = test_context();
    for (int format = 0; format < SF_PIXEL_MJPEG; format++) {
        char options[64];
        const char *name = sf_pixel_format_name((sf_pixel_format)format);
        snprintf(options, sizeof options, "?size=5x3&format=%s&fps=25", name);
        pipe_file.size = 0;
        for (uint64_t i = 0; i < 4; i++) pipe_add_pixels(i, sizes[format]);
        sf_source *source = pipe_open_source(ctx, pipe_put_file(options));
        sf_source_info info;
        sf_source_describe(source, &info);
        assert_int_equal(info.width, 5);
        assert_int_equal(info.height, 3);
        assert_int_equal(info.format, format);
        assert_true(info.frames_per_second == 25);
        assert_false(info.live);
        test_assert_contains(info.name, "frames", __FILE__, __LINE__);
        pipe_assert_frames(ctx, source, 4, 25);
        assert_int_equal(pipe_counts_of(source).given, 4);
        assert_int_equal(pipe_counts_of(source).damaged + pipe_counts_of(source).dropped, 0);
        sf_source_close(&source);
    }
    sf_context_destroy(&ctx);
}

static void test_colours(void **state) {
    (void)state;
    static const struct {
        const char *options;
        sf_yuv_matrix matrix;
        int full;
    } cases[] = {{"?size=4x2&format=YUYV", SF_YUV_601, 0},
                 {"?size=4x2&format=YUYV&matrix=709", SF_YUV_709, 0},
                 {"?size=4x2&format=YUYV&matrix=2020&range=full", SF_YUV_2020, 1},
                 {"?size=4x2&format=YUYV&matrix=601&range=limited", SF_YUV_601, 0}};
    sf_context *ctx = test_context();
    pipe_file.size = 0;
    pipe_add_pixels(0, 16);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        sf_frame frame;
        sf_source *source = pipe_open_source(ctx, pipe_put_file(cases[i].options));
        assert_ok(ctx, sf_source_next(source, -1, &frame));
        assert_int_equal(frame.matrix, cases[i].matrix);
        assert_int_equal(frame.full_range, cases[i].full);
        sf_source_close(&source);
    }
    sf_context_destroy(&ctx);
}

/* What is missing of the last frame is counted, not invented. */
static void test_cut_short(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    for (size_t cut = 1; cut < 27; cut += 5) {
        pipe_file.size = 0;
        for (uint64_t i = 0; i < 3; i++) pipe_add_pixels(i, 27);
        pipe_file.size -= cut;
        sf_source *source = pipe_open_source(ctx, pipe_put_file("?size=5x3&format=NV12"));
        pipe_assert_frames(ctx, source, 2, 30);
        assert_int_equal(pipe_counts_of(source).damaged, 1);
        sf_source_close(&source);
    }
    sf_context_destroy(&ctx);
}

/* YUV4MPEG2. */

/* The matrix, of which the stream says nothing: by its size, unless it is asked for. */
static void test_y4m_matrix(void **state) {
    (void)state;
    static const struct {
        int width, height;
        const char *colours, *options;
        sf_yuv_matrix matrix;
        int said;
    } cases[] = {{2, 576, "420", "", SF_YUV_601, 0},
                 {2, 577, "420", "", SF_YUV_709, 1},
                 {1279, 16, "420", "", SF_YUV_601, 0},
                 {1280, 16, "420", "", SF_YUV_709, 1}, /* HD, cropped */
                 {2, 720, "422", "", SF_YUV_709, 1},
                 {2, 1080, "444", "?fps=5", SF_YUV_709, 1},
                 {1280, 16, "mono", "", SF_YUV_601, 0},
                 {2, 720, "420", "?matrix=601", SF_YUV_601, 0},
                 {2, 1080, "420", "?matrix=2020", SF_YUV_2020, 0}};
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char header[64];
        sf_frame frame;
        snprintf(header, sizeof header, "YUV4MPEG2 W%d H%d C%s\nFRAME\n", cases[i].width, cases[i].height,
                 cases[i].colours);
        pipe_file.size = 0;
        pipe_add_text(header);
        pipe_add_pixels(0, (size_t)cases[i].width * (size_t)cases[i].height * 3); /* and more than it takes */
        test_log_clear();
        sf_source *source = pipe_open_source(ctx, pipe_put_file(cases[i].options));
        assert_ok(ctx, sf_source_next(source, -1, &frame));
        assert_int_equal(frame.matrix, cases[i].matrix);
        assert_int_equal(strstr(test_log, "BT.709 is taken") != NULL, cases[i].said);
        sf_source_release(source, &frame);
        sf_source_close(&source);
    }
    sf_context_destroy(&ctx);
}

static void test_y4m_colours(void **state) {
    (void)state;
    static const struct {
        const char *header;
        sf_pixel_format format;
        size_t bytes; /* of 5 x 3 px */
        int full;
    } cases[] = {
        {"YUV4MPEG2 W5 H3 F30:1\n", SF_PIXEL_YU12, 27, 0},
        {"YUV4MPEG2 W5 H3 F30:1 Ip A1:1 C420jpeg XYSCSS=420JPEG XCOLORRANGE=LIMITED\n", SF_PIXEL_YU12, 27, 0},
        {"YUV4MPEG2 C420mpeg2 H3 W5 F30000:1000 I? A0:0 XCOLORRANGE=FULL\n", SF_PIXEL_YU12, 27, 1},
        {"YUV4MPEG2 W5 H3 F0:0 C420paldv\n", SF_PIXEL_YU12, 27, 0},
        {"YUV4MPEG2 W5  H3 C420 \n", SF_PIXEL_YU12, 27, 0},
        {"YUV4MPEG2 W5 H3 F30:1 C422\n", SF_PIXEL_422P, 33, 0},
        {"YUV4MPEG2 W5 H3 F30:1 C444\n", SF_PIXEL_444P, 45, 0},
        {"YUV4MPEG2 W5 H3 F30:1 Cmono XCOLORRANGE=FULL\n", SF_PIXEL_GREY, 15, 1},
    };
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        sf_frame frame;
        pipe_file.size = 0;
        pipe_add_text(cases[i].header);
        for (uint64_t k = 0; k < 3; k++) {
            pipe_add_text(k == 1 ? "FRAME Ip Xwhatever\n" : "FRAME\n");
            pipe_add_pixels(k, cases[i].bytes);
        }
        sf_source *source = pipe_open_source(ctx, pipe_put_file(""));
        pipe_assert_frames(ctx, source, 3, 30);
        sf_source_close(&source);
        source = pipe_open_source(ctx, pipe_put_file("?matrix=709"));
        assert_ok(ctx, sf_source_next(source, -1, &frame));
        assert_int_equal(frame.format, cases[i].format);
        assert_int_equal(frame.full_range, cases[i].full);
        assert_int_equal(frame.matrix, SF_YUV_709);
        sf_source_close(&source);
    }
    sf_context_destroy(&ctx);
}

static void test_y4m_rate(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_source_info info;
    pipe_file.size = 0;
    pipe_add_text("YUV4MPEG2 W5 H3 F30000:1001\nFRAME\n");
    pipe_add_pixels(0, 27);
    sf_source *source = pipe_open_source(ctx, pipe_put_file(""));
    sf_source_describe(source, &info);
    assert_true(info.frames_per_second > 29.969 && info.frames_per_second < 29.971);
    sf_source_close(&source);
    source = pipe_open_source(ctx, pipe_put_file("?fps=12.5"));
    sf_source_describe(source, &info);
    assert_true(info.frames_per_second == 12.5);
    sf_source_close(&source);
    sf_context_destroy(&ctx);
}

static void test_y4m_refused(void **state) {
    (void)state;
    static const struct {
        const char *header, *part;
        sf_status status;
    } bad[] = {
        {"YUV4MPEG2 W5 H3 It\n", "interlacing: \"t\"", SF_ERR_UNSUPPORTED},
        {"YUV4MPEG2 W5 H3 Ib\n", "interlacing: \"b\"", SF_ERR_UNSUPPORTED},
        {"YUV4MPEG2 W5 H3 Im\n", "interlacing: \"m\"", SF_ERR_UNSUPPORTED},
        {"YUV4MPEG2 W5 H3 Ix\n", "interlacing: \"x\"", SF_ERR_FORMAT},
        {"YUV4MPEG2 W5 H3 C420p10\n", "colour space: \"420p10\"", SF_ERR_UNSUPPORTED},
        {"YUV4MPEG2 W5 H3 C411\n", "colour space: \"411\"", SF_ERR_UNSUPPORTED},
        {"YUV4MPEG2 W5 H3 C\n", "colour space: \"\"", SF_ERR_UNSUPPORTED},
        {"YUV4MPEG2 H3\n", "width", SF_ERR_FORMAT},
        {"YUV4MPEG2 W5\n", "height", SF_ERR_FORMAT},
        {"YUV4MPEG2 W0 H3\n", "width: \"0\"", SF_ERR_FORMAT},
        {"YUV4MPEG2 W-5 H3\n", "width: \"-5\"", SF_ERR_FORMAT},
        {"YUV4MPEG2 W5x H3\n", "width: \"5x\"", SF_ERR_FORMAT},
        {"YUV4MPEG2 W5 H65536\n", "height: \"65536\"", SF_ERR_FORMAT},
        {"YUV4MPEG2 W65535 H65535\n", "65535 x 65535", SF_ERR_UNSUPPORTED},
        {"YUV4MPEG2 W5 H3 F30\n", "rate: \"30\"", SF_ERR_FORMAT},
        {"YUV4MPEG2 W5 H3 F-1:1\n", "rate: \"-1:1\"", SF_ERR_FORMAT},
        {"YUV4MPEG2 W5 H3 XCOLORRANGE=HALF\n", "XCOLORRANGE: \"HALF\"", SF_ERR_FORMAT},
        {"YUV4MPEG2 W5 H3 Z1\n", "header: \"Z1\"", SF_ERR_FORMAT},
        {"YUV4MPEG3 W5 H3\n", "begins with neither", SF_ERR_FORMAT},
        {"P6 5 3 255\n", "begins with neither", SF_ERR_FORMAT},
        {"YUV4MPEG2 W5", "ends before", SF_ERR_EMPTY},
        {"", "ends before", SF_ERR_EMPTY},
    };
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        sf_source *source;
        pipe_file.size = 0;
        pipe_add_text(bad[i].header);
        assert_status(ctx, sf_source_open(ctx, pipe_put_file(""), &source), bad[i].status);
        assert_error_names(ctx, bad[i].part);
        assert_error_names(ctx, "frames");
        assert_null(source);
    }
    pipe_file.size = 0;
    pipe_add_text("YUV4MPEG2 ");
    for (int i = 0; i < 200; i++) pipe_add_text("Xpadding ");
    sf_source *source;
    assert_status(ctx, sf_source_open(ctx, pipe_put_file(""), &source), SF_ERR_FORMAT);
    sf_context_destroy(&ctx);
}

/* What stands where a frame should begin is named with its place; the frames before it are given. */
static void test_y4m_wrong_frame(void **state) {
    (void)state;
    static const char *const wrong[] = {"FRAMES\n", "frame\n", "\n", "FRAM\n", "\x01\x02\xff\n"};
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        sf_frame frame;
        pipe_file.size = 0;
        pipe_add_text("YUV4MPEG2 W5 H3 F30:1\nFRAME\n"); /* 22 + 6 bytes */
        pipe_add_pixels(0, 27);
        pipe_add_text(wrong[i]);
        pipe_add_pixels(1, 27);
        sf_source *source = pipe_open_source(ctx, pipe_put_file(""));
        assert_ok(ctx, sf_source_next(source, -1, &frame));
        pipe_assert_pixels(&frame, 0);
        sf_source_release(source, &frame);
        assert_status(ctx, sf_source_next(source, -1, &frame), SF_ERR_FORMAT);
        assert_error_names(ctx, "offset 55: ");
        assert_error_names(ctx, "is no FRAME header");
        sf_source_close(&source);
    }
    for (size_t cut = 1; cut < 33; cut += 8) { /* also within the header of the frame */
        pipe_file.size = 0;
        pipe_add_text("YUV4MPEG2 W5 H3 F30:1\nFRAME\n");
        pipe_add_pixels(0, 27);
        pipe_add_text("FRAME\n");
        pipe_add_pixels(1, 27);
        pipe_file.size -= cut;
        sf_source *source = pipe_open_source(ctx, pipe_put_file(""));
        pipe_assert_frames(ctx, source, 1, 30);
        assert_int_equal(pipe_counts_of(source).damaged, 1);
        sf_source_close(&source);
    }
    sf_context_destroy(&ctx);
}

/* JPEGs. */

typedef struct jpeg {
    uint8_t data[8192];
    size_t size;
} jpeg;

static jpeg make_jpeg(sf_context *ctx, int width, int height, int number) {
    jpeg j;
    float rgb[3 * 64 * 64];
    uint8_t *coded;
    assert_true(width <= 64 && height <= 64);
    for (int i = 0; i < 3 * width * height; i++) rgb[i] = (float)((i * 37 + number * 1009) % 256) / 255;
    assert_ok(ctx, sf_encode_jpeg(ctx, width, height, rgb, 90, &coded, &j.size));
    assert_true(j.size <= sizeof j.data);
    memcpy(j.data, coded, j.size);
    sf_encoded_free(ctx, &coded);
    return j;
}

/* With a whole JPEG, a thumbnail, in an APP segment, and FF bytes before a marker. */
static jpeg with_thumbnail(const jpeg *j, const jpeg *thumbnail) {
    jpeg out = {.size = 0};
    size_t length = thumbnail->size + 2;
    const uint8_t head[] = {0xff, 0xd8, 0xff, 0xff, 0xff, 0xe1, (uint8_t)(length >> 8), (uint8_t)length};
    assert_true(sizeof head + thumbnail->size + j->size - 2 <= sizeof out.data);
    memcpy(out.data, head, sizeof head);
    memcpy(out.data + sizeof head, thumbnail->data, thumbnail->size);
    memcpy(out.data + sizeof head + thumbnail->size, j->data + 2, j->size - 2);
    out.size = sizeof head + thumbnail->size + j->size - 2;
    return out;
}

static void assert_jpeg(sf_context *ctx, sf_source *source, const jpeg *expected, uint64_t sequence,
                        int width, int height) {
    sf_frame frame;
    assert_ok(ctx, sf_source_next(source, -1, &frame));
    assert_int_equal(frame.format, SF_PIXEL_MJPEG);
    assert_int_equal(frame.sequence, sequence);
    assert_int_equal(frame.width, width);
    assert_int_equal(frame.height, height);
    assert_int_equal(frame.bytes, expected->size);
    assert_int_equal(frame.stride[0], 0);
    assert_memory_equal(frame.plane[0], expected->data, expected->size);
    sf_source_release(source, &frame);
}

/* What cameras leave behind the end marker is not the JPEG's; FF D9 there counts as its end. */
static void test_jpeg_ends(void **state) {
    (void)state;
    static const struct {
        const char *data;
        size_t size, end;
    } cases[] = {
        {"\xff\xd8 picture \xff\xd9", 13, 13},
        {"\xff\xd8 picture \xff\xd9\0\0\0", 16, 13},
        {"\xff\xd8 picture \xff\xd9 junk", 18, 13},
        {"\xff\xd8\xff\xd9 \xff\xd9\xff", 8, 7},
        {"\xff\xd8 picture \xff", 12, 0},
        {"\xff\xd8 picture ", 11, 0},
        {"\xff\xd9 picture \xff\xd9", 13, 0},
        {"\xff\xd8\xff\xd9", 4, 4},
        {"\xff\xd8\xd9", 3, 0},
        {"", 0, 0},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        assert_int_equal(sf_jpeg_end((const uint8_t *)cases[i].data, cases[i].size), cases[i].end);
}

static void test_jpegs(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    jpeg a = make_jpeg(ctx, 40, 30, 1), small = make_jpeg(ctx, 8, 8, 2), b = with_thumbnail(&a, &small);
    static const char *const options[] = {"", "?format=MJPEG", "?format=MJPEG&size=40x30&fps=10"};
    pipe_file.size = 0;
    pipe_add(a.data, a.size);
    pipe_add(b.data, b.size);
    pipe_add_text("\r\n--boundary\r\nContent-Type: image/jpeg\r\n\r\n"); /* as web cameras part them */
    pipe_add(small.data, small.size);
    for (int i = 0; i < 3; i++) {
        sf_source_info info;
        sf_frame frame;
        sf_source *source = pipe_open_source(ctx, pipe_put_file(options[i]));
        sf_source_describe(source, &info);
        assert_int_equal(info.format, SF_PIXEL_MJPEG);
        assert_int_equal(info.width, 40);
        assert_int_equal(info.height, 30);
        assert_jpeg(ctx, source, &a, 0, 40, 30);
        assert_jpeg(ctx, source, &b, 1, 40, 30);
        assert_jpeg(ctx, source, &small, 2, 8, 8);
        assert_status(ctx, sf_source_next(source, -1, &frame), SF_ERR_END);
        assert_int_equal(pipe_counts_of(source).damaged, 0);
        sf_source_close(&source);
    }
    sf_context_destroy(&ctx);
}

/* A JPEG that was cut off ends where the next one begins. */
static void test_cut_jpegs(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    jpeg a = make_jpeg(ctx, 40, 30, 1), b = make_jpeg(ctx, 40, 30, 2);
    sf_frame frame;
    for (size_t cut = 2; cut < 600; cut += 97) {
        pipe_file.size = 0;
        pipe_add(a.data, a.size);
        pipe_add(b.data, b.size - cut);
        pipe_add(b.data, b.size);
        pipe_add(a.data, a.size - cut);
        sf_source *source = pipe_open_source(ctx, pipe_put_file(""));
        assert_jpeg(ctx, source, &a, 0, 40, 30);
        assert_jpeg(ctx, source, &b, 2, 40, 30);
        assert_status(ctx, sf_source_next(source, -1, &frame), SF_ERR_END);
        assert_int_equal(pipe_counts_of(source).damaged, 2);
        sf_source_close(&source);
    }
    sf_source *source;
    pipe_file.size = 0;
    pipe_add(a.data, a.size - 10);
    assert_status(ctx, sf_source_open(ctx, pipe_put_file(""), &source), SF_ERR_EMPTY);
    assert_error_names(ctx, "no whole JPEG");
    assert_null(source);
    sf_context_destroy(&ctx);
}

/* The cutter finds the same, however the bytes come in, and gets over whatever comes. */
static void test_cutter(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    jpeg a = make_jpeg(ctx, 24, 16, 1), thumbnail = make_jpeg(ctx, 8, 8, 2),
         b = with_thumbnail(&a, &thumbnail);
    pipe_file.size = 0;
    pipe_add(a.data, a.size);
    pipe_add_text("\xff");
    pipe_add(b.data, b.size);
    pipe_add(b.data, b.size - 20);
    pipe_add(a.data, a.size);
    for (size_t chunk = 1; chunk < 2000; chunk = 2 * chunk + 1) {
        sf_jpeg_cutter cutter = {0};
        size_t whole = 0, begun = 0, broken = 0, ends[4] = {0};
        for (size_t at = 0; at < pipe_file.size;) {
            size_t taken, left = pipe_file.size - at;
            sf_jpeg_event event =
                sf_jpeg_cut(&cutter, pipe_file.data + at, left < chunk ? left : chunk, &taken);
            at += taken;
            begun += event == SF_JPEG_BEGIN;
            broken += event == SF_JPEG_BROKEN;
            if (event == SF_JPEG_WHOLE) ends[whole++ & 3] = at;
        }
        assert_int_equal(begun, 4);
        assert_int_equal(whole, 3);
        assert_int_equal(broken, 1);
        assert_int_equal(ends[0], a.size);
        assert_int_equal(ends[1], a.size + 1 + b.size);
        assert_int_equal(ends[2], pipe_file.size);
    }
    uint32_t random = 1;
    for (int round = 0; round < 300; round++) { /* flipped bytes: no matter what, all is taken */
        jpeg c = b;
        sf_jpeg_cutter cutter = {0};
        for (int i = 0; i < 3; i++) {
            random = random * 1664525 + 1013904223;
            c.data[random % c.size] = (uint8_t)(random >> 24);
        }
        for (size_t at = 0, taken, calls = 0; at < c.size; at += taken, calls++) {
            sf_jpeg_cut(&cutter, c.data + at, c.size - at, &taken);
            assert_true(calls < 2 * c.size);
        }
    }
    int32_t width, height;
    assert_true(sf_jpeg_size(b.data, b.size, &width, &height));
    assert_int_equal(width, 24);
    assert_int_equal(height, 16);
    assert_false(sf_jpeg_size(b.data, b.size - 1, &width, &height));
    assert_false(sf_jpeg_size(b.data + 1, b.size - 1, &width, &height));
    size_t header = 0; /* more pixels than so few bytes hold */
    while (memcmp(a.data + header, "\xff\xc0", 2) != 0) header++;
    memcpy(a.data + header + 5, "\x10\x00\xff\xdc", 4);
    assert_false(sf_jpeg_size(a.data, a.size, &width, &height));
    sf_context_destroy(&ctx);
}

int main(void) {
    signal(SIGPIPE, SIG_IGN);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_raw_formats), cmocka_unit_test(test_colours),
        cmocka_unit_test(test_cut_short),   cmocka_unit_test(test_y4m_matrix),
        cmocka_unit_test(test_y4m_colours), cmocka_unit_test(test_y4m_rate),
        cmocka_unit_test(test_y4m_refused), cmocka_unit_test(test_y4m_wrong_frame),
        cmocka_unit_test(test_jpegs),       cmocka_unit_test(test_jpeg_ends),
        cmocka_unit_test(test_cut_jpegs),   cmocka_unit_test(test_cutter),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
