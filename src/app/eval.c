/* eval.c - splatfit eval: PSNR and SSIM of a model on the held-out views of a project. */
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "camera_path.h"

static const arg_option own_options[] = {
    {"json", 0, "FILE", "also write psnr, ssim, gaussians, bytes and views[] as JSON"},
    {"eval-views", 0, "N", "evaluate at most N views, evenly spread (all)"},
    {"cameras", 0, "FILE",
     "the project's cameras as the fit refined them: the splat.cameras.json that it wrote; default: as "
     "given"},
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
    if (e->most && e->of > (size_t)e->most) printf("%zu of %zu views evaluated\n", e->views, e->of);
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

/* A model, drawn with cameras of a file. */
typedef struct refined_drawer {
    app_drawer d;
    sf_scene *scene;
    sf_camera *cameras; /* [count], of all views of the scene in their order; NULL: as given */
    size_t count;
} refined_drawer;

static size_t index_of(const refined_drawer *r, uint32_t id) {
    sf_view_info view;
    size_t i = 0;
    while (i + 1 < r->count && (sf_scene_get_view(r->scene, i, &view) || view.id != id)) i++;
    return i;
}

static sf_status draw_refined(void *user, const sf_view_info *view, float *rgb) {
    const refined_drawer *r = user;
    sf_view_info moved = *view;
    if (r->cameras) {
        const sf_camera *c = &r->cameras[index_of(r, view->id)];
        memcpy(moved.camera.R_cw, c->R_cw, sizeof c->R_cw);
        memcpy(moved.camera.t_cw, c->t_cw, sizeof c->t_cw);
        moved.camera.fx = c->fx, moved.camera.fy = c->fy;
    }
    return app_draw_model((void *)(uintptr_t)&r->d, &moved, rgb);
}

/* Cameras of the same views, as far as the file tells. */
static int load_cameras(const args *a, sf_context *ctx, sf_scene *scene, refined_drawer *r) {
    const char *path = args_value(a, "cameras");
    sf_scene_info info;
    sf_view_info view;
    r->scene = scene;
    if (!path) return 0;
    double from[3], to[3];
    if (sf_cameras_load(ctx, path, &r->cameras, &r->count, from)) return app_fail(a, ctx);
    sf_scene_get_origin(scene, to);
    for (size_t i = 0; i < r->count; i++) camera_path_change_origin(&r->cameras[i], from, to);
    sf_scene_get_info(scene, &info);
    int same = r->count == info.views;
    for (size_t i = 0; same && i < r->count; i++)
        same = !sf_scene_get_view(scene, i, &view) && view.camera.width == r->cameras[i].width &&
               view.camera.height == r->cameras[i].height;
    return same ? 0
                : app_say(a, path,
                          "is not of this project: the number of its cameras, or their size, is another "
                          "(it was written with the same --images and --downscale?)");
}

static int run(const args *a) {
    sf_context *ctx = NULL;
    sf_model *model = NULL;
    sf_scene *scene = NULL;
    refined_drawer r = {0};
    evaluation e = {0};
    const char *json = args_value(a, "json");
    int error = app_split_check(a);
    if (!error) error = args_int(a, "eval-views", 1, 1000000000, &e.most);
    if (!error && json) error = app_check_output(a, json);
    if (!error) error = app_context(a, &ctx);
    if (!error) error = app_load_shown(a, ctx, a->positional[0], &model);
    if (!error) error = app_load(a, ctx, a->positional[1], &scene);
    if (!error) sf_scene_place_model(scene, model);
    if (!error) error = load_cameras(a, ctx, scene, &r);
    if (!error) error = app_render_options(a, &r.d.options);
    if (!error && sf_renderer_create(ctx, &r.d.renderer)) error = app_fail(a, ctx);
    r.d.model = model;
    if (!error && app_evaluate_drawn(ctx, scene, a, "test", draw_refined, &r, &e)) error = app_fail(a, ctx);
    if (!error && !e.views)
        error = app_say(a, a->positional[1],
                        "no view to evaluate: nothing is held out (see --hold-out, --split)");
    if (!error) error = report(a, ctx, &e, sf_model_count(model));
    json_decref(e.list);
    sf_cameras_free(ctx, &r.cameras);
    sf_renderer_destroy(&r.d.renderer);
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
