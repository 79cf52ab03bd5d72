/* test_chart.c - charts: well-formed, with as many curves and marks as there are, each where its figures say;
 * and logs that are broken are refused by file and field. */
#include "testing.h"

#include <ctype.h>
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "../../src/chart/chart.h"

/* A log as fit writes it, with what charts need. Quality rises by 2 dB and 0.1 from point to point. */
typedef struct log_plan {
    const char *label, *preset, *isa, *scene;
    int width, height, seed;
    double first_psnr, gaussians;
    double seconds[8]; /* ended by 0 */
} log_plan;

static const log_plan plain = {.label = "one",
                               .isa = "avx2",
                               .scene = "test",
                               .width = 64,
                               .height = 48,
                               .seed = 1,
                               .first_psnr = 20,
                               .gaussians = 1000,
                               .seconds = {1, 2, 5, 10}};

static json_t *make_log(const log_plan *plan) {
    json_t *curve = json_array();
    json_array_append_new(curve, json_pack("{s:i, s:f, s:f}", "step", 0, "seconds", 0.5, "loss", 0.3));
    for (int i = 0; plan->seconds[i] > 0; i++)
        json_array_append_new(curve, json_pack("{s:f, s:f, s:f, s:f}", "seconds", plan->seconds[i],
                                               "gaussians", plan->gaussians * (i + 1), "psnr",
                                               plan->first_psnr + 2 * i, "ssim", 0.5 + 0.1 * i));
    json_t *log = json_pack(
        "{s:o, s:{s:s, s:s, s:i, s:f, s:f}, s:{s:s, s:i, s:i}, s:i, s:{s:i, s:f, s:f, s:f, s:f, s:f}}",
        "curve", curve, "machine", "cpu", "A & B <1>", "isa", plan->isa, "threads", 2, "load_start", 0.1,
        "load_end", 1.5, "scene", "name", plan->scene, "width", plan->width, "height", plan->height, "seed",
        plan->seed, "result", "steps", 100, "seconds", 10.5, "setup_seconds", 0.25, "evaluation_seconds", 1.0,
        "gaussians", 4000.0, "needles", 0.01);
    if (plan->label) json_object_set_new(log, "label", json_string(plan->label));
    if (plan->preset) json_object_set_new(log, "preset", json_string(plan->preset));
    assert_non_null(log);
    return log;
}

static const char *write_json(const char *name, json_t *json) {
    const char *path = test_path(name);
    assert_int_equal(json_dump_file(json, path, JSON_INDENT(1)), 0);
    json_decref(json);
    return path;
}

static void read_plan(chart_input *input, const char *name, const log_plan *plan) {
    assert_ok(input->ctx, chart_read(input, write_json(name, make_log(plan))));
}

/* XML, as far as it must be right: tags close in order, attributes are quoted, no stray signs. */

enum { DEPTH = 32 };

static const char *skip_name(const char *at) {
    while (isalnum((unsigned char)*at) || strchr("-:_", *at)) {
        if (!*at) break;
        at++;
    }
    return at;
}

static const char *skip_attributes(const char *at) {
    for (;;) {
        while (isspace((unsigned char)*at)) at++;
        if (*at == '>' || *at == '/') return at;
        const char *name = at;
        at = skip_name(at);
        if (at == name || at[0] != '=' || at[1] != '"') fail_msg("an attribute is wrong at: %.40s", name);
        at += 2 + strcspn(at + 2, "\"<");
        if (*at++ != '"') fail_msg("an attribute is not closed: %.40s", name);
    }
}

static const char *skip_text(const char *at) {
    static const char *const entities[] = {"&amp;", "&lt;", "&gt;", "&quot;"};
    for (; *at && *at != '<'; at++) {
        int known = *at != '&';
        for (int i = 0; i < 4; i++) known |= !strncmp(at, entities[i], strlen(entities[i]));
        if (!known || *at == '>') fail_msg("a sign stands bare at: %.40s", at);
    }
    return at;
}

static void assert_well_formed(const char *text) {
    struct {
        const char *name;
        size_t size;
    } open[DEPTH];
    int depth = 0, roots = 0;
    const char *at = text;
    if (!strncmp(at, "<!DOCTYPE html>", 15)) at += 15;
    while (*(at = skip_text(at))) {
        int closing = at[1] == '/';
        const char *name = at + 1 + closing, *end = skip_name(name);
        size_t size = (size_t)(end - name);
        if (!size) fail_msg("a tag has no name at: %.40s", at);
        at = skip_attributes(end);
        if (closing) {
            if (!depth || open[depth - 1].size != size || strncmp(open[depth - 1].name, name, size) != 0)
                fail_msg("closes what is not open: %.40s", name);
            depth--;
        } else if (*at != '/') {
            assert_true(depth < DEPTH);
            roots += depth == 0;
            open[depth].name = name;
            open[depth++].size = size;
        }
        at += strcspn(at, ">");
        assert_int_equal(*at++, '>');
    }
    if (depth) fail_msg("is not closed: %.40s", open[depth - 1].name);
    assert_int_equal(roots, 1);
}

static int count_of(const char *text, const char *part) {
    int n = 0;
    for (; (text = strstr(text, part)); text += strlen(part)) n++;
    return n;
}

/* A picture that one of the functions of draw.c wrote; free() it. */
typedef sf_status (*draw_fn)(const void *what, sf_writer *out);

static char *drawn(sf_context *ctx, draw_fn draw, const void *what) {
    sf_writer out;
    size_t size;
    const char *path = test_path("drawn.svg");
    assert_ok(ctx, sf_writer_open(&out, ctx, path));
    assert_ok(ctx, draw(what, &out));
    assert_ok(ctx, sf_writer_commit(&out));
    char *text = (char *)test_read(path, &size);
    assert_well_formed(text);
    return text;
}

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
    char *text = drawn(input->ctx, draw, &scene);
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
    read_plan(&input, "a.json", &plain);
    char *picture = drawn_scene(&input, draw_psnr);
    double one = tick_at(picture, "1", "middle", 'x'), ten = tick_at(picture, "10", "middle", 'x');
    double low = tick_at(picture, "20", "end", 'y'), high = tick_at(picture, "26", "end", 'y');
    assert_true(ten > one && high < low);
    for (int i = 0; i < 4; i++) {
        svg_point p = circle_at(picture, i);
        assert_near(p.x, one + (ten - one) * log10(plain.seconds[i]), 0.15);
        assert_near(p.y, low + (high - low) * i / 3, 0.15);
    }
    assert_int_equal(count_of(picture, "class=\"mark\""), 4);
    assert_int_equal(count_of(picture, "class=\"curve\""), 1);
    assert_int_equal(count_of(picture, "class=\"band\""), 0);
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
    log_plan plan = plain;
    plan.label = NULL, plan.preset = "fast";
    for (int seed = 0; seed < 3; seed++) {
        char name[16];
        snprintf(name, sizeof name, "s%d.json", seed);
        plan.first_psnr = 20 + seed;
        read_plan(&input, name, &plan);
    }
    assert_string_equal(input.runs[0].label, "fast / avx2");
    plan.preset = NULL, plan.isa = "<odd & long>", plan.seconds[2] = 6;
    read_plan(&input, "t.json", &plan);
    assert_string_equal(input.runs[3].label, "<odd & long>");
    plan.width = 65;
    read_plan(&input, "u.json", &plan);
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
    char *picture = drawn(input.ctx, draw_psnr, &scene);
    assert_int_equal(count_of(picture, "class=\"curve\""), 2);
    assert_int_equal(count_of(picture, "class=\"band\""), 1);
    assert_int_equal(count_of(picture, "class=\"mark\""), 8);
    assert_int_equal(count_of(picture, "&lt;odd &amp; long&gt;</text>"), 1);
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
    log_plan plan = plain;
    char names[CURVES][2 * LETTERS + 8];
    for (int i = 0; i < CURVES; i++) {
        char file[16];
        snprintf(names[i], sizeof names[i], "%d", i);
        for (int k = 0; k < LETTERS && i == 3; k++) strcat(names[i], "\xc3\xb6"); /* two bytes each */
        snprintf(file, sizeof file, "n%d.json", i);
        plan.label = names[i], plan.first_psnr = 20 + i;
        json_t *log = make_log(&plan);
        if (i == 5) json_object_set_new(json_object_get(log, "machine"), "threads", json_integer(4));
        assert_ok(input.ctx, chart_read(&input, write_json(file, log)));
    }
    char *picture = drawn_scene(&input, draw_psnr);
    assert_int_equal(count_of(picture, "class=\"curve\""), CURVES);
    assert_int_equal(count_of(picture, "class=\"mark\""), 4 * CURVES);
    test_assert_contains(picture, "on several machines or numbers of threads", __FILE__, __LINE__);
    assert_int_equal(count_of(picture, "\xc3\xb6...</text>"), 1);
    free(picture);
    chart_free(&input);
    sf_context_destroy(&input.ctx);
}

/* Runs evaluated at other times: interpolated over the logarithm of time, kept at the end, from when all have
 * begun. */
static void test_mean_of_runs_at_other_times(void **state) {
    (void)state;
    chart_input input = {.ctx = test_context()};
    log_plan plan = plain;
    memcpy(plan.seconds, (double[8]){1, 4, 16}, sizeof plan.seconds);
    read_plan(&input, "a.json", &plan);
    memcpy(plan.seconds, (double[8]){2, 8.01, 64}, sizeof plan.seconds);
    plan.first_psnr = 30;
    read_plan(&input, "b.json", &plan);
    memcpy(plan.seconds, (double[8]){2.01, 8, 64}, sizeof plan.seconds);
    read_plan(&input, "c.json", &plan);
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
    log_plan plan = plain;
    read_plan(&input, "a.json", &plan);
    plan.label = "two", plan.first_psnr = 19.2; /* ends at 25.2: between best - 1 and best - 0.5 */
    read_plan(&input, "b.json", &plan);
    chart_scene scene;
    assert_ok(input.ctx, chart_scene_make(&input, &input.runs[0], &scene));
    const chart_curve *curves = scene.curves[CHART_PSNR];
    assert_near(chart_best(&scene, CHART_PSNR), 26, 1e-9);
    assert_near(chart_time_to(&curves[0], 25), sqrt(5 * 10.0), 1e-9); /* half way between 24 and 26 dB */
    assert_near(chart_time_to(&curves[0], 20), 1, 1e-9);
    assert_near(chart_time_to(&curves[0], 15), 1, 1e-9);
    assert_true(chart_time_to(&curves[0], 26.1) < 0);
    char *picture = drawn(input.ctx, draw_times, &scene);
    assert_int_equal(count_of(picture, "class=\"bar\""), 4);
    assert_int_equal(count_of(picture, ">not reached<"), 2);
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
        log_plan plan = plain;
        plan.scene = cases[i].scene, plan.width = cases[i].width, plan.height = cases[i].height;
        read_plan(&input, "a.json", &plan);
        char *psnr = drawn_scene(&input, draw_psnr), *ssim = drawn_scene(&input, draw_ssim);
        assert_int_equal(count_of(psnr, "class=\"peer\""), cases[i].peers);
        assert_int_equal(count_of(psnr, "measured by the authors"), cases[i].peers);
        assert_int_equal(count_of(ssim, "class=\"peer\""), 0);
        if (cases[i].peers) assert_int_equal(count_of(psnr, "class=\"peer-mark\""), 5 + 3);
        free(psnr);
        free(ssim);
        chart_free(&input);
        sf_context_destroy(&input.ctx);
    }
}

#define MOVE(name, seconds)                                                                                  \
    "{\"move\": \"" name "\", \"seconds\": " seconds ", \"steps\": 1500, \"psnr\": 31.25}"

static void write_text(const char *name, const char *text) {
    test_write(test_path(name), text, strlen(text));
}

static void test_moves(void **state) {
    (void)state;
    chart_input input = {.ctx = test_context()};
    write_text("x.json", "[" MOVE("none", "40") ", " MOVE("+ a < b", "10") ", " MOVE("+ c", "12") "]");
    assert_ok(input.ctx, chart_read(&input, test_path("x.json")));
    assert_int_equal(input.ablation_count, 1);
    char *picture = drawn(input.ctx, draw_moves, &input.ablations[0]);
    assert_int_equal(count_of(picture, "class=\"bar\""), 3);
    assert_int_equal(count_of(picture, "class=\"saved\""), 1);
    assert_int_equal(count_of(picture, "1,500 steps, 31.25 dB"), 3);
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
        log_plan plan = plain;
        memcpy(plan.seconds, (double[8]){5}, sizeof plan.seconds);
        plan.first_psnr = size->psnr;
        json_t *log = make_log(&plan), *result = json_object_get(log, "result");
        json_object_set_new(result, "gaussians", json_real(size->gaussians));
        if (size->bytes > 0) json_object_set_new(result, "bytes", json_real(size->bytes));
        if (size->train > 0) json_object_set_new(result, "train_psnr", json_real(size->train));
        if (size->series) json_object_set_new(log, "series", json_string(size->series));
        json_object_set_new(log, "options", json_pack("{s:f}", "max_gaussians", size->cap));
        if (size->size) json_object_set_new(json_object_get(log, "options"), "size", json_string(size->size));
        assert_ok(input->ctx, chart_read(input, write_json("size.json", log)));
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

    char *picture = drawn(input.ctx, draw_size_psnr, &sizes);
    assert_int_equal(count_of(picture, "class=\"mark\""), 4 + 1 + 1 + 1); /* 25 dB is below the axis */
    assert_int_equal(count_of(picture, "class=\"curve\""), 1);
    test_assert_contains(picture, " Gaussians, the fewest within 0.1 dB", __FILE__, __LINE__);
    test_assert_contains(picture, "knee: 13,72", __FILE__, __LINE__);
    double one = tick_at(picture, "1000", "middle", 'x'), ten = tick_at(picture, "10k", "middle", 'x');
    double low = tick_at(picture, "28", "end", 'y'), high = tick_at(picture, "30", "end", 'y');
    svg_point at = circle_at(picture, 1);
    assert_near(at.x, one + (ten - one) * log10(4.02), 0.15);
    assert_near(at.y, low + (high - low) * 2.1 / 2, 0.15);
    free(picture);
    picture = drawn(input.ctx, draw_bytes_ssim, &sizes);
    test_assert_contains(picture, "bytes of the model's file", __FILE__, __LINE__);
    test_assert_contains(picture, " bytes, the fewest within 0.1 dB", __FILE__, __LINE__);
    free(picture);
    assert_true(chart_gap_known(&sizes));
    picture = drawn(input.ctx, draw_gap, &sizes);
    assert_int_equal(count_of(picture, "class=\"mark\""), 4 + 1);
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

static sf_status draw_choices(const void *choices, sf_writer *out) {
    chart_draw_choices(choices, out);
    return SF_OK;
}

static sf_status draw_degrees(const void *input_pointer, sf_writer *out) {
    const chart_input *input = input_pointer;
    chart_draw_degrees(input, &input->runs[0], out);
    return SF_OK;
}

static void test_choices_and_degrees(void **state) {
    (void)state;
    chart_input input = {.ctx = test_context()};
    write_text("k.json",
               "[{\"complexity\": 100, \"gaussians\": 130}, {\"complexity\": 1000, \"gaussians\": 900},"
               " {\"complexity\": 100, \"gaussians\": 200, \"series\": \"a<b\"}]");
    assert_ok(input.ctx, chart_read(&input, test_path("k.json")));
    assert_int_equal(input.choices_count, 1);
    char *picture = drawn(input.ctx, draw_choices, &input.choices[0]);
    assert_int_equal(count_of(picture, "class=\"mark\""), 3);
    assert_int_equal(count_of(picture, "class=\"equal\""), 1);
    assert_int_equal(count_of(picture, ">a&lt;b</text>"), 1);
    assert_int_equal(count_of(picture, ">automatic choice</text>"), 1);
    free(picture);
    json_t *log = make_log(&plain);
    json_object_set_new(json_object_get(log, "result"), "sh_degrees",
                        json_pack("[i,i,i,i]", 1500, 0, 300, 200));
    assert_ok(input.ctx, chart_read(&input, write_json("d.json", log)));
    assert_int_equal(chart_degree_rows(&input, &input.runs[0]), 1);
    picture = drawn(input.ctx, draw_degrees, &input);
    assert_int_equal(count_of(picture, "class=\"bar\""), 3);
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
    json_t *log = make_log(&plain), *at = log;
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
    read_plan(&input, "a.json", &plain);
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

    write_text("moves.json", "[" MOVE("none", "40") "]");
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
        assert_well_formed(picture);
        free(picture);
    }
    char *page = (char *)test_read(test_path("a/b/index.html"), &size);
    assert_well_formed(page);
    assert_int_equal(count_of(page, "<svg "), 4);
    assert_int_equal(count_of(page, "src=\"data:image/png;base64,iVBORw0KGgo"), (int)snapshots);
    assert_int_equal(count_of(page, "<td>a &lt;b&gt;</td>"), 1);
    assert_int_equal(count_of(page, "http"),
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
    assert_well_formed(page);
    free(page);
}

static void test_the_program_refuses(void **state) {
    (void)state;
    char arguments[1024];
    write_text("bad.json", "{}");
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
        cmocka_unit_test(test_points_land_where_the_ticks_say),
        cmocka_unit_test(test_labels_seeds_and_scenes),
        cmocka_unit_test(test_many_curves_with_long_names),
        cmocka_unit_test(test_mean_of_runs_at_other_times),
        cmocka_unit_test(test_times_to_a_quality),
        cmocka_unit_test(test_peers_on_their_scene_alone),
        cmocka_unit_test(test_moves),
        cmocka_unit_test(test_series_of_sizes),
        cmocka_unit_test(test_no_series_of_sizes),
        cmocka_unit_test(test_choices_and_degrees),
        cmocka_unit_test(test_prune_to_the_page),
        cmocka_unit_test(test_broken_logs_are_refused),
        cmocka_unit_test(test_text_that_is_no_log_is_refused),
        cmocka_unit_test(test_from_a_fit_to_the_page),
        cmocka_unit_test(test_the_program_refuses),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
