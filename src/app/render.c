/* render.c - splatfit render: a model as the views of a project see it, as PNG. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "app.h"

static const arg_option own_options[] = {
    {"out", 'o', "DIR", "folder for the pictures and cameras.json, made if it is missing"},
    {0},
};

static int render_view(const args *a, sf_context *ctx, sf_renderer *renderer, const sf_model *model,
                       const sf_render_options *options, const sf_view_info *view, const char *folder) {
    size_t pixels = (size_t)view->camera.width * (size_t)view->camera.height,
           room = strlen(folder) + strlen(view->name) + 8;
    float *rgb = calloc(pixels, 3 * sizeof *rgb);
    char *path = malloc(room);
    int error = EXIT_FAILED;
    if (rgb && path) {
        const char *dot = strrchr(view->name, '.'), *slash = strrchr(view->name, '/');
        int stem = dot && (!slash || dot > slash) ? (int)(dot - view->name) : (int)strlen(view->name);
        snprintf(path, room, "%s/%.*s.png", folder, stem, view->name);
        error = app_make_folders(a, path);
        sf_image_out out = {.rgb = rgb};
        if (!error && (sf_render(renderer, model, &view->camera, options, &out) ||
                       sf_write_png(ctx, path, view->camera.width, view->camera.height, rgb)))
            error = app_fail(a, ctx);
    } else {
        app_say(a, view->name, "out of memory");
    }
    free(rgb);
    free(path);
    return error;
}

static int render_all(const args *a, sf_context *ctx, const sf_model *model, sf_scene *scene,
                      const char *folder) {
    sf_render_options options;
    sf_renderer *renderer = NULL;
    sf_scene_info info;
    size_t done = 0;
    sf_scene_get_info(scene, &info);
    int error = app_render_options(a, scene, &options);
    if (!error && sf_renderer_create(ctx, &renderer)) error = app_fail(a, ctx);
    for (size_t i = 0; i < info.views && !error; i++) {
        sf_view_info view;
        if (sf_scene_get_view(scene, i, &view))
            error = app_fail(a, ctx);
        else if (app_split_wants(a, "all", view.split)) {
            error = render_view(a, ctx, renderer, model, &options, &view, folder);
            done += !error;
        }
    }
    sf_renderer_destroy(&renderer);
    if (!error && !args_value(a, "quiet")) printf("wrote %zu pictures to %s\n", done, folder);
    return error;
}

static int run(const args *a) {
    const char *folder = args_value(a, "out");
    if (!folder) {
        app_say(a, "--out DIR", "is needed: the folder for the pictures");
        return EXIT_USAGE;
    }
    sf_context *ctx = NULL;
    sf_model *model = NULL;
    sf_scene *scene = NULL;
    int error = app_split_check(a);
    if (!error) error = app_context(a, &ctx);
    if (!error && sf_model_load(ctx, a->positional[0], &model)) error = app_fail(a, ctx);
    if (!error) error = app_load(a, ctx, a->positional[1], &scene);
    if (!error) error = render_all(a, ctx, model, scene, folder);
    if (!error) {
        size_t room = strlen(folder) + 16;
        char *path = malloc(room);
        if (path) snprintf(path, room, "%s/cameras.json", folder);
        if (!path || sf_scene_save_cameras(scene, path)) error = app_fail(a, ctx);
        free(path);
    }
    sf_scene_destroy(&scene);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
    return error;
}

static const arg_option *const tables[] = {own_options, render_options, load_options, common_options, NULL};

const command command_render = {
    .name = "render",
    .synopsis = "MODEL PROJECT --out DIR [OPTIONS]",
    .summary = "Renders a model as the views of a project see it. Pictures take the views' names, as PNG.",
    .tables = tables,
    .least = 2,
    .most = 2,
    .run = run,
};
