/* bench.c - splatfit bench: how fast and how exact this machine is. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../bench/report.h"
#include "app.h"

static const arg_option own_options[] = {
    {"json", 0, "FILE", "write all figures as JSON"},
    {"report", 0, NULL, "measure for about a minute and print a short text in Markdown, for sharing"},
    {"svg", 0, "DIR", "write the charts bench-accuracy.svg and bench-roofs.svg into a folder"},
    {"before", 0, "FILE",
     "what --json wrote with another build: drawn dashed in bench-accuracy.svg (needs --svg)"},
    {"only", 0, "LIST", "measure only these of roofs,kernels,accuracy,steps,sfm"},
    {"model", 0, "FILE", "also measure whole steps of this model (needs --project)"},
    {"project", 0, "PATH", "the project whose training views are used for the steps of --model"},
    {"quick", 0, NULL, "small scenes and few rounds: tests that everything works, the times mean nothing"},
    {"once", 0, NULL, "run each kernel once at --isa and print its units, for counting instructions"},
    {"instructions", 0, "FILE", "add counted instructions to the report (from tests/bench/callgrind.sh)"},
    {0},
};

static int wants(const args *a, const char *section) {
    const char *list = args_value(a, "only");
    if (args_value(a, "report") && !strcmp(section, "roofs")) return 0;
    return !list || strstr(list, section);
}

/* Every name of --only is one of the sections. */
static int check_only(const args *a) {
    static const char *const sections[] = {"roofs", "kernels", "accuracy", "steps", "sfm"};
    const char *list = args_value(a, "only");
    while (list && *list) {
        size_t n = strcspn(list, ","), known = 0;
        for (size_t i = 0; i < sizeof sections / sizeof *sections; i++)
            known |= strlen(sections[i]) == n && !strncmp(list, sections[i], n);
        if (!known) {
            args_error(a->command, "--only: \"%.*s\" is none of roofs, kernels, accuracy, steps, sfm", (int)n,
                       list);
            return EXIT_USAGE;
        }
        list += n + (list[n] == ',');
    }
    return 0;
}

static int measure_model(const args *a, sf_context *ctx, const bench_options *options, bench_report *report) {
    const char *model_path = args_value(a, "model"), *project = args_value(a, "project");
    sf_model *model = NULL;
    sf_scene *scene = NULL;
    sf_render_options render;
    if (!model_path) return 0;
    int error = sf_model_load(ctx, model_path, &model) ? app_fail(a, ctx) : 0;
    if (!error) error = app_load(a, ctx, project, &scene);
    if (!error) error = app_render_options(a, &render);
    if (!error && bench_fit(ctx, options, model, scene, render.near_plane, report)) error = app_fail(a, ctx);
    sf_scene_destroy(&scene);
    sf_model_destroy(&model);
    return error;
}

static int measure(const args *a, sf_context *ctx, const bench_options *options, bench_report *report) {
    const char *before = args_value(a, "before");
    sf_status status = bench_begin(ctx, options, report);
    if (!status && before) status = bench_read_before(ctx, before, report);
    if (!status && wants(a, "roofs")) status = bench_roofs(ctx, options, report);
    if (!status && (wants(a, "kernels") || wants(a, "accuracy")))
        status = bench_kernels(ctx, options, report);
    if (!status && wants(a, "kernels") && !options->brief) status = bench_stages(ctx, options, report);
    if (!status && wants(a, "accuracy")) status = bench_accuracies(ctx, options, report);
    if (!status && wants(a, "steps")) status = bench_steps(ctx, options, report);
    if (!status && wants(a, "sfm") && !options->brief) status = bench_sfm(ctx, options, report);
    if (status) return app_fail(a, ctx);
    int error = measure_model(a, ctx, options, report);
    bench_end(report);
    return error;
}

static int write_charts(const args *a, sf_context *ctx, const bench_report *report, const char *folder) {
    static const struct {
        const char *name;
        sf_status (*draw)(sf_context *ctx, const bench_report *report, const char *path);
    } charts[] = {{"bench-accuracy.svg", bench_chart_accuracy}, {"bench-roofs.svg", bench_chart_roofs}};
    int error = 0;
    for (size_t i = 0; i < sizeof charts / sizeof *charts && !error; i++) {
        size_t room = strlen(folder) + strlen(charts[i].name) + 2;
        char *path = malloc(room);
        if (!path) return app_say(a, folder, "out of memory");
        snprintf(path, room, "%s/%s", folder, charts[i].name);
        if (charts[i].draw(ctx, report, path)) error = app_fail(a, ctx);
        free(path);
    }
    return error;
}

static int measure_and_report(const args *a, sf_context *ctx, const bench_options *options) {
    const char *json = args_value(a, "json"), *svg = args_value(a, "svg"),
               *instructions = args_value(a, "instructions");
    bench_report *report = calloc(1, sizeof *report);
    if (!report) return app_say(a, "cannot start", "out of memory");
    int error = measure(a, ctx, options, report);
    if (!error && instructions && bench_read_instructions(ctx, instructions, report))
        error = app_fail(a, ctx);
    if (!error && options->brief)
        bench_markdown(report, stdout);
    else if (!error && !args_value(a, "quiet"))
        bench_print(report, stdout);
    if (!error && json) error = app_write_json(a, ctx, json, bench_json(report));
    if (!error && svg) error = write_charts(a, ctx, report, svg);
    free(report);
    return error;
}

static int run(const args *a) {
    const char *json = args_value(a, "json"), *isa = args_value(a, "isa");
    sf_context *ctx = NULL;
    if (!args_value(a, "model") != !args_value(a, "project")) {
        app_say(a, "--model and --project", "go together");
        return EXIT_USAGE;
    }
    if (args_value(a, "before") && !args_value(a, "svg")) {
        app_say(a, "--before", "needs --svg DIR, for the chart that it is drawn in");
        return EXIT_USAGE;
    }
    int error = check_only(a);
    if (!error && json) error = app_check_output(a, json);
    if (!error) error = app_context(a, &ctx);
    if (error) return error;
    if (!isa) isa = getenv("SPLATFIT_ISA");
    bench_options options = {.isa = isa && *isa ? isa : NULL,
                             .quick = args_value(a, "quick") != NULL,
                             .brief = args_value(a, "report") != NULL,
                             .progress = args_value(a, "quiet") ? NULL : stderr};
    if (!args_value(a, "once"))
        error = measure_and_report(a, ctx, &options);
    else if (bench_once(ctx, &options, stdout))
        error = app_fail(a, ctx);
    sf_context_destroy(&ctx);
    return error;
}

static const arg_option *const tables[] = {own_options, load_options, common_options, NULL};

const command command_bench = {
    .name = "bench",
    .synopsis = "[OPTIONS]",
    .summary = "Measures this machine: its peak rates, the speed and accuracy of each kernel at each level, "
               "whole steps.",
    .tables = tables,
    .least = 0,
    .most = 0,
    .run = run,
};
