/* info_project.c - what splatfit info says of a project: what was found, and what a fit of it takes. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "app.h"

/* Views that follow each other and have one camera, but for its pose. */
typedef struct camera_run {
    sf_view_info first;
    size_t views;
} camera_run;

static int is_same(const sf_view_info *a, const sf_view_info *b) {
    const sf_camera *c = &a->camera, *d = &b->camera;
    return a->lens == b->lens && c->width == d->width && c->height == d->height && c->fx == d->fx &&
           c->fy == d->fy && c->cx == d->cx && c->cy == d->cy;
}

/* The run that begins at `index`; 0 views at the end. */
static camera_run next_run(sf_scene *scene, size_t index) {
    camera_run run = {.views = 0};
    sf_view_info view;
    while (!sf_scene_get_view(scene, index + run.views, &view)) {
        if (!run.views) run.first = view;
        if (!is_same(&run.first, &view)) break;
        run.views++;
    }
    return run;
}

/* The bill of a fit with the defaults; 0: it does not fit, as sf_last_error says. */
static int forecast(sf_context *ctx, sf_scene *scene, sf_memory_bill *bill) {
    app_hold_log(1);
    int fits = !sf_fit_memory(ctx, scene, NULL, bill);
    app_hold_log(0);
    return fits;
}

/* As text. */

static int has_origin(const sf_scene *scene, double origin[3]) {
    sf_scene_get_origin(scene, origin);
    return origin[0] != 0 || origin[1] != 0 || origin[2] != 0;
}

static void print_counts(const sf_scene *scene, const sf_scene_info *info) {
    double origin[3];
    printf("%s: %zu views: %zu to train on, %zu held out\n", info->kind ? info->kind : "scene", info->views,
           info->train_views, info->test_views);
    printf("%zu sparse points\n", info->points);
    if (info->skipped_missing)
        printf("%zu views skipped: picture missing or not readable\n", info->skipped_missing);
    if (info->skipped_pose) printf("%zu views skipped: pose not usable\n", info->skipped_pose);
    if (info->skipped_points) printf("%zu points skipped: not finite\n", info->skipped_points);
    if (info->undistorted_views) printf("%zu views undistorted\n", info->undistorted_views);
    if (info->cropped_views) printf("%zu views cropped to a pinhole camera's field\n", info->cropped_views);
    if (info->masked_views) printf("%zu views with a mask: black is ignored\n", info->masked_views);
    if (info->alpha_views) printf("%zu views with an alpha channel\n", info->alpha_views);
    if (info->rotated_views)
        printf("%zu views with an EXIF orientation, which is ignored\n", info->rotated_views);
    printf("extent %.5g, centre %.5g %.5g %.5g\n", info->extent, info->center[0], info->center[1],
           info->center[2]);
    if (has_origin(scene, origin))
        printf("origin %.17g %.17g %.17g: coordinates are relative to it\n", origin[0], origin[1], origin[2]);
}

static void print_run(const camera_run *run) {
    const sf_camera *c = &run->first.camera;
    printf("from %s on, %zu views: ", run->first.name, run->views);
    if (run->first.lens) printf("%s, ", run->first.lens);
    printf("%dx%d px, fx %.2f, fy %.2f, cx %.2f, cy %.2f", (int)c->width, (int)c->height, c->fx, c->fy, c->cx,
           c->cy);
    if (run->first.undistorted)
        printf("; undistorted: %.0f of %.0f degrees across", run->first.field_kept, run->first.field_seen);
    printf("\n");
}

static void print_held_out(sf_scene *scene) {
    enum { MOST = 8 };
    sf_view_info view;
    size_t count = 0;
    for (size_t i = 0; !sf_scene_get_view(scene, i, &view); i++) {
        if (view.split != SF_SPLIT_TEST) continue;
        if (count++ < MOST) printf("%s%s", count == 1 ? "held out: " : ", ", view.name);
    }
    if (count > MOST) printf(" and %zu more", count - MOST);
    if (count) printf("\n");
}

static const double mega = 1048576;

static void print_forecast(sf_context *ctx, const sf_memory_bill *bill) {
    if (!bill)
        printf("a fit with the defaults: %s\n", sf_last_error(ctx));
    else
        printf("a fit with the defaults takes up to %.0f MB of memory, %.0f of them for the program and the "
               "pictures\n",
               (double)bill->total / mega, (double)bill->before / mega);
}

static void print_all(sf_context *ctx, sf_scene *scene, const sf_scene_info *info,
                      const sf_memory_bill *bill) {
    camera_run run;
    print_counts(scene, info);
    for (size_t i = 0; (run = next_run(scene, i)).views; i += run.views) print_run(&run);
    print_held_out(scene);
    if (info->train_views) print_forecast(ctx, bill);
}

/* As JSON. */

static json_t *cameras_json(sf_scene *scene) {
    json_t *list = json_array();
    camera_run run;
    for (size_t i = 0; (run = next_run(scene, i)).views; i += run.views) {
        const sf_camera *c = &run.first.camera;
        json_array_append_new(
            list, json_pack("{s:o, s:I, s:s?, s:i, s:i, s:f, s:f, s:f, s:f, s:b, s:f, s:f}", "first",
                            app_json_text(run.first.name), "views", (json_int_t)run.views, "lens",
                            run.first.lens, "width", (int)c->width, "height", (int)c->height, "fx", c->fx,
                            "fy", c->fy, "cx", c->cx, "cy", c->cy, "undistorted", run.first.undistorted,
                            "field_seen", run.first.field_seen, "field_kept", run.first.field_kept));
    }
    return list;
}

static json_t *held_out_json(sf_scene *scene) {
    json_t *list = json_array();
    sf_view_info view;
    for (size_t i = 0; !sf_scene_get_view(scene, i, &view); i++)
        if (view.split == SF_SPLIT_TEST) json_array_append_new(list, app_json_text(view.name));
    return list;
}

static json_t *memory_json(const sf_memory_bill *bill) {
    if (!bill) return json_null();
    return json_pack("{s:I, s:I, s:I}", "total", (json_int_t)bill->total, "before", (json_int_t)bill->before,
                     "budget", (json_int_t)bill->budget);
}

static json_t *all_json(sf_scene *scene, const sf_scene_info *info, const char *path,
                        const sf_memory_bill *bill) {
    json_t *all =
        json_pack("{s:o, s:s?, s:I, s:I, s:I, s:I, s:f, s:[f,f,f]}", "project", app_json_text(path), "kind",
                  info->kind, "views", (json_int_t)info->views, "train_views", (json_int_t)info->train_views,
                  "test_views", (json_int_t)info->test_views, "points", (json_int_t)info->points, "extent",
                  info->extent, "center", info->center[0], info->center[1], info->center[2]);
    const struct {
        const char *name;
        size_t count;
    } counts[] = {{"skipped_missing", info->skipped_missing}, {"skipped_pose", info->skipped_pose},
                  {"skipped_points", info->skipped_points},   {"undistorted_views", info->undistorted_views},
                  {"cropped_views", info->cropped_views},     {"masked_views", info->masked_views},
                  {"alpha_views", info->alpha_views},         {"rotated_views", info->rotated_views}};
    for (size_t i = 0; i < sizeof counts / sizeof *counts; i++)
        json_object_set_new(all, counts[i].name, json_integer((json_int_t)counts[i].count));
    double origin[3];
    if (has_origin(scene, origin))
        json_object_set_new(all, "origin", json_pack("[f,f,f]", origin[0], origin[1], origin[2]));
    json_object_set_new(all, "cameras", cameras_json(scene));
    json_object_set_new(all, "held_out", held_out_json(scene));
    json_object_set_new(all, "fit_memory", memory_json(bill));
    return all;
}

int app_info_project(const args *a, sf_context *ctx, const char *path) {
    const char *json = args_value(a, "json");
    sf_scene *scene = NULL;
    int error = json ? app_check_output(a, json) : 0;
    if (!error) error = app_load_cameras(a, ctx, path, &scene);
    if (error) return error;
    sf_scene_info info;
    sf_memory_bill found, *bill = NULL;
    sf_scene_get_info(scene, &info);
    if (info.train_views && forecast(ctx, scene, &found)) bill = &found;
    if (!json || strcmp(json, "-") != 0) print_all(ctx, scene, &info, bill);
    if (json) error = app_write_json(a, ctx, json, all_json(scene, &info, path, bill));
    sf_scene_destroy(&scene);
    return error;
}
