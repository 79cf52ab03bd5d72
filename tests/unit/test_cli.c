/* test_cli.c - the program from outside, where all is well: what it writes, what it says. */
#include "cli_fixture.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static void test_help(void **state) {
    (void)state;
    static const struct {
        const char *args[3], *part;
    } cases[] = {{{"--help"}, "Exit codes"},
                 {{"-h"}, "Exit codes"},
                 {{"help"}, "Exit codes"},
                 {{"help", "fit"}, "--max-gaussians"},
                 {{"fit", "--help"}, "--eval-every"},
                 {{"fit", "-h"}, "--eval-every"},
                 {{"eval", "--help"}, "--json"},
                 {{"render", "--help"}, "--path"},
                 {{"convert", "--help"}, "--crop"},
                 {{"view", "--help"}, "--listen"},
                 {{"info", "--help"}, "--downscale"},
                 {{"--version"}, "splatfit 0."}};
    for (size_t i = 0; i < COUNT(cases); i++) {
        outcome o = run_args_ok(cases[i].args);
        test_assert_contains(o.out, cases[i].part, __FILE__, __LINE__);
        assert_string_equal(o.err, "");
        assert_int_equal(o.out[o.out_size - 1], '\n');
        free_outcome(&o);
    }
}

/* An option means one thing: where two tables of a command had the same name, the first would take what the
 * second is for. */
static void test_options_are_given_once(void **state) {
    (void)state;
    static const char *const names[] = {"fit",     "live", "eval",  "render",  "convert",   "prune", "view",
                                        "capture", "info", "board", "devices", "calibrate", "bench", "chart"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        outcome o = run_ok(names[i], "--help");
        char options[256][40];
        int count = 0;
        for (const char *at = o.out; (at = strstr(at, "\n  --")); at++) {
            assert_between(count, 0, 255);
            assert_int_equal(sscanf(at, "\n  --%39[a-z0-9-]", options[count]), 1);
            for (int k = 0; k < count; k++)
                if (!strcmp(options[k], options[count])) fail_msg("%s: --%s twice", names[i], options[k]);
            count++;
        }
        assert_true(count > 0);
        free_outcome(&o);
    }
}

/* With and without a model to begin with, whose file may say otherwise. */
static void test_fits_antialiased(void **state) {
    (void)state;
    clear_out();
    outcome o = run_ok(FIT, "--antialiased", "--steps", "3");
    free_outcome(&o);
    o = run_ok("info", "out/x.ply");
    assert_non_null(strstr(o.out, "anti-aliased"));
    free_outcome(&o);
    o = run_ok(FIT, "--from", "good.ply", "--steps", "3", "--antialiased");
    free_outcome(&o);
    o = run_ok("info", "out/x.ply");
    assert_non_null(strstr(o.out, "anti-aliased"));
    free_outcome(&o);
}

/* The help names every hyperparameter, as it is typed. */
static void test_help_is_complete(void **state) {
    (void)state;
    outcome o = run_ok("fit", "--help");
    sf_option_info info;
    for (size_t i = 0; !sf_fit_option_info(i, &info); i++) {
        char typed[64];
        snprintf(typed, sizeof typed, "  --%s ", info.name);
        for (char *c = typed + 4; *c; c++)
            if (*c == '_') *c = '-';
        test_assert_contains(o.out, typed, __FILE__, __LINE__);
        test_assert_contains(o.out, info.text, __FILE__, __LINE__);
    }
    free_outcome(&o);
}

static void check_log(const char *name) {
    json_t *log = test_json(work(name)), *options = json_object_get(log, "options");
    const json_t *curve = json_object_get(log, "curve"), *result = json_object_get(log, "result");
    sf_option_info info;
    for (size_t i = 0; !sf_fit_option_info(i, &info); i++)
        if (!json_object_get(options, info.name)) fail_msg("the log lacks the option %s", info.name);
    assert_int_equal(test_number(options, "seed"), 7);
    assert_int_equal(test_number(options, "steps"), 30);
    assert_int_equal(test_number(log, "threads"), 2);
    assert_true(json_string_length(json_object_get(log, "isa")) > 0);
    assert_string_equal(json_string_value(json_object_get(log, "version")), sf_version());
    assert_string_equal(json_string_value(json_object_get(log, "project")), SCENE);
    assert_true(json_array_size(curve) >= 3);
    size_t i, with_psnr = 0;
    json_t *point;
    double step = 0, seconds = 0;
    json_array_foreach(curve, i, point) {
        assert_true(test_number(point, "step") >= step && test_number(point, "loss") > 0);
        assert_true(test_number(point, "gaussians") <= 400);
        step = test_number(point, "step");
        with_psnr += json_object_get(point, "psnr") != NULL;
        assert_true(!json_object_get(point, "psnr") == !json_object_get(point, "ssim"));
        assert_true(test_number(point, "seconds") > seconds);
        seconds = test_number(point, "seconds");
    }
    const json_t *machine = json_object_get(log, "machine"), *scene = json_object_get(log, "scene");
    assert_true(json_string_length(json_object_get(machine, "cpu")) > 0);
    assert_int_equal(test_number(machine, "threads"), 2);
    assert_string_equal(json_string_value(json_object_get(scene, "name")), "sim:studio");
    assert_int_equal(test_number(scene, "width"), SCENE_WIDTH);
    assert_int_equal(test_number(scene, "height"), SCENE_HEIGHT);
    assert_int_equal(test_number(log, "seed"), 7);
    assert_true(test_number(result, "seconds") >= seconds && test_number(result, "evaluation_seconds") > 0);
    assert_true(test_number(result, "setup_seconds") < seconds &&
                test_number(result, "fit_seconds") <= seconds);
    assert_between((size_t)(1000 * test_number(result, "needles")), 0, 1000);
    assert_int_equal(step, 30);
    assert_int_equal(with_psnr, 3); /* every 10 steps */
    assert_int_equal(test_number(result, "steps"), 30);
    assert_true(test_number(result, "psnr") > 5 && test_number(result, "ssim") > 0);
    assert_true(test_number(result, "psnr_corrected") > 5);
    assert_int_equal(json_array_size(json_object_get(result, "views")), SCENE_HELD_OUT);
    assert_true(json_is_true(json_object_get(result, "complete")));
    assert_string_equal(json_string_value(json_object_get(result, "end")), "complete");
    json_decref(log);
}

static void test_fit_writes_all(void **state) {
    (void)state;
    clear_out();
    outcome o = run_ok("fit", SCENE, "-o", "out/m.ply", "--steps", "30", "--seed", "7", SMALL, "--log",
                       "out/log.json", "--compare", "out/c.png", "--eval-every", "10");
    test_assert_contains(o.out, "7 training views, 2 held out", __FILE__, __LINE__);
    test_assert_contains(o.out, "done after 30 steps", __FILE__, __LINE__);
    test_assert_contains(o.out, "wrote out/m.ply", __FILE__, __LINE__);
    test_assert_contains(o.out, "PSNR", __FILE__, __LINE__);
    test_assert_contains(o.out, "\ncomplete\n", __FILE__, __LINE__);
    free_outcome(&o);
    assert_int_equal(test_count_entries(work("out")), 4);
    size_t count = count_in("out/m.ply");
    assert_between(count, 1, 400);
    json_t *cameras = test_json(work("out/m.cameras.json"));
    assert_int_equal(json_array_size(cameras), SCENE_VIEWS);
    json_decref(cameras);
    assert_png("out/c.png", 2 * SCENE_WIDTH, SCENE_HEIGHT);
    check_log("out/log.json");
}

/* --quiet says nothing at all; a file named by --cameras, or none. */
static void test_quiet_and_cameras(void **state) {
    (void)state;
    clear_out();
    outcome o = run_ok("fit", "good", "-q", "-o", "out/m.ply", "--steps", "2", "--cameras", "out/c.json");
    assert_string_equal(o.out, "");
    assert_string_equal(o.err, "");
    free_outcome(&o);
    json_t *cameras = test_json(work("out/c.json"));
    assert_int_equal(json_array_size(cameras), IMAGES);
    json_decref(cameras);
    assert_int_equal(test_count_entries(work("out")), 2);
    run_quietly(ARGS("fit", "good", "-o", "out/m.ply", "--steps", "2", "--cameras", "none"));
    assert_int_equal(test_count_entries(work("out")), 2);
}

static void test_eval(void **state) {
    (void)state;
    clear_out();
    outcome o = run_ok("eval", "good.ply", SCENE, "--json", "out/e.json");
    assert_string_equal(o.err, "");
    test_assert_contains(o.out, "frame_0008", __FILE__, __LINE__);
    free_outcome(&o);
    json_t *json = test_json(work("out/e.json")), *views = json_object_get(json, "views"), *view;
    double psnr = 0, ssim = 0;
    size_t i;
    assert_int_equal(json_array_size(views), SCENE_HELD_OUT);
    json_array_foreach(views, i, view) {
        assert_true(json_is_string(json_object_get(view, "name")));
        psnr += test_number(view, "psnr") / SCENE_HELD_OUT;
        ssim += test_number(view, "ssim") / SCENE_HELD_OUT;
    }
    assert_true(fabs(test_number(json, "psnr") - psnr) < 1e-9 &&
                fabs(test_number(json, "ssim") - ssim) < 1e-9);
    content model = content_of("good.ply");
    assert_int_equal(test_number(json, "gaussians"), 5);
    assert_int_equal(test_number(json, "bytes"), model.size);
    free(model.data);
    json_decref(json);

    run_quietly(ARGS("eval", "good.ply", SCENE, "--split", "all", "--json", "out/e.json"));
    json = test_json(work("out/e.json"));
    assert_int_equal(json_array_size(json_object_get(json, "views")), SCENE_VIEWS);
    json_decref(json);
}

static void remove_renders(const char *folder) {
    for (int i = 0; i < SCENE_VIEWS; i++) {
        char name[64];
        snprintf(name, sizeof name, "%s/frame_%04d.png", folder, i);
        unlink(work(name));
    }
    unlink(work(cli_in_project(folder, "cameras.json")));
    assert_int_equal(rmdir(work(folder)), 0);
}

/* The two that nobody sees go, or some at random; a model on standard output stands there alone. */
static void test_prune(void **state) {
    (void)state;
    clear_out();
    outcome o =
        run_ok("prune", "good.ply", SCENE, "--loss", "0.1dB", "-o", "out/p.ply", "--log", "out/p.json", "-q");
    assert_string_equal(o.err, "");
    assert_string_equal(o.out, "");
    free_outcome(&o);
    json_t *log = test_json(work("out/p.json")), *result = json_object_get(log, "result");
    json_t *before = json_object_get(result, "before");
    assert_true(count_in("out/p.ply") == (size_t)test_number(result, "gaussians"));
    assert_int_equal(test_number(before, "gaussians"), 5);
    assert_true(test_number(result, "train_psnr") >= test_number(before, "train_psnr") - 0.1);
    assert_true(test_number(result, "psnr") > 0 && test_number(before, "ssim") <= 1);
    content model = content_of("out/p.ply");
    assert_int_equal(test_number(result, "bytes"), model.size);
    assert_true(test_number(json_object_get(log, "options"), "loss") == 0.1);
    json_decref(log);

    o = run_ok("prune", "good.ply", SCENE, "--loss", "0.1", "-o", "-");
    assert_int_equal(o.out_size, model.size);
    assert_memory_equal(o.out, model.data, model.size);
    test_assert_contains(o.err, "before", __FILE__, __LINE__);
    free_outcome(&o);
    free(model.data);
    run_quietly(ARGS("prune", "good.ply", SCENE, "--random", "--to", "2", "-o", "out/r.ply", "-q"));
    assert_int_equal(count_in("out/r.ply"), 2);
}

static void test_render(void **state) {
    (void)state;
    clear_out();
    outcome o = run_ok("render", "good.ply", SCENE, "--out", "out/r");
    assert_string_equal(o.err, "");
    free_outcome(&o);
    assert_int_equal(test_count_entries(work("out/r")), SCENE_VIEWS + 1);
    assert_png("out/r/frame_0000.png", SCENE_WIDTH, SCENE_HEIGHT);
    assert_png("out/r/frame_0008.png", SCENE_WIDTH, SCENE_HEIGHT);
    json_t *cameras = test_json(work("out/r/cameras.json"));
    assert_int_equal(json_array_size(cameras), SCENE_VIEWS);
    json_decref(cameras);
    remove_renders("out/r");
    run_quietly(
        ARGS("render", "good.ply", SCENE, "--out", "out/r", "--split", "test", "--background", "0.5,0,1"));
    assert_int_equal(test_count_entries(work("out/r")), SCENE_HELD_OUT + 1);
    assert_png("out/r/frame_0008.png", SCENE_WIDTH, SCENE_HEIGHT);
    remove_renders("out/r");
}

static void test_info(void **state) {
    (void)state;
    outcome o = run_ok("info", "good.ply");
    test_assert_contains(o.out, "5 Gaussians, SH degree 1", __FILE__, __LINE__);
    test_assert_contains(o.out, " of degree 0, ", __FILE__, __LINE__);
    test_assert_contains(o.out, "floats  ", __FILE__, __LINE__);
    assert_string_equal(o.err, "");
    free_outcome(&o);
    o = run_ok("info", "good");
    test_assert_contains(o.out, "4 views: 3 to train on, 1 held out", __FILE__, __LINE__);
    test_assert_contains(o.out, "COLMAP: ", __FILE__, __LINE__);
    test_assert_contains(o.out, "12 sparse points", __FILE__, __LINE__);
    test_assert_contains(o.out, "PINHOLE, 32x24 px", __FILE__, __LINE__);
    test_assert_contains(o.out, "held out: ", __FILE__, __LINE__);
    test_assert_contains(o.out, "a fit with the defaults takes up to ", __FILE__, __LINE__);
    assert_string_equal(o.err, "");
    free_outcome(&o);
    o = run_ok("info", SCENE, "--hold-out", "0");
    test_assert_contains(o.out, "9 views: 9 to train on, 0 held out", __FILE__, __LINE__);
    free_outcome(&o);
    o = run_ok("info", "good", "--json", "-");
    json_error_t error;
    json_t *json = json_loads(o.out, 0, &error);
    assert_non_null(json);
    assert_string_equal(json_string_value(json_object_get(json, "kind")), "COLMAP");
    assert_int_equal((int)test_number(json, "views"), 4);
    assert_int_equal((int)json_array_size(json_object_get(json, "held_out")), 1);
    assert_true(test_number(json_array_get(json_object_get(json, "cameras"), 0), "fx") > 0);
    assert_true(test_number(json_object_get(json, "fit_memory"), "total") > 1e6);
    json_decref(json);
    free_outcome(&o);
}

/* Nothing but objects on standard output, one a line, the last one at the end of the run. */
/* Each camera of the list begins a line; where there is none, a line says so. */
static void test_devices(void **state) {
    (void)state;
    outcome o = run_ok("devices"), j = run_ok("devices", "--json");
    json_error_t error;
    json_t *json = json_loads(j.out, JSON_REJECT_DUPLICATES, &error);
    if (!json) fail_msg("line %d: %s", error.line, error.text);
    const json_t *list = json_object_get(json, "devices");
    assert_true(json_is_array(list));
    size_t i, lines = 0;
    json_t *device;
    json_array_foreach(list, i, device) {
        assert_true(json_is_array(json_object_get(device, "modes")));
        test_assert_contains(o.out, json_string_value(json_object_get(device, "source")), __FILE__, __LINE__);
    }
    for (const char *c = o.out; *c; c = strchr(c, '\n') + 1) lines += *c != ' ';
    assert_int_equal(lines, i ? i : 1);
    if (!i) test_assert_contains(o.out, "no camera was found; folder:DIR", __FILE__, __LINE__);
    json_decref(json);
    free_outcome(&o);
    free_outcome(&j);
}

static void test_progress_as_json(void **state) {
    (void)state;
    clear_out();
    outcome o = run_ok("fit", SCENE, "-o", "out/m.ply", "--steps", "20", SMALL, "--progress", "json");
    double step = 0;
    int lines = 0;
    for (char *line = o.out, *end; (end = strchr(line, '\n')); line = end + 1, lines++) {
        json_error_t error;
        *end = 0;
        json_t *json = json_loads(line, 0, &error);
        if (!json) fail_msg("\"%s\": %s", line, error.text);
        assert_true(test_number(json, "step") >= step && test_number(json, "steps") == 20);
        assert_true(test_number(json, "gaussians") > 0 && json_is_number(json_object_get(json, "loss")));
        step = test_number(json, "step");
        json_decref(json);
    }
    assert_true(lines >= 1);
    assert_int_equal(step, 20);
    free_outcome(&o);
}

/* The same bytes again, and by any number of threads. */
static void test_same_bytes(void **state) {
    (void)state;
    static const char *const threads[] = {"1", "1", "2", "4"};
    const char *steps = getenv("SPLATFIT_QUICK") ? "6" : "20";
    clear_out();
    for (int i = 0; i < 4; i++) {
        char name[32];
        snprintf(name, sizeof name, "out/%d.ply", i);
        run_quietly(ARGS("fit", SCENE, "-o", name, "--steps", steps, "--max-gaussians", "400", "--threads",
                         threads[i], "--cameras", i ? "none" : "out/c.json"));
        if (i) assert_same_files("out/0.ply", name);
    }
    assert_int_equal(test_count_entries(work("out")), 5);
    run_quietly(ARGS("fit", SCENE, "-o", "out/5.ply", "--steps", steps, SMALL, "--seed", "2"));
    content a = content_of("out/0.ply"), b = content_of("out/5.ply");
    assert_true(a.size != b.size || memcmp(a.data, b.data, a.size));
    free(a.data);
    free(b.data);
    assert_same_files("out/c.json", "out/5.cameras.json");
}

/* A model gone on from: not worse by more than 0.5 dB after 20 steps. */
static void test_from(void **state) {
    (void)state;
    int quick = getenv("SPLATFIT_QUICK") != NULL;
    clear_out();
    run_quietly(ARGS("fit", SCENE, "-o", "out/a.ply", "--steps", quick ? "20" : "60", SMALL));
    run_quietly(
        ARGS("fit", SCENE, "-o", "out/b.ply", "--steps", quick ? "7" : "20", SMALL, "--from", "out/a.ply"));
    double psnr[2];
    for (int i = 0; i < 2; i++) {
        run_quietly(
            ARGS("eval", i ? "out/b.ply" : "out/a.ply", SCENE, "--split", "train", "--json", "out/e.json"));
        json_t *json = test_json(work("out/e.json"));
        psnr[i] = test_number(json, "psnr");
        json_decref(json);
    }
    print_message("%.2f dB, after a third more steps %.2f dB\n", psnr[0], psnr[1]);
    assert_true(psnr[1] >= psnr[0] - 0.5);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_help),
        cmocka_unit_test(test_help_is_complete),
        cmocka_unit_test(test_options_are_given_once),
        cmocka_unit_test(test_fits_antialiased),
        cmocka_unit_test(test_fit_writes_all),
        cmocka_unit_test(test_quiet_and_cameras),
        cmocka_unit_test(test_eval),
        cmocka_unit_test(test_prune),
        cmocka_unit_test(test_render),
        cmocka_unit_test(test_info),
        cmocka_unit_test(test_devices),
        cmocka_unit_test(test_progress_as_json),
        cmocka_unit_test(test_same_bytes),
        cmocka_unit_test(test_from),
    };
    return cmocka_run_group_tests(tests, cli_set_up, NULL);
}
