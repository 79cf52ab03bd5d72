/* eval.c - splatfit eval: PSNR and SSIM of a model on the held-out views of a project. */
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "app.h"

static const arg_option own_options[] = {
    {"json", 0, "FILE", "also write psnr, ssim, gaussians, bytes and views[] as JSON"},
    {0},
};

static void print_table(const evaluation *e, size_t gaussians, long long bytes) {
    size_t i;
    json_t *view;
    printf("%-40s %8s %8s %10s\n", "view", "PSNR dB", "SSIM", "corrected");
    json_array_foreach(e->list, i, view)
        printf("%-40s %8.3f %8.4f %10.3f\n", json_string_value(json_object_get(view, "name")),
               json_real_value(json_object_get(view, "psnr")), json_real_value(json_object_get(view, "ssim")),
               json_real_value(json_object_get(view, "psnr_corrected")));
    printf("%-40s %8.3f %8.4f %10.3f\n", "mean", e->psnr, e->ssim, e->psnr_corrected);
    printf("%zu Gaussians, %lld bytes\n", gaussians, bytes);
}

static int report(const args *a, sf_context *ctx, const evaluation *e, size_t gaussians) {
    struct stat st = {0};
    long long bytes = stat(a->positional[0], &st) ? 0 : (long long)st.st_size;
    if (!args_value(a, "quiet")) print_table(e, gaussians, bytes);
    const char *path = args_value(a, "json");
    if (!path) return 0;
    return app_write_json(a, ctx, path,
                          json_pack("{s:o, s:o, s:f, s:f, s:f, s:I, s:I, s:O}", "model",
                                    app_json_text(a->positional[0]), "project",
                                    app_json_text(a->positional[1]), "psnr", e->psnr, "ssim", e->ssim,
                                    "psnr_corrected", e->psnr_corrected, "gaussians", (json_int_t)gaussians,
                                    "bytes", (json_int_t)bytes, "views", e->list));
}

static int run(const args *a) {
    sf_context *ctx = NULL;
    sf_model *model = NULL;
    sf_scene *scene = NULL;
    app_drawer d = {0};
    evaluation e = {0};
    const char *json = args_value(a, "json");
    int error = app_split_check(a);
    if (!error && json) error = app_check_output(a, json);
    if (!error) error = app_context(a, &ctx);
    if (!error) error = app_load_model(a, ctx, a->positional[0], &model);
    if (!error) error = app_load(a, ctx, a->positional[1], &scene);
    if (!error) sf_scene_place_model(scene, model);
    if (!error) error = app_render_options(a, &d.options);
    if (!error && sf_renderer_create(ctx, &d.renderer)) error = app_fail(a, ctx);
    d.model = model;
    if (!error && app_evaluate(ctx, scene, a, "test", app_draw_model, &d, &e)) error = app_fail(a, ctx);
    if (!error && !e.views)
        error = app_say(a, a->positional[1],
                        "no view to evaluate: nothing is held out (see --hold-out, --split)");
    if (!error) error = report(a, ctx, &e, sf_model_count(model));
    json_decref(e.list);
    sf_renderer_destroy(&d.renderer);
    sf_scene_destroy(&scene);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
    return error;
}

static const arg_option *const tables[] = {
    own_options, model_options, compensation_options, render_options, load_options, common_options, NULL};

const command command_eval = {
    .name = "eval",
    .synopsis = "MODEL PROJECT [OPTIONS]",
    .summary =
        "Evaluates a model on the held-out views of a project. Prints PSNR (values clamped to 0..1, "
        "not rounded) "
        "and SSIM (11x11 Gaussian window, zero padding) of each view and their means; corrected: PSNR of "
        "the right half, with a gain and a bias per channel fitted to the left half.",
    .tables = tables,
    .least = 2,
    .most = 2,
    .run = run,
};
