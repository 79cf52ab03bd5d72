/* test_stability.c - the experiments that are quick, each as a test; and the frame that they run in. */
#include "stability.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static stab_effort effort(void) {
    const char *quick = getenv("SPLATFIT_QUICK");
    return quick && *quick && strcmp(quick, "0") ? STAB_EMULATED : STAB_QUICK;
}

static void runs_within_its_bounds(void **state) {
    stab_run run;
    stab_execute(*state, effort(), &run);
    for (size_t i = 0; i < run.figure_count; i++)
        if (!stab_figure_holds(&run.figures[i]))
            print_error("row %s: %s: %.6g %s, bound %.6g\n", run.row->id, run.figures[i].name,
                        run.figures[i].value, run.figures[i].unit, run.figures[i].bound);
    int holds = stab_run_is_known(&run);
    char reason[STAB_TEXT];
    memcpy(reason, run.skipped, sizeof reason);
    stab_free(&run);
    if (reason[0]) test_skip(reason);
    assert_true(holds);
}

/* A row of the test's own. */
static void report_two(stab_run *run) {
    stab_at_most(run, 1, 2, "px", "kept %d", 1);
    stab_at_least(run, 1, 2, "px", "missed");
    stab_textbook(run, INFINITY);
    stab_chart_begin(run, "a < b", (stab_axis){"x (px)", 1}, (stab_axis){"y (px)", 1});
    stab_series_begin(run, STAB_OURS, "ours");
    for (int i = 0; i < 20; i++) stab_point(run, 1 + i, i == 7 ? INFINITY : i);
    stab_bound_line(run, 3, "bound");
}

static void report_nothing(stab_run *run) { (void)run; }
static void report_nan(stab_run *run) { stab_at_most(run, NAN, 2, "px", "not a number"); }
static void report_skip(stab_run *run) { stab_skip(run, "no data"); }

static void report_known(stab_run *run) {
    stab_at_most(run, 3, 2, "px", "beyond");
    stab_known(run, "a reason");
}
static void report_both(stab_run *run) {
    report_known(run);
    stab_at_most(run, 3, 2, "px", "beyond as well");
}

/* 2: holds; 1: fails as is known; 0: fails. */
static int verdict_of(void (*experiment)(stab_run *run)) {
    stab_row row = {.id = "0", .failure = "f", .cure = "c", .run = experiment};
    stab_run run;
    stab_execute(&row, STAB_EMULATED, &run);
    int result = stab_run_holds(&run) ? 2 : stab_run_is_known(&run);
    stab_free(&run);
    return result;
}

static void what_is_beyond_its_bound_fails(void **state) {
    (void)state;
    assert_int_equal(verdict_of(report_two), 0);
    assert_int_equal(verdict_of(report_nothing), 0);
    assert_int_equal(verdict_of(report_nan), 0);
    assert_int_equal(verdict_of(report_both), 0);
    assert_int_equal(verdict_of(report_known), 1);
    assert_int_equal(verdict_of(report_skip), 2);
}

static void files_hold_what_was_reported(void **state) {
    (void)state;
    stab_row row = {.id = "0", .failure = "a <failure>", .cure = "c", .run = report_two};
    stab_run run;
    size_t size;
    sf_context *ctx = test_context();
    stab_execute(&row, STAB_EMULATED, &run);
    assert_ok(ctx, stab_write_json(ctx, &run, 1, test_path("s.json")));
    assert_ok(ctx, stab_write_page(ctx, &run, 1, test_path("s.html")));
    json_t *root = test_json(test_path("s.json")), *first = json_array_get(json_object_get(root, "rows"), 0);
    assert_string_equal(json_string_value(json_object_get(first, "result")), "failed");
    json_t *figure = json_array_get(json_object_get(first, "figures"), 1);
    assert_true(test_number(figure, "at_least") == 2);
    assert_string_equal(json_string_value(json_object_get(figure, "textbook")), "inf");
    char *page = (char *)test_read(test_path("s.html"), &size);
    test_assert_contains(page, "a &lt;failure&gt;", __FILE__, __LINE__);
    test_assert_contains(page, "y (px)", __FILE__, __LINE__);
    test_assert_contains(page, "kept 1", __FILE__, __LINE__);
    free(page);
    json_decref(root);
    assert_status(ctx, stab_write_page(ctx, &run, 1, test_path("no/such/s.html")), SF_ERR_IO);
    stab_free(&run);
    sf_context_destroy(&ctx);
}

int main(void) {
    struct CMUnitTest *tests = calloc(stab_row_count() + 2, sizeof *tests);
    size_t count = 0;
    if (!tests) return 1;
    tests[count++] = (struct CMUnitTest)cmocka_unit_test(what_is_beyond_its_bound_fails);
    tests[count++] = (struct CMUnitTest)cmocka_unit_test(files_hold_what_was_reported);
    for (size_t i = 0; i < stab_row_count(); i++)
        if (stab_row_at(i)->quick)
            tests[count++] = (struct CMUnitTest){.name = stab_row_at(i)->failure,
                                                 .test_func = runs_within_its_bounds,
                                                 .initial_state = (void *)(uintptr_t)stab_row_at(i)};
    int failed = _cmocka_run_group_tests("stability", tests, count, NULL, NULL);
    free(tests);
    return failed;
}
