/* test_capture.c - splatfit capture from outside: what it records. */
#define _XOPEN_SOURCE 700 /* SIGXFSZ */
#include "capture_fixture.h"

#include <jansson.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* The frames of a recording, as its source gives them again. */
static sf_source *reopen(sf_context *ctx, const char *recording, const char *options) {
    char name[600];
    sf_source *source;
    snprintf(name, sizeof name, "folder:%s%s", test_path(recording), options);
    assert_ok(ctx, sf_source_open(ctx, name, &source));
    return source;
}

/* Greatest difference of two RGB frames of the same size. */
static int difference(const sf_frame *a, const sf_frame *b) {
    int most = 0;
    assert_int_equal(a->width, b->width);
    assert_int_equal(a->height, b->height);
    for (size_t i = 0; i < 3 * (size_t)a->width * (size_t)a->height; i++) {
        size_t y = i / (3 * (size_t)a->width), x = i % (3 * (size_t)a->width);
        int d = abs(a->plane[0][y * a->stride[0] + x] - b->plane[0][y * b->stride[0] + x]);
        if (d > most) most = d;
    }
    return most;
}

static void assert_same_frames(const char *recording, int most) {
    sf_context *ctx = test_context();
    sf_source *is, *should = reopen(ctx, recording, "");
    sf_frame a, b;
    assert_ok(ctx, sf_source_open(ctx, SCENE, &is));
    for (int i = 0; i < SCENE_FRAMES; i++) {
        assert_ok(ctx, sf_source_next(is, -1, &a));
        assert_ok(ctx, sf_source_next(should, -1, &b));
        assert_int_equal(a.sequence, b.sequence);
        assert_int_equal(a.time_ns, b.time_ns);
        int d = difference(&a, &b);
        assert_true(d <= most);
        assert_true(most == 0 || d > 0);
        sf_source_release(is, &a);
        sf_source_release(should, &b);
    }
    sf_source_close(&is);
    sf_source_close(&should);
    sf_context_destroy(&ctx);
}

/* 3. Recordings */

static void test_pictures(void **state) {
    (void)state;
    capture_ok(SCENE, "-o", "png", "--format", "png");
    capture_forget("png", SCENE_FRAMES);
    assert_same_frames("png", 0);
    capture_ok(SCENE, "-o", "jpg");
    json_t *list = capture_assert_recording("jpg", SCENE_FRAMES);
    assert_same_frames("jpg", 40); /* one pixel's worst, at quality 95 */
    assert_string_equal(json_string_value(json_object_get(list, "source")), SCENE);
    assert_string_equal(json_string_value(json_object_get(list, "format")), "RGB24");
    assert_string_equal(json_string_value(json_object_get(capture_entry(list, 2), "file")),
                        "images/frame_000003.jpg");
    assert_true(test_number(capture_entry(list, 2), "time_ns") == 66666666);
    assert_true(test_number(capture_entry(list, 0), "sharpness") > 1);
    assert_true(capture_total(list, "dropped") + capture_total(list, "skipped") +
                    capture_total(list, "damaged") ==
                0);
    json_decref(list);
}

/* What is recorded with known cameras is a project: it loads with the same cameras, and fits. */
static void test_fit(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *is, *should;
    capture_ok(SCENE, "-o", "project", "--format", "png");
    assert_ok(ctx, sf_scene_load(ctx, SCENE, NULL, &should));
    assert_ok(ctx, sf_scene_load(ctx, test_path("project"), NULL, &is));
    for (size_t i = 0; i < SCENE_FRAMES; i++) {
        sf_view_info a, b;
        static float x[3 * SCENE_WIDTH * SCENE_HEIGHT], y[3 * SCENE_WIDTH * SCENE_HEIGHT];
        assert_ok(ctx, sf_scene_get_view(should, i, &a));
        assert_ok(ctx, sf_scene_get_view(is, i, &b));
        for (int k = 0; k < 9; k++) assert_true(fabs(a.camera.R_cw[k] - b.camera.R_cw[k]) < 1e-12);
        for (int k = 0; k < 3; k++) assert_true(fabs(a.camera.t_cw[k] - b.camera.t_cw[k]) < 1e-12);
        assert_true(fabs(a.camera.fx - b.camera.fx) < 1e-9 && fabs(a.camera.fy - b.camera.fy) < 1e-9);
        assert_true(a.camera.cx == b.camera.cx && a.camera.cy == b.camera.cy);
        assert_ok(ctx, sf_scene_get_pixels(should, a.id, x, NULL));
        assert_ok(ctx, sf_scene_get_pixels(is, b.id, y, NULL));
        assert_memory_equal(x, y, sizeof x);
    }
    sf_scene_destroy(&is);
    sf_scene_destroy(&should);
    sf_context_destroy(&ctx);
    outcome o = capture_wait_for(capture_start(
        ARGS("fit", "project", "-o", "splat.ply", "--steps", "3", "--max-gaussians", "300", "--threads", "2"),
        0));
    assert_int_equal(o.code, 0);
    assert_true(test_exists(test_path("splat.ply")));
    capture_free_outcome(&o);
}

static void test_every(void **state) {
    (void)state;
    capture_ok(SCENE, "-o", "every", "--every", "4");
    json_t *list = capture_assert_recording("every", 3);
    for (size_t i = 0; i < 3; i++)
        assert_true(test_number(capture_entry(list, i), "sequence") == (double)(4 * i));
    assert_true(capture_total(list, "given") == SCENE_FRAMES && capture_total(list, "passed_over") == 6);
    json_decref(list);

    capture_ok(SCENE, "-o", "few", "--frames", "2", "--every", "3");
    list = capture_assert_recording("few", 2);
    assert_true(test_number(capture_entry(list, 1), "sequence") == 3);
    assert_true(capture_total(list, "given") == 4); /* none is taken beyond those */
    json_decref(list);

    capture_ok(SCENE, "-o", "seconds", "--seconds", "0.11"); /* frames at 0, 33, 67, 100 ms */
    capture_forget("seconds", 4);
}

/* Stripes that are blurred over 2 n + 1 pixels. */
static void write_stripes(sf_context *ctx, const char *name, int n) {
    enum { W = 48, H = 32 };
    static float rgb[3 * W * H];
    for (int i = 0; i < W * H; i++) {
        float sum = 0;
        for (int k = -n; k <= n; k++) sum += (i % W + k + 64) / 8 % 2 ? 1.0f : 0.0f;
        for (int c = 0; c < 3; c++) rgb[3 * i + c] = sum / (float)(2 * n + 1);
    }
    assert_ok(ctx, sf_write_png(ctx, test_path(name), W, H, rgb));
}

static void test_sharpest(void **state) {
    (void)state;
    static const int blurs[8] = {2, 0, 1, 2, 1, 3, 2, 1};
    sf_context *ctx = test_context();
    assert_int_equal(mkdir(test_path("stripes"), 0777), 0);
    for (int i = 0; i < 8; i++) {
        char name[64];
        snprintf(name, sizeof name, "stripes/%d.png", i);
        write_stripes(ctx, name, blurs[i]);
    }
    capture_ok("folder:stripes", "-o", "sharp", "--every", "3", "--sharpest");
    json_t *list = capture_assert_recording("sharp", 3); /* the last group has two frames */
    static const double best[3] = {1, 4, 7};
    for (size_t i = 0; i < 3; i++) assert_true(test_number(capture_entry(list, i), "sequence") == best[i]);
    assert_true(test_number(capture_entry(list, 0), "sharpness") >
                2 * test_number(capture_entry(list, 1), "sharpness"));
    assert_true(capture_total(list, "passed_over") == 5);
    json_decref(list);
    capture_ok("folder:stripes", "-o", "one", "--every", "3", "--sharpest", "--frames", "1");
    list = capture_assert_recording("one", 1);
    assert_true(test_number(capture_entry(list, 0), "sequence") == 1 && capture_total(list, "given") == 3);
    json_decref(list);
    sf_context_destroy(&ctx);
}

static void test_downscale(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_load_options options = sf_load_options_default();
    sf_scene *is, *should;
    sf_view_info a, b;
    options.downscale = 3;
    capture_ok(SCENE, "-o", "small", "--downscale", "3", "--format", "png", "--frames", "3");
    json_t *list = capture_assert_recording("small", 3);
    assert_true(test_number(capture_entry(list, 0), "width") == 10 &&
                test_number(capture_entry(list, 0), "height") == 8);
    json_decref(list);
    assert_ok(ctx, sf_scene_load(ctx, SCENE, &options, &should));
    assert_ok(ctx, sf_scene_load(ctx, test_path("small"), NULL, &is));
    assert_ok(ctx, sf_scene_get_view(should, 1, &a));
    assert_ok(ctx, sf_scene_get_view(is, 1, &b));
    static float x[3 * 10 * 8], y[3 * 10 * 8];
    assert_true(fabs(a.camera.fx - b.camera.fx) < 1e-9 && fabs(a.camera.cx - b.camera.cx) < 1e-9);
    assert_ok(ctx, sf_scene_get_pixels(should, a.id, x, NULL));
    assert_ok(ctx, sf_scene_get_pixels(is, b.id, y, NULL));
    for (int i = 0; i < 3 * 10 * 8; i++) assert_true(fabs((double)x[i] - (double)y[i]) < 1.1 / 255);
    sf_scene_destroy(&is);
    sf_scene_destroy(&should);
    sf_context_destroy(&ctx);
}

/* JPEGs stay as they are, and one with a hole is left out and counted. */
static void test_jpegs(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    size_t sizes[4], all = 0;
    uint8_t *files[4];
    static uint8_t stream[1 << 16];
    static float rgb[3 * 64 * 48];
    for (size_t i = 0; i < 4; i++) {
        for (size_t k = 0; k < 3 * 64 * 48; k++) rgb[k] = (float)(k * (i + 3) % 255) / 255;
        assert_ok(ctx, sf_encode_jpeg(ctx, 64, 48, rgb, 80, &files[i], &sizes[i]));
        size_t hole = i == 2 ? sizes[i] / 3 : 0, begin = sizes[i] / 2;
        assert_true(all + sizes[i] <= sizeof stream);
        memcpy(stream + all, files[i], begin);
        memcpy(stream + all + begin, files[i] + begin + hole, sizes[i] - begin - hole);
        all += sizes[i] - hole;
    }
    test_write(test_path("stream.mjpeg"), stream, all);
    capture_ok("pipe:stream.mjpeg", "-o", "jpegs");
    json_t *list = capture_assert_recording("jpegs", 3);
    assert_true(capture_total(list, "given") == 4 && capture_total(list, "undecodable") == 1);
    static const size_t numbers[3] = {0, 1, 3};
    for (size_t i = 0; i < 3; i++) {
        char path[64];
        size_t size;
        snprintf(path, sizeof path, "jpegs/images/frame_%06zu.jpg", i + 1);
        uint8_t *bytes = test_read(test_path(path), &size);
        assert_int_equal(size, sizes[numbers[i]]);
        assert_memory_equal(bytes, files[numbers[i]], size);
        assert_true(test_number(capture_entry(list, i), "sequence") == (double)numbers[i]);
        free(bytes);
    }
    json_decref(list);
    capture_ok("pipe:stream.mjpeg", "-o", "three", "--frames", "3"); /* the hole is not one of them */
    capture_forget("three", 3);
    for (int i = 0; i < 4; i++) sf_encoded_free(ctx, &files[i]);
    sf_context_destroy(&ctx);
}

/* Plain pixels come back byte for byte, and as a picture with the colours that they stand for. */
static void test_raw(void **state) {
    (void)state;
    enum { FRAME = 4 * 3 * 5 }; /* 6 x 5 px, YUYV */
    static uint8_t bytes[3 * FRAME];
    for (size_t i = 0; i < sizeof bytes; i++) bytes[i] = (uint8_t)(i % 4 == 0 || i % 4 == 2 ? 16 + i : 128);
    test_write(test_path("pixels"), bytes, sizeof bytes);
    capture_ok("pipe:pixels?size=6x5&format=YUYV&range=full", "-o", "raw", "--format", "raw");
    json_t *list = capture_assert_recording("raw", 3);
    const json_t *e = capture_entry(list, 1);
    assert_string_equal(json_string_value(json_object_get(e, "file")), "images/frame_000002.yuyv");
    assert_string_equal(json_string_value(json_object_get(e, "format")), "YUYV");
    assert_string_equal(json_string_value(json_object_get(e, "range")), "full");
    assert_string_equal(json_string_value(json_object_get(e, "matrix")), "601");
    json_decref(list);
    size_t size;
    uint8_t *read = test_read(test_path("raw/images/frame_000002.yuyv"), &size);
    assert_int_equal(size, FRAME);
    assert_memory_equal(read, bytes + FRAME, FRAME);
    free(read);

    capture_ok("pipe:pixels?size=6x5&format=YUYV&range=full", "-o", "grey", "--format", "png");
    sf_context *ctx = test_context();
    sf_source *source = reopen(ctx, "grey", "");
    sf_frame frame;
    assert_ok(ctx, sf_source_next(source, -1, &frame));
    for (size_t i = 0; i < 30; i++) /* no colour: R = G = B = Y */
        for (size_t c = 0; c < 3; c++)
            assert_int_equal(frame.plane[0][i / 6 * frame.stride[0] + 3 * (i % 6) + c], bytes[2 * i]);
    sf_source_close(&source);
    sf_context_destroy(&ctx);
}

/* Pictures of a folder may have other sizes than the first. */
static void test_too_small(void **state) {
    (void)state;
    capture_ok("sim:studio?width=64&height=48&frames=1", "-o", "sizes/1");
    capture_ok("sim:studio?width=16&height=16&frames=1", "-o", "sizes/2");
    mkdir(test_path("sizes/all"), 0777);
    rename(test_path("sizes/1/images/frame_000001.jpg"), test_path("sizes/all/1.jpg"));
    rename(test_path("sizes/2/images/frame_000001.jpg"), test_path("sizes/all/2.jpg"));
    run(FAILED, "frame 1: 16 x 16 px cannot be reduced by --downscale 20", "capture", "folder:sizes/all",
        "-o", "reduced", "--quiet", "--downscale", "20");
    capture_forget("reduced", 1);
}

/* 4. Ends of other kinds */

static void test_older_recording(void **state) {
    (void)state;
    capture_ok(SCENE, "-o", "twice");
    run(FAILED, "twice: holds a recording", "capture", SCENE, "-o", "twice", "--quiet");
    capture_forget("twice", SCENE_FRAMES);
    capture_ok("folder:stripes", "-o", "twice", "--force", "--frames", "2");
    capture_forget("twice", 2);
    assert_false(test_exists(test_path("twice/transforms.json"))); /* the older one's */
    test_write(test_path("twice/images/holiday.jpg"), "mine", 4);
    run(FAILED, "twice/images: holds pictures that are no recording's", "capture", SCENE, "-o", "twice",
        "--quiet", "--force");
    assert_true(test_exists(test_path("twice/images/holiday.jpg")));
    unlink(test_path("twice/images/holiday.jpg"));
    capture_forget("twice", 2); /* a refusal removes nothing */
    run(FAILED, "twice: is where the frames come from", "capture", "folder:twice", "-o", "twice", "--quiet",
        "--force");
    run(FAILED, "twice: is where the frames come from", "capture", "folder:twice/images", "-o", "twice",
        "--quiet", "--force");
    capture_forget("twice", 2);
    rename(test_path("twice/frames.json"), test_path("twice/transforms.json")); /* another program's folder */
    run(FAILED, "twice/images: holds pictures that are no recording's", "capture", SCENE, "-o", "twice",
        "--quiet", "--force");
    assert_true(test_exists(test_path("twice/images/frame_000001.jpg")));
    assert_true(test_exists(test_path("twice/transforms.json")));
    test_write(test_path("nothing.y4m"), "YUV4MPEG2 W4 H4\n", 16);
    run(FAILED, "", "capture", "pipe:nothing.y4m", "-o", "again",
        "--quiet"); /* keeps nobody from another try */
    capture_ok(SCENE, "-o", "again");
    capture_forget("again", SCENE_FRAMES);
    test_write(test_path("file"), "", 0);
    run(FAILED, "file: ", "capture", SCENE, "-o", "file", "--quiet");
}

int main(void) {
    if (capture_find_program()) return 1;
    signal(SIGXFSZ, SIG_IGN);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_pictures),
        cmocka_unit_test(test_fit),
        cmocka_unit_test(test_every),
        cmocka_unit_test(test_sharpest),
        cmocka_unit_test(test_downscale),
        cmocka_unit_test(test_jpegs),
        cmocka_unit_test(test_raw),
        cmocka_unit_test(test_too_small),
        cmocka_unit_test(test_older_recording),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
