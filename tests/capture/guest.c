/* guest.c - runs the groups of tests that it is given and says what came out as TAP. */
#include "guest.h"

#include <dirent.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "pattern.h"

enum { TEST_SECONDS = 60, SKIPPED = 77 };

/* 1. What tests use */

static void say(const char *before, const char *format, va_list args) {
    fputs(before, stdout);
    vprintf(format, args);
    putchar('\n');
    fflush(stdout);
}

void fail(const char *format, ...) {
    va_list args;
    va_start(args, format);
    say("", format, args);
    va_end(args);
    _exit(1);
}

void skip(const char *reason) {
    printf("skipped: %s\n", reason);
    fflush(stdout);
    _exit(SKIPPED);
}

void sleep_ms(int ms) {
    struct timespec t = {ms / 1000, ms % 1000 * 1000000L};
    nanosleep(&t, NULL);
}

int64_t now_ms(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000 + t.tv_nsec / 1000000;
}

static char logged[16384];

static void keep_line(void *user, sf_log_level level, const char *message) {
    (void)user, (void)level;
    size_t length = strlen(logged);
    snprintf(logged + length, sizeof logged - length, "%s\n", message);
    printf("log: %s\n", message);
}

int was_logged(const char *part) { return strstr(logged, part) != NULL; }

sf_context *guest_context(void) {
    static sf_context *context;
    sf_context_options options = {.log = keep_line, .threads = 1};
    if (!context && sf_context_create(&context, &options) != SF_OK) fail("no context");
    return context;
}

sf_source *open_source(const char *format, ...) {
    char name[256];
    va_list args;
    va_start(args, format);
    vsnprintf(name, sizeof name, format, args);
    va_end(args);
    sf_source *source;
    sf_status status = sf_source_open(guest_context(), name, &source);
    check(status == SF_OK, "open %s: %s", name, sf_last_error(guest_context()));
    return source;
}

void next_frame(sf_source *source, int timeout_ms, sf_frame *frame) {
    int64_t end = now_ms() + 20000;
    sf_status status;
    do status = sf_source_next(source, timeout_ms, frame);
    while (status == SF_ERR_TIMEOUT && now_ms() < end);
    check(status == SF_OK, "next: %s: %s", sf_status_text(status), sf_last_error(guest_context()));
}

sf_source_counts counts_of(const sf_source *source) {
    sf_source_counts counts;
    sf_source_count(source, &counts);
    return counts;
}

int64_t take_exact(sf_source *source, int count) {
    int64_t first = -1, last = -1;
    uint64_t sequence = 0;
    for (int i = 0; i < count; i++) {
        sf_frame frame;
        next_frame(source, 5000, &frame);
        int64_t id = pattern_id(&frame);
        check(id >= 0, "frame %d, sequence %llu: the pixels are not those that were sent", i,
              (unsigned long long)frame.sequence);
        check(id > last, "frame %d: id %lld after %lld", i, (long long)id, (long long)last);
        check(i == 0 || frame.sequence > sequence, "frame %d: sequence %llu after %llu", i,
              (unsigned long long)frame.sequence, (unsigned long long)sequence);
        if (i == 0) first = id;
        last = id;
        sequence = frame.sequence;
        sf_source_release(source, &frame);
    }
    return first;
}

/* Whether /sys/class/video4linux/NODE/FILE begins with `start`. */
static int node_says(const char *node, const char *file, const char *start) {
    char path[320], text[64] = "";
    snprintf(path, sizeof path, "/sys/class/video4linux/%s/%s", node, file);
    FILE *f = fopen(path, "r");
    if (!f) return 0;
    char *read = fgets(text, sizeof text, f);
    fclose(f);
    return read && strncmp(text, start, strlen(start)) == 0;
}

static int look_for_node(const char *name, char node[32]) {
    DIR *nodes = opendir("/sys/class/video4linux");
    int found = 0;
    for (struct dirent *entry; nodes && !found && (entry = readdir(nodes));) {
        /* A webcam's second node is for metadata. */
        found = strncmp(entry->d_name, "video", 5) == 0 && strlen(entry->d_name) < 16 &&
                node_says(entry->d_name, "name", name) && node_says(entry->d_name, "index", "0");
        if (found) snprintf(node, 32, "/dev/%.16s", entry->d_name);
    }
    if (nodes) closedir(nodes);
    return found && access(node, R_OK | W_OK) == 0;
}

int node_exists(const char *name) {
    char node[32];
    return look_for_node(name, node);
}

void find_node(const char *name, char node[32]) {
    for (int i = 0; i < 100; i++) {
        if (look_for_node(name, node)) return;
        sleep_ms(100);
    }
    fail("no camera \"%s\" within 10 s", name);
}

/* 2. Running them */

static const struct {
    const char *name;
    const guest_test *tests;
} groups[] = {{"vivid", vivid_tests},         {"faults", fault_tests},    {"uvc", uvc_tests},
              {"libcamera", libcamera_tests}, {"virtual", virtual_tests}, {"live", live_tests}};

enum { GROUPS = sizeof groups / sizeof *groups };

static const guest_test *group(const char *name) {
    for (int i = 0; i < GROUPS; i++)
        if (strcmp(groups[i].name, name) == 0) return groups[i].tests;
    fprintf(stderr, "guest: \"%s\" is no group of tests\n", name);
    exit(2);
}

/* Of the tests whose name holds ONLY, where that is set. */
static int wanted(const guest_test *test) {
    const char *only = getenv("only");
    return !only || strstr(test->name, only);
}

static int count_tests(const guest_test *test) {
    int count = 0;
    for (; test->name; test++) count += wanted(test);
    return count;
}

/* A child, so that what it leaves open or a crash ends with it. */
static int run_test(const guest_test *test) {
    fflush(stdout);
    pid_t child = fork();
    if (child == 0) {
        alarm(TEST_SECONDS);
        test->run();
        fflush(stdout);
        _exit(0);
    }
    int status;
    if (child < 0 || waitpid(child, &status, 0) != child) return 1;
    if (WIFSIGNALED(status)) {
        printf("ended by signal %d%s\n", WTERMSIG(status), WTERMSIG(status) == SIGALRM ? ": hung" : "");
        return 1;
    }
    return WEXITSTATUS(status);
}

static void report(int number, const char *name, int status, int64_t ms) {
    printf("%s: %lld.%lld s\n", name, (long long)ms / 1000, (long long)ms / 100 % 10);
    if (status == SKIPPED)
        printf("ok %d # SKIP %s\n", number, name);
    else
        printf("%sok %d - %s\n", status ? "not " : "", number, name);
    fflush(stdout);
}

int main(int argc, char **argv) {
    int count = 0, number = 0;
    for (int i = 1; i < argc; i++) count += count_tests(group(argv[i]));
    printf("1..%d\n", count);
    for (int i = 1; i < argc; i++)
        for (const guest_test *test = group(argv[i]); test->name; test++) {
            if (!wanted(test)) continue;
            int64_t began = now_ms();
            int status = run_test(test);
            report(++number, test->name, status, now_ms() - began);
        }
    return 0;
}
