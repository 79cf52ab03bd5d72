/* test_capture.c - splatfit capture from outside: what it records, what it says, how it ends.
 *
 * The program is SPLATFIT_PROGRAM, else build/splatfit, started through the command in RUN if that is set, in
 * the scratch folder of the test.
 */
#define _XOPEN_SOURCE 700 /* SIGXFSZ */
#include "testing.h"

#include <errno.h>
#include <fcntl.h>
#include <jansson.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#define SCENE "sim:studio?width=32&height=24&frames=9"
enum { SCENE_FRAMES = 9, SCENE_WIDTH = 32, SCENE_HEIGHT = 24 };
enum { FAILED = 1, USAGE = 2, TIME_LIMIT = 120 /* s */, MAX_COMMAND = 40 };

/* 1. Starting the program */

static char program[4096];

typedef struct outcome {
    int code, signal; /* exit code; the signal that ended it, 0: none */
    char *out, *err;
} outcome;

static void redirect(const char *path, int flags, int to) {
    int fd = open(path, flags, 0600);
    if (fd < 0 || dup2(fd, to) < 0) _exit(99);
    close(fd);
}

static void become_program(const char *const *args, rlim_t file_limit) {
    char prefix[4096];
    char *command[MAX_COMMAND] = {0};
    int n = 0;
    snprintf(prefix, sizeof prefix, "%s", getenv("RUN") ? getenv("RUN") : "");
    for (char *word = strtok(prefix, " "); word && n < 20; word = strtok(NULL, " ")) command[n++] = word;
    command[n++] = program;
    for (; *args && n < MAX_COMMAND - 1; args++) memcpy(&command[n++], args, sizeof *args);
    if (*args || chdir(test_folder())) _exit(99);
    signal(SIGHUP, SIG_DFL); /* also where the test runs under nohup */
    redirect("/dev/null", O_RDONLY, STDIN_FILENO);
    redirect("captured.out", O_WRONLY | O_CREAT | O_TRUNC, STDOUT_FILENO);
    redirect("captured.err", O_WRONLY | O_CREAT | O_TRUNC, STDERR_FILENO);
    struct rlimit limit = {file_limit, file_limit};
    if (file_limit && setrlimit(RLIMIT_FSIZE, &limit)) _exit(99);
    execvp(command[0], command);
    _exit(99);
}

static pid_t start(const char *const *args, rlim_t file_limit) {
    test_folder(); /* is made here, not there */
    pid_t pid = fork();
    assert_true(pid >= 0);
    if (pid == 0) become_program(args, file_limit);
    return pid;
}

static outcome wait_for(pid_t pid) {
    int status = 0, turns = TIME_LIMIT * 200;
    while (waitpid(pid, &status, WNOHANG) == 0 && turns-- > 0) test_pause_ms(5);
    if (turns < 0) {
        kill(pid, SIGKILL);
        waitpid(pid, &status, 0);
        fail_msg("the program still ran after %d s", TIME_LIMIT);
    }
    size_t size;
    return (outcome){.code = WIFEXITED(status) ? WEXITSTATUS(status) : -1,
                     .signal = WIFSIGNALED(status) ? WTERMSIG(status) : 0,
                     .out = (char *)test_read(test_path("captured.out"), &size),
                     .err = (char *)test_read(test_path("captured.err"), &size)};
}

#define ARGS(...) ((const char *const[]){__VA_ARGS__, NULL})

static void free_outcome(outcome *o) {
    free(o->out);
    free(o->err);
}

/* Runs it and asserts how it ends: with one line on standard error that names `part`, or nothing there. */
static void run_limited(const char *const *args, rlim_t file_limit, int code, const char *part) {
    outcome o = wait_for(start(args, file_limit));
    if (o.code != code || (part ? !strstr(o.err, part) : *o.err != 0)) {
        print_error("splatfit");
        for (; *args; args++) print_error(" '%s'", *args);
        print_error(": exit code %d, signal %d, not %d; expected: \"%s\"; said:\n%s\n", o.code, o.signal,
                    code, part ? part : "", o.err);
        fail();
    }
    if (part) {
        assert_memory_equal(o.err, "splatfit", 8);
        assert_ptr_equal(strchr(o.err, '\n'), o.err + strlen(o.err) - 1);
    }
    free_outcome(&o);
}

#define run(code, part, ...) run_limited(ARGS(__VA_ARGS__), 0, code, part)
#define capture_ok(...)      run(0, NULL, "capture", __VA_ARGS__, "--quiet", "--threads", "1")

/* 2. What is in a recording */

static json_t *json_of(const char *recording, const char *name) {
    char path[256];
    snprintf(path, sizeof path, "%s/%s", recording, name);
    return test_json(test_path(path));
}

static double total(const json_t *list, const char *key) {
    return test_number(json_object_get(list, "totals"), key);
}

static const json_t *entry(const json_t *list, size_t index) {
    const json_t *e = json_array_get(json_object_get(list, "frames"), index);
    assert_non_null(e);
    return e;
}

/* Reads frames.json and asserts that it is about the pictures that are there, and its sums hold. */
static json_t *assert_recording(const char *recording, size_t pictures) {
    char path[256];
    json_t *list = json_of(recording, "frames.json");
    snprintf(path, sizeof path, "%s/images", recording);
    assert_int_equal(test_count_entries(test_path(path)), pictures);
    assert_int_equal(json_array_size(json_object_get(list, "frames")), pictures);
    assert_true(total(list, "kept") == (double)pictures);
    assert_true(total(list, "given") == total(list, "kept") + total(list, "passed_over") +
                                            total(list, "undecodable") + total(list, "dropped_by_writer"));
    for (size_t i = 0; i < pictures; i++) {
        const char *name = json_string_value(json_object_get(entry(list, i), "file"));
        assert_non_null(name);
        snprintf(path, sizeof path, "%s/%s", recording, name);
        assert_true(test_exists(test_path(path)));
        if (i)
            assert_true(test_number(entry(list, i), "sequence") >
                        test_number(entry(list, i - 1), "sequence"));
        if (i)
            assert_true(test_number(entry(list, i), "time_ns") > test_number(entry(list, i - 1), "time_ns"));
    }
    snprintf(path, sizeof path, "%s/.frames.json.tmp", recording);
    assert_false(test_exists(test_path(path)));
    return list;
}

static void forget(const char *recording, size_t pictures) {
    json_decref(assert_recording(recording, pictures));
}

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
    forget("png", SCENE_FRAMES);
    assert_same_frames("png", 0);
    capture_ok(SCENE, "-o", "jpg");
    json_t *list = assert_recording("jpg", SCENE_FRAMES);
    assert_same_frames("jpg", 40); /* one pixel's worst, at quality 95 */
    assert_string_equal(json_string_value(json_object_get(list, "source")), SCENE);
    assert_string_equal(json_string_value(json_object_get(list, "format")), "RGB24");
    assert_string_equal(json_string_value(json_object_get(entry(list, 2), "file")),
                        "images/frame_000003.jpg");
    assert_true(test_number(entry(list, 2), "time_ns") == 66666666);
    assert_true(test_number(entry(list, 0), "sharpness") > 1);
    assert_true(total(list, "dropped") + total(list, "skipped") + total(list, "damaged") == 0);
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
    outcome o = wait_for(start(
        ARGS("fit", "project", "-o", "splat.ply", "--steps", "3", "--max-gaussians", "300", "--threads", "2"),
        0));
    assert_int_equal(o.code, 0);
    assert_true(test_exists(test_path("splat.ply")));
    free_outcome(&o);
}

static void test_every(void **state) {
    (void)state;
    capture_ok(SCENE, "-o", "every", "--every", "4");
    json_t *list = assert_recording("every", 3);
    for (size_t i = 0; i < 3; i++) assert_true(test_number(entry(list, i), "sequence") == (double)(4 * i));
    assert_true(total(list, "given") == SCENE_FRAMES && total(list, "passed_over") == 6);
    json_decref(list);

    capture_ok(SCENE, "-o", "few", "--frames", "2", "--every", "3");
    list = assert_recording("few", 2);
    assert_true(test_number(entry(list, 1), "sequence") == 3);
    assert_true(total(list, "given") == 4); /* none is taken beyond those */
    json_decref(list);

    capture_ok(SCENE, "-o", "seconds", "--seconds", "0.11"); /* frames at 0, 33, 67, 100 ms */
    forget("seconds", 4);
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
    json_t *list = assert_recording("sharp", 3); /* the last group has two frames */
    static const double best[3] = {1, 4, 7};
    for (size_t i = 0; i < 3; i++) assert_true(test_number(entry(list, i), "sequence") == best[i]);
    assert_true(test_number(entry(list, 0), "sharpness") > 2 * test_number(entry(list, 1), "sharpness"));
    assert_true(total(list, "passed_over") == 5);
    json_decref(list);
    capture_ok("folder:stripes", "-o", "one", "--every", "3", "--sharpest", "--frames", "1");
    list = assert_recording("one", 1);
    assert_true(test_number(entry(list, 0), "sequence") == 1 && total(list, "given") == 3);
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
    json_t *list = assert_recording("small", 3);
    assert_true(test_number(entry(list, 0), "width") == 10 && test_number(entry(list, 0), "height") == 8);
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
    json_t *list = assert_recording("jpegs", 3);
    assert_true(total(list, "given") == 4 && total(list, "undecodable") == 1);
    static const size_t numbers[3] = {0, 1, 3};
    for (size_t i = 0; i < 3; i++) {
        char path[64];
        size_t size;
        snprintf(path, sizeof path, "jpegs/images/frame_%06zu.jpg", i + 1);
        uint8_t *bytes = test_read(test_path(path), &size);
        assert_int_equal(size, sizes[numbers[i]]);
        assert_memory_equal(bytes, files[numbers[i]], size);
        assert_true(test_number(entry(list, i), "sequence") == (double)numbers[i]);
        free(bytes);
    }
    json_decref(list);
    capture_ok("pipe:stream.mjpeg", "-o", "three", "--frames", "3"); /* the hole is not one of them */
    forget("three", 3);
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
    json_t *list = assert_recording("raw", 3);
    const json_t *e = entry(list, 1);
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
    forget("reduced", 1);
}

/* 4. Ends of other kinds */

static void test_older_recording(void **state) {
    (void)state;
    capture_ok(SCENE, "-o", "twice");
    run(FAILED, "twice: holds a recording", "capture", SCENE, "-o", "twice", "--quiet");
    forget("twice", SCENE_FRAMES);
    capture_ok("folder:stripes", "-o", "twice", "--force", "--frames", "2");
    forget("twice", 2);
    assert_false(test_exists(test_path("twice/transforms.json"))); /* the older one's */
    test_write(test_path("twice/images/holiday.jpg"), "mine", 4);
    run(FAILED, "twice/images: holds pictures that are no recording's", "capture", SCENE, "-o", "twice",
        "--quiet", "--force");
    assert_true(test_exists(test_path("twice/images/holiday.jpg")));
    unlink(test_path("twice/images/holiday.jpg"));
    forget("twice", 2); /* a refusal removes nothing */
    run(FAILED, "twice: is where the frames come from", "capture", "folder:twice", "-o", "twice", "--quiet",
        "--force");
    run(FAILED, "twice: is where the frames come from", "capture", "folder:twice/images", "-o", "twice",
        "--quiet", "--force");
    forget("twice", 2);
    rename(test_path("twice/frames.json"), test_path("twice/transforms.json")); /* another program's folder */
    run(FAILED, "twice/images: holds pictures that are no recording's", "capture", SCENE, "-o", "twice",
        "--quiet", "--force");
    assert_true(test_exists(test_path("twice/images/frame_000001.jpg")));
    assert_true(test_exists(test_path("twice/transforms.json")));
    test_write(test_path("nothing.y4m"), "YUV4MPEG2 W4 H4\n", 16);
    run(FAILED, "", "capture", "pipe:nothing.y4m", "-o", "again",
        "--quiet"); /* keeps nobody from another try */
    capture_ok(SCENE, "-o", "again");
    forget("again", SCENE_FRAMES);
    test_write(test_path("file"), "", 0);
    run(FAILED, "file: ", "capture", SCENE, "-o", "file", "--quiet");
}

static void end_by(int number, const char *folder) {
    pid_t pid =
        start(ARGS("capture", "sim:studio?width=16&height=16&fps=50&loop=1", "-o", folder, "--quiet"), 0);
    char images[600];
    snprintf(images, sizeof images, "%s/images", test_path(folder));
    int turns = TIME_LIMIT * 200;
    while (test_count_entries(images) < 3 && turns-- > 0) test_pause_ms(5);
    kill(pid, number);
    outcome o = wait_for(pid);
    assert_int_equal(o.code, 128 + number);
    assert_string_equal(o.err, "");
    free_outcome(&o);
    json_t *list = json_of(folder, "frames.json");
    size_t pictures = (size_t)total(list, "kept");
    assert_true(pictures >= 3);
    assert_true(json_is_true(json_object_get(list, "live")));
    forget(folder, pictures);
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
    run_limited(ARGS("capture", "folder:growing", "-o", "full", "--format", "raw", "--quiet"), 200000, FAILED,
                "full/images/frame_000002.rgb24: ");
    json_t *list = assert_recording("full", 1);
    assert_true(total(list, "dropped_by_writer") >= 1);
    json_decref(list);
    sf_context_destroy(&ctx);
}

/* More frames than can be written: those that are left out are counted, and a source that waits loses none.
 */
static void test_slow_writer(void **state) {
    (void)state;
    static uint8_t zeros[60 * 96 * 64];
    capture_ok("pipe:/dev/zero?size=160x120&format=GREY&live=1", "-o", "slow", "--frames", "150");
    json_t *list = assert_recording("slow", 150);
    assert_true(total(list, "dropped_by_writer") > 0);
    assert_true(total(list, "dropped") > 0); /* by the pipe */
    json_decref(list);
    test_write(test_path("zeros"), zeros, sizeof zeros);
    capture_ok("pipe:zeros?size=96x64&format=GREY", "-o", "patient");
    list = assert_recording("patient", 60);
    assert_true(total(list, "given") == 60 && total(list, "dropped_by_writer") + total(list, "dropped") == 0);
    json_decref(list);
}

/* A source that breaks: what came before is there, and why it ended is said. */
static void test_broken_source(void **state) {
    (void)state;
    static const char text[] = "YUV4MPEG2 W4 H2 F30:1\nFRAME\nYYYYYYYYUUVVFRAME\nYYYYYYYYUUVVFRAME\nYYYY";
    char broken[sizeof text + 16];
    test_write(test_path("cut.y4m"), text, strlen(text));
    capture_ok("pipe:cut.y4m", "-o", "cut");
    json_t *list = assert_recording("cut", 2);
    assert_true(total(list, "damaged") == 1);
    json_decref(list);
    snprintf(broken, sizeof broken, "%.40s%s", text, "What?\n");
    test_write(test_path("broken.y4m"), broken, strlen(broken));
    run(FAILED, "pipe:broken.y4m: offset 40: \"What?\" is no FRAME header", "capture", "pipe:broken.y4m",
        "-o", "broken", "--quiet");
    forget("broken", 1);
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
    json_t *list = assert_recording("lens", 1);
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
        {"nowhere: unknown source; known:", {"nowhere", "-o", "x", NULL}},
        {"unknown option \"speed\"", {"sim:studio?speed=2", "-o", "x", NULL}},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const char *args[10] = {"capture"};
        memcpy(args + 1, cases[i].args, sizeof cases[i].args);
        run_limited(args, 0, USAGE, cases[i].part);
    }
    run(FAILED, "/nowhere: cannot be opened", "capture", "folder:/nowhere", "-o", "x");
    assert_false(test_exists(test_path("x")));
}

/* What it says on standard output, and that --quiet says nothing. */
static void test_words(void **state) {
    (void)state;
    outcome o = wait_for(start(ARGS("capture", SCENE, "-o", "words"), 0));
    assert_int_equal(o.code, 0);
    test_assert_contains(o.out, "simulated studio", __FILE__, __LINE__);
    test_assert_contains(o.out, "frames 9", __FILE__, __LINE__);
    test_assert_contains(o.out, "wrote words: 9 pictures of 9 frames", __FILE__, __LINE__);
    free_outcome(&o);
    o = wait_for(start(ARGS("capture", SCENE, "-o", "quiet", "--quiet"), 0));
    assert_int_equal(o.code, 0);
    assert_string_equal(o.out, "");
    free_outcome(&o);
    o = wait_for(start(ARGS("capture", "--help"), 0));
    test_assert_contains(o.out, "--sharpest", __FILE__, __LINE__);
    free_outcome(&o);
}

int main(void) {
    const char *given = getenv("SPLATFIT_PROGRAM");
    char top[2048];
    if (!getcwd(top, sizeof top)) return 1;
    given = given && *given ? given : "build/splatfit";
    snprintf(program, sizeof program, "%s%s%s", *given == '/' ? "" : top, *given == '/' ? "" : "/", given);
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
        cmocka_unit_test(test_interrupt),
        cmocka_unit_test(test_full_disk),
        cmocka_unit_test(test_slow_writer),
        cmocka_unit_test(test_broken_source),
        cmocka_unit_test(test_silent_source),
        cmocka_unit_test(test_lens),
        cmocka_unit_test(test_wrong_usage),
        cmocka_unit_test(test_words),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
