/* test_video.c - pictures as YUV4MPEG2: bytes by hand, odd sizes, and back through the reader of pipes. */
#include "testing.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static sf_video *open_video(sf_context *ctx, const char *path, int width, int height, sf_video_chroma chroma,
                            sf_yuv_matrix matrix) {
    sf_video_options o = sf_video_options_default();
    sf_video *video;
    o.width = width, o.height = height, o.chroma = chroma, o.matrix = matrix;
    assert_ok(ctx, sf_video_open(ctx, path, &o, &video));
    return video;
}

/* Black, white, red and blue (clamped), 3 x 1 and 1 x 1: the last column's chroma is its own. */
static void test_bytes(void **state) {
    (void)state;
    static const float rgb[] = {0, 0, 0, 1, 1, 1, 1.5f, -1, 0};
    /* BT.601: red is Y 81, Cb 90, Cr 240; the mean of black and white is grey. */
    static const uint8_t expected[] = {16, 235, 81, 128, 90, 128, 240};
    static const char head[] = "YUV4MPEG2 W3 H1 F30:1 Ip A1:1 C420jpeg XCOLORRANGE=LIMITED\nFRAME\n";
    sf_context *ctx = test_context();
    const char *path = test_path("bytes.y4m");
    size_t size;
    sf_video *video = open_video(ctx, path, 3, 1, SF_VIDEO_420, SF_YUV_601);
    assert_ok(ctx, sf_video_add(video, rgb));
    assert_false(test_exists(path)); /* until it is whole */
    assert_ok(ctx, sf_video_close(&video));
    assert_null(video);
    uint8_t *data = test_read(path, &size);
    assert_int_equal(size, strlen(head) + sizeof expected);
    assert_memory_equal(data, head, strlen(head));
    for (size_t i = 0; i < sizeof expected; i++) assert_int_equal(data[strlen(head) + i], expected[i]);
    free(data);
    sf_context_destroy(&ctx);
}

/* A smooth picture: a plane of each colour. */
static void fill(float *rgb, int width, int height, int number) {
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            float *p = rgb + 3 * (y * width + x);
            p[0] = 0.1f + 0.8f * (float)x / (float)width;
            p[1] = 0.2f + 0.6f * (float)y / (float)height;
            p[2] = 0.15f + 0.2f * (float)number;
        }
}

static double worst_of(sf_context *ctx, sf_source *source, const float *rgb, int width, int height) {
    sf_frame frame;
    size_t pixels = (size_t)width * (size_t)height;
    float *planes = malloc(3 * pixels * sizeof *planes);
    float *const plane[3] = {planes, planes + pixels, planes + 2 * pixels};
    double worst = 0;
    assert_non_null(planes);
    assert_ok(ctx, sf_source_next(source, 10000, &frame));
    assert_int_equal(frame.width, width);
    assert_int_equal(frame.height, height);
    assert_ok(ctx, sf_frame_convert(ctx, &frame, plane, (size_t)width));
    for (size_t i = 0; i < pixels; i++)
        for (size_t c = 0; c < 3; c++) worst = fmax(worst, fabs((double)(plane[c][i] - rgb[3 * i + c])));
    sf_source_release(source, &frame);
    free(planes);
    return worst;
}

static void test_our_reader_agrees(void **state) {
    (void)state;
    enum { WIDTH = 37, HEIGHT = 23, FRAMES = 3 };
    static float rgb[3 * WIDTH * HEIGHT];
    sf_context *ctx = test_context();
    for (int kind = 0; kind < 4; kind++) {
        sf_video_chroma chroma = kind & 1 ? SF_VIDEO_444 : SF_VIDEO_420;
        sf_yuv_matrix matrix = kind & 2 ? SF_YUV_709 : SF_YUV_601;
        const char *path = test_path("film.y4m");
        char name[600];
        sf_video *video = open_video(ctx, path, WIDTH, HEIGHT, chroma, matrix);
        for (int i = 0; i < FRAMES; i++) {
            fill(rgb, WIDTH, HEIGHT, i);
            assert_ok(ctx, sf_video_add(video, rgb));
        }
        assert_ok(ctx, sf_video_close(&video));
        sf_source *source;
        snprintf(name, sizeof name, "pipe:%s?matrix=%s", path, kind & 2 ? "709" : "601");
        assert_ok(ctx, sf_source_open(ctx, name, &source));
        for (int i = 0; i < FRAMES; i++) {
            fill(rgb, WIDTH, HEIGHT, i);
            /* Half a step of Y and of the chroma's share; with 4:2:0 also the slope over a pixel or two. */
            double worst = worst_of(ctx, source, rgb, WIDTH, HEIGHT);
            assert_true(worst < (chroma == SF_VIDEO_444 ? 0.008 : 0.03));
        }
        sf_source_close(&source);
    }
    sf_context_destroy(&ctx);
}

static void test_refusals(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_video_options o = sf_video_options_default();
    sf_video *video = NULL;
    o.width = 0;
    assert_status(ctx, sf_video_open(ctx, test_path("none.y4m"), &o, &video), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "width: 0");
    o = sf_video_options_default();
    o.matrix = SF_YUV_2020;
    assert_status(ctx, sf_video_open(ctx, test_path("none.y4m"), &o, &video), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "matrix");
    o = sf_video_options_default();
    assert_status(ctx, sf_video_open(ctx, test_path("no/such.y4m"), &o, &video), SF_ERR_IO);
    assert_null(video);
    sf_video_abandon(&video);
    assert_ok(ctx, sf_video_close(&video));
    int before = test_count_entries(test_folder());
    video = open_video(ctx, test_path("gone.y4m"), 8, 8, SF_VIDEO_420, SF_YUV_601);
    sf_video_abandon(&video);
    assert_int_equal(test_count_entries(test_folder()), before);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_bytes),
        cmocka_unit_test(test_our_reader_agrees),
        cmocka_unit_test(test_refusals),
    };
    return cmocka_run_group_tests_name("video", tests, NULL, NULL);
}
