/* capture_fixture.h - runs of splatfit capture. */
#ifndef TESTS_UNIT_CAPTURE_FIXTURE_H
#define TESTS_UNIT_CAPTURE_FIXTURE_H

#include "testing.h"

#include <jansson.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/types.h>

#define SCENE "sim:studio?width=32&height=24&frames=9"
enum { SCENE_FRAMES = 9, SCENE_WIDTH = 32, SCENE_HEIGHT = 24 };
enum { FAILED = 1, USAGE = 2, TIME_LIMIT = 120 /* s */, MAX_COMMAND = 40 };

typedef struct outcome {
    int code, signal; /* exit code; the signal that ended it, 0: none */
    char *out, *err;
} outcome;

/* Finds the program under test, before the first run of it; not 0: there is no current folder. */
int capture_find_program(void);

pid_t capture_start(const char *const *args, rlim_t file_limit);
outcome capture_wait_for(pid_t pid);

#define ARGS(...) ((const char *const[]){__VA_ARGS__, NULL})

void capture_free_outcome(outcome *o);

/* Runs it and asserts how it ends: with one line on standard error that names `part`, or nothing there. */
void capture_run_limited(const char *const *args, rlim_t file_limit, int code, const char *part);

#define run(code, part, ...) capture_run_limited(ARGS(__VA_ARGS__), 0, code, part)
#define capture_ok(...)      run(0, NULL, "capture", __VA_ARGS__, "--quiet", "--threads", "1")

json_t *capture_json_of(const char *recording, const char *name);
double capture_total(const json_t *list, const char *key);
const json_t *capture_entry(const json_t *list, size_t index);

/* Reads frames.json and asserts that it is about the pictures that are there, and its sums hold. */
json_t *capture_assert_recording(const char *recording, size_t pictures);
void capture_forget(const char *recording, size_t pictures);

#endif
