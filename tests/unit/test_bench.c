/* test_bench.c - the benchmark: its scene is the work that it says, and its report is whole. Times are not
 * judged. */
#include "testing.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../../src/bench/exact.h"
#include "../../src/bench/scene.h"
#include "../../src/bench/step.h"
#include "../../src/scene/gaussians.h"

/* The scene of the kernels, projected. */
typedef struct setup {
    sf_context *ctx;
    bench_scene scene;
    sf_workspace ws;
} setup;

static void open_setup(setup *s, size_t gaussians, int width, int height) {
    s->ctx = test_context();
    sf_workspace_init(&s->ws, s->ctx);
    assert_ok(s->ctx, bench_scene_create(s->ctx, gaussians, width, height, BENCH_SEED, &s->scene));
    assert_ok(s->ctx, bench_scene_project(&s->scene, &s->ws));
}

static void close_setup(setup *s) {
    sf_workspace_free(&s->ws);
    bench_scene_destroy(&s->scene);
    sf_context_destroy(&s->ctx);
}

static void assert_near(double value, double expected, double tolerance) {
    if (!(fabs(value - expected) <= tolerance))
        fail_msg("%g is not within %g of %g", value, tolerance, expected);
}

static void test_scene_is_the_load_it_says(void **state) {
    (void)state;
    setup s;
    open_setup(&s, BENCH_GAUSSIANS, BENCH_WIDTH, BENCH_HEIGHT);
    bench_pairs pairs = bench_count_pairs(&s.ws, 4, 4);
    double entries = s.ws.tile_begin[s.ws.eye.tiles_x * s.ws.eye.tiles_y];
    assert_near(entries, 198000, 0.02 * 198000);
    assert_near(pairs.contributing / (BENCH_WIDTH * BENCH_HEIGHT), 43, 1);
    assert_near(100 * pairs.contributing / pairs.evaluated, 50, 1);
    close_setup(&s);
}

static void test_smaller_blocks_evaluate_less(void **state) {
    (void)state;
    setup s;
    open_setup(&s, 2000, 120, 68);
    bench_pairs pixels = bench_count_pairs(&s.ws, 1, 1), small = bench_count_pairs(&s.ws, 2, 2),
                large = bench_count_pairs(&s.ws, 4, 4), tile = bench_count_pairs(&s.ws, SF_TILE, SF_TILE);
    assert_true(pixels.contributing == small.contributing && small.contributing == large.contributing &&
                large.contributing == tile.contributing);
    assert_true(pixels.contributing <= pixels.evaluated && pixels.evaluated < small.evaluated &&
                small.evaluated < large.evaluated && large.evaluated < tile.evaluated);
    close_setup(&s);
}

static void test_a_lifted_gaussian_projects_to_what_was_drawn(void **state) {
    (void)state;
    setup s;
    open_setup(&s, 2000, 120, 68);
    for (size_t i = 0; i < s.ws.count; i++) {
        const sf_splat *splat = &s.ws.splats[i];
        assert_int_equal(s.ws.state[i], SF_SEEN); /* all are drawn in the picture, none fainter than 1/255 */
        assert_true(splat->u >= 0 && splat->u <= 120 && splat->v >= 0 && splat->v <= 68);
        assert_true(splat->depth >= 1 && splat->depth <= 10 && splat->log2_opacity <= -0.0144f);
    }
    close_setup(&s);
}

static void test_float64_agrees_with_the_kernels(void **state) {
    (void)state;
    setup s;
    exact ex;
    double worst = 0;
    open_setup(&s, 2000, 120, 68);
    static const float grey[3] = {0.5f, 0.5f, 0.5f};
    sf_stage_blend(&s.ws, grey, 0);
    assert_ok(s.ctx, exact_create(&s.ws, &ex));
    for (size_t ch = 0; ch < SF_CHANNELS; ch++)
        for (int y = 0; y < s.ws.eye.height; y++)
            for (int x = 0; x < s.ws.eye.width; x++) {
                size_t at = (size_t)y * s.ws.stride + (size_t)x;
                if (!ex.left_out[at])
                    worst = fmax(worst, fabs((double)s.ws.rgb[ch][at] - ex.rgb[ch * ex.pixels + at]));
            }
    assert_near(worst, 0, 1e-5);
    exact_destroy(s.ctx, &ex);
    close_setup(&s);
}

static void test_steps_change_nothing(void **state) {
    (void)state;
    setup s;
    sf_optimizer_state moments;
    open_setup(&s, 2000, 120, 68);
    const sf_model *model = s.scene.model;
    assert_ok(s.ctx, sf_optimizer_create(model, SF_MOMENTS_FLOAT, 0, &moments));
    bench_view view = {.camera = s.scene.camera, .near_plane = BENCH_NEAR, .rgb = s.scene.picture};
    size_t bytes = model->count * 3 * sizeof(float);
    float *before = malloc(bytes);
    assert_non_null(before);
    memcpy(before, model->params.field[SF_FIELD_mean], bytes);
    for (int i = 0; i < 2; i++) {
        double seconds[STAGES] = {0};
        assert_ok(s.ctx, bench_step(&s.ws, model, &moments, &view, seconds));
        for (int k = 0; k < STAGES; k++) assert_true(seconds[k] > 0);
    }
    assert_memory_equal(before, model->params.field[SF_FIELD_mean], bytes);
    free(before);
    sf_optimizer_destroy(s.ctx, &moments);
    close_setup(&s);
}

/* splatfit bench with arguments that hold no spaces; its exit status. */
static int run_bench(const char *arguments) {
    char command[4096];
    const char *program = getenv("SPLATFIT_PROGRAM"), *prefix = getenv("RUN");
    snprintf(command, sizeof command, "%s %s bench %s >%s 2>&1", prefix ? prefix : "",
             program ? program : "build/splatfit", arguments, test_path("said"));
    return system(command);
}

static void check_kernels(const json_t *kernels) {
    size_t i;
    const json_t *kernel;
    assert_true(json_array_size(kernels) > 0);
    json_array_foreach(kernels, i, kernel) {
        assert_true(json_is_string(json_object_get(kernel, "kernel")));
        assert_true(json_is_string(json_object_get(kernel, "level")));
        assert_true(test_number(kernel, "ns_per_unit") > 0);
        assert_true(test_number(kernel, "units") > 0);
    }
}

/* All levels find and match the same. */
static void check_photos(const json_t *photos) {
    size_t i;
    const json_t *row;
    assert_true(json_array_size(photos) >= 4);
    json_array_foreach(photos, i, row) {
        const json_t *scalar = json_array_get(photos, i % 2);
        assert_true(test_number(row, "features_ms") > 0 && test_number(row, "match_ms") > 0);
        assert_true(test_number(row, "matches") > 5);
        assert_true(test_number(row, "features") == test_number(scalar, "features"));
        assert_true(test_number(row, "matches") == test_number(scalar, "matches"));
    }
}

static void check_report(const json_t *report) {
    const json_t *machine = json_object_get(report, "machine"), *roofs = json_object_get(report, "roofs"),
                 *steps = json_object_get(report, "steps"), *accuracy = json_object_get(report, "accuracy");
    size_t i;
    const json_t *item;
    assert_true(test_number(machine, "clock_ghz") > 0);
    assert_true(test_number(machine, "cpus") >= 1);
    assert_true(test_number(json_array_get(json_object_get(roofs, "memory_read_gbs"), 0) ? roofs : NULL,
                            "memory_array_bytes") > 0);
    check_kernels(json_object_get(report, "kernels"));
    assert_true(json_array_size(steps) > 0 && json_array_size(accuracy) > 0);
    check_photos(json_object_get(report, "sfm"));
    json_array_foreach(steps, i, item) assert_true(test_number(json_object_get(item, "ms"), "total") > 0);
    json_array_foreach(accuracy, i, item) {
        /* the polynomials' own errors: 1.7e-3 at degree 2, 7.5e-5 at 3, 2.6e-6 at 4 */
        static const double most[] = {[2] = 1e-2, [3] = 1e-3, [4] = 1e-4, [5] = 1e-4, [6] = 1e-4};
        int degree = (int)test_number(item, "degree");
        assert_true(degree >= 2 && degree <= 6);
        assert_true(test_number(item, "picture_rms") < most[degree]);
        assert_true(test_number(item, "gradient_rms") < 10 * most[degree]);
    }
}

static void test_quick_report_is_whole(void **state) {
    (void)state;
    char arguments[1024];
    snprintf(arguments, sizeof arguments, "--quick --json %s --svg %s", test_path("bench.json"),
             test_folder());
    int status = run_bench(arguments);
    size_t size;
    char *said = (char *)test_read(test_path("said"), &size);
    if (status) fail_msg("status %d: %s", status, said);
    free(said);
    json_error_t error;
    json_t *report = json_load_file(test_path("bench.json"), 0, &error);
    if (!report) fail_msg("bench.json, line %d: %s", error.line, error.text);
    check_report(report);
    json_decref(report);
    assert_true(test_exists(test_path("bench-accuracy.svg")) && test_exists(test_path("bench-roofs.svg")));
}

/* Figures of the kernels are above 0; JSON holds neither inf nor nan, a row with one would be missing. */
static void check_figures(const json_t *value) {
    const char *key;
    size_t i;
    json_t *item;
    if (json_is_number(value)) {
        double figure = json_number_value(value);
        assert_true(figure > 0 && isfinite(figure));
    }
    json_array_foreach(value, i, item) check_figures(item);
    json_object_foreach((json_t *)value, key, item) check_figures(item);
}

static const json_t *find_kernel(const json_t *kernels, const char *name, const char *level) {
    size_t i;
    json_t *kernel;
    json_array_foreach(kernels, i, kernel) {
        if (!strcmp(json_string_value(json_object_get(kernel, "kernel")), name) &&
            !strcmp(json_string_value(json_object_get(kernel, "level")), level))
            return kernel;
    }
    return NULL;
}

/* No number that was printed is inf or nan. */
static void check_said(void) {
    size_t size;
    char *said = (char *)test_read(test_path("said"), &size), *end;
    for (const char *word = strtok(said, " \n,"); word; word = strtok(NULL, " \n,")) {
        double value = strtod(word, &end);
        if (!*end && !isfinite(value)) fail_msg("%s is among the figures", word);
    }
    free(said);
}

static json_t *report_only(const char *sections) {
    char arguments[1024];
    snprintf(arguments, sizeof arguments, "--only %s --quick --json %s", sections, test_path("only.json"));
    assert_int_equal(run_bench(arguments), 0);
    json_t *report = json_load_file(test_path("only.json"), 0, NULL);
    assert_non_null(report);
    check_said();
    return report;
}

static void test_kernels_alone_have_their_figures(void **state) {
    (void)state;
    static const char *const names[] = {
        "project",
        "spans",
        "blend",
        "unpack",
        "loss",
        "blend_importance",
        "blend_bwd",
        "project_bwd",
        "adam, in cache",
        "adam, in memory",
        "adam_half, in cache",
        "adam_half, in memory",
        "rmsprop, in cache",
        "rmsprop, in memory",
        "convert, YUYV",
        "convert, 444P",
        "convert, GREY",
        "convert, a whole frame",
    };
    static const char *const parts[] = {"kernels", "scene", "stages", "update_beyond_caches"};
    json_t *report = report_only("kernels");
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        if (!find_kernel(json_object_get(report, "kernels"), names[i], "scalar"))
            fail_msg("%s is missing", names[i]);
    for (size_t i = 0; i < sizeof parts / sizeof *parts; i++) {
        const json_t *part = json_object_get(report, parts[i]);
        assert_true(json_array_size(part) + json_object_size(part) > 0);
        check_figures(part);
    }
    json_decref(report);
}

static void test_sections_stand_alone(void **state) {
    (void)state;
    static const char *const sections[] = {"roofs", "steps", "accuracy", "roofs,steps", "sfm"};
    for (size_t i = 0; i < sizeof sections / sizeof *sections; i++) json_decref(report_only(sections[i]));
}

static size_t dashes_in(const char *path) {
    size_t size, count = 0;
    char *svg = (char *)test_read(path, &size);
    for (const char *at = svg; (at = strstr(at, "stroke-dasharray=\"4 3\"")); at++) count++;
    free(svg);
    return count;
}

/* Another build's figures are drawn dashed; here they are this one's, so that each of its lines has one
 * beside it. */
static void test_the_build_before_is_drawn(void **state) {
    (void)state;
    char arguments[4096], folder[1024];
    snprintf(folder, sizeof folder, "%s", test_folder());
    json_decref(report_only("accuracy"));
    snprintf(arguments, sizeof arguments, "--quick --only accuracy --svg %s", folder);
    assert_int_equal(run_bench(arguments), 0);
    assert_int_equal(dashes_in(test_path("bench-accuracy.svg")), 0);
    snprintf(arguments, sizeof arguments, "--quick --only accuracy --svg %s --before %s/only.json", folder,
             folder);
    assert_int_equal(run_bench(arguments), 0);
    sf_isa_info info;
    size_t levels = 0;
    for (size_t i = 0; !sf_isa_describe(i, &info); i++)
        levels += info.usable && strcmp(info.name, "scalar") != 0;
    assert_int_equal(dashes_in(test_path("bench-accuracy.svg")),
                     levels * 2 * 4); /* halves; lines between 5 degrees */
}

static void test_wrong_usage_is_refused(void **state) {
    (void)state;
    assert_int_not_equal(run_bench("--only kernel"), 0);
    assert_int_not_equal(run_bench("--model x.ply"), 0);
    assert_int_not_equal(run_bench("--isa none"), 0);
    assert_int_not_equal(run_bench("--before bench.json"), 0);
}

static void test_once_names_kernels_and_units(void **state) {
    (void)state;
    assert_int_equal(run_bench("--once --quick --isa scalar"), 0);
    size_t size;
    char *said = (char *)test_read(test_path("said"), &size);
    test_assert_contains(said, "sf_blend_scalar ", __FILE__, __LINE__);
    test_assert_contains(said, "sf_blend_importance_scalar ", __FILE__, __LINE__);
    test_assert_contains(said, "sf_project_bwd_scalar 2000\n", __FILE__, __LINE__);
    free(said);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_scene_is_the_load_it_says),
        cmocka_unit_test(test_smaller_blocks_evaluate_less),
        cmocka_unit_test(test_a_lifted_gaussian_projects_to_what_was_drawn),
        cmocka_unit_test(test_float64_agrees_with_the_kernels),
        cmocka_unit_test(test_steps_change_nothing),
        cmocka_unit_test(test_quick_report_is_whole),
        cmocka_unit_test(test_kernels_alone_have_their_figures),
        cmocka_unit_test(test_sections_stand_alone),
        cmocka_unit_test(test_the_build_before_is_drawn),
        cmocka_unit_test(test_wrong_usage_is_refused),
        cmocka_unit_test(test_once_names_kernels_and_units),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
