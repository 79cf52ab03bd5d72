/* board.c - splatfit board: draws a board of AprilTags for calibration. */
#include <stdio.h>

#include "app.h"

static const arg_option own_options[] = {
    {"output", 'o', "FILE",
     "the file to write: .pdf, .svg or .png for printing, or .json for the board's description"},
    {"board", 0, "NAME", "a4-36h11, letter-36h11 or a3-36h11 (a4-36h11)"},
    {0},
};

static int draw(const args *a, sf_context *ctx, const char *name, const char *path) {
    sf_board *board = NULL;
    int error = 0;
    sf_status status = sf_board_open(ctx, name, 0, &board);
    if (!status) status = sf_board_write(ctx, board, path);
    if (status) {
        app_fail(a, ctx);
        error = status == SF_ERR_ARGUMENT ? EXIT_USAGE : EXIT_FAILED;
    } else if (!args_value(a, "quiet")) {
        printf("wrote %s: %zu tags of %.1f mm; print it at 100 %% and measure a tag\n", path, board->count,
               1e3 * board->tag_size);
    }
    sf_board_close(&board);
    return error;
}

static int run(const args *a) {
    const char *path = args_value(a, "output"), *name = args_value(a, "board");
    sf_context *ctx = NULL;
    if (!path) {
        app_say(a, "--output FILE", "is needed: the drawing to write");
        return EXIT_USAGE;
    }
    int error = app_context(a, &ctx);
    if (!error) error = draw(a, ctx, name ? name : "a4-36h11", path);
    sf_context_destroy(&ctx);
    return error;
}

static const arg_option *const tables[] = {own_options, common_options, NULL};

const command command_board = {
    .name = "board",
    .synopsis = "-o FILE [OPTIONS]",
    .summary =
        "Draws a board of AprilTags to calibrate a camera with. Print it at 100 %, glue it onto something "
        "flat, measure a tag's black side.",
    .tables = tables,
    .least = 0,
    .most = 0,
    .run = run,
};
