/* render.c - splatfit render: a model as the views of a project see it, or along a path. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "pictures.h"
#include "camera_path.h"

typedef struct job {
    const args *a;
    sf_context *ctx;
    sf_model *model;
    sf_scene *scene; /* NULL: none was given */
    sf_renderer *renderer;
    sf_render_options options;
    camera_path along;
    pictures to;
} job;

/* The views that --split wants. */
typedef struct wanted {
    sf_view_info *views;
    char **names; /* each one's picture, within the folder and without .png: the view's, without its ending */
    size_t count;
} wanted;

static void free_wanted(wanted *w) {
    for (size_t i = 0; w->names && i < w->count; i++) free(w->names[i]);
    free(w->names);
    free(w->views);
}

static char *name_of(const sf_view_info *view) {
    const char *dot = strrchr(view->name, '.'), *slash = strrchr(view->name, '/');
    size_t stem = dot && (!slash || dot > slash) ? (size_t)(dot - view->name) : strlen(view->name);
    char *name = malloc(stem + 1);
    if (!name) return NULL;
    memcpy(name, view->name, stem);
    name[stem] = 0;
    return name;
}

static int list_wanted(const job *j, wanted *w) {
    sf_scene_info info;
    sf_scene_get_info(j->scene, &info);
    w->views = calloc(info.views + 1, sizeof *w->views);
    w->names = calloc(info.views + 1, sizeof *w->names);
    if (!w->views || !w->names) return app_say(j->a, "views", "out of memory");
    for (size_t i = 0; i < info.views; i++) {
        sf_view_info *view = &w->views[w->count];
        if (sf_scene_get_view(j->scene, i, view)) return app_fail(j->a, j->ctx);
        if (!app_split_wants(j->a, "all", view->split)) continue;
        w->names[w->count] = name_of(view);
        if (!w->names[w->count++]) return app_say(j->a, view->name, "out of memory");
    }
    return 0;
}

static int by_text(const void *a, const void *b) { return strcmp(*(char *const *)a, *(char *const *)b); }

/* 0.jpg and 0.png would both be 0.png. */
static int check_names(const job *j, const wanted *w) {
    char **sorted = calloc(w->count + 1, sizeof *sorted);
    int error = sorted ? 0 : app_say(j->a, "views", "out of memory");
    for (size_t i = 0; sorted && i < w->count; i++) sorted[i] = w->names[i];
    if (sorted) qsort(sorted, w->count, sizeof *sorted, by_text);
    for (size_t i = 1; i < w->count && !error; i++)
        if (!strcmp(sorted[i - 1], sorted[i]))
            error = app_say(
                j->a, sorted[i],
                "two pictures of the project have this name but for the ending, and would be one .png: "
                "rename one of them");
    free(sorted);
    return error;
}

/* A picture of the project is not written over, by whatever path it is named. */
static int check_photos(const job *j, const wanted *w) {
    sf_scene_info info;
    sf_scene_get_info(j->scene, &info);
    for (size_t i = 0; i < w->count; i++) {
        struct stat there, photo;
        char *path = pictures_path(&j->to, w->names[i]);
        int found = path && !stat(path, &there),
            error = path ? 0 : app_say(j->a, w->names[i], "out of memory");
        for (size_t k = 0; found && !error && k < info.views; k++) {
            sf_view_info view;
            if (sf_scene_get_view(j->scene, k, &view) || !view.file || stat(view.file, &photo)) continue;
            if (photo.st_dev == there.st_dev && photo.st_ino == there.st_ino)
                error =
                    app_say(j->a, path,
                            "is a picture of the project, and would be written over: name another folder");
        }
        free(path);
        if (error) return error;
    }
    return 0;
}

static int save_cameras(const job *j) {
    size_t room = strlen(j->to.out) + 16;
    char *path = malloc(room);
    if (path) snprintf(path, room, "%s/cameras.json", j->to.out);
    int error = app_make_folders(j->a, path ? path : "");
    if (!error && (!path || sf_scene_save_cameras(j->scene, path, 0))) error = app_fail(j->a, j->ctx);
    free(path);
    return error;
}

static int render_views(job *j) {
    wanted w = {0};
    int error = list_wanted(j, &w);
    if (!error && !j->to.streams) error = check_names(j, &w);
    if (!error && !j->to.streams) error = check_photos(j, &w);
    for (size_t i = 0; i < w.count && !error; i++)
        error = pictures_add(&j->to, j->renderer, j->model, &w.views[i].camera, &j->options, w.names[i]);
    free_wanted(&w);
    return error || j->to.streams ? error : save_cameras(j);
}

static int render_path(job *j) {
    int error = 0;
    for (size_t i = 0; i < j->along.count && !error; i++) {
        char name[32];
        snprintf(name, sizeof name, "frame_%05zu", i);
        error = pictures_add(&j->to, j->renderer, j->model, &j->along.cameras[i], &j->options, name);
    }
    if (error || j->to.streams) return error;
    char *text = camera_path_lines(&j->along, j->model);
    error = text ? pictures_note(&j->to, "path.txt", text) : app_say(j->a, "path.txt", "out of memory");
    free(text);
    return error;
}

static int render_all(job *j) {
    int path = args_value(j->a, "path") != NULL;
    int error = app_render_options(j->a, &j->options);
    if (!error && path) error = camera_path_make(j->a, j->ctx, j->model, j->scene, &j->along);
    if (!error && !j->scene && !args_value(j->a, "near-plane") && j->along.near_plane > 0)
        j->options.near_plane = (float)j->along.near_plane;
    if (!error && sf_renderer_create(j->ctx, &j->renderer)) error = app_fail(j->a, j->ctx);
    if (!error) error = path ? render_path(j) : render_views(j);
    /* Standard output may be the stream's. */
    FILE *say = !strcmp(j->to.out, "-") ? stderr : stdout;
    size_t count = j->to.count;
    error = pictures_end(&j->to, error);
    if (!error && !args_value(j->a, "quiet")) fprintf(say, "wrote %zu pictures to %s\n", count, j->to.out);
    return error;
}

static int check(const args *a) {
    const char *path = args_value(a, "path");
    int error = app_split_check(a);
    if (!error) error = camera_path_check(a);
    if (error || a->positionals > 1) return error;
    if (path && strcmp(path, "cameras")) return 0;
    app_say(a, "PROJECT", path ? "is needed for --path cameras" : "is needed, or --path");
    return EXIT_USAGE;
}

static int run(const args *a) {
    job j = {.a = a};
    int rate = 30, error = check(a);
    if (!error) error = args_int(a, "fps", 1, 1000, &rate);
    if (!error) error = app_context(a, &j.ctx);
    if (!error) error = pictures_begin(a, j.ctx, rate, &j.to);
    if (!error) error = app_load_shown(a, j.ctx, a->positional[0], &j.model);
    if (!error && a->positionals > 1) error = app_load_cameras(a, j.ctx, a->positional[1], &j.scene);
    if (!error && j.scene) sf_scene_place_model(j.scene, j.model);
    if (!error) error = render_all(&j);
    camera_path_free(&j.along);
    sf_renderer_destroy(&j.renderer);
    sf_scene_destroy(&j.scene);
    sf_model_destroy(&j.model);
    sf_context_destroy(&j.ctx);
    return error;
}

static const arg_option *const tables[] = {
    picture_options, camera_path_options, model_options,  compensation_options,
    render_options,  load_options,        common_options, NULL};

const command command_render = {
    .name = "render",
    .synopsis = "MODEL [PROJECT] --out WHERE [OPTIONS]",
    .summary = "Renders a model from the views of a project, or along a path. Pictures of views have the "
               "views' names; those of a path are frame_00000 and so on, and path.txt lists their poses. A "
               "turntable as a film: splatfit render MODEL --path orbit --out - | ffmpeg -i - out.mp4",
    .tables = tables,
    .least = 1,
    .most = 2,
    .run = run,
};
