/* test_chart.c - charts: well-formed, with as many curves and marks as there are, each where its figures say.
 */
#include "chart_fixture.h"

#include <ctype.h>
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../../src/chart/chart.h"

static sf_status draw_psnr(const void *scene, sf_writer *out) {
    return chart_draw_quality(scene, CHART_PSNR, out);
}

static sf_status draw_ssim(const void *scene, sf_writer *out) {
    return chart_draw_quality(scene, CHART_SSIM, out);
}

static sf_status draw_times(const void *scene, sf_writer *out) {
    chart_draw_times(scene, out);
    return SF_OK;
}

static sf_status draw_moves(const void *ablation, sf_writer *out) {
    chart_draw_moves(ablation, out);
    return SF_OK;
}

static char *drawn_scene(const chart_input *input, draw_fn draw) {
    chart_scene scene;
    assert_ok(input->ctx, chart_scene_make(input, &input->runs[0], &scene));
    char *text = chart_drawn(input->ctx, draw, &scene);
    chart_scene_free(&scene);
    return text;
}

static void assert_near(double value, double expected, double tolerance) {
    if (!(fabs(value - expected) <= tolerance))
        fail_msg("%g is not within %g of %g", value, tolerance, expected);
}

/* Where the number of a tick stands: its text's x or y. */
static double tick_at(const char *picture, const char *number, const char *anchor, char axis) {
    char end[64];
    snprintf(end, sizeof end, ">%s</text>", number);
    for (const char *at = picture; (at = strstr(at, end)); at++) {
        const char *tag = at;
        while (*tag != '<') tag--;
        double x, y;
        if (sscanf(tag, "<text x=\"%lf\" y=\"%lf\"", &x, &y) == 2 && strstr(tag, anchor) &&
            strstr(tag, anchor) < at)
            return axis == 'x' ? x : y - 4;
    }
    fail_msg("no tick %s", number);
    return 0;
}

/* The i-th mark that is a circle. */
static svg_point circle_at(const char *picture, int index) {
    svg_point p = {0};
    for (const char *at = picture; (at = strstr(at, "<circle cx=")); at++) {
        double r;
        char kind[16] = "";
        int n =
            sscanf(at, "<circle cx=\"%lf\" cy=\"%lf\" r=\"%lf\" class=\"%15[a-z]\"", &p.x, &p.y, &r, kind);
        if (n == 4 && !strcmp(kind, "mark") && index-- == 0) return p;
    }
    fail_msg("too few marks");
    return p;
}

/* By the numbers along the axes: seconds logarithmic, dB linear. */
static void test_points_land_where_the_ticks_say(void **state) {
    (void)state;
    chart_input input = {.ctx = test_context()};
    chart_read_plan(&input, "a.json", &chart_plain);
    char *picture = drawn_scene(&input, draw_psnr);
    double one = tick_at(picture, "1", "middle", 'x'), ten = tick_at(picture, "10", "middle", 'x');
    double low = tick_at(picture, "20", "end", 'y'), high = tick_at(picture, "26", "end", 'y');
    assert_true(ten > one && high < low);
    for (int i = 0; i < 4; i++) {
        svg_point p = circle_at(picture, i);
        assert_near(p.x, one + (ten - one) * log10(chart_plain.seconds[i]), 0.15);
        assert_near(p.y, low + (high - low) * i / 3, 0.15);
    }
    assert_int_equal(chart_count_of(picture, "class=\"mark\""), 4);
    assert_int_equal(chart_count_of(picture, "class=\"curve\""), 1);
    assert_int_equal(chart_count_of(picture, "class=\"band\""), 0);
    free(picture);
    picture = drawn_scene(&input, draw_ssim);
    low = tick_at(picture, "0.5", "end", 'y'), high = tick_at(picture, "0.8", "end", 'y');
    for (int i = 0; i < 4; i++) assert_near(circle_at(picture, i).y, low + (high - low) * i / 3, 0.15);
    free(picture);
    chart_free(&input);
    sf_context_destroy(&input.ctx);
}

/* Seeds of a label are a curve with a band; another label has a curve of its own, another scene a chart. */
static void test_labels_seeds_and_scenes(void **state) {
    (void)state;
    chart_input input = {.ctx = test_context()};
    log_plan plan = chart_plain;
    plan.label = NULL, plan.preset = "fast";
    for (int seed = 0; seed < 3; seed++) {
        char name[16];
        snprintf(name, sizeof name, "s%d.json", seed);
        plan.first_psnr = 20 + seed;
        chart_read_plan(&input, name, &plan);
    }
    assert_string_equal(input.runs[0].label, "fast / avx2");
    plan.preset = NULL, plan.isa = "<odd & long>", plan.seconds[2] = 6;
    chart_read_plan(&input, "t.json", &plan);
    assert_string_equal(input.runs[3].label, "<odd & long>");
    plan.width = 65;
    chart_read_plan(&input, "u.json", &plan);
    chart_scene scene;
    assert_ok(input.ctx, chart_scene_make(&input, &input.runs[0], &scene));
    assert_int_equal(scene.count, 2);
    const chart_curve *curve = &scene.curves[CHART_PSNR][0];
    assert_int_equal(curve->runs, 3);
    assert_int_equal(curve->count, 4);
    for (size_t i = 0; i < 4; i++) {
        assert_near(curve->samples[i].mean, 21 + 2 * (double)i, 1e-9);
        assert_near(curve->samples[i].least, 20 + 2 * (double)i, 1e-9);
        assert_near(curve->samples[i].most, 22 + 2 * (double)i, 1e-9);
        assert_near(curve->samples[i].gaussians, 1000 * ((double)i + 1), 1e-9);
    }
    assert_int_not_equal(curve[0].style, curve[1].style);
    char *picture = chart_drawn(input.ctx, draw_psnr, &scene);
    assert_int_equal(chart_count_of(picture, "class=\"curve\""), 2);
    assert_int_equal(chart_count_of(picture, "class=\"band\""), 1);
    assert_int_equal(chart_count_of(picture, "class=\"mark\""), 8);
    assert_int_equal(chart_count_of(picture, "&lt;odd &amp; long&gt;</text>"), 1);
    free(picture);
    chart_scene_free(&scene);
    assert_true(chart_opens_scene(&input, 0) && !chart_opens_scene(&input, 3) &&
                chart_opens_scene(&input, 4));
    chart_free(&input);
    sf_context_destroy(&input.ctx);
}

/* More curves than there are shapes of marks, each with its row; a name that is too long for its row is cut
 * between two letters. */
static void test_many_curves_with_long_names(void **state) {
    (void)state;
    enum { CURVES = 9, LETTERS = 80 };
    chart_input input = {.ctx = test_context()};
    log_plan plan = chart_plain;
    char names[CURVES][2 * LETTERS + 8];
    for (int i = 0; i < CURVES; i++) {
        char file[16];
        snprintf(names[i], sizeof names[i], "%d", i);
        for (int k = 0; k < LETTERS && i == 3; k++) strcat(names[i], "\xc3\xb6"); /* two bytes each */
        snprintf(file, sizeof file, "n%d.json", i);
        plan.label = names[i], plan.first_psnr = 20 + i;
        json_t *log = chart_make_log(&plan);
        if (i == 5) json_object_set_new(json_object_get(log, "machine"), "threads", json_integer(4));
        assert_ok(input.ctx, chart_read(&input, chart_write_json(file, log)));
    }
    char *picture = drawn_scene(&input, draw_psnr);
    assert_int_equal(chart_count_of(picture, "class=\"curve\""), CURVES);
    assert_int_equal(chart_count_of(picture, "class=\"mark\""), 4 * CURVES);
    test_assert_contains(picture, "on several machines or numbers of threads", __FILE__, __LINE__);
    assert_int_equal(chart_count_of(picture, "\xc3\xb6...</text>"), 1);
    free(picture);
    chart_free(&input);
    sf_context_destroy(&input.ctx);
}

/* Runs evaluated at other times: interpolated over the logarithm of time, kept at the end, from when all have
 * begun. */
static void test_mean_of_runs_at_other_times(void **state) {
    (void)state;
    chart_input input = {.ctx = test_context()};
    log_plan plan = chart_plain;
    memcpy(plan.seconds, (double[8]){1, 4, 16}, sizeof plan.seconds);
    chart_read_plan(&input, "a.json", &plan);
    memcpy(plan.seconds, (double[8]){2, 8.01, 64}, sizeof plan.seconds);
    plan.first_psnr = 30;
    chart_read_plan(&input, "b.json", &plan);
    memcpy(plan.seconds, (double[8]){2.01, 8, 64}, sizeof plan.seconds);
    chart_read_plan(&input, "c.json", &plan);
    chart_scene scene;
    assert_ok(input.ctx, chart_scene_make(&input, &input.runs[0], &scene));
    const chart_curve *curve = &scene.curves[CHART_PSNR][0];
    static const double times[] = {2.01, 4, 8.005, 16, 64}, least[] = {21, 22, 23, 24, 24};
    assert_int_equal(curve->count, 5);
    for (int i = 0; i < 5; i++) {
        assert_near(curve->samples[i].seconds, times[i], 0.006);
        assert_near(curve->samples[i].least, least[i], 0.01);
    }
    chart_scene_free(&scene);
    chart_free(&input);
    sf_context_destroy(&input.ctx);
}

static void test_times_to_a_quality(void **state) {
    (void)state;
    chart_input input = {.ctx = test_context()};
    log_plan plan = chart_plain;
    chart_read_plan(&input, "a.json", &plan);
    plan.label = "two", plan.first_psnr = 19.2; /* ends at 25.2: between best - 1 and best - 0.5 */
    chart_read_plan(&input, "b.json", &plan);
    chart_scene scene;
    assert_ok(input.ctx, chart_scene_make(&input, &input.runs[0], &scene));
    const chart_curve *curves = scene.curves[CHART_PSNR];
    assert_near(chart_best(&scene, CHART_PSNR), 26, 1e-9);
    assert_near(chart_time_to(&curves[0], 25), sqrt(5 * 10.0), 1e-9); /* half way between 24 and 26 dB */
    assert_near(chart_time_to(&curves[0], 20), 1, 1e-9);
    assert_near(chart_time_to(&curves[0], 15), 1, 1e-9);
    assert_true(chart_time_to(&curves[0], 26.1) < 0);
    char *picture = chart_drawn(input.ctx, draw_times, &scene);
    assert_int_equal(chart_count_of(picture, "class=\"bar\""), 4);
    assert_int_equal(chart_count_of(picture, ">not reached<"), 2);
    test_assert_contains(picture, ">7.07 s<", __FILE__, __LINE__);
    free(picture);
    chart_scene_free(&scene);
    chart_free(&input);
    sf_context_destroy(&input.ctx);
}

/* Other programs, on the pictures on which they were measured and on no others. */
static void test_peers_on_their_scene_alone(void **state) {
    (void)state;
    static const struct {
        const char *scene;
        int width, height, peers;
    } cases[] = {{"fox-centred-270", 270, 480, 2}, {"fox-centred-270", 135, 240, 0}, {"test", 270, 480, 0}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        chart_input input = {.ctx = test_context()};
        log_plan plan = chart_plain;
        plan.scene = cases[i].scene, plan.width = cases[i].width, plan.height = cases[i].height;
        chart_read_plan(&input, "a.json", &plan);
        char *psnr = drawn_scene(&input, draw_psnr), *ssim = drawn_scene(&input, draw_ssim);
        assert_int_equal(chart_count_of(psnr, "class=\"peer\""), cases[i].peers);
        assert_int_equal(chart_count_of(psnr, "measured by the authors"), cases[i].peers);
        assert_int_equal(chart_count_of(ssim, "class=\"peer\""), 0);
        if (cases[i].peers) assert_int_equal(chart_count_of(psnr, "class=\"peer-mark\""), 5 + 3);
        free(psnr);
        free(ssim);
        chart_free(&input);
        sf_context_destroy(&input.ctx);
    }
}

static void test_moves(void **state) {
    (void)state;
    chart_input input = {.ctx = test_context()};
    chart_write_text("x.json", "[" MOVE("none", "40") ", " MOVE("+ a < b", "10") ", " MOVE("+ c", "12") "]");
    assert_ok(input.ctx, chart_read(&input, test_path("x.json")));
    assert_int_equal(input.ablation_count, 1);
    char *picture = chart_drawn(input.ctx, draw_moves, &input.ablations[0]);
    assert_int_equal(chart_count_of(picture, "class=\"bar\""), 3);
    assert_int_equal(chart_count_of(picture, "class=\"saved\""), 1);
    assert_int_equal(chart_count_of(picture, "1,500 steps, 31.25 dB"), 3);
    test_assert_contains(picture, "10.0 s (-30)", __FILE__, __LINE__);
    test_assert_contains(picture, "12.0 s (+2)", __FILE__, __LINE__);
    free(picture);
    chart_free(&input);
    sf_context_destroy(&input.ctx);
}

/* A run of a series, its end alone: gaussians, PSNR, and what a log may lack. */
typedef struct size_plan {
    const char *series, *size;
    double cap, gaussians, psnr, bytes, train;
} size_plan;

static void read_sizes(chart_input *input, const size_plan *sizes, size_t count) {
    for (size_t i = 0; i < count; i++) {
        const size_plan *size = &sizes[i];
        log_plan plan = chart_plain;
        memcpy(plan.seconds, (double[8]){5}, sizeof plan.seconds);
        plan.first_psnr = size->psnr;
        json_t *log = chart_make_log(&plan), *result = json_object_get(log, "result");
        json_object_set_new(result, "gaussians", json_real(size->gaussians));
        if (size->bytes > 0) json_object_set_new(result, "bytes", json_real(size->bytes));
        if (size->train > 0) json_object_set_new(result, "train_psnr", json_real(size->train));
        if (size->series) json_object_set_new(log, "series", json_string(size->series));
        json_object_set_new(log, "options", json_pack("{s:f}", "max_gaussians", size->cap));
        if (size->size) json_object_set_new(json_object_get(log, "options"), "size", json_string(size->size));
        assert_ok(input->ctx, chart_read(input, chart_write_json("size.json", log)));
    }
}

static const size_plan sweep[] = {
    {NULL, NULL, 1000, 1000, 28, 2e5, 28.5},      {NULL, "cap", 4000, 4000, 30, 8e5, 31},
    {NULL, NULL, 4000, 4040, 30.2, 8.2e5, 31.2},  {NULL, NULL, 16000, 16000, 31, 32e5, 33},
    {NULL, NULL, 64000, 64000, 30.95, 128e5, 34}, {NULL, "auto", 64000, 12000, 30.9, 20e5, 32},
    {"pruned", NULL, 0, 9000, 30.8, 18e5, 0},     {"random", NULL, 0, 9000, 25, 18e5, 0},
    {"random", NULL, 0, 30000, 30, 60e5, 0}};
enum { SWEEP = sizeof sweep / sizeof *sweep };

static sf_status draw_size_psnr(const void *sizes, sf_writer *out) {
    return chart_draw_size(sizes, CHART_GAUSSIANS, CHART_PSNR, out);
}

static sf_status draw_bytes_ssim(const void *sizes, sf_writer *out) {
    return chart_draw_size(sizes, CHART_BYTES, CHART_SSIM, out);
}

static sf_status draw_gap(const void *sizes, sf_writer *out) { return chart_draw_gap(sizes, out); }

/* Fits of one label with other caps are a series; seeds are one point; the knee lies between two of them. */
static void test_series_of_sizes(void **state) {
    (void)state;
    chart_input input = {.ctx = test_context()};
    chart_sizes sizes;
    double plateau;
    read_sizes(&input, sweep, SWEEP);
    for (size_t i = 0; i < SWEEP; i++) assert_int_equal(input.runs[i].timed, i == 5);
    assert_ok(input.ctx, chart_sizes_make(&input, &input.runs[0], &sizes));
    assert_int_equal(sizes.count[CHART_CAPS], 4);
    assert_int_equal(sizes.count[CHART_AUTO], 1);
    assert_int_equal(sizes.count[CHART_PRUNED], 1);
    assert_int_equal(sizes.count[CHART_RANDOM], 2);
    const chart_size_point *seeds = &sizes.points[CHART_CAPS][1];
    assert_int_equal(seeds->runs, 2);
    assert_near(seeds->size[CHART_GAUSSIANS], 4020, 1e-9);
    assert_near(seeds->quality[CHART_PSNR], 30.1, 1e-9);
    assert_near(seeds->most[CHART_PSNR], 30.2, 1e-9);
    assert_near(seeds->train[CHART_PSNR], 31.1, 1e-9);
    assert_near(chart_knee(&sizes, CHART_GAUSSIANS, &plateau), 4020 * pow(16000 / 4020.0, 0.8 / 0.9), 1e-6);
    assert_near(plateau, 31, 1e-9);
    assert_near(chart_knee(&sizes, CHART_BYTES, &plateau), 8.1e5 * pow(32 / 8.1, 0.8 / 0.9), 1e-3);

    char *picture = chart_drawn(input.ctx, draw_size_psnr, &sizes);
    assert_int_equal(chart_count_of(picture, "class=\"mark\""), 4 + 1 + 1 + 1); /* 25 dB is below the axis */
    assert_int_equal(chart_count_of(picture, "class=\"curve\""), 1);
    test_assert_contains(picture, " Gaussians, the fewest within 0.1 dB", __FILE__, __LINE__);
    test_assert_contains(picture, "knee: 13,72", __FILE__, __LINE__);
    double one = tick_at(picture, "1000", "middle", 'x'), ten = tick_at(picture, "10k", "middle", 'x');
    double low = tick_at(picture, "28", "end", 'y'), high = tick_at(picture, "30", "end", 'y');
    svg_point at = circle_at(picture, 1);
    assert_near(at.x, one + (ten - one) * log10(4.02), 0.15);
    assert_near(at.y, low + (high - low) * 2.1 / 2, 0.15);
    free(picture);
    picture = chart_drawn(input.ctx, draw_bytes_ssim, &sizes);
    test_assert_contains(picture, "bytes of the model's file", __FILE__, __LINE__);
    test_assert_contains(picture, " bytes, the fewest within 0.1 dB", __FILE__, __LINE__);
    free(picture);
    assert_true(chart_gap_known(&sizes));
    picture = chart_drawn(input.ctx, draw_gap, &sizes);
    assert_int_equal(chart_count_of(picture, "class=\"mark\""), 4 + 1);
    free(picture);
    chart_sizes_free(&sizes);
    chart_free(&input);
    sf_context_destroy(&input.ctx);
}

/* Without several sizes there is nothing to draw; seeds of one cap stay a curve. */
static void test_no_series_of_sizes(void **state) {
    (void)state;
    chart_input input = {.ctx = test_context()};
    chart_sizes sizes;
    double plateau;
    const size_plan seeds[] = {{NULL, NULL, 4000, 4000, 30, 0, 0}, {NULL, NULL, 4000, 3500, 30, 0, 0}};
    read_sizes(&input, seeds, 2);
    assert_true(input.runs[0].timed && input.runs[1].timed);
    assert_ok(input.ctx, chart_sizes_make(&input, &input.runs[0], &sizes));
    assert_false(chart_sizes_known(&sizes, CHART_GAUSSIANS));
    assert_false(chart_gap_known(&sizes));
    assert_true(chart_knee(&sizes, CHART_GAUSSIANS, &plateau) == 0);
    assert_int_equal(chart_degree_rows(&input, &input.runs[0]), 0);
    chart_sizes_free(&sizes);
    read_sizes(&input, &(size_plan){NULL, NULL, 8000, 8000, 31, 0, 0}, 1); /* no bytes in the log */
    assert_ok(input.ctx, chart_sizes_make(&input, &input.runs[0], &sizes));
    assert_true(chart_sizes_known(&sizes, CHART_GAUSSIANS));
    assert_false(chart_sizes_known(&sizes, CHART_BYTES));
    chart_sizes_free(&sizes);
    chart_free(&input);
    sf_context_destroy(&input.ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_points_land_where_the_ticks_say),
        cmocka_unit_test(test_labels_seeds_and_scenes),
        cmocka_unit_test(test_many_curves_with_long_names),
        cmocka_unit_test(test_mean_of_runs_at_other_times),
        cmocka_unit_test(test_times_to_a_quality),
        cmocka_unit_test(test_peers_on_their_scene_alone),
        cmocka_unit_test(test_moves),
        cmocka_unit_test(test_series_of_sizes),
        cmocka_unit_test(test_no_series_of_sizes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
