/* test_chart_logs.c - logs that are broken are refused by file and field; from a run to the page. */
#include "chart_fixture.h"

#include <ctype.h>
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../../src/chart/chart.h"

/* XML, as far as it must be right: tags close in order, attributes are quoted, no stray signs. */

static sf_status draw_choices(const void *choices, sf_writer *out) {
    chart_draw_choices(choices, out);
    return SF_OK;
}

static sf_status draw_degrees(const void *input_pointer, sf_writer *out) {
    const chart_input *input = input_pointer;
    chart_draw_degrees(input, &input->runs[0], out);
    return SF_OK;
}

static sf_status draw_walks(const void *input, sf_writer *out) { return chart_draw_walks(input, out); }

/* Logs of live fits with truth: one chart of all. */
static void test_walks(void **state) {
    (void)state;
    chart_input input = {.ctx = test_context()};
    chart_write_text("before.json", "{\"curve\": [], \"result\": {\"keyframe_errors\": ["
                                    "{\"time\": 0, \"degrees\": 0.1, \"distance\": 0.01},"
                                    "{\"time\": 1.5, \"degrees\": 0.2, \"distance\": 0.2},"
                                    "{\"time\": 2.5, \"degrees\": 0.3, \"distance\": 0.5}]}}");
    chart_write_text("after.json", "{\"result\": {\"keyframe_errors\": ["
                                   "{\"time\": 1, \"degrees\": 0.2, \"distance\": 0.03}]}}");
    assert_ok(input.ctx, chart_read(&input, test_path("before.json")));
    assert_ok(input.ctx, chart_read(&input, test_path("after.json")));
    assert_int_equal(input.walk_count, 2);
    char *picture = chart_drawn(input.ctx, draw_walks, &input);
    assert_int_equal(chart_count_of(picture, "class=\"mark\""), 4);
    assert_int_equal(chart_count_of(picture, "class=\"curve\""), 2);
    test_assert_contains(picture, "before: 3 keyframes, median 0.2 and 0.20 degrees, at most 0.5", __FILE__,
                         __LINE__);
    free(picture);
    chart_write_text("bad.json", "{\"result\": {\"keyframe_errors\": ["
                                 "{\"time\": 2, \"degrees\": 0.1, \"distance\": 0.01},"
                                 "{\"time\": 1, \"degrees\": 0.3, \"distance\": 0.5}]}}");
    assert_status(input.ctx, chart_read(&input, test_path("bad.json")), SF_ERR_FORMAT);
    assert_error_names(input.ctx, "result.keyframe_errors[1].time: is before");
    assert_int_equal(input.walk_count, 2);
    chart_free(&input);
    sf_context_destroy(&input.ctx);
}

static void test_choices_and_degrees(void **state) {
    (void)state;
    chart_input input = {.ctx = test_context()};
    chart_write_text("k.json",
                     "[{\"complexity\": 100, \"gaussians\": 130}, {\"complexity\": 1000, \"gaussians\": 900},"
                     " {\"complexity\": 100, \"gaussians\": 200, \"series\": \"a<b\"}]");
    assert_ok(input.ctx, chart_read(&input, test_path("k.json")));
    assert_int_equal(input.choices_count, 1);
    char *picture = chart_drawn(input.ctx, draw_choices, &input.choices[0]);
    assert_int_equal(chart_count_of(picture, "class=\"mark\""), 3);
    assert_int_equal(chart_count_of(picture, "class=\"equal\""), 1);
    assert_int_equal(chart_count_of(picture, ">a&lt;b</text>"), 1);
    assert_int_equal(chart_count_of(picture, ">automatic choice</text>"), 1);
    free(picture);
    json_t *log = chart_make_log(&chart_plain);
    json_object_set_new(json_object_get(log, "result"), "sh_degrees",
                        json_pack("[i,i,i,i]", 1500, 0, 300, 200));
    assert_ok(input.ctx, chart_read(&input, chart_write_json("d.json", log)));
    assert_int_equal(chart_degree_rows(&input, &input.runs[0]), 1);
    picture = chart_drawn(input.ctx, draw_degrees, &input);
    assert_int_equal(chart_count_of(picture, "class=\"bar\""), 3);
    test_assert_contains(picture, "1,500 of degree 0, 0 of 1, 300 of 2, 200 of 3", __FILE__, __LINE__);
    free(picture);
    chart_free(&input);
    sf_context_destroy(&input.ctx);
}

/* What is wrong is named: file, field, and of a list which item; what was read before stays. */

static void assert_text_refused(chart_input *input, const char *text, const char *part) {
    char name[256];
    snprintf(name, sizeof name, "%s", test_path("bad.json"));
    test_write(name, text, strlen(text));
    size_t runs = input->run_count, ablations = input->ablation_count;
    assert_status(input->ctx, chart_read(input, name), SF_ERR_FORMAT);
    assert_error_names(input->ctx, "bad.json: ");
    assert_error_names(input->ctx, part);
    assert_null(strchr(sf_last_error(input->ctx), '\n'));
    assert_true(input->run_count == runs && input->ablation_count == ablations);
}

/* A good log with the value at a path ("a.b", "curve[1].x") replaced; NULL: taken out. */
static void assert_change_refused(chart_input *input, const char *path, json_t *value, const char *part) {
    json_t *log = chart_make_log(&chart_plain), *at = log;
    char list[32], name[32];
    int index;
    if (sscanf(path, "%31[a-z][%d].%31s", list, &index, name) == 3)
        at = json_array_get(json_object_get(at, list), (size_t)index);
    else if (sscanf(path, "%31[a-z].%31s", list, name) == 2)
        at = json_object_get(at, list);
    else
        snprintf(name, sizeof name, "%s", path);
    if (value)
        json_object_set_new(at, name, value);
    else
        assert_int_equal(json_object_del(at, name), 0);
    char *text = json_dumps(log, 0);
    json_decref(log);
    assert_text_refused(input, text, part);
    free(text);
}

static void test_broken_logs_are_refused(void **state) {
    (void)state;
    static const char *const needed[] = {"curve",
                                         "machine",
                                         "machine.cpu",
                                         "machine.isa",
                                         "machine.threads",
                                         "machine.load_start",
                                         "scene",
                                         "scene.name",
                                         "scene.width",
                                         "scene.height",
                                         "seed",
                                         "result",
                                         "result.steps",
                                         "result.needles",
                                         "result.seconds",
                                         "result.gaussians",
                                         "curve[2].seconds",
                                         "curve[2].ssim",
                                         "curve[2].gaussians"};
    chart_input input = {.ctx = test_context()};
    chart_read_plan(&input, "a.json", &chart_plain);
    for (size_t i = 0; i < sizeof needed / sizeof *needed; i++) {
        char part[64];
        snprintf(part, sizeof part, "%s: is missing", needed[i]);
        assert_change_refused(&input, needed[i], NULL, part);
        assert_change_refused(&input, needed[i], json_true(), needed[i]);
    }
    assert_change_refused(&input, "curve[1].psnr", json_null(), "curve[1].psnr: is not a number");
    assert_change_refused(&input, "curve[1].psnr", json_string("30"), "curve[1].psnr: is not a number");
    assert_change_refused(&input, "curve[1].psnr", json_real(1e6), "curve[1].psnr: 1e+06 is not in");
    assert_change_refused(&input, "curve[3].seconds", json_real(2), "curve[3].seconds: is not later");
    assert_change_refused(&input, "curve[1].seconds", json_real(0), "curve[1].seconds: 0 is not in");
    assert_change_refused(&input, "result.needles", json_real(1.5), "result.needles: 1.5 is not in");
    assert_change_refused(&input, "curve", json_array(), "curve: no point has psnr");
    assert_change_refused(&input, "label", json_string(""), "label: is empty");
    assert_change_refused(&input, "label", json_integer(3), "label: is not text");
    assert_change_refused(&input, "snapshots", json_true(), "snapshots: is not a list");
    assert_change_refused(&input, "snapshots", json_pack("[{}]"), "snapshots[0].second: is missing");
    assert_change_refused(&input, "snapshots", json_pack("[{s:i, s:f}]", "second", 0, "seconds", 0.0),
                          "snapshots[0].file: is missing");
    assert_change_refused(&input, "snapshots",
                          json_pack("[{s:i, s:f, s:s}]", "second", 0, "seconds", 0.0, "file", "none.png"),
                          "none.png");
    assert_change_refused(&input, "snapshots",
                          json_pack("[{s:i, s:f, s:s}]", "second", 0, "seconds", 0.0, "file", "a.json"),
                          "snapshots[0].file: is not a PNG");
    assert_change_refused(&input, "series", json_string("big"), "series: is none of caps, auto");
    assert_change_refused(&input, "series", json_integer(3), "series: is not text");
    assert_change_refused(&input, "result.bytes", json_real(-1), "result.bytes: -1 is not in");
    assert_change_refused(&input, "result.train_psnr", json_string("30"),
                          "result.train_psnr: is not a number");
    assert_change_refused(&input, "result.sh_degrees", json_pack("[i]", 3),
                          "result.sh_degrees: is not a list of 4");
    assert_change_refused(&input, "result.sh_degrees", json_pack("[i,i,i,i]", 3, 1, -1, 0),
                          "result.sh_degrees: holds what is not");
    chart_free(&input);
    sf_context_destroy(&input.ctx);
}

static void test_text_that_is_no_log_is_refused(void **state) {
    (void)state;
    chart_input input = {.ctx = test_context()};
    assert_text_refused(&input, "", "line 1");
    assert_text_refused(&input, "{}", "curve: is missing");
    assert_text_refused(&input, "{\"psnr\": 3}", "curve: is missing");
    assert_text_refused(&input, "{\"curve\": [{\"seconds\": 1,\n \"psnr\": NaN}]}", "line 2: psnr: ");
    assert_text_refused(&input, "{\"curve\": [{\"psnr\": 1e999}]}", "psnr");
    assert_text_refused(&input, "{\"curve\": [3]}", "curve[0].");
    assert_text_refused(&input, "[]", "the list is empty");
    assert_text_refused(&input, "[3]", "[0].move: is missing");
    assert_text_refused(&input, "[" MOVE("a", "4") ", {\"move\": \"b\", \"seconds\": 3, \"steps\": 1}]",
                        "[1].psnr: is missing");
    assert_text_refused(&input, "[{\"complexity\": 3}]", "[0].gaussians: is missing");
    assert_text_refused(&input, "[{\"complexity\": 3, \"gaussians\": 2}, 4]", "[1].complexity: is missing");
    assert_text_refused(&input, "[{\"complexity\": 0, \"gaussians\": 2}]", "[0].complexity: 0 is not in");
    assert_text_refused(&input, "[" MOVE("a", "-4") "]", "[0].seconds: -4 is not in");
    assert_status(input.ctx, chart_read(&input, test_path("absent.json")), SF_ERR_IO);
    assert_error_names(input.ctx, "absent.json: ");
    chart_free(&input);
    sf_context_destroy(&input.ctx);
}

/* The program: from a fit's log and snapshots to the page. */

static int run_program(const char *arguments) {
    char command[8192];
    const char *program = getenv("SPLATFIT_PROGRAM"), *prefix = getenv("RUN");
    snprintf(command, sizeof command, "%s %s %s >%s 2>&1", prefix ? prefix : "",
             program ? program : "build/splatfit", arguments, test_path("said"));
    int status = system(command);
    return status < 0 || status > 0xff ? status >> 8 : status ? -1 : 0;
}

static void assert_said(const char *part) {
    size_t size;
    char *said = (char *)test_read(test_path("said"), &size);
    test_assert_contains(said, part, __FILE__, __LINE__);
    free(said);
}

static void test_from_a_fit_to_the_page(void **state) {
    (void)state;
    char arguments[2048];
    snprintf(arguments, sizeof arguments,
             "fit 'sim:studio?width=64&height=48&frames=9' -q -o /dev/null --time-limit %s --threads 2 "
             "--max-gaussians 300 --size cap --eval-at 1e-5,2e-5,1e9 --snapshots %s/shots --log %s/run.json "
             "--label 'a <b>'",
             getenv("SPLATFIT_QUICK") ? "12" : "2.5", test_folder(),
             test_folder()); /* emulated, set-up alone takes seconds */
    assert_int_equal(run_program(arguments), 0);
    json_t *log = json_load_file(test_path("run.json"), 0, NULL);
    assert_string_equal(json_string_value(json_object_get(json_object_get(log, "scene"), "name")),
                        "sim:studio");
    assert_string_equal(
        json_string_value(json_object_get(json_array_get(json_object_get(log, "snapshots"), 0), "file")),
        "shots/picture.png");
    json_decref(log);
    assert_true(test_exists(test_path("shots/picture.png")));

    chart_input input = {.ctx = test_context()};
    assert_ok(input.ctx, chart_read(&input, test_path("run.json")));
    const chart_run *run = &input.runs[0];
    assert_int_equal(run->count, 2); /* the first step, at which both early moments have come, and the end */
    assert_true(run->points[0].seconds >= 2e-5 && run->points[1].seconds > run->points[0].seconds);
    assert_true(run->evaluation_seconds > 0 && run->seconds >= run->points[1].seconds);
    assert_true(run->snapshot_count >= 2);
    for (size_t i = 1; i < run->snapshot_count; i++)
        assert_true(run->snapshots[i].second >= 1 && run->snapshots[i].seconds >= run->snapshots[i].second);
    size_t snapshots = run->snapshot_count;
    chart_free(&input);
    sf_context_destroy(&input.ctx);

    chart_write_text("moves.json", "[" MOVE("none", "40") "]");
    snprintf(arguments, sizeof arguments, "chart %s/run.json %s/moves.json --out %s/a/b", test_folder(),
             test_folder(), test_folder());
    assert_int_equal(run_program(arguments), 0);
    static const char *const names[] = {"psnr-sim-studio-64x48", "ssim-sim-studio-64x48",
                                        "times-sim-studio-64x48", "moves-moves"};
    size_t size;
    assert_int_equal(test_count_entries(test_path("a/b")), 5);
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        char name[64];
        snprintf(name, sizeof name, "a/b/%s.svg", names[i]);
        char *picture = (char *)test_read(test_path(name), &size);
        chart_assert_well_formed(picture);
        free(picture);
    }
    char *page = (char *)test_read(test_path("a/b/index.html"), &size);
    chart_assert_well_formed(page);
    assert_int_equal(chart_count_of(page, "<svg "), 4);
    assert_int_equal(chart_count_of(page, "src=\"data:image/png;base64,iVBORw0KGgo"), (int)snapshots);
    assert_int_equal(chart_count_of(page, "<td>a &lt;b&gt;</td>"), 1);
    assert_int_equal(chart_count_of(page, "http"),
                     4); /* the name of SVG's language alone: nothing from elsewhere */
    free(page);
}

/* Fits of two caps, and one of them pruned: charts of size alone, and what the logs say. */
static void test_prune_to_the_page(void **state) {
    (void)state;
    static const char scene[] = "'sim:studio?width=64&height=48&frames=9'";
    char arguments[2048];
    for (int cap = 200; cap <= 400; cap += 200) {
        snprintf(arguments, sizeof arguments,
                 "fit %s -q -o %s/s.ply --cameras none --steps 10 --max-gaussians %d --log %s/s%d.json "
                 "--eval-train",
                 scene, test_folder(), cap, test_folder(), cap);
        assert_int_equal(run_program(arguments), 0);
    }
    json_t *log = test_json(test_path("s400.json")), *result = json_object_get(log, "result");
    size_t size;
    free(test_read(test_path("s.ply"), &size));
    assert_true(test_number(result, "bytes") == (double)size);
    assert_true(test_number(result, "parameters") == 59 * test_number(result, "gaussians"));
    assert_true(test_number(result, "train_psnr") > 5 && test_number(result, "train_ssim") > 0);
    assert_true(json_integer_value(json_array_get(json_object_get(result, "sh_degrees"), 3)) ==
                json_integer_value(json_object_get(result, "gaussians")));
    int half = (int)test_number(result, "gaussians") / 2;
    json_decref(log);
    snprintf(arguments, sizeof arguments, "prune %s/s.ply %s -o %s/p.ply --to %d --log %s/p.json",
             test_folder(), scene, test_folder(), half, test_folder());
    assert_int_equal(run_program(arguments), 0);
    assert_said("held out");
    log = test_json(test_path("p.json")), result = json_object_get(log, "result");
    assert_string_equal(json_string_value(json_object_get(log, "series")), "pruned");
    assert_true(test_number(result, "gaussians") == half);
    assert_true(test_number(json_object_get(result, "before"), "bytes") == (double)size);
    assert_true(test_number(result, "bytes") < (double)size);
    json_decref(log);
    snprintf(arguments, sizeof arguments, "chart %s/s200.json %s/s400.json %s/p.json --out %s/sizes",
             test_folder(), test_folder(), test_folder(), test_folder());
    assert_int_equal(run_program(arguments), 0);
    assert_true(test_exists(test_path("sizes/size-psnr-sim-studio-64x48.svg")));
    assert_true(test_exists(test_path("sizes/bytes-ssim-sim-studio-64x48.svg")));
    assert_true(test_exists(test_path("sizes/gap-sim-studio-64x48.svg")));
    char *page = (char *)test_read(test_path("sizes/index.html"), &size);
    chart_assert_well_formed(page);
    free(page);
}

static void test_the_program_refuses(void **state) {
    (void)state;
    char arguments[1024];
    chart_write_text("bad.json", "{}");
    snprintf(arguments, sizeof arguments, "chart %s/bad.json --out %s/none", test_folder(), test_folder());
    assert_int_equal(run_program(arguments), 1);
    assert_said("bad.json: curve: is missing");
    assert_false(test_exists(test_path("none")));
    snprintf(arguments, sizeof arguments, "chart %s/bad.json", test_folder());
    assert_int_equal(run_program(arguments), 2);
    assert_said("--out DIR");
    static const char *const lists[] = {"x", "0", "-1", "2,1", "1,1", "1,", ",1", "nan", "inf", "1;2"};
    for (size_t i = 0; i < sizeof lists / sizeof *lists; i++) {
        snprintf(arguments, sizeof arguments, "fit sim:studio -o /dev/null --eval-at '%s'", lists[i]);
        assert_int_equal(run_program(arguments), 2);
        assert_said("--eval-at: ");
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_walks),
        cmocka_unit_test(test_choices_and_degrees),
        cmocka_unit_test(test_prune_to_the_page),
        cmocka_unit_test(test_broken_logs_are_refused),
        cmocka_unit_test(test_text_that_is_no_log_is_refused),
        cmocka_unit_test(test_from_a_fit_to_the_page),
        cmocka_unit_test(test_the_program_refuses),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
