/* chart.c - splatfit chart: charts of quality against time from the logs of fits. */
#include <stdio.h>

#include "../chart/chart.h"
#include "app.h"

static const arg_option own_options[] = {
    {"out", 'o', "DIR", "folder for index.html and the charts, made if it is missing"},
    {0},
};

static int run(const args *a) {
    const char *folder = args_value(a, "out");
    sf_context *ctx = NULL;
    if (!folder) {
        app_say(a, "--out DIR", "is needed: the folder for the charts");
        return EXIT_USAGE;
    }
    int error = app_context(a, &ctx);
    chart_input input = {.ctx = ctx};
    for (int i = 0; i < a->positionals && !error; i++)
        if (chart_read(&input, a->positional[i])) error = app_fail(a, ctx);
    if (!error) error = app_make_folder(a, folder);
    if (!error && chart_write_page(&input, folder)) error = app_fail(a, ctx);
    if (!error && !args_value(a, "quiet"))
        printf("wrote %s/index.html: %zu runs, %zu ablations, %zu walks\n", folder, input.run_count,
               input.ablation_count, input.walk_count);
    chart_free(&input);
    sf_context_destroy(&ctx);
    return error;
}

static const arg_option *const tables[] = {own_options, common_options, NULL};

const command command_chart = {
    .name = "chart",
    .synopsis = "RUN.json... --out DIR [OPTIONS]",
    .summary =
        "Draws quality against time from what fit --log wrote, and from what live --log wrote of simulated "
        "cameras how far keyframes are off along their walks. A list of {move, seconds, steps, psnr} becomes "
        "a chart of what each move saves.",
    .tables = tables,
    .least = 1,
    .most = ARGS_POSITIONAL,
    .run = run,
};
