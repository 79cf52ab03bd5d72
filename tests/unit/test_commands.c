/* test_commands.c - the program from outside: what its rarer options write and say. */
#define _GNU_SOURCE
#include "program.h"

#include <math.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define FIT                  "fit", SCENE, "-o", "out/m.ply", "--cameras", "none", SMALL
#define SAYS(outcome, part)  test_assert_contains((outcome).out, part, __FILE__, __LINE__)
#define WARNS(outcome, part) test_assert_contains((outcome).err, part, __FILE__, __LINE__)

static json_t *result_of(json_t *log) { return json_object_get(log, "result"); }

static double option_of(json_t *log, const char *name) {
    return test_number(json_object_get(log, "options"), name);
}

/* What a fit learned beside the Gaussians is said and logged. */
static void test_what_is_refined_is_said(void **state) {
    (void)state;
    clear_out();
    outcome o = run_ok(FIT, "--steps", "40", "--refine-poses", "--refine-intrinsics", "--refine-start", "0",
                       "--exposure", "--background", "auto", "--eval-train", "--log", "out/l.json");
    SAYS(o, "poses corrected, in the median by ");
    SAYS(o, "focal length corrected by ");
    SAYS(o, "\nbackground ");
    SAYS(o, "held out, 2 views: PSNR ");
    SAYS(o, "trained on, 7 views: PSNR ");
    json_t *log = test_json(work("out/l.json")), *result = result_of(log),
           *refinement = json_object_get(result, "refinement");
    assert_true(test_number(refinement, "turned_degrees") > 0);
    assert_true(test_number(refinement, "moved_depths") > 0);
    assert_true(test_number(refinement, "focal_change") != 0);
    assert_true(test_number(result, "train_psnr") > 5 && test_number(result, "train_ssim") > 0);
    assert_int_equal(json_array_size(json_object_get(result, "background")), 3);
    json_decref(log);
    free_outcome(&o);
}

/* Of the held-out views as many as are asked for are evaluated, and that is said, logged and timed. */
static void test_some_views_evaluated(void **state) {
    (void)state;
    static const char *const asked[] = {"1", "2", "99"}, *const said[] = {"1 of 2", "2", "2"};
    clear_out();
    for (int i = 0; i < 3; i++) {
        char text[64];
        outcome o = run_ok(FIT, "--steps", "3", "--eval-views", asked[i], "--log", "out/l.json");
        snprintf(text, sizeof text, "held out, %s views: PSNR ", said[i]);
        SAYS(o, text);
        json_t *log = test_json(work("out/l.json")), *result = result_of(log);
        size_t views = i ? 2 : 1;
        assert_int_equal(json_array_size(json_object_get(result, "views")), views);
        assert_int_equal((size_t)test_number(result, "held_out_evaluated"), views);
        assert_int_equal((size_t)test_number(json_object_get(log, "scene"), "test_views"), 2);
        assert_true(test_number(result, "evaluation_seconds") > 0);
        json_decref(log);
        free_outcome(&o);
    }
    outcome o = run_ok("eval", "out/m.ply", SCENE, "--eval-views", "1");
    SAYS(o, "1 of 2 views evaluated");
    free_outcome(&o);
    clear_out();
    assert_refused(ARGS("eval", "good.ply", SCENE, "--eval-views", "0"), USAGE, "--eval-views: ", 0);
}

static double psnr_of_eval(const char *cameras) {
    run_quietly(ARGS("eval", "out/m.ply", SCENE, "--json", "out/e.json", cameras ? "--cameras" : "--quiet",
                     cameras ? cameras : NULL));
    json_t *json = test_json(work("out/e.json"));
    double psnr = test_number(json, "psnr");
    json_decref(json);
    return psnr;
}

/* The file of cameras holds the poses that the model fits: with them eval gives the fit's own figure. */
static void test_eval_takes_refined_cameras(void **state) {
    (void)state;
    clear_out();
    run_quietly(ARGS("fit", SCENE, "-o", "out/m.ply", SMALL, "--steps", "60", "--refine-poses",
                     "--refine-intrinsics", "--refine-start", "0", "--lr-pose", "0.01", "--log",
                     "out/l.json"));
    json_t *log = test_json(work("out/l.json"));
    double psnr = test_number(result_of(log), "psnr");
    json_decref(log);
    assert_true(fabs(psnr_of_eval("out/m.cameras.json") - psnr) < 1e-3);
    assert_true(fabs(psnr_of_eval(NULL) - psnr) > 1e-2);
    assert_int_equal(rename(work("out/m.cameras.json"), work("refined.json")), 0);
    assert_int_equal(rename(work("out/m.ply"), work("refined.ply")), 0);
    clear_out();
    assert_refused(
        ARGS("eval", "refined.ply", "sim:studio?width=64&height=48&frames=8", "--cameras", "refined.json"),
        FAILED, "refined.json: is not of this project", 0);
    assert_refused(ARGS("eval", "refined.ply", SCENE, "--cameras", "out/none.json"), FAILED,
                   "out/none.json: ", 0);
}

static void test_background_as_a_colour(void **state) {
    (void)state;
    clear_out();
    outcome o = run_ok(FIT, "--steps", "3", "--background", "0.25,0.5,1", "--log", "out/l.json");
    json_t *log = test_json(work("out/l.json")), *colour = json_object_get(result_of(log), "background");
    static const double expected[] = {0.25, 0.5, 1};
    for (size_t k = 0; k < 3; k++) assert_true(json_number_value(json_array_get(colour, k)) == expected[k]);
    assert_true(option_of(log, "background_green") == 0.5);
    json_decref(log);
    free_outcome(&o);
}

/* The first processor that this program may run on. */
static int first_core(void) {
    cpu_set_t set;
    assert_int_equal(sched_getaffinity(0, sizeof set, &set), 0);
    int i = 0;
    while (!CPU_ISSET((size_t)i, &set)) i++;
    return i;
}

static void test_cores(void **state) {
    (void)state;
    char one[16];
    snprintf(one, sizeof one, "%d", first_core());
    clear_out();
    outcome o = run_ok("info", "--cpu", "--cores", one);
    SAYS(o, "1 threads\n");
    free_outcome(&o);
    static const char *const wrong[] = {"", "x", "1-", "2-1", "0,", "0,,1", "1023", "99999999999", "0-1023"};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++)
        assert_refused(ARGS("info", "--cpu", "--cores", wrong[i]), USAGE, "--cores: ", 0);
}

static void test_target_ends_the_run(void **state) {
    (void)state;
    clear_out();
    outcome o = run_ok(FIT, "--steps", "400", "--target-psnr", "6", "--log", "out/l.json");
    SAYS(o, "target reached: ");
    json_t *log = test_json(work("out/l.json")), *result = result_of(log);
    assert_string_equal(json_string_value(json_object_get(result, "end")), "target");
    assert_true(test_number(result, "validation_psnr") >= 6);
    assert_true(test_number(result, "steps") < 400);
    json_decref(log);
    free_outcome(&o);
}

static void test_divergence_is_said(void **state) {
    (void)state;
    clear_out();
    outcome o = run_ok(FIT, "--steps", "60", "--validate", "0", "--lr-sh0", "1", "--lr-mean", "0.5",
                       "--lr-scale", "1", "--lr-opacity", "1");
    SAYS(o, "diverged ");
    SAYS(o, " times, and went on from an earlier model");
    WARNS(o, "the fit diverged (loss ");
    assert_true(count_in("out/m.ply") > 0);
    free_outcome(&o);
}

static void make_empty_model(void) {
    sf_context *ctx = test_context();
    sf_model *model;
    assert_ok(ctx, sf_model_create(ctx, 0, 0, &model));
    assert_ok(ctx, sf_model_save(model, work("none.ply")));
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

static void test_fit_refuses(void **state) {
    (void)state;
    static const bad_input cases[] = {
        {USAGE,
         "out/l.json: is named for two outputs",
         {FIT, "--log", "out/l.json", "--checkpoint", "out/l.json"}},
        {USAGE, "--background: \"2,0,0\" is neither R,G,B", {FIT, "--background", "2,0,0"}},
        {USAGE, "preset: \"slow\"", {FIT, "--preset", "slow"}},
        {FAILED, "link: is a symbolic link to nothing", {FIT, "--log", "link"}},
        {FAILED, "none.ply: holds no Gaussian to go on from", {FIT, "--from", "none.ply"}},
        {FAILED, "absent.fit: ", {FIT, "--resume", "absent.fit"}},
        {USAGE, "--from: cannot be given beside --resume", {FIT, "--resume", "a", "--from", "b"}},
        {USAGE, "--preset: cannot be given beside --replay", {FIT, "--replay", "a", "--preset", "draft"}},
    };
    make_empty_model();
    assert_int_equal(symlink("nowhere", work("link")), 0);
    assert_all_refused(cases, COUNT(cases));
}

/* A name that is no UTF-8 is in the log all the same, as far as JSON can have it. */
static void test_label_that_is_no_text(void **state) {
    (void)state;
    clear_out();
    outcome o = run_ok(FIT, "--steps", "2", "--label", "caf\xe9 \xc3\xa9", "--log", "out/l.json");
    json_t *log = test_json(work("out/l.json"));
    assert_string_equal(json_string_value(json_object_get(log, "label")), "caf? ??");
    json_decref(log);
    free_outcome(&o);
}

/* One level is in use, by all kernels that have a form of it; scalar is there always. */
static void test_info_of_the_processor(void **state) {
    (void)state;
    outcome o = run_ok("info", "--cpu", "--isa", "scalar", "--threads", "3");
    sf_isa_info isa;
    sf_kernel_info kernel;
    char line[80];
    SAYS(o, "3 threads\n");
    for (size_t i = 0; !sf_isa_describe(i, &isa); i++) {
        const char *is = !strcmp(isa.name, "scalar") ? "in use" : isa.usable ? "usable" : "";
        snprintf(line, sizeof line, "%-12s %s", isa.name, is);
        SAYS(o, line);
    }
    sf_context_options options = {.isa = "scalar", .threads = 1};
    sf_context *ctx;
    assert_int_equal(sf_context_create(&ctx, &options), SF_OK);
    size_t kernels = 0;
    for (; !sf_kernel_describe(ctx, kernels, &kernel); kernels++) {
        snprintf(line, sizeof line, "%-12s scalar\n", kernel.name);
        SAYS(o, line);
    }
    assert_true(kernels > 10);
    sf_context_destroy(&ctx);
    free_outcome(&o);
}

/* Whole steps of a model of one's own, and counted instructions, go into the report. */
static void test_bench_of_a_model(void **state) {
    (void)state;
    clear_out();
    run_quietly(ARGS(FIT, "--steps", "3"));
    write_text("counted", "scalar blend 12.5\nscalar adam 3\n");
    outcome o = run_ok("bench", "--quick", "--only", "kernels", "--isa", "scalar", "--model", "out/m.ply",
                       "--project", SCENE, "--instructions", "counted", "--json", "out/b.json");
    SAYS(o, "fitted model: ");
    SAYS(o, "median of the views ");
    json_t *report = test_json(work("out/b.json")), *fitted = json_object_get(report, "model"), *step,
           *kernel;
    size_t i, counted = 0;
    assert_true(test_number(fitted, "gaussians") == (double)count_in("out/m.ply"));
    assert_true(test_number(fitted, "width") == SCENE_WIDTH && test_number(fitted, "views") == 2);
    assert_true(json_array_size(json_object_get(fitted, "steps")) > 0);
    json_array_foreach(json_object_get(fitted, "steps"), i, step)
        assert_true(test_number(step, "median_total_ms") > 0);
    json_array_foreach(json_object_get(report, "kernels"), i, kernel) {
        const json_t *count = json_object_get(kernel, "instructions_per_unit");
        if (json_number_value(count) == 12.5) counted++;
    }
    assert_int_equal(counted, 1);
    json_decref(report);
    free_outcome(&o);
}

static void test_bench_refuses(void **state) {
    (void)state;
    static const bad_input cases[] = {
        {USAGE, "--only: \"roof\" is none of roofs", {"bench", "--only", "kernels,roof"}},
        {USAGE, "--model and --project: go together", {"bench", "--model", "a.ply"}},
        {USAGE, "--model and --project: go together", {"bench", "--project", SCENE}},
        {FAILED,
         "absent: cannot be opened",
         {"bench", "--quick", "--quiet", "--only", "roofs", "--isa", "scalar", "--instructions", "absent"}},
        {FAILED,
         "words: not lines of level, kernel, instructions",
         {"bench", "--quick", "--quiet", "--only", "roofs", "--isa", "scalar", "--instructions", "words"}},
        {FAILED,
         "absent.ply: ",
         {"bench", "--quick", "--quiet", "--only", "roofs", "--isa", "scalar", "--model", "absent.ply",
          "--project", SCENE}},
    };
    write_text("words", "scalar blend many\n");
    assert_all_refused(cases, COUNT(cases));
}

static void write_picture(const char *name, int width, int height) {
    static float rgb[3 * 64 * 48];
    sf_context *ctx = test_context();
    uint8_t *file;
    size_t size;
    for (int i = 0; i < 3 * width * height; i++) rgb[i] = (float)(i % 61) / 61;
    assert_ok(ctx, sf_encode_jpeg(ctx, width, height, rgb, 90, &file, &size));
    test_write(work(name), file, size);
    sf_encoded_free(ctx, &file);
    sf_context_destroy(&ctx);
}

/* Pictures of two sizes are of two cameras; without a board there is no lens. */
static void test_calibrate_refuses(void **state) {
    (void)state;
    clear_out();
    make_folder("sizes");
    make_folder("blank");
    write_picture("sizes/0.jpg", 64, 48);
    write_picture("sizes/1.jpg", 32, 48);
    write_picture("blank/0.jpg", 64, 48);
    outcome o = run("calibrate", "folder:blank", "-o", "out/lens.json");
    if (o.code == USAGE || strstr(o.err, "apriltag")) {
        free_outcome(&o);
        test_skip("built without apriltag");
    }
    assert_int_equal(o.code, FAILED);
    assert_int_equal(test_count_entries(work("out")), 0);
    free_outcome(&o);
    o = run("calibrate", "folder:sizes", "-o", "out/lens.json");
    assert_int_equal(o.code, FAILED);
    WARNS(o, "frame 1: 32 x 48 px after frames of 64 x 48: one camera, one size");
    assert_int_equal(test_count_entries(work("out")), 0);
    free_outcome(&o);
}

/* A simulated camera that tells its poses. */
#define LIVE "live", "sim:studio?width=64&height=48&fps=0&frames=24", "--poses", "frames", "--listen", "none"

static void test_live_writes_what_it_was_told_to(void **state) {
    (void)state;
    clear_out();
    outcome o = run_ok(LIVE, "-o", "out/m.ply", "--steps-per-frame", "3", "--trajectory", "out/path.txt",
                       "--cameras", "out/cameras.json", "--log", "out/l.json", SMALL);
    SAYS(o, "24 frames looked at, 24 with a pose, lost 0 times");
    free_outcome(&o);
    json_t *log = test_json(work("out/l.json")), *result = result_of(log);
    assert_int_equal(test_number(result, "gaussians"), count_in("out/m.ply"));
    assert_true(test_number(result, "steps") == 72 && option_of(log, "max_gaussians") == 400);
    json_t *cameras = test_json(work("out/cameras.json"));
    assert_int_equal(json_array_size(cameras), test_number(result, "keyframes"));
    json_decref(cameras);
    json_decref(log);
    content path = content_of("out/path.txt");
    int lines = 0;
    for (size_t i = 0; i < path.size; i++) lines += path.data[i] == '\n';
    assert_int_equal(lines, 25); /* a comment, and a pose for each frame */
    free(path.data);
}

static void test_live_refuses(void **state) {
    (void)state;
    clear_out();
    static const bad_input inputs[] = {
        {USAGE, "--seconds: \"soon\" is not a number", {LIVE, "--seconds", "soon"}},
        {USAGE, "--time-limit: \"3\" is --seconds here", {LIVE, "--time-limit", "3"}},
        {USAGE, "m.obj: models are not written as .obj", {LIVE, "-o", "m.obj"}},
        {USAGE, "--poses: \"dream\" is none of", {"live", "sim:studio", "--poses", "dream"}},
        {FAILED, "\"nope\" is none of a4-36h11", {"live", "sim:studio", "--board", "nope"}},
        {FAILED, "no/such: cannot be opened", {"live", "sim:studio", "--poses", "file:no/such"}},
        {FAILED, "is not ADDRESS:PORT", {"live", "sim:studio", "--poses", "frames", "--listen", "here"}},
        {FAILED,
         "no model: no pose was found",
         {"live", "sim:studio?width=64&height=48&fps=0&frames=3", "--poses", "frames", "--listen", "none",
          "-o", "out/m.ply"}},
    };
    assert_all_refused(inputs, COUNT(inputs));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_live_writes_what_it_was_told_to),
        cmocka_unit_test(test_live_refuses),
        cmocka_unit_test(test_what_is_refined_is_said),
        cmocka_unit_test(test_some_views_evaluated),
        cmocka_unit_test(test_eval_takes_refined_cameras),
        cmocka_unit_test(test_background_as_a_colour),
        cmocka_unit_test(test_cores),
        cmocka_unit_test(test_target_ends_the_run),
        cmocka_unit_test(test_divergence_is_said),
        cmocka_unit_test(test_fit_refuses),
        cmocka_unit_test(test_label_that_is_no_text),
        cmocka_unit_test(test_info_of_the_processor),
        cmocka_unit_test(test_bench_of_a_model),
        cmocka_unit_test(test_bench_refuses),
        cmocka_unit_test(test_calibrate_refuses),
    };
    return cmocka_run_group_tests_name("commands", tests, program_set_up, NULL);
}
