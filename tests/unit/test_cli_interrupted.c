/* test_cli_interrupted.c - the program from outside, interrupted and gone on with; time, memory and room that
 * run out. */
#include "cli_fixture.h"

#include <jansson.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>

/* Going on and repeating. */

static void wait_for_text(pid_t pid, const char *text) {
    double since = now();
    int status = 0, found = 0;
    while (!found) {
        size_t size;
        char *out = (char *)test_read(test_path("stdout"), &size);
        found = strstr(out, text) != NULL;
        free(out);
        if (!found && has_ended(pid, since, &status)) fail_msg("ended before it said \"%s\"", text);
        if (!found) test_pause_ms(5);
    }
}

/* Interrupted by a signal, gone on with: the bytes of a run that was not. */
static void test_resume(void **state) {
    (void)state;
    const char *steps = getenv("SPLATFIT_QUICK") ? "60" : "400";
    clear_out();
    run_quietly(ARGS("fit", SCENE, "-o", "out/a.ply", "--steps", steps, SMALL, "--cameras", "none"));
    pid_t pid = start_program(ARGS("fit", SCENE, "-o", "out/b.ply", "--steps", steps, "--max-gaussians",
                                   "400", "--threads", "1", "--checkpoint", "out/c", "--checkpoint-every",
                                   "0", "--progress", "plain", "--cameras", "none"),
                              NULL);
    wait_for_text(pid, "step ");
    kill(pid, SIGTERM);
    outcome o = wait_for(pid);
    assert_true(o.code == 128 + SIGTERM || o.code == 0);
    free_outcome(&o);
    o = run_ok("fit", SCENE, "-o", "out/b.ply", "--resume", "out/c", "--checkpoint", "out/c", "--threads",
               "2", "--cameras", "none", "--log", "out/log.json");
    test_assert_contains(o.out, "going on after step ", __FILE__, __LINE__);
    free_outcome(&o);
    assert_same_files("out/a.ply", "out/b.ply");
    json_t *log = test_json(work("out/log.json"));
    assert_true(test_number(json_object_get(log, "options"), "max_gaussians") == 400);
    json_decref(log);

    assert_int_equal(rename(work("out/c"), work("c")), 0);
    clear_out();
    static const bad_input cases[] = {
        {FAILED, "c: sh_degree: the run has 3", {"fit", SCENE, "--resume", "c", "--sh-degree", "2"}},
        {FAILED, "c: is of another scene", {"fit", SCENE, "--resume", "c", "--downscale", "2"}},
        {FAILED, "good.ply: is not a checkpoint", {"fit", SCENE, "--resume", "good.ply"}},
        {FAILED, "absent: cannot be opened", {"fit", SCENE, "--resume", "absent"}},
        {USAGE, "from: cannot be given", {"fit", SCENE, "--resume", "c", "--from", "good.ply"}},
        {FAILED, "empty: is a folder", {"fit", SCENE, "--checkpoint", "empty"}},
        {USAGE, "--checkpoint-every: \"-1\"", {"fit", SCENE, "--checkpoint-every", "-1"}},
        {FAILED, "memory: 1 MB are not enough", {"fit", SCENE, "--memory", "1M"}},
    };
    for (size_t i = 0; i < COUNT(cases); i++) assert_refused(cases[i].args, cases[i].code, cases[i].part, 0);
}

/* The old checkpoint stays where there is no room for the new one, and the exit code tells of it. */
static void test_checkpoint_too_large(void **state) {
    (void)state;
    clear_out();
    write_text("out/c", "the old checkpoint");
    launch limited = {.file_limit = 8192};
    outcome o = wait_for(start_program(
        ARGS("fit", SHORT_FIT, "--quiet", "-o", "/dev/null", "--cameras", "none", "--checkpoint", "out/c"),
        &limited));
    assert_int_equal(o.code, FAILED);
    test_assert_contains(o.err, "out/c: ", __FILE__, __LINE__);
    free_outcome(&o);
    content c = content_of("out/c");
    assert_string_equal(c.data, "the old checkpoint");
    free(c.data);
    assert_int_equal(test_count_entries(work("out")), 1);
}

static void write_changed(const char *name, json_t *log, const char *key, json_t *value) {
    json_t *copy = json_deep_copy(log);
    if (value)
        json_object_set_new(copy, key, value);
    else
        json_object_del(copy, key);
    assert_int_equal(json_dump_file(copy, work(name), 0), 0);
    json_decref(copy);
}

/* A run limited by time, again, as fast as it goes. */
static void test_replay(void **state) {
    (void)state;
    clear_out();
    const char *limit =
        getenv("SPLATFIT_QUICK") ? "3" : "1"; /* a program with sanitizers has read the scene by then */
    run_quietly(ARGS("fit", SCENE, "-o", "out/a.ply", "--time-limit", limit, SMALL, "--log", "out/a.json",
                     "--cameras", "none", "--seed", "3"));
    run_quietly(ARGS("fit", SCENE, "-o", "out/b.ply", "--replay", "out/a.json", "--threads", "1", "--log",
                     "out/b.json", "--cameras", "none"));
    assert_same_files("out/a.ply", "out/b.ply");
    json_t *a = test_json(work("out/a.json")), *b = test_json(work("out/b.json")),
           *times = json_object_get(a, "plan");
    assert_true(json_equal(times, json_object_get(b, "plan")));
    assert_true(json_equal(json_object_get(a, "options"), json_object_get(b, "options")));
    assert_true(test_number(times, "steps") == test_number(json_object_get(a, "result"), "steps"));
    write_changed("other.json", a, "isa", json_string("abacus"));
    write_changed("version.json", a, "version", json_string("0"));
    write_changed("planless.json", a, "plan", NULL);
    write_changed("plan.json", a, "plan",
                  json_pack("{s:i,s:i,s:s}", "ticks", 1 << 24, "steps", 3, "deltas", "5 6"));
    write_changed("optionless.json", a, "options", NULL);
    write_changed("options.json", a, "options", json_object());
    write_changed("from.json", a, "warm_start", json_true());
    json_decref(a);
    json_decref(b);
    assert_int_equal(rename(work("out/a.json"), work("a.json")), 0);
    clear_out();
    static const bad_input cases[] = {
        {FAILED, "steps: is given again", {"fit", SCENE, "--replay", "a.json", "--steps", "5"}},
        {FAILED, "a.json: scene: ", {"fit", SCENE, "--replay", "a.json", "--downscale", "2"}},
        {FAILED, "other.json: isa: ", {"fit", SCENE, "--replay", "other.json"}},
        {FAILED, "version.json: version: ", {"fit", SCENE, "--replay", "version.json"}},
        {FAILED, "planless.json: plan: ", {"fit", SCENE, "--replay", "planless.json"}},
        {FAILED, "plan.json: plan: ", {"fit", SCENE, "--replay", "plan.json"}},
        {FAILED, "optionless.json: options: ", {"fit", SCENE, "--replay", "optionless.json"}},
        {FAILED, "options.json: steps: is missing", {"fit", SCENE, "--replay", "options.json"}},
        {FAILED, "from.json: warm_start: ", {"fit", SCENE, "--replay", "from.json"}},
        {FAILED, "good.ply: line 1: ", {"fit", SCENE, "--replay", "good.ply"}},
        {FAILED, "/dev/zero: is not a regular file", {"fit", SCENE, "--replay", "/dev/zero"}},
        {FAILED, "absent.json: No such file", {"fit", SCENE, "--replay", "absent.json"}},
    };
    for (size_t i = 0; i < COUNT(cases); i++) assert_refused(cases[i].args, cases[i].code, cases[i].part, 0);
}

/* MB that the program has had resident, by its log. */
static double peak_in(const char *name) {
    json_t *log = test_json(work(name));
    double peak = test_number(json_object_get(log, "result"), "peak_memory_mb");
    json_decref(log);
    return peak;
}

/* The cap that the memory allows, said in one line. What a sanitizer or an emulator takes is found out first.
 */
static void test_memory(void **state) {
    (void)state;
    char budget[32];
    clear_out();
    run_quietly(ARGS("fit", SCENE, "-o", "/dev/null", "--steps", "1", "--log", "out/log.json"));
    double allowed = floor(peak_in("out/log.json")) + 100;
    snprintf(budget, sizeof budget, "%.0fM", allowed);
    outcome o = run_ok("fit", SCENE, "-o", "/dev/null", "--steps", "1", "--max-gaussians", "1000000",
                       "--memory", budget, "--log", "out/log.json");
    test_assert_contains(o.out, "memory: about ", __FILE__, __LINE__);
    test_assert_contains(o.err, "max_gaussians lowered from 1000000 to ", __FILE__, __LINE__);
    free_outcome(&o);
    json_t *log = test_json(work("out/log.json")), *options = json_object_get(log, "options");
    assert_true(test_number(options, "max_gaussians") > 1000 &&
                test_number(options, "max_gaussians") < 200000);
    assert_true(test_number(options, "memory") == allowed * 1048576);
    json_decref(log);
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
    assert_true(peak_in("out/log.json") <= allowed);
#endif
    clear_out();
    assert_refused(ARGS("fit", "good", "-o", "out/x.ply", "--memory", "10K"), FAILED,
                   "good: memory: 0 MB are not enough: the pictures take about ", 0);
}

/* Signals and full disks. */

/* A fit that is under way. */
static pid_t start_endless(const char *model) {
    pid_t pid = start_program(ARGS("fit", SCENE, "-o", model, "--steps", "100000000", SMALL, "--progress",
                                   "plain", "--log", "out/log.json"),
                              NULL);
    wait_for_text(pid, "step ");
    return pid;
}

/* The model so far is written, whole, and the exit code tells which signal it was. */
static void check_signal(int number_of_signal) {
    clear_out();
    pid_t pid = start_endless("out/m.ply");
    assert_int_equal(kill(pid, number_of_signal), 0);
    test_pause_ms(1);
    assert_int_equal(kill(pid, number_of_signal), 0); /* as timeout(1) does */
    outcome o = wait_for(pid);
    assert_int_equal(o.signal, 0);
    assert_int_equal(o.code, 128 + number_of_signal);
    test_assert_contains(o.out, "stopped after ", __FILE__, __LINE__);
    test_assert_contains(o.out, "wrote out/m.ply", __FILE__, __LINE__);
    free_outcome(&o);
    assert_true(count_in("out/m.ply") > 0);
    assert_int_equal(test_count_entries(work("out")), 3);
    json_t *log = test_json(work("out/log.json")), *result = json_object_get(log, "result");
    assert_true(json_is_false(json_object_get(result, "complete")));
    assert_string_equal(json_string_value(json_object_get(result, "end")), "signal");
    assert_true(test_number(result, "steps") >= 1 && test_number(result, "steps") < 100000000);
    json_decref(log);
}

static void test_interrupted(void **state) {
    (void)state;
    check_signal(SIGINT);
}

static void test_terminated(void **state) {
    (void)state;
    check_signal(SIGTERM);
}

/* A model that nobody reads holds the program up; who asks a second time, a second later, is rid of it. */
static void test_interrupted_twice(void **state) {
    (void)state;
    clear_out();
    assert_int_equal(mkfifo(work("out/pipe"), 0600), 0);
    pid_t pid = start_endless("out/pipe");
    assert_int_equal(kill(pid, SIGINT), 0);
    test_pause_ms(1200);
    int status;
    assert_int_equal(waitpid(pid, &status, WNOHANG), 0);
    assert_int_equal(kill(pid, SIGINT), 0);
    outcome o = wait_for(pid);
    assert_int_equal(o.signal, SIGINT);
    free_outcome(&o);
}

/* No room for the new model: the old one stays, and nothing beside it. */
static void test_file_too_large(void **state) {
    (void)state;
    clear_out();
    write_text("out/m.ply", "the old model");
    launch limited = {.file_limit = 8192};
    outcome o = wait_for(start_program(ARGS("fit", SHORT_FIT, "--quiet", "-o", "out/m.ply"), &limited));
    assert_int_equal(o.code, FAILED);
    test_assert_contains(o.err, "out/m.ply: ", __FILE__, __LINE__);
    test_assert_contains(o.err, "File too large", __FILE__, __LINE__);
    assert_ptr_equal(strchr(o.err, '\n'), o.err + strlen(o.err) - 1);
    free_outcome(&o);
    content c = content_of("out/m.ply");
    assert_string_equal(c.data, "the old model");
    free(c.data);
    assert_int_equal(test_count_entries(work("out")), 1);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_resume),
        cmocka_unit_test(test_checkpoint_too_large),
        cmocka_unit_test(test_replay),
        cmocka_unit_test(test_memory),
        cmocka_unit_test(test_interrupted),
        cmocka_unit_test(test_terminated),
        cmocka_unit_test(test_interrupted_twice),
        cmocka_unit_test(test_file_too_large),
    };
    return cmocka_run_group_tests(tests, cli_set_up, NULL);
}
