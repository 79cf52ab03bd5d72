/* cameras_json.c - the views' cameras as INRIA's cameras.json, out and in. */
#include "cameras_json.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../base/file.h"
#include "../base/linear.h"
#include "json_read.h"

/* Names of files need not be UTF-8, which JSON is: bytes beyond ASCII are then replaced. */
static json_t *name_text(sf_context *ctx, const char *name) {
    json_t *text = json_string(name);
    if (text) return text;
    size_t size = strlen(name) + 1;
    char *plain = sf_alloc(ctx, size, 1);
    if (!plain) return NULL;
    for (size_t i = 0; i < size; i++) plain[i] = (unsigned char)name[i] < 128 ? name[i] : '?';
    text = json_string(plain);
    sf_free(ctx, plain);
    return text;
}

/* Camera to world, row by row: the transpose of R_cw. */
static json_t *rotation_rows(const double R[9]) {
    return json_pack("[[fff][fff][fff]]", R[0], R[3], R[6], R[1], R[4], R[7], R[2], R[5], R[8]);
}

static json_t *describe_view(const sf_view *view, const sf_camera *c, size_t index, const double origin[3],
                             int world) {
    double o[3];
    sf_camera_center(c, o);
    for (int k = 0; k < 3 && world; k++) o[k] += origin[k];
    json_t *json =
        json_pack("{s:I s:o s:i s:i s:[fff] s:o s:f s:f}", "id", (json_int_t)index, "img_name",
                  name_text(view->ctx, view->name), "width", (int)c->width, "height", (int)c->height,
                  "position", o[0], o[1], o[2], "rotation", rotation_rows(c->R_cw), "fx", c->fx, "fy", c->fy);
    if (json && !world && (origin[0] != 0 || origin[1] != 0 || origin[2] != 0))
        json_object_set_new(json, "origin", json_pack("[fff]", origin[0], origin[1], origin[2]));
    return json;
}

/* NULL where memory is short. */
static json_t *describe_views(sf_scene *scene, sf_camera_fn replace, void *user, int world) {
    json_t *list = json_array();
    pthread_mutex_lock(&scene->lock);
    for (size_t i = 0; list && i < scene->view_count; i++) {
        sf_camera camera = scene->views[i]->camera;
        if (replace) replace(user, scene->views[i]->id, &camera);
        if (!json_array_append_new(list, describe_view(scene->views[i], &camera, i, scene->origin, world)))
            continue;
        json_decref(list);
        list = NULL;
    }
    pthread_mutex_unlock(&scene->lock);
    return list;
}

sf_status sf_save_cameras(sf_scene *scene, sf_camera_fn replace, void *user, const char *path, int world) {
    json_t *list = describe_views(scene, replace, user, world);
    char *text = list ? json_dumps(list, 0) : NULL;
    json_decref(list);
    if (!text) return sf_fail(scene->ctx, SF_ERR_MEMORY, "%s: no memory for the list of cameras", path);
    sf_status status = sf_write_file(scene->ctx, path, text, strlen(text));
    free(text);
    return status;
}

sf_status sf_scene_save_cameras(sf_scene *scene, const char *path, int world) {
    return sf_save_cameras(scene, NULL, NULL, path, world);
}

/* ---- In ---- */

enum { CAMERAS_MOST_BYTES = 64 << 20 };

/* `n` numbers of an array, or (n = 1) a number. */
static int read_numbers(const json_t *json, size_t n, double *values) {
    if (n == 1 && json_is_number(json)) {
        *values = json_number_value(json);
        return 1;
    }
    if (json_array_size(json) != n) return 0;
    for (size_t k = 0; k < n; k++) {
        if (!json_is_number(json_array_get(json, k))) return 0;
        values[k] = json_number_value(json_array_get(json, k));
    }
    return 1;
}

/* NULL, or the field that is wrong. origin: what the camera states, else 0. */
static const char *read_camera(const json_t *json, sf_camera *c, double origin[3]) {
    double size[2], center[3];
    const json_t *rows = json_object_get(json, "rotation"), *stated = json_object_get(json, "origin");
    origin[0] = origin[1] = origin[2] = 0;
    if (stated && !read_numbers(stated, 3, origin)) return "origin";
    if (!isfinite(origin[0] + origin[1] + origin[2])) return "origin";
    if (!read_numbers(json_object_get(json, "width"), 1, size) || !(size[0] >= 1 && size[0] <= 65535))
        return "width";
    if (!read_numbers(json_object_get(json, "height"), 1, size + 1) || !(size[1] >= 1 && size[1] <= 65535))
        return "height";
    if (!read_numbers(json_object_get(json, "fx"), 1, &c->fx) || !(c->fx > 0)) return "fx";
    if (!read_numbers(json_object_get(json, "fy"), 1, &c->fy) || !(c->fy > 0)) return "fy";
    if (!read_numbers(json_object_get(json, "position"), 3, center)) return "position";
    if (json_array_size(rows) != 3) return "rotation";
    for (size_t i = 0; i < 3; i++) {
        double row[3];
        if (!read_numbers(json_array_get(rows, i), 3, row)) return "rotation";
        for (size_t k = 0; k < 3; k++) c->R_cw[3 * k + i] = row[k];
    }
    c->width = (int32_t)size[0], c->height = (int32_t)size[1];
    c->cx = c->width / 2.0, c->cy = c->height / 2.0;
    for (int i = 0; i < 3; i++) {
        c->t_cw[i] = 0;
        for (int k = 0; k < 3; k++) c->t_cw[i] -= c->R_cw[3 * i + k] * center[k];
    }
    if (!sf_camera_check(c)) return NULL;
    return isfinite(c->t_cw[0] + c->t_cw[1] + c->t_cw[2]) ? "rotation" : "position";
}

/* Moves a camera that is relative to `from` to coordinates relative to `to`. */
static void change_origin(sf_camera *c, const double from[3], const double to[3]) {
    double way[3] = {to[0] - from[0], to[1] - from[1], to[2] - from[2]};
    for (int k = 0; k < 3; k++) c->t_cw[k] += sf_dot3(c->R_cw + 3 * k, way);
}

static sf_status read_cameras(sf_context *ctx, const char *path, const json_t *list, sf_camera **cameras,
                              size_t *count, double origin[3]) {
    double first[3] = {0}, own[3];
    size_t n = json_array_size(list);
    if (!n) return sf_fail(ctx, SF_ERR_EMPTY, "%s: holds no camera", path);
    sf_camera *all = sf_calloc(ctx, n, sizeof *all);
    if (!all) return SF_ERR_MEMORY;
    for (size_t i = 0; i < n; i++) {
        const char *field = read_camera(json_array_get(list, i), &all[i], own);
        if (origin && !i) memcpy(first, own, sizeof first);
        if (!field) change_origin(&all[i], own, first);
        if (!field) continue;
        sf_free(ctx, all);
        return sf_fail(ctx, SF_ERR_FORMAT, "%s: camera %zu: %s: is missing or makes no sense", path, i,
                       field);
    }
    if (origin) memcpy(origin, first, sizeof first);
    *cameras = all;
    *count = n;
    return SF_OK;
}

sf_status sf_cameras_load(sf_context *ctx, const char *path, sf_camera **cameras, size_t *count,
                          double origin[3]) {
    json_t *list;
    *cameras = NULL;
    *count = 0;
    sf_status status = sf_json_read(ctx, path, CAMERAS_MOST_BYTES, &list);
    if (status) return status;
    status = json_is_array(list) ? read_cameras(ctx, path, list, cameras, count, origin)
                                 : sf_fail(ctx, SF_ERR_FORMAT, "%s: is not an array of cameras", path);
    json_decref(list);
    return status;
}

void sf_cameras_free(sf_context *ctx, sf_camera **cameras) {
    sf_free(ctx, *cameras);
    *cameras = NULL;
}
