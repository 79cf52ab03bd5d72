/* program.h - the program from outside: it is started, and what it wrote, said and ended with is looked at.
 *
 * The program is SPLATFIT_PROGRAM, else build/splatfit, started through the command in RUN if that is set. It
 * runs in the scratch folder "work"; what a command is to write goes to "out" in there.
 */
#ifndef PROGRAM_H
#define PROGRAM_H

#include "testing.h"

#include <sys/resource.h>
#include <sys/types.h>

/* A scene for fits that take a moment, and what keeps them small. */
#define SCENE "sim:studio?width=64&height=48&frames=9"
#define SMALL "--max-gaussians", "400", "--threads", "2"
enum { SCENE_VIEWS = 9, SCENE_HELD_OUT = 2, SCENE_WIDTH = 64, SCENE_HEIGHT = 48 };

enum { FAILED = 1, USAGE = 2 };

/* How to start it, beside its arguments. */
typedef struct launch {
    rlim_t file_limit; /* bytes of the largest file that it may write; 0: no limit */
    int to_full_disk;  /* standard output is /dev/full */
} launch;

typedef struct outcome {
    int code, signal; /* exit code; the signal that ended it, 0: none */
    char *out, *err;  /* what it wrote, with a 0 behind it */
    size_t out_size;
} outcome;

typedef struct content {
    char *data;
    size_t size;
} content;

typedef struct bad_input {
    int code;
    const char *part;
    const char *args[16];
} bad_input;

/* "<scratch folder>/work/<name>", as test_path. */
const char *work(const char *name);

/* how: NULL: in no particular way. */
pid_t start_program(const char *const *args, const launch *how);
/* Seconds of a clock. */
double now(void);
/* Whether a program started at `since` has ended, and with which status. It is killed, and the test fails,
 * after two minutes. */
int has_ended(pid_t pid, double since, int *status);
/* What it wrote before it ended; free_outcome. */
outcome take_outcome(int status);
outcome wait_for(pid_t pid);
void free_outcome(outcome *o);

outcome run_args(const char *const *args);
/* A run that must go well. */
outcome run_args_ok(const char *const *args);
/* For a run of which only the files matter. */
void run_quietly(const char *const *args);
#define ARGS(...)    ((const char *const[]){__VA_ARGS__, NULL})
#define run(...)     run_args(ARGS(__VA_ARGS__))
#define run_ok(...)  run_args_ok(ARGS(__VA_ARGS__))
#define COUNT(array) (sizeof(array) / sizeof *(array))

/* Files and folders of the folder work. */
void make_folder(const char *name);
void write_text(const char *name, const char *text);
/* Empties the folder "out". */
void clear_out(void);
content content_of(const char *name);
void assert_same_files(const char *a, const char *b);
/* Gaussians of a model file that must be whole. */
size_t count_in(const char *name);
/* Width and height as a PNG's header has them. */
void assert_png(const char *name, unsigned width, unsigned height);

/* One line on standard error that names `part`, where warned after lines that are warnings; exit code `code`,
 * or any but 0 that is no signal's; nothing written. */
void assert_refused(const char *const *args, int code, const char *part, int warned);
void assert_all_refused(const bad_input *cases, size_t count);

/* Finds the program and makes the folder work with "out" in it; the setup of a group of tests. Other than
 * 0: there is no program. */
int program_set_up(void **state);

#endif
