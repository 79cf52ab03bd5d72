/* view.c - splatfit view: a finished model, or a project's points and cameras, on a page in the browser. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "../preview/preview.h"
#include "camera_path.h"

/* Views to choose from on the page, evenly chosen where there are more. */
enum { VIEWS = 60, WIDTH = 960, HEIGHT = 720 };

static const arg_option own_options[] = {
    {"listen", 0, "ADDRESS:PORT", "serve the page there (127.0.0.1:8090; if that is taken, another port)"},
    {"token", 0, "TEXT",
     "a secret that the page's address must contain; default: random, but no token on a loopback address"},
    {"cameras", 0, "FILE",
     "cameras of a fit: the initial view and a list of views (splat.cameras.json beside splat.ply, else "
     "cameras.json there, if one exists)"},
    {"up", 0, "AXIS",
     "x, -x, y, -y, z or -z; default: as the cameras, else the normal of the model's main plane"},
    {"background", 0, "COLOR", "black, white or R,G,B in 0..1 (black)"},
    {0},
};

/* What is shown: scene is NULL for a model. */
typedef struct subject {
    sf_scene *scene;
    sf_model *model;
} subject;

/* The view from which the whole model is seen; a project's from behind its cameras. */
static int first_camera(const args *a, sf_context *ctx, const subject *s, const sf_camera *known,
                        size_t count, sf_camera *first) {
    camera_path one = {.cameras = first, .count = 1};
    sf_model_bounds bounds;
    *first = (sf_camera){.width = WIDTH, .height = HEIGHT, .cx = WIDTH / 2.0, .cy = HEIGHT / 2.0};
    first->fx = first->fy = HEIGHT;
    int error = camera_path_orbit(a, ctx, s->model, known, count, &one);
    if (error || !s->scene) return error;
    if (sf_model_get_bounds(s->model, &bounds)) return app_fail(a, ctx);
    first->t_cw[2] += bounds.radius;
    return 0;
}

/* In place of the number of Gaussians. */
static void describe(sf_scene *scene, json_t *status) {
    sf_scene_info info;
    char text[128];
    sf_scene_get_info(scene, &info);
    snprintf(text, sizeof text, "%zu sparse points, %zu cameras, %zu of them held out (blue)", info.points,
             info.views, info.test_views);
    json_object_set_new(status, "contents", json_string(text));
    json_object_set_new(status, "state", json_string("project"));
}

/* What the page is told: it never changes. */
static int show_status(const args *a, sf_context *ctx, sf_preview *preview, const subject *s) {
    sf_camera *known, first;
    size_t count;
    sf_render_options options;
    int error = camera_path_known(a, ctx, s->model, s->scene, &known, &count);
    if (!error) error = app_render_options(a, &options);
    if (!error) error = first_camera(a, ctx, s, known, count, &first);
    if (!error) {
        const double background[3] = {options.background[0], options.background[1], options.background[2]};
        size_t shown = count < VIEWS ? count : VIEWS;
        json_t *views = json_array();
        for (size_t i = 0; i < shown; i++)
            json_array_append_new(views,
                                  app_json_pose(&known[shown > 1 ? i * (count - 1) / (shown - 1) : 0]));
        json_t *status =
            json_pack("{s:b, s:s, s:I, s:o, s:o, s:o}", "still", 1, "state", "finished", "gaussians",
                      (json_int_t)sf_model_count(s->model), "background", app_json_numbers(background, 3),
                      "pose", app_json_pose(count && !s->scene ? &known[0] : &first), "views", views);
        if (s->scene) describe(s->scene, status);
        double origin[3];
        sf_model_get_origin(s->model, origin);
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

static int serve(const args *a, sf_context *ctx, const subject *s) {
    const struct timespec moment = {.tv_nsec = 100 * 1000 * 1000};
    sf_preview *preview = NULL;
    int error = open_page(a, ctx, &preview);
    if (!error) error = show_status(a, ctx, preview, s);
    if (!error && sf_preview_set_model(preview, s->model, SF_MAX_SH_DEGREE)) error = app_fail(a, ctx);
    if (!error) {
        app_catch_signals(NULL);
        printf("page: %s\n", sf_preview_url(preview));
        fflush(stdout);
        while (!app_stopped_by()) nanosleep(&moment, NULL);
    }
    sf_preview_close(&preview);
    return error;
}

static int load(const args *a, sf_context *ctx, subject *s) {
    const char *path = a->positional[0];
    if (app_names_model(path)) {
        int error = app_refuse_load_options(a, path);
        return error ? error : app_load_shown(a, ctx, path, &s->model);
    }
    if (args_value(a, "cameras")) {
        args_error(a->command, "--cameras: goes with a model, not with %s", path);
        return EXIT_USAGE;
    }
    int error = app_load_cameras(a, ctx, path, &s->scene);
    return error ? error : app_project_model(a, ctx, s->scene, &s->model);
}

static int run(const args *a) {
    sf_context *ctx = NULL;
    subject s = {0};
    int error = app_context(a, &ctx);
    if (!error) error = load(a, ctx, &s);
    if (!error) error = serve(a, ctx, &s);
    sf_model_destroy(&s.model);
    sf_scene_destroy(&s.scene);
    sf_context_destroy(&ctx);
    return error;
}

static const arg_option *const tables[] = {own_options,  model_options,  compensation_options,
                                           load_options, common_options, NULL};

const command command_view = {
    .name = "view",
    .synopsis = "MODEL|PROJECT [OPTIONS]",
    .summary = "Shows a model (.ply, .spz, .splat, .glb, .gltf, .sog), or the sparse points and cameras of a "
               "project (held-out views blue), on a page that it serves. It prints "
               "the page's address for a browser, with the token that other machines need, and ends with "
               "SIGINT (Ctrl-C) or SIGTERM. Colours depend on the direction as in a render, except for SH "
               "values beyond -1..1.",
    .tables = tables,
    .least = 1,
    .most = 1,
    .run = run,
};
