/* program.c - see program.h. */
#define _XOPEN_SOURCE 700 /* realpath, SIGXFSZ */
#include "program.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

enum { MAX_COMMAND = 64, TIME_LIMIT = 120 /* s */ };

static char program[4096], captured_out[512], captured_err[512];

const char *work(const char *name) {
    char path[512];
    snprintf(path, sizeof path, "work/%s", name);
    return test_path(path);
}

static void redirect(const char *path, int flags, int to) {
    int fd = open(path, flags, 0600);
    if (fd < 0 || dup2(fd, to) < 0) _exit(99);
    close(fd);
}

static void become_program(const char *const *args, const launch *how) {
    char *command[MAX_COMMAND] = {0};
    size_t n = test_runner(command, 20);
    command[n++] = program;
    for (; *args && n < MAX_COMMAND - 1; args++) memcpy(&command[n++], args, sizeof *args);
    if (*args || chdir(test_path("work"))) _exit(99);
    redirect("/dev/null", O_RDONLY, STDIN_FILENO);
    redirect(how->to_full_disk ? "/dev/full" : captured_out, O_WRONLY | O_CREAT | O_TRUNC, STDOUT_FILENO);
    redirect(captured_err, O_WRONLY | O_CREAT | O_TRUNC, STDERR_FILENO);
    if (how->file_limit) {
        struct rlimit limit = {how->file_limit, how->file_limit};
        signal(SIGXFSZ, SIG_IGN); /* so that a write beyond it fails, as one on a full disk does */
        if (setrlimit(RLIMIT_FSIZE, &limit)) _exit(99);
    }
    execvp(command[0], command);
    _exit(99);
}

pid_t start_program(const char *const *args, const launch *how) {
    static const launch plain = {0};
    test_write(captured_out, "", 0);
    test_write(captured_err, "", 0);
    pid_t pid = fork();
    assert_true(pid >= 0);
    if (pid == 0) become_program(args, how ? how : &plain);
    return pid;
}

double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

int has_ended(pid_t pid, double since, int *status) {
    pid_t got = waitpid(pid, status, WNOHANG);
    assert_true(got >= 0);
    if (got == pid) return 1;
    if (now() - since < TIME_LIMIT) return 0;
    kill(pid, SIGKILL);
    waitpid(pid, status, 0);
    fail_msg("the program still ran after %d s", TIME_LIMIT);
    return 1;
}

outcome take_outcome(int status) {
    outcome o = {.code = WIFEXITED(status) ? WEXITSTATUS(status) : -1,
                 .signal = WIFSIGNALED(status) ? WTERMSIG(status) : 0};
    size_t size;
    o.out = (char *)test_read(captured_out, &o.out_size);
    o.err = (char *)test_read(captured_err, &size);
    return o;
}

outcome wait_for(pid_t pid) {
    double since = now();
    int status = 0;
    while (!has_ended(pid, since, &status)) test_pause_ms(5);
    return take_outcome(status);
}

void free_outcome(outcome *o) {
    free(o->out);
    free(o->err);
}

outcome run_args(const char *const *args) { return wait_for(start_program(args, NULL)); }

static void complain(const char *const *args, const outcome *o, const char *what) {
    print_error("splatfit");
    for (; *args; args++) print_error(" '%s'", *args);
    print_error("\n%s; exit code %d, signal %d, standard error:\n%s\n", what, o->code, o->signal, o->err);
    fail();
}

outcome run_args_ok(const char *const *args) {
    outcome o = run_args(args);
    if (o.code) complain(args, &o, "did not go well");
    return o;
}

void run_quietly(const char *const *args) {
    outcome o = run_args_ok(args);
    free_outcome(&o);
}

/* Files and folders. */

void make_folder(const char *name) { assert_true(!mkdir(work(name), 0777) || errno == EEXIST); }

void write_text(const char *name, const char *text) { test_write(work(name), text, strlen(text)); }

void clear_out(void) {
    make_folder("out");
    DIR *d = opendir(work("out"));
    assert_non_null(d);
    for (struct dirent *e; (e = readdir(d));)
        if (e->d_name[0] != '.' || strlen(e->d_name) > 2) unlinkat(dirfd(d), e->d_name, 0);
    closedir(d);
    assert_int_equal(test_count_entries(work("out")), 0);
}

content content_of(const char *name) {
    content c;
    c.data = (char *)test_read(work(name), &c.size);
    return c;
}

void assert_same_files(const char *a, const char *b) {
    content x = content_of(a), y = content_of(b);
    if (x.size != y.size || memcmp(x.data, y.data, x.size)) fail_msg("%s and %s differ", a, b);
    free(x.data);
    free(y.data);
}

size_t count_in(const char *name) {
    sf_context *ctx = test_context();
    sf_model *model;
    test_log_clear();
    assert_ok(ctx, sf_model_load(ctx, work(name), &model));
    assert_string_equal(test_log, ""); /* nothing left out */
    size_t count = sf_model_count(model);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
    return count;
}

void assert_png(const char *name, unsigned width, unsigned height) {
    content c = content_of(name);
    const unsigned char *p = (const unsigned char *)c.data;
    assert_true(c.size > 24);
    assert_memory_equal(p, "\x89PNG\r\n\x1a\n", 8);
    assert_int_equal(p[18] << 8 | p[19], width);
    assert_int_equal(p[22] << 8 | p[23], height);
    free(c.data);
}

void assert_refused(const char *const *args, int code, const char *part, int warned) {
    int files = test_count_entries(work("."));
    outcome o = run_args(args);
    if (code ? o.code != code : !(o.code > 0 && o.code < 128)) complain(args, &o, "wrong exit code");
    if (!strstr(o.err, part)) {
        print_error("expected to be named: \"%s\"\n", part);
        complain(args, &o, "does not name it");
    }
    char *line = o.err, *end;
    while ((end = strchr(line, '\n')) && end[1] && warned && !strncmp(line, "warning: ", 9)) line = end + 1;
    if (!end || end[1]) complain(args, &o, "not one line");
    if (strncmp(line, "splatfit", 8)) complain(args, &o, "the line does not begin with the program's name");
    if (test_count_entries(work("out"))) complain(args, &o, "left a file in out");
    if (test_count_entries(work(".")) != files) complain(args, &o, "left a file");
    free_outcome(&o);
}

void assert_all_refused(const bad_input *cases, size_t count) {
    clear_out();
    for (size_t i = 0; i < count; i++) assert_refused(cases[i].args, cases[i].code, cases[i].part, 0);
}

static int find_program(void) {
    const char *name = getenv("SPLATFIT_PROGRAM");
    char *path = realpath(name && *name ? name : "build/splatfit", NULL);
    if (!path || strlen(path) >= sizeof program) {
        print_error("%s: no such program; see SPLATFIT_PROGRAM\n", name ? name : "build/splatfit");
        free(path);
        return -1;
    }
    strcpy(program, path);
    free(path);
    return 0;
}

int program_set_up(void **state) {
    (void)state;
    if (find_program()) return -1;
    snprintf(captured_out, sizeof captured_out, "%s", test_path("stdout"));
    snprintf(captured_err, sizeof captured_err, "%s", test_path("stderr"));
    if (mkdir(test_path("work"), 0777)) return -1;
    make_folder("out");
    return 0;
}
