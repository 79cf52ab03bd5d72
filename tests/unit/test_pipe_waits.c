/* test_pipe_waits.c - pipes that wait, end, are interrupted or closed; names; memory. */
#define _XOPEN_SOURCE 700 /* mkfifo, setitimer */
#include "pipe_fixture.h"

#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <unistd.h>

enum { SMALL = 27 };
#define SMALL_OPTIONS "?size=5x3&format=NV12"

static const char *fifo_name(const char *options) {
    static char name[600];
    const char *path = test_path("fifo");
    unlink(path);
    assert_int_equal(mkfifo(path, 0600), 0);
    snprintf(name, sizeof name, "pipe:%s%s", path, options);
    return name;
}

/* A process that writes frames first .. first+count-1 into the fifo. */
static pid_t start_writer(const char *header, uint64_t first, uint64_t count, long pause) {
    const char *path = test_path("fifo");
    pid_t pid = fork();
    assert_true(pid >= 0);
    if (pid) return pid;
    int fd = open(path, O_WRONLY);
    uint8_t bytes[SMALL];
    for (const char *c = header; *c; c++)
        if (write(fd, c, 1) != 1) _exit(1); /* byte by byte */
    for (uint64_t k = first; k < first + count; k++) {
        for (size_t i = 0; i < SMALL; i++) bytes[i] = pipe_pixel(k, i);
        if (write(fd, bytes, SMALL) != SMALL) _exit(1);
        if (pause) test_pause_ms(pause);
    }
    _exit(0);
}

static void assert_ended(pid_t pid) {
    int status;
    assert_int_equal(waitpid(pid, &status, 0), pid);
    assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 0);
}

/* Nobody writes yet: the wait ends, and the source goes on once frames come. */
static void test_timeout(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_frame frame;
    sf_source *source = pipe_open_source(ctx, fifo_name(SMALL_OPTIONS));
    for (int i = 0; i < 2; i++) {
        assert_status(ctx, sf_source_next(source, 3, &frame), SF_ERR_TIMEOUT);
        assert_error_names(ctx, "no frame within 3 ms");
        assert_null(frame.plane[0]);
    }
    pid_t writer = start_writer("", 0, 5, 0);
    pipe_assert_frames(ctx, source, 5, 30);
    assert_ended(writer);
    sf_source_close(&source);
    sf_context_destroy(&ctx);
}

/* The writer waits for a slow reader: nothing is lost. */
static void test_nothing_is_lost(void **state) {
    (void)state;
    enum { FRAMES = 100 };
    sf_context *ctx = test_context();
    sf_frame frame;
    sf_source *source = pipe_open_source(ctx, fifo_name(SMALL_OPTIONS));
    pid_t writer = start_writer("", 0, FRAMES, 0);
    for (uint64_t i = 0; i < FRAMES; i++) {
        if (i % 20 == 0) test_pause_ms(5);
        assert_ok(ctx, sf_source_newest(source, -1, &frame)); /* not live: the next */
        assert_int_equal(frame.sequence, i);
        pipe_assert_pixels(&frame, i);
        sf_source_release(source, &frame);
    }
    assert_status(ctx, sf_source_next(source, -1, &frame), SF_ERR_END);
    assert_int_equal(pipe_counts_of(source).skipped + pipe_counts_of(source).dropped, 0);
    assert_ended(writer);
    sf_source_close(&source);
    sf_context_destroy(&ctx);
}

/* A live pipe is read whether or not anybody takes frames; each is given, skipped or dropped, and counted. */
static void live(int newest) {
    enum { FRAMES = 3000 }; /* more than a pipe holds */
    sf_context *ctx = test_context();
    sf_frame frame;
    sf_source *source = pipe_open_source(ctx, fifo_name(SMALL_OPTIONS "&live=1"));
    pid_t writer = start_writer("", 0, FRAMES, 0);
    assert_ended(writer); /* though nothing was taken */
    uint64_t gaps = 0, next = 0;
    int64_t last_ns = 0;
    sf_status status;
    while ((status = newest ? sf_source_newest(source, -1, &frame) : sf_source_next(source, -1, &frame)) ==
           SF_OK) {
        assert_true(frame.sequence >= next && frame.time_ns >= last_ns);
        pipe_assert_pixels(&frame, frame.sequence);
        gaps += frame.sequence - next;
        next = frame.sequence + 1;
        last_ns = frame.time_ns;
        sf_source_release(source, &frame);
    }
    assert_status(ctx, status, SF_ERR_END);
    sf_source_counts counts = pipe_counts_of(source);
    assert_int_equal(next, FRAMES); /* the last one is among those that waited */
    assert_int_equal(counts.given + counts.skipped + counts.dropped, FRAMES);
    assert_int_equal(counts.skipped + counts.dropped, gaps);
    assert_true(newest ? counts.given >= 1 : counts.skipped == 0);
    assert_int_equal(counts.damaged, 0);
    sf_source_close(&source);
    sf_context_destroy(&ctx);
}

static void test_live(void **state) {
    (void)state;
    live(0);
    live(1);
}

static void on_alarm(int number) { (void)number; }

/* A header that comes byte by byte, while signals interrupt. */
static void test_interrupted(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    struct sigaction action = {.sa_handler = on_alarm}, old;
    const struct itimerval often = {{0, 2000}, {0, 2000}}, never = {{0, 0}, {0, 0}};
    char header[] = "YUV4MPEG2 W5 H3 F30:1\nFRAME\n";
    const char *name = fifo_name("");
    sigemptyset(&action.sa_mask);
    sigaction(SIGALRM, &action, &old);
    pid_t writer = start_writer(header, 0, 1, 20);
    setitimer(ITIMER_REAL, &often, NULL);
    sf_source *source = pipe_open_source(ctx, name);
    pipe_assert_frames(ctx, source, 1, 30);
    setitimer(ITIMER_REAL, &never, NULL);
    sigaction(SIGALRM, &old, NULL);
    assert_ended(writer);
    sf_source_close(&source);
    sf_context_destroy(&ctx);
}

static int open_files(void) { return test_count_entries("/proc/self/fd"); }

/* Closing ends a reader that waits, for bytes or for room, and leaves no file open. */
static void test_close(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    int before = open_files();
    sf_frame frame;
    sf_source *source = pipe_open_source(ctx, fifo_name(SMALL_OPTIONS));
    sf_source_close(&source);
    source = pipe_open_source(ctx, fifo_name(SMALL_OPTIONS));
    int silent = open(test_path("fifo"), O_WRONLY);
    assert_true(silent >= 0);
    assert_status(ctx, sf_source_next(source, 1, &frame), SF_ERR_TIMEOUT);
    sf_source_close(&source);
    assert_null(source);
    close(silent);
    pipe_file.size = 0;
    for (uint64_t i = 0; i < 20; i++) pipe_add_pixels(i, SMALL);
    source = pipe_open_source(ctx, pipe_put_file(SMALL_OPTIONS));
    assert_ok(ctx, sf_source_next(source, -1, &frame)); /* it is out when the source is closed */
    sf_source_close(&source);
    assert_int_equal(open_files(), before);
    sf_context_destroy(&ctx);
}

static void test_standard_input(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    pipe_file.size = 0;
    pipe_add_text("YUV4MPEG2 W5 H3 F30:1\nFRAME\n");
    pipe_add_pixels(0, SMALL);
    pipe_put_file("");
    int saved = dup(STDIN_FILENO), fd = open(test_path("frames"), O_RDONLY);
    assert_true(fd >= 0 && dup2(fd, STDIN_FILENO) == STDIN_FILENO);
    close(fd);
    sf_source *source = pipe_open_source(ctx, "pipe:-");
    pipe_assert_frames(ctx, source, 1, 30);
    sf_source_close(&source);
    assert_true(fcntl(STDIN_FILENO, F_GETFD) >= 0); /* it is not ours to close */
    if (saved >= 0) {
        dup2(saved, STDIN_FILENO);
        close(saved);
    }
    sf_context_destroy(&ctx);
}

static void test_leases(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_frame a, b, c;
    pipe_file.size = 0;
    for (uint64_t i = 0; i < 12; i++) pipe_add_pixels(i, SMALL);
    sf_source *source = pipe_open_source(ctx, pipe_put_file(SMALL_OPTIONS));
    assert_ok(ctx, sf_source_next(source, -1, &a));
    for (uint64_t i = 1; i < 11; i++) {
        assert_ok(ctx, sf_source_next(source, -1, &b));
        assert_status(ctx, sf_source_next(source, -1, &c), SF_ERR_ARGUMENT);
        pipe_assert_pixels(&a, i - 1);
        pipe_assert_pixels(&b, i);
        sf_source_release(source, &a);
        a = b;
    }
    sf_source_close(&source);
    sf_context_destroy(&ctx);
}

static void test_bad_names(void **state) {
    (void)state;
    static const struct {
        const char *options, *part;
    } bad[] = {
        {"?size=5x3", "format: \"\" is none of RGB24"},
        {"?format=NV12", "size: \"\" is not WIDTHxHEIGHT"},
        {"?size=5x3&format=NV21", "format: \"NV21\" is none of RGB24"},
        {"?size=5&format=NV12", "size: \"5\""},
        {"?size=5x&format=NV12", "size: \"5x\""},
        {"?size=x3&format=NV12", "size: \"x3\""},
        {"?size=5x3x2&format=NV12", "size: \"5x3x2\""},
        {"?size=0x3&format=NV12", "size: \"0x3\""},
        {"?size=65536x3&format=NV12", "size: \"65536x3\""},
        {"?size=65535x65535&format=NV12", "size: \"65535x65535\""},
        {"?size=5x3&format=MJPG", "format: \"MJPG\""},
        {"?size=5x3&format=NV12&matrix=602", "matrix: \"602\" is none of 601 709 2020"},
        {"?size=5x3&format=NV12&range=some", "range: \"some\" is none of limited full"},
        {"?fps=-1", "fps: -1"},
        {"?fps=1001", "fps: 1001"},
        {"?live=2", "live: 2"},
        {"?live=0.5", "live: 0.5"},
        {"?speed=2", "unknown option \"speed\""},
    };
    sf_context *ctx = test_context();
    sf_source *source;
    int before = open_files();
    pipe_file.size = 0;
    pipe_add_pixels(0, SMALL);
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        assert_status(ctx, sf_source_open(ctx, pipe_put_file(bad[i].options), &source), SF_ERR_ARGUMENT);
        assert_error_names(ctx, bad[i].part);
        assert_error_names(ctx, "pipe:");
        assert_null(source);
    }
    assert_status(ctx, sf_source_open(ctx, "pipe:", &source), SF_ERR_IO);
    char name[600];
    snprintf(name, sizeof name, "pipe:%s", test_path("absent"));
    assert_status(ctx, sf_source_open(ctx, name, &source), SF_ERR_IO);
    assert_error_names(ctx, "absent: cannot be opened");
    snprintf(name, sizeof name, "pipe:%s", test_folder());
    assert_status(ctx, sf_source_open(ctx, name, &source), SF_ERR_IO);
    assert_error_names(ctx, "is a folder");
    assert_int_equal(open_files(), before);
    sf_context_destroy(&ctx);
}

static const char *name_of_source(void) { return pipe_put_file(SMALL_OPTIONS); }

/* Wherever memory ends it is said, and nothing stays behind. */
static void test_memory_ends(void **state) {
    (void)state;
    test_allocations a = {.fail_at = 0};
    sf_allocator allocator = {test_count_alloc, test_count_free, &a};
    sf_context_options options = {.allocator = &allocator, .threads = 1};
    sf_context *ctx;
    assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
    pipe_file.size = 0;
    pipe_add_pixels(0, SMALL);
    test_source_without_memory(ctx, &a, name_of_source, 4);
    sf_context_destroy(&ctx);
}

int main(void) {
    signal(SIGPIPE, SIG_IGN);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_timeout),     cmocka_unit_test(test_nothing_is_lost),
        cmocka_unit_test(test_live),        cmocka_unit_test(test_interrupted),
        cmocka_unit_test(test_close),       cmocka_unit_test(test_standard_input),
        cmocka_unit_test(test_leases),      cmocka_unit_test(test_bad_names),
        cmocka_unit_test(test_memory_ends),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
