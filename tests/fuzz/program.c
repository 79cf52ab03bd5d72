/* program.c - targets args, log, replay: what the program alone reads. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "app/app.h"
#include "app/training_log.h"
#include "chart/chart.h"
#include "fuzz.h"

/* What fails has one line, on standard error. */
static int said_well(int error) {
    const char *text = fuzz_heard(), *end = strchr(text, '\n');
    FUZZ_CHECK(!error || (end && end > text && !end[1]), "exit code %d, and the text \"%s\"", error, text);
    FUZZ_CHECK(error || !*text, "no exit code, but the text \"%s\"", text);
    return !error;
}

/* Options that are more than texts, for a command whatever it does with them. */
static int read_values(const args *a, sf_context *ctx) {
    sf_fit_options options = sf_fit_options_default();
    sf_render_options render;
    training_log times = {.a = a};
    int seed = 0, error = args_int(a, "threads", 0, 256, &seed);
    if (!error) error = app_split_check(a);
    if (!error && !a->command->with_fit_options) error = app_render_options(a, &render);
    if (!error) error = training_log_read(&times);
    for (int i = 0; i < a->givens && !error && a->command->with_fit_options; i++) {
        sf_option_info info;
        for (size_t k = 0; !error && !sf_fit_option_info(k, &info); k++)
            if (!strcmp(info.name, a->given[i].name) &&
                sf_fit_options_set(ctx, &options, info.name, a->given[i].value))
                error = app_fail(a, ctx);
    }
    return error;
}

/* Lines: the number of a command in the first byte, then its arguments. */
int fuzz_args(const uint8_t *data, size_t size) {
    enum { MOST = 4096, WORDS = 2048 };
    static const command *const commands[] = {&command_fit,       &command_render,  &command_eval,
                                              &command_info,      &command_capture, &command_board,
                                              &command_calibrate, &command_bench,   &command_chart,
                                              &command_convert,   &command_prune,   &command_devices};
    static args a;
    char text[MOST + 1], *words[WORDS];
    int count = 0;
    if (!size) return 0;
    snprintf(text, sizeof text, "%.*s", size < MOST ? (int)size - 1 : MOST, (const char *)data + 1);
    for (char *at = text; *at && count < WORDS; count++) {
        words[count] = at;
        at += strcspn(at, "\n");
        if (*at) *at++ = 0;
    }
    sf_context *ctx = fuzz_begin(size, 1 << 16, 0);
    const command *cmd = commands[data[0] % (sizeof commands / sizeof *commands)];
    fuzz_listen();
    int error = args_parse(&a, cmd, count, words);
    if (!error) error = read_values(&a, ctx);
    int well = said_well(error);
    fuzz_end();
    return well;
}

/* Logs, divided by a line "----", become charts. */
static sf_status read_logs(chart_input *input, sf_bytes *rest) {
    static const char line[] = "\n----\n";
    sf_status status = SF_OK;
    for (int i = 0; i < 4 && !status && sf_bytes_left(rest); i++) {
        const uint8_t *from = rest->data + rest->at, *end = from;
        size_t left = sf_bytes_left(rest), size = left;
        while ((end = memchr(end, '\n', left - (size_t)(end - from))))
            if (left - (size_t)(end - from) >= sizeof line - 1 && !memcmp(end, line, sizeof line - 1)) {
                size = (size_t)(end - from);
                break;
            } else {
                end++;
            }
        char name[16];
        snprintf(name, sizeof name, "run%d.json", i);
        status = chart_read(input, fuzz_file(name, from, size));
        sf_bytes_take(rest, size < left ? size + sizeof line - 1 : left);
    }
    return status;
}

/* JSON takes up to 100 times its text. */
int fuzz_log(const uint8_t *data, size_t size) {
    sf_context *ctx = fuzz_begin(size, 2 << 20, 256);
    chart_input input = {.ctx = ctx};
    sf_bytes rest = {.data = data, .size = size};
    const char *folder = fuzz_subfolder("charts");
    int well = fuzz_went_well(ctx, read_logs(&input, &rest), "run");
    if (well) FUZZ_CHECK(!chart_write_page(&input, folder), "page: %s", sf_last_error(ctx));
    chart_free(&input);
    fuzz_clear("charts");
    fuzz_end();
    return well;
}

/* A log that says that it is of the empty scene. */
int fuzz_replay(const uint8_t *data, size_t size) {
    static const arg_option table[] = {{"replay", 0, "FILE", ""}, {0}};
    static const arg_option *const tables[] = {table, NULL};
    static const command cmd = {.name = "fit", .tables = tables, .most = 1};
    sf_context *ctx = fuzz_begin(size, 1 << 20, 128);
    args a = {.command = &cmd, .given = {{"replay", fuzz_file("replay.json", data, size)}}, .givens = 1};
    sf_fit_options options = sf_fit_options_default();
    json_t *log = NULL;
    sf_scene *scene;
    FUZZ_CHECK(!sf_scene_create(ctx, &scene), "scene: %s", sf_last_error(ctx));
    fuzz_listen();
    int error = replay_open(&a, &log);
    if (!error) error = replay_options(&a, ctx, log, &options);
    if (!error) error = replay_check(&a, ctx, log, scene);
    int well = said_well(error);
    json_decref(log);
    sf_scene_destroy(&scene);
    fuzz_end();
    return well;
}
