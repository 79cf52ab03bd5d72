/* chart_fixture.c - see the header. */
#include "chart_fixture.h"

#include <ctype.h>
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "../../src/chart/chart.h"

const log_plan chart_plain = {.label = "one",
                              .isa = "avx2",
                              .scene = "test",
                              .width = 64,
                              .height = 48,
                              .seed = 1,
                              .first_psnr = 20,
                              .gaussians = 1000,
                              .seconds = {1, 2, 5, 10}};

json_t *chart_make_log(const log_plan *plan) {
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

const char *chart_write_json(const char *name, json_t *json) {
    const char *path = test_path(name);
    assert_int_equal(json_dump_file(json, path, JSON_INDENT(1)), 0);
    json_decref(json);
    return path;
}

void chart_read_plan(chart_input *input, const char *name, const log_plan *plan) {
    assert_ok(input->ctx, chart_read(input, chart_write_json(name, chart_make_log(plan))));
}

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

void chart_assert_well_formed(const char *text) {
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

int chart_count_of(const char *text, const char *part) {
    int n = 0;
    for (; (text = strstr(text, part)); text += strlen(part)) n++;
    return n;
}

char *chart_drawn(sf_context *ctx, draw_fn draw, const void *what) {
    sf_writer out;
    size_t size;
    const char *path = test_path("drawn.svg");
    assert_ok(ctx, sf_writer_open(&out, ctx, path));
    assert_ok(ctx, draw(what, &out));
    assert_ok(ctx, sf_writer_commit(&out));
    char *text = (char *)test_read(path, &size);
    chart_assert_well_formed(text);
    return text;
}

void chart_write_text(const char *name, const char *text) { test_write(test_path(name), text, strlen(text)); }
