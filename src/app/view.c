/* view.c - splatfit view: a finished model on a page in the browser. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "../preview/preview.h"
#include "shots.h"

/* Views to choose from on the page, evenly chosen where there are more. */
enum { VIEWS = 60, WIDTH = 960, HEIGHT = 720 };

static const arg_option own_options[] = {
    {"listen", 0, "ADDRESS:PORT", "serve the page there (127.0.0.1:8090; if that is taken, another port)"},
    {"token", 0, "TEXT",
     "a secret that the page's address must contain; default: random, but no token on a loopback address"},
    {"cameras", 0, "FILE",
     "cameras.json: the initial view and a list of views (cameras.json beside the model, if it exists)"},
    {"up", 0, "AXIS",
     "x, -x, y, -y, z or -z; default: as the cameras, else the normal of the model's main plane"},
    {"background", 0, "COLOR", "black, white or R,G,B in 0..1 (black)"},
    {0},
};

/* The view from which the whole model is seen. */
static int first_camera(const args *a, sf_context *ctx, const sf_model *model, const sf_camera *known,
                        size_t count, sf_camera *first) {
    shots one = {.cameras = first, .count = 1};
    *first = (sf_camera){.width = WIDTH, .height = HEIGHT, .cx = WIDTH / 2.0, .cy = HEIGHT / 2.0};
    first->fx = first->fy = HEIGHT;
    return shots_orbit(a, ctx, model, known, count, &one);
}

/* What the page is told: it never changes. */
static int show_status(const args *a, sf_context *ctx, sf_preview *preview, sf_model *model) {
    sf_camera *known, first;
    size_t count;
    sf_render_options options;
    int error = shots_known(a, ctx, model, NULL, &known, &count);
    if (!error) error = app_render_options(a, &options);
    if (!error) error = first_camera(a, ctx, model, known, count, &first);
    if (!error) {
        const double background[3] = {options.background[0], options.background[1], options.background[2]};
        size_t shown = count < VIEWS ? count : VIEWS;
        json_t *views = json_array();
        for (size_t i = 0; i < shown; i++)
            json_array_append_new(views,
                                  app_json_pose(&known[shown > 1 ? i * (count - 1) / (shown - 1) : 0]));
        json_t *status =
            json_pack("{s:b, s:s, s:I, s:o, s:o, s:o}", "still", 1, "state", "finished", "gaussians",
                      (json_int_t)sf_model_count(model), "background", app_json_numbers(background, 3),
                      "pose", app_json_pose(count ? &known[0] : &first), "views", views);
        double origin[3];
        sf_model_get_origin(model, origin);
        app_json_origin(status, origin);
        char *text = status ? json_dumps(status, JSON_COMPACT | JSON_REAL_PRECISION(8)) : NULL;
        json_decref(status);
        if (!text)
            error = app_say(a, "page", "out of memory");
        else if (sf_preview_set_status(preview, text))
            error = app_fail(a, ctx);
        free(text);
    }
    free(known);
    return error;
}

static int open_page(const args *a, sf_context *ctx, sf_preview **preview) {
    const char *listen = args_value(a, "listen"), *slash = strrchr(a->positional[0], '/');
    sf_preview_options options = {listen, args_value(a, "token"), slash ? slash + 1 : a->positional[0]};
    sf_status status = sf_preview_open(ctx, &options, preview);
    if (status == SF_ERR_IO && !listen) {
        options.listen = "127.0.0.1:0";
        status = sf_preview_open(ctx, &options, preview);
    }
    return status ? app_fail(a, ctx) : 0;
}

static int serve(const args *a, sf_context *ctx, sf_model *model) {
    const struct timespec moment = {.tv_nsec = 100 * 1000 * 1000};
    sf_preview *preview = NULL;
    int error = open_page(a, ctx, &preview);
    if (!error) error = show_status(a, ctx, preview, model);
    if (!error && sf_preview_set_model(preview, model, SF_MAX_SH_DEGREE)) error = app_fail(a, ctx);
    if (!error) {
        app_catch_signals(NULL);
        printf("page: %s\n", sf_preview_url(preview));
        fflush(stdout);
        while (!app_stopped_by()) nanosleep(&moment, NULL);
    }
    sf_preview_close(&preview);
    return error;
}

static int run(const args *a) {
    sf_context *ctx = NULL;
    sf_model *model = NULL;
    int error = app_context(a, &ctx);
    if (!error) error = app_load_model(a, ctx, a->positional[0], &model);
    if (!error) error = serve(a, ctx, model);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
    return error;
}

static const arg_option *const tables[] = {own_options, model_options, compensation_options, common_options,
                                           NULL};

const command command_view = {
    .name = "view",
    .synopsis = "MODEL [OPTIONS]",
    .summary = "Shows a model (.ply, .spz, .splat, .glb, .gltf, .sog) on a page that it serves. It prints "
               "the page's address for a browser, with the token that other machines need, and ends with "
               "SIGINT (Ctrl-C) or SIGTERM. Colours depend on the direction as in a render, except for SH "
               "values beyond -1..1.",
    .tables = tables,
    .least = 1,
    .most = 1,
    .run = run,
};
