/* test_capture_faults.c - splatfit capture from outside: how it ends, and what it says. */
#define _XOPEN_SOURCE 700 /* SIGXFSZ */
#include "capture_fixture.h"

#include <jansson.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static void end_by(int number, const char *folder) {
    pid_t pid = capture_start(
        ARGS("capture", "sim:studio?width=16&height=16&fps=50&loop=1", "-o", folder, "--quiet"), 0);
    char images[600];
    snprintf(images, sizeof images, "%s/images", test_path(folder));
    int turns = TIME_LIMIT * 200;
    while (test_count_entries(images) < 3 && turns-- > 0) test_pause_ms(5);
    kill(pid, number);
    outcome o = capture_wait_for(pid);
    assert_int_equal(o.code, 128 + number);
    assert_string_equal(o.err, "");
    capture_free_outcome(&o);
    json_t *list = capture_json_of(folder, "frames.json");
    size_t pictures = (size_t)capture_total(list, "kept");
    assert_true(pictures >= 3);
    assert_true(json_is_true(json_object_get(list, "live")));
    capture_forget(folder, pictures);
    json_decref(list);
}

static void test_interrupt(void **state) {
    (void)state;
    end_by(SIGINT, "endless");
    end_by(SIGHUP, "hung-up"); /* the terminal was closed */
}

/* What cannot be written ends the recording; what was written before is listed. */
static void test_full_disk(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    static float rgb[3 * 320 * 240];
    assert_int_equal(mkdir(test_path("growing"), 0777), 0);
    assert_ok(ctx, sf_write_png(ctx, test_path("growing/1.png"), 8, 8, rgb));
    assert_ok(ctx, sf_write_png(ctx, test_path("growing/2.png"), 320, 240, rgb));
    assert_ok(ctx, sf_write_png(ctx, test_path("growing/3.png"), 8, 8, rgb));
    capture_run_limited(ARGS("capture", "folder:growing", "-o", "full", "--format", "raw", "--quiet"), 200000,
                        FAILED, "full/images/frame_000002.rgb24: ");
    json_t *list = capture_assert_recording("full", 1);
    assert_true(capture_total(list, "dropped_by_writer") >= 1);
    json_decref(list);
    sf_context_destroy(&ctx);
}

/* More frames than can be written: those that are left out are counted, and a source that waits loses none.
 */
static void test_slow_writer(void **state) {
    (void)state;
    static uint8_t zeros[60 * 96 * 64];
    capture_ok("pipe:/dev/zero?size=160x120&format=GREY&live=1", "-o", "slow", "--frames", "150");
    json_t *list = capture_assert_recording("slow", 150);
    assert_true(capture_total(list, "dropped_by_writer") > 0);
    assert_true(capture_total(list, "dropped") > 0); /* by the pipe */
    json_decref(list);
    test_write(test_path("zeros"), zeros, sizeof zeros);
    capture_ok("pipe:zeros?size=96x64&format=GREY", "-o", "patient");
    list = capture_assert_recording("patient", 60);
    assert_true(capture_total(list, "given") == 60 &&
                capture_total(list, "dropped_by_writer") + capture_total(list, "dropped") == 0);
    json_decref(list);
}

/* A source that breaks: what came before is there, and why it ended is said. */
static void test_broken_source(void **state) {
    (void)state;
    static const char text[] = "YUV4MPEG2 W4 H2 F30:1\nFRAME\nYYYYYYYYUUVVFRAME\nYYYYYYYYUUVVFRAME\nYYYY";
    char broken[sizeof text + 16];
    test_write(test_path("cut.y4m"), text, strlen(text));
    capture_ok("pipe:cut.y4m", "-o", "cut");
    json_t *list = capture_assert_recording("cut", 2);
    assert_true(capture_total(list, "damaged") == 1);
    json_decref(list);
    snprintf(broken, sizeof broken, "%.40s%s", text, "What?\n");
    test_write(test_path("broken.y4m"), broken, strlen(broken));
    run(FAILED, "pipe:broken.y4m: offset 40: \"What?\" is no FRAME header", "capture", "pipe:broken.y4m",
        "-o", "broken", "--quiet");
    capture_forget("broken", 1);
    test_write(test_path("empty.y4m"), text, 22);
    run(FAILED, "pipe:empty.y4m: gave no frame", "capture", "pipe:empty.y4m", "-o", "empty", "--quiet");
    assert_false(test_exists(test_path("empty/frames.json"))); /* another try needs no --force */
}

static void test_silent_source(void **state) {
    (void)state;
    assert_int_equal(mkfifo(test_path("silent"), 0600), 0);
    run(FAILED, "no frame for 1 s", "capture", "pipe:silent?size=4x2&format=GREY", "-o", "silence", "--quiet",
        "--wait", "1");
    assert_false(test_exists(test_path("silence/frames.json"))); /* another try needs no --force */
}

/* A calibration goes along, for the size that is written. */
static void test_lens(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_calibration known = {.width = SCENE_WIDTH,
                            .height = SCENE_HEIGHT,
                            .lens = {30, 31, 16.5, 12.25, 0.1, -0.02, 1e-3, 2e-3, 4e-3}};
    assert_ok(ctx, sf_calibration_save(ctx, &known, test_path("lens.json")));
    capture_ok(SCENE, "-o", "lens", "--frames", "1", "--lens", "lens.json", "--downscale", "2");
    json_t *list = capture_assert_recording("lens", 1);
    const json_t *lens = json_object_get(list, "lens");
    assert_true(test_number(lens, "w") == 16 && test_number(lens, "h") == 12);
    assert_true(test_number(lens, "fl_x") == 15 && test_number(lens, "fl_y") == 15.5);
    assert_true(test_number(lens, "cx") == 8.25 && test_number(lens, "cy") == 6.125);
    assert_true(test_number(lens, "k1") == 0.1 && test_number(lens, "k2") == -0.02);
    assert_true(test_number(lens, "p1") == 1e-3 && test_number(lens, "p2") == 2e-3);
    assert_true(test_number(lens, "k3") == 4e-3);
    json_decref(list);
    known.width = 640;
    assert_ok(ctx, sf_calibration_save(ctx, &known, test_path("other.json")));
    test_write(test_path("bad.json"), "{\"fx\": ", 7);
    run(FAILED, "other.json: size: 640 x 24 is not the source's 32 x 24", "capture", SCENE, "-o", "x",
        "--lens", "other.json");
    run(FAILED, "bad.json: ", "capture", SCENE, "-o", "x", "--lens", "bad.json");
    run(FAILED, "absent.json: ", "capture", SCENE, "-o", "x", "--lens", "absent.json");
    assert_false(test_exists(test_path("x")));
    sf_context_destroy(&ctx);
}

static void test_wrong_usage(void **state) {
    (void)state;
    static const struct {
        const char *part, *args[8];
    } cases[] = {
        {"argument is missing", {NULL}},
        {"--output: is missing", {SCENE, NULL}},
        {"one argument too many", {SCENE, SCENE, NULL}},
        {"--frames: \"0\"", {SCENE, "-o", "x", "--frames", "0", NULL}},
        {"--frames: \"many\"", {SCENE, "-o", "x", "--frames", "many", NULL}},
        {"--seconds: \"0\" is not a number", {SCENE, "-o", "x", "--seconds", "0", NULL}},
        {"--seconds: \"nan\" is not a number", {SCENE, "-o", "x", "--seconds", "nan", NULL}},
        {"--every: \"0\"", {SCENE, "-o", "x", "--every", "0", NULL}},
        {"--sharpest: needs --every", {SCENE, "-o", "x", "--sharpest", NULL}},
        {"--format: none of", {SCENE, "-o", "x", "--format", "gif", NULL}},
        {"--quality: \"101\"", {SCENE, "-o", "x", "--quality", "101", NULL}},
        {"--quality: is for", {SCENE, "-o", "x", "--quality", "90", "--format", "png", NULL}},
        {"--downscale: \"65\"", {SCENE, "-o", "x", "--downscale", "65", NULL}},
        {"--downscale: cannot be given", {SCENE, "-o", "x", "--downscale", "2", "--format", "raw", NULL}},
        {"--downscale: more than a side", {SCENE, "-o", "x", "--downscale", "25", NULL}},
        {"--wait: \"0\"", {SCENE, "-o", "x", "--wait", "0", NULL}},
        {"--bogus: unknown option", {SCENE, "-o", "x", "--bogus", NULL}},
        {"nowhere: unknown source, and no video or folder; known:", {"nowhere", "-o", "x", NULL}},
        {"unknown option \"speed\"", {"sim:studio?speed=2", "-o", "x", NULL}},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const char *args[10] = {"capture"};
        memcpy(args + 1, cases[i].args, sizeof cases[i].args);
        capture_run_limited(args, 0, USAGE, cases[i].part);
    }
    run(FAILED, "/nowhere: cannot be opened", "capture", "folder:/nowhere", "-o", "x");
    assert_false(test_exists(test_path("x")));
}

/* What it says on standard output, and that --quiet says nothing. */
static void test_words(void **state) {
    (void)state;
    outcome o = capture_wait_for(capture_start(ARGS("capture", SCENE, "-o", "words"), 0));
    assert_int_equal(o.code, 0);
    test_assert_contains(o.out, "simulated studio", __FILE__, __LINE__);
    test_assert_contains(o.out, "frames 9", __FILE__, __LINE__);
    test_assert_contains(o.out, "wrote words: 9 pictures of 9 frames", __FILE__, __LINE__);
    capture_free_outcome(&o);
    o = capture_wait_for(capture_start(ARGS("capture", SCENE, "-o", "quiet", "--quiet"), 0));
    assert_int_equal(o.code, 0);
    assert_string_equal(o.out, "");
    capture_free_outcome(&o);
    o = capture_wait_for(capture_start(ARGS("capture", "--help"), 0));
    test_assert_contains(o.out, "--sharpest", __FILE__, __LINE__);
    capture_free_outcome(&o);
}

int main(void) {
    if (capture_find_program()) return 1;
    signal(SIGXFSZ, SIG_IGN);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_interrupt),     cmocka_unit_test(test_full_disk),
        cmocka_unit_test(test_slow_writer),   cmocka_unit_test(test_broken_source),
        cmocka_unit_test(test_silent_source), cmocka_unit_test(test_lens),
        cmocka_unit_test(test_wrong_usage),   cmocka_unit_test(test_words),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
