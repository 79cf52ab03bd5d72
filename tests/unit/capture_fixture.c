/* capture_fixture.c - see the header. */
#include "capture_fixture.h"

#include <fcntl.h>
#include <jansson.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

static char program[4096];

static void redirect(const char *path, int flags, int to) {
    int fd = open(path, flags, 0600);
    if (fd < 0 || dup2(fd, to) < 0) _exit(99);
    close(fd);
}

static void become_program(const char *const *args, rlim_t file_limit) {
    char *command[MAX_COMMAND] = {0};
    size_t n = test_runner(command, 20);
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

pid_t capture_start(const char *const *args, rlim_t file_limit) {
    test_folder(); /* is made here, not there */
    pid_t pid = fork();
    assert_true(pid >= 0);
    if (pid == 0) become_program(args, file_limit);
    return pid;
}

outcome capture_wait_for(pid_t pid) {
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

void capture_free_outcome(outcome *o) {
    free(o->out);
    free(o->err);
}

void capture_run_limited(const char *const *args, rlim_t file_limit, int code, const char *part) {
    outcome o = capture_wait_for(capture_start(args, file_limit));
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
    capture_free_outcome(&o);
}

json_t *capture_json_of(const char *recording, const char *name) {
    char path[256];
    snprintf(path, sizeof path, "%s/%s", recording, name);
    return test_json(test_path(path));
}

double capture_total(const json_t *list, const char *key) {
    return test_number(json_object_get(list, "totals"), key);
}

const json_t *capture_entry(const json_t *list, size_t index) {
    const json_t *e = json_array_get(json_object_get(list, "frames"), index);
    assert_non_null(e);
    return e;
}

json_t *capture_assert_recording(const char *recording, size_t pictures) {
    char path[256];
    json_t *list = capture_json_of(recording, "frames.json");
    snprintf(path, sizeof path, "%s/images", recording);
    assert_int_equal(test_count_entries(test_path(path)), pictures);
    assert_int_equal(json_array_size(json_object_get(list, "frames")), pictures);
    assert_true(capture_total(list, "kept") == (double)pictures);
    assert_true(capture_total(list, "given") ==
                capture_total(list, "kept") + capture_total(list, "passed_over") +
                    capture_total(list, "undecodable") + capture_total(list, "dropped_by_writer"));
    for (size_t i = 0; i < pictures; i++) {
        const char *name = json_string_value(json_object_get(capture_entry(list, i), "file"));
        assert_non_null(name);
        snprintf(path, sizeof path, "%s/%s", recording, name);
        assert_true(test_exists(test_path(path)));
        if (i)
            assert_true(test_number(capture_entry(list, i), "sequence") >
                        test_number(capture_entry(list, i - 1), "sequence"));
        if (i)
            assert_true(test_number(capture_entry(list, i), "time_ns") >
                        test_number(capture_entry(list, i - 1), "time_ns"));
    }
    snprintf(path, sizeof path, "%s/.frames.json.tmp", recording);
    assert_false(test_exists(test_path(path)));
    return list;
}

void capture_forget(const char *recording, size_t pictures) {
    json_decref(capture_assert_recording(recording, pictures));
}

int capture_find_program(void) {
    const char *given = getenv("SPLATFIT_PROGRAM");
    char top[2048];
    if (!getcwd(top, sizeof top)) return 1;
    given = given && *given ? given : "build/splatfit";
    snprintf(program, sizeof program, "%s%s%s", *given == '/' ? "" : top, *given == '/' ? "" : "/", given);
    return 0;
}
