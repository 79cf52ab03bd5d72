/* test_folder.c - frames from the pictures of a folder; sources that keep time. */
#include "testing.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <time.h>

#include "../../src/io/paths.h"
#include "../../src/capture/pace.h"

enum { WIDTH = 9, HEIGHT = 5 };

static const char *folder; /* of the test that runs */

static void new_folder(const char *name) {
    folder = test_path(name);
    assert_int_equal(mkdir(folder, 0777), 0);
}

static const char *in_folder(const char *name) {
    static char path[4][600];
    static unsigned turn;
    char *p = path[turn++ % 4];
    snprintf(p, sizeof path[0], "%s/%s", folder, name);
    return p;
}

static const char *source_name(const char *options) {
    static char name[600];
    snprintf(name, sizeof name, "folder:%s%s", folder, options);
    return name;
}

/* What channel `i` of the picture `number` holds, as 8 bits. */
static uint8_t value(int number, size_t i) { return (uint8_t)(17 * (size_t)number + 5 * i); }

static void write_picture(sf_context *ctx, const char *name, int number, int width, int height) {
    float rgb[3 * 16 * 16];
    assert_true(width <= 16 && height <= 16);
    for (size_t i = 0; i < (size_t)(3 * width * height); i++) rgb[i] = (float)value(number, i) / 255;
    const char *ending = strrchr(name, '.');
    if (!strcasecmp(ending, ".png")) {
        assert_ok(ctx, sf_write_png(ctx, in_folder(name), width, height, rgb));
        return;
    }
    uint8_t *file;
    size_t size;
    assert_ok(ctx, sf_encode_jpeg(ctx, width, height, rgb, 95, &file, &size));
    test_write(in_folder(name), file, size);
    sf_encoded_free(ctx, &file);
}

static sf_source *open_source(sf_context *ctx, const char *options) {
    sf_source *source;
    assert_ok(ctx, sf_source_open(ctx, source_name(options), &source));
    return source;
}

/* Takes the next frame, which shows the PNG `number`; it goes back at once. */
static sf_frame assert_next(sf_context *ctx, sf_source *source, int number, int width, int height) {
    sf_frame frame;
    assert_ok(ctx, sf_source_next(source, -1, &frame));
    assert_int_equal(frame.format, SF_PIXEL_RGB24);
    assert_int_equal(frame.width, width);
    assert_int_equal(frame.height, height);
    assert_int_equal(frame.dmabuf, -1);
    for (size_t i = 0; i < (size_t)(3 * width * height); i++)
        assert_int_equal(frame.plane[0][i / (3 * (size_t)width) * frame.stride[0] + i % (3 * (size_t)width)],
                         value(number, i));
    sf_frame copy = frame;
    sf_source_release(source, &frame);
    return copy;
}

static void assert_end(sf_context *ctx, sf_source *source) {
    sf_frame frame;
    for (int i = 0; i < 2; i++) assert_status(ctx, sf_source_next(source, -1, &frame), SF_ERR_END);
    assert_null(frame.plane[0]);
}

static void test_natural_order(void **state) {
    (void)state;
    static const char *const sorted[] = {"",
                                         "01.png",
                                         "1.png",
                                         "2.png",
                                         "10.png",
                                         "a",
                                         "a1",
                                         "a2b9",
                                         "a2b10",
                                         "a10",
                                         "a10b",
                                         "a00010c",
                                         "a11",
                                         "b",
                                         "frame_99999",
                                         "frame_100000",
                                         "frame_99999999999999999999",
                                         "frame_100000000000000000000"};
    for (int i = 0; i < (int)(sizeof sorted / sizeof *sorted); i++)
        for (int k = 0; k < (int)(sizeof sorted / sizeof *sorted); k++) {
            int order = sf_natural_order(sorted[i], sorted[k]);
            assert_int_equal((order > 0) - (order < 0), (i > k) - (i < k));
        }
}

static void test_pictures(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_source_info info;
    new_folder("pictures");
    write_picture(ctx, "f10.png", 3, WIDTH, HEIGHT);
    write_picture(ctx, "f9.PNG", 2, WIDTH, HEIGHT);
    write_picture(ctx, "f2.png", 1, 3, 7);
    test_write(in_folder("notes.txt"), "no picture", 10);
    test_write(in_folder(".f1.png"), "hidden", 6);
    assert_int_equal(mkdir(in_folder("f3.png"), 0777), 0);
    sf_source *source = open_source(ctx, "");
    sf_source_describe(source, &info);
    assert_int_equal(info.width, 3); /* the first one's */
    assert_int_equal(info.height, 7);
    assert_int_equal(info.frames, 3);
    assert_int_equal(info.format, SF_PIXEL_RGB24);
    assert_false(info.live || info.has_poses);
    assert_true(info.frames_per_second == 0);
    for (int i = 0; i < 3; i++) {
        sf_frame frame = assert_next(ctx, source, i + 1, i ? WIDTH : 3, i ? HEIGHT : 7);
        assert_int_equal(frame.sequence, i);
        assert_true(llabs(frame.time_ns - (int64_t)i * 1000000000 / 30) <= 1);
        assert_true(frame.exposure_s == 0 && frame.gain == 0);
    }
    assert_end(ctx, source);
    sf_source_close(&source);
    sf_context_destroy(&ctx);
}

/* JPEGs decoded, and as they are. */
static void test_jpegs(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_frame frame;
    sf_source_info info;
    size_t size;
    new_folder("jpegs");
    write_picture(ctx, "1.jpg", 1, WIDTH, HEIGHT);
    write_picture(ctx, "2.png", 2, WIDTH, HEIGHT);
    write_picture(ctx, "3.JPEG", 3, 16, 16);
    uint8_t *bytes = test_read(in_folder("1.jpg"), &size);
    sf_source *source = open_source(ctx, "");
    assert_ok(ctx, sf_source_next(source, -1, &frame));
    assert_int_equal(frame.format, SF_PIXEL_RGB24);
    assert_int_equal(frame.width, WIDTH);
    sf_source_close(&source);

    source = open_source(ctx, "?decode=0");
    sf_source_describe(source, &info);
    assert_int_equal(info.format, SF_PIXEL_MJPEG);
    assert_ok(ctx, sf_source_next(source, -1, &frame));
    assert_int_equal(frame.format, SF_PIXEL_MJPEG);
    assert_int_equal(frame.width, WIDTH);
    assert_int_equal(frame.height, HEIGHT);
    assert_int_equal(frame.bytes, size);
    assert_memory_equal(frame.plane[0], bytes, size);
    sf_source_release(source, &frame);
    assert_next(ctx, source, 2, WIDTH, HEIGHT);
    assert_ok(ctx, sf_source_next(source, -1, &frame));
    assert_int_equal(frame.format, SF_PIXEL_MJPEG);
    assert_int_equal(frame.width, 16);
    sf_source_close(&source);
    free(bytes);
    sf_context_destroy(&ctx);
}

/* Damaged pictures are passed over, with a line that names each. */
static void test_damaged(void **state) {
    (void)state;
    static const char *const options[] = {"", "?decode=0"};
    sf_context *ctx = test_context();
    size_t size;
    new_folder("damaged");
    write_picture(ctx, "1.png", 1, WIDTH, HEIGHT);
    write_picture(ctx, "2.jpg", 2, WIDTH, HEIGHT);
    write_picture(ctx, "3.png", 3, WIDTH, HEIGHT);
    write_picture(ctx, "5.png", 5, WIDTH, HEIGHT);
    test_write(in_folder("4.png"), "", 0);
    uint8_t *bytes = test_read(in_folder("2.jpg"), &size);
    test_write(in_folder("2.jpg"), bytes, size - 30);
    free(bytes);
    for (int i = 0; i < 2; i++) {
        test_log_clear();
        sf_source *source = open_source(ctx, options[i]);
        sf_source_counts counts;
        assert_int_equal(assert_next(ctx, source, 1, WIDTH, HEIGHT).sequence, 0);
        assert_int_equal(assert_next(ctx, source, 3, WIDTH, HEIGHT).sequence, 2);
        assert_int_equal(assert_next(ctx, source, 5, WIDTH, HEIGHT).sequence, 4);
        assert_end(ctx, source);
        sf_source_count(source, &counts);
        assert_int_equal(counts.given, 3);
        assert_int_equal(counts.damaged, 2);
        assert_int_equal(counts.dropped + counts.skipped, 0);
        test_assert_contains(test_log, "2.jpg: ", __FILE__, __LINE__);
        test_assert_contains(test_log, "4.png: is empty", __FILE__, __LINE__);
        sf_source_close(&source);
    }
    sf_context_destroy(&ctx);
}

static void test_loop(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_source_info info;
    new_folder("loop");
    write_picture(ctx, "1.png", 1, WIDTH, HEIGHT);
    write_picture(ctx, "2.png", 2, WIDTH, HEIGHT);
    sf_source *source = open_source(ctx, "?loop=1");
    sf_source_describe(source, &info);
    assert_int_equal(info.frames, 0);
    for (int i = 0; i < 7; i++)
        assert_int_equal(assert_next(ctx, source, i % 2 + 1, WIDTH, HEIGHT).sequence, i);
    test_write(in_folder("1.png"), "x", 1);
    test_write(in_folder("2.png"), "x", 1);
    sf_frame frame;
    assert_status(ctx, sf_source_next(source, -1, &frame), SF_ERR_IO); /* not for ever */
    assert_error_names(ctx, "none of its pictures can be read");
    sf_source_close(&source);
    sf_context_destroy(&ctx);
}

static void write_list(const char *text) { test_write(in_folder("frames.json"), text, strlen(text)); }

static void test_list(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    new_folder("list");
    assert_int_equal(mkdir(in_folder("images"), 0777), 0);
    write_picture(ctx, "images/a.png", 1, WIDTH, HEIGHT);
    write_picture(ctx, "images/b.png", 2, WIDTH, HEIGHT);
    write_picture(ctx, "images/c.png", 3, WIDTH, HEIGHT);
    sf_source *source = open_source(ctx, ""); /* without a list: those in images */
    for (int i = 0; i < 3; i++) assert_next(ctx, source, i + 1, WIDTH, HEIGHT);
    assert_end(ctx, source);
    sf_source_close(&source);

    write_list("{\"frames\": [\n"
               "{\"file\": \"images/c.png\", \"sequence\": 7, \"time_ns\": 1000000500, \"exposure_s\": 0.01, "
               "\"gain\": 2},\n"
               "{\"file\": \"images/d.yuyv\", \"sequence\": 8},\n"
               "{\"file\": \"images/a.png\", \"sequence\": 12, \"time_ns\": 1000000900}]}");
    source = open_source(ctx, "");
    sf_frame frame = assert_next(ctx, source, 3, WIDTH, HEIGHT);
    assert_int_equal(frame.sequence, 7);
    assert_int_equal(frame.time_ns, 0);
    assert_true(frame.exposure_s == 0.01 && frame.gain == 2);
    frame = assert_next(ctx, source, 1, WIDTH, HEIGHT);
    assert_int_equal(frame.sequence, 12);
    assert_int_equal(frame.time_ns, 400);
    assert_true(frame.exposure_s == 0 && frame.gain == 0);
    assert_end(ctx, source);
    sf_source_close(&source);

    source = open_source(ctx, "?loop=1"); /* then the recorded times would go back */
    for (int i = 0; i < 4; i++)
        assert_int_equal(assert_next(ctx, source, i % 2 ? 1 : 3, WIDTH, HEIGHT).sequence, i);
    sf_source_close(&source);
    sf_context_destroy(&ctx);
}

static void test_bad_lists(void **state) {
    (void)state;
    static const struct {
        const char *text, *part;
        sf_status status;
    } bad[] = {
        {"", "frames.json: line 1: JSON", SF_ERR_FORMAT},
        {"{\"frames\": [", "frames.json: line 1: JSON", SF_ERR_FORMAT},
        {"{}", "frames.json: frames: is missing", SF_ERR_FORMAT},
        {"[]", "frames.json: frames: is missing", SF_ERR_FORMAT},
        {"{\"frames\": 3}", "frames: is not an array", SF_ERR_FORMAT},
        {"{\"frames\": []}", "holds no JPEG or PNG", SF_ERR_EMPTY},
        {"{\"frames\": [3]}", "frames[0]: file: is no text", SF_ERR_FORMAT},
        {"{\"frames\": [{}]}", "frames[0]: file: is no text", SF_ERR_FORMAT},
        {"{\"frames\": [{\"file\": 3}]}", "frames[0]: file: is no text", SF_ERR_FORMAT},
        {"{\"frames\": [{\"file\": \"a.png\"}, {\"file\": \"../a.png\"}]}",
         "frames[1]: file: is not a path inside", SF_ERR_FORMAT},
        {"{\"frames\": [{\"file\": \"/a.png\"}]}", "frames[0]: file: is not a path inside", SF_ERR_FORMAT},
        {"{\"frames\": [{\"file\": \"a.png\", \"sequence\": -1}]}", "frames[0]: sequence", SF_ERR_FORMAT},
        {"{\"frames\": [{\"file\": \"a.png\", \"sequence\": 1.5}]}", "frames[0]: sequence", SF_ERR_FORMAT},
        {"{\"frames\": [{\"file\": \"a.png\", \"time_ns\": \"now\"}]}", "frames[0]: time_ns", SF_ERR_FORMAT},
        {"{\"frames\": [{\"file\": \"a.png\", \"exposure_s\": -1}]}", "frames[0]: exposure_s", SF_ERR_FORMAT},
        {"{\"frames\": [{\"file\": \"a.png\", \"gain\": []}]}", "frames[0]: gain", SF_ERR_FORMAT},
        {"{\"frames\": [{\"file\": \"absent.png\"}]}", "none of its pictures can be read", SF_ERR_EMPTY},
        {"{\"frames\": [{\"file\": \"a.raw\"}]}", "holds no JPEG or PNG", SF_ERR_EMPTY},
    };
    sf_context *ctx = test_context();
    new_folder("bad-lists");
    write_picture(ctx, "a.png", 1, WIDTH, HEIGHT);
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        sf_source *source;
        write_list(bad[i].text);
        assert_status(ctx, sf_source_open(ctx, source_name(""), &source), bad[i].status);
        assert_error_names(ctx, bad[i].part);
        assert_error_names(ctx, "bad-lists");
        assert_null(source);
    }
    sf_context_destroy(&ctx);
}

static void test_bad_names(void **state) {
    (void)state;
    static const struct {
        const char *name, *part;
        sf_status status;
    } bad[] = {
        {"folder:", "cannot be opened", SF_ERR_IO},
        {"folder:/nowhere/at/all", "/nowhere/at/all: cannot be opened", SF_ERR_IO},
        {"folder:src?fps=-1", "fps: -1", SF_ERR_ARGUMENT},
        {"folder:src?loop=2", "loop: 2", SF_ERR_ARGUMENT},
        {"folder:src?decode=yes", "decode: \"yes\"", SF_ERR_ARGUMENT},
        {"folder:src?width=3", "unknown option \"width\"", SF_ERR_ARGUMENT},
        {"folder:src", "src: holds no JPEG or PNG picture", SF_ERR_EMPTY},
    };
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        sf_source *source;
        assert_status(ctx, sf_source_open(ctx, bad[i].name, &source), bad[i].status);
        assert_error_names(ctx, bad[i].part);
        assert_null(source);
    }
    sf_context_destroy(&ctx);
}

/* Sources that keep time. */

/* Frames are due on the clock: each is given, skipped or dropped, and none comes before it is due. */
static void keep_time(sf_context *ctx, sf_source *source, int newest) {
    sf_frame frame;
    sf_source_counts counts;
    uint64_t next = 0, gaps = 0;
    int64_t first_ns = 0;
    for (int i = 0; i < 12; i++) {
        struct timespec now;
        if (i % 4 == 3) test_pause_ms(20); /* 20 frames */
        assert_ok(ctx, newest ? sf_source_newest(source, -1, &frame) : sf_source_next(source, -1, &frame));
        clock_gettime(CLOCK_MONOTONIC, &now);
        if (!i)
            first_ns = frame.time_ns - (int64_t)frame.sequence * 1000000; /* slow machines miss the first */
        assert_true(frame.sequence >= next);
        assert_int_equal(frame.time_ns, first_ns + (int64_t)frame.sequence * 1000000);
        assert_true(frame.time_ns <= (int64_t)now.tv_sec * 1000000000 + now.tv_nsec);
        gaps += frame.sequence - next;
        next = frame.sequence + 1;
        sf_source_release(source, &frame);
    }
    sf_source_count(source, &counts);
    assert_int_equal(counts.given, 12);
    assert_int_equal(counts.dropped + counts.skipped, gaps);
    assert_true(counts.dropped >= 3 * (20 - SF_PACE_WAITING - 1));
    assert_true(newest ? counts.skipped >= 3 * (SF_PACE_WAITING - 1) : counts.skipped == 0);
}

static void test_time(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    new_folder("time");
    write_picture(ctx, "1.png", 1, WIDTH, HEIGHT);
    write_picture(ctx, "2.png", 2, WIDTH, HEIGHT);
    const char *names[2] = {"sim:studio?width=16&height=16&frames=5&fps=1000&loop=1",
                            source_name("?fps=1000&loop=1")};
    for (int i = 0; i < 4; i++) {
        sf_source *source;
        sf_source_info info;
        assert_ok(ctx, sf_source_open(ctx, names[i / 2], &source));
        sf_source_describe(source, &info);
        assert_true(info.live);
        assert_true(info.frames_per_second == 1000);
        assert_int_equal(info.frames, 0);
        keep_time(ctx, source, i % 2);
        sf_source_close(&source);
    }
    sf_context_destroy(&ctx);
}

/* A frame that is not due yet is waited for no longer than was asked. */
static void test_not_due(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_frame frame;
    sf_source *source;
    sf_source_counts counts;
    assert_ok(ctx, sf_source_open(ctx, "sim:studio?width=16&height=16&fps=0.01", &source));
    assert_ok(ctx, sf_source_next(source, 0, &frame)); /* the first one is due at once */
    assert_int_equal(frame.sequence, 0);
    sf_source_release(source, &frame);
    for (int i = 0; i < 2; i++) {
        assert_status(ctx, sf_source_next(source, 2, &frame), SF_ERR_TIMEOUT);
        assert_error_names(ctx, "no frame within 2 ms");
    }
    sf_source_count(source, &counts);
    assert_int_equal(counts.given, 1);
    assert_int_equal(counts.dropped + counts.skipped, 0);
    sf_source_close(&source);

    /* The last frames wait, as in a driver's buffers; those before them are lost. */
    assert_ok(ctx, sf_source_open(ctx, "sim:studio?width=16&height=16&frames=10&fps=1000", &source));
    assert_ok(ctx, sf_source_next(source, -1, &frame));
    sf_source_release(source, &frame);
    test_pause_ms(20);
    for (uint64_t i = 10 - SF_PACE_WAITING; i < 10; i++) {
        assert_ok(ctx, sf_source_next(source, -1, &frame));
        assert_int_equal(frame.sequence, i);
        sf_source_release(source, &frame);
    }
    assert_status(ctx, sf_source_next(source, -1, &frame), SF_ERR_END);
    sf_source_count(source, &counts);
    assert_int_equal(counts.dropped, 9 - SF_PACE_WAITING);
    sf_source_close(&source);

    sf_scene *scene;
    assert_status(ctx, sf_scene_load(ctx, "sim:studio?fps=30", NULL, &scene), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "fps: a scene");
    assert_status(ctx, sf_scene_load(ctx, "sim:studio?loop=1", NULL, &scene), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "loop: a scene");
    sf_context_destroy(&ctx);
}

/* Round and round, not in time: frame n is frame n - frames. */
static void test_sim_loop(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_source *source;
    sf_frame frame;
    static uint8_t first[3][3 * 16 * 16];
    assert_ok(ctx, sf_source_open(ctx, "sim:studio?width=16&height=16&frames=3&loop=1", &source));
    for (uint64_t i = 0; i < 7; i++) {
        assert_ok(ctx, sf_source_next(source, -1, &frame));
        assert_int_equal(frame.sequence, i);
        if (i < 3)
            memcpy(first[i], frame.plane[0], sizeof first[i]);
        else
            assert_memory_equal(first[i % 3], frame.plane[0], sizeof first[0]);
        sf_source_release(source, &frame);
    }
    sf_source_close(&source);
    sf_context_destroy(&ctx);
}

static const char *name_of_source(void) { return source_name(""); }

/* Wherever memory ends it is said, and nothing stays behind. */
static void test_memory_ends(void **state) {
    (void)state;
    test_allocations a = {.fail_at = 0};
    sf_allocator allocator = {test_count_alloc, test_count_free, &a};
    sf_context_options options = {.allocator = &allocator, .threads = 1};
    sf_context *ctx;
    assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
    new_folder("memory");
    write_picture(ctx, "1.png", 1, WIDTH, HEIGHT);
    write_list("{\"frames\": [{\"file\": \"1.png\"}]}");
    test_source_without_memory(ctx, &a, name_of_source, 8);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_natural_order), cmocka_unit_test(test_pictures),
        cmocka_unit_test(test_jpegs),         cmocka_unit_test(test_damaged),
        cmocka_unit_test(test_loop),          cmocka_unit_test(test_list),
        cmocka_unit_test(test_bad_lists),     cmocka_unit_test(test_bad_names),
        cmocka_unit_test(test_time),          cmocka_unit_test(test_not_due),
        cmocka_unit_test(test_sim_loop),      cmocka_unit_test(test_memory_ends),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
