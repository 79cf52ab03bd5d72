/* cameras_json.c - the views' cameras as INRIA's cameras.json. */
#include "cameras_json.h"

#include <stdlib.h>
#include <string.h>

#include <jansson.h>

#include "../base/file.h"

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

static json_t *describe_view(const sf_view *view, const sf_camera *c, size_t index) {
    double o[3];
    sf_camera_center(c, o);
    return json_pack("{s:I s:o s:i s:i s:[fff] s:o s:f s:f}", "id", (json_int_t)index, "img_name",
                     name_text(view->ctx, view->name), "width", (int)c->width, "height", (int)c->height,
                     "position", o[0], o[1], o[2], "rotation", rotation_rows(c->R_cw), "fx", c->fx, "fy",
                     c->fy);
}

/* NULL where memory is short. */
static json_t *describe_views(sf_scene *scene, sf_camera_fn replace, void *user) {
    json_t *list = json_array();
    pthread_mutex_lock(&scene->lock);
    for (size_t i = 0; list && i < scene->view_count; i++) {
        sf_camera camera = scene->views[i]->camera;
        if (replace) replace(user, scene->views[i]->id, &camera);
        if (!json_array_append_new(list, describe_view(scene->views[i], &camera, i))) continue;
        json_decref(list);
        list = NULL;
    }
    pthread_mutex_unlock(&scene->lock);
    return list;
}

sf_status sf_save_cameras(sf_scene *scene, sf_camera_fn replace, void *user, const char *path) {
    json_t *list = describe_views(scene, replace, user);
    char *text = list ? json_dumps(list, 0) : NULL;
    json_decref(list);
    if (!text) return sf_fail(scene->ctx, SF_ERR_MEMORY, "%s: no memory for the list of cameras", path);
    sf_status status = sf_write_file(scene->ctx, path, text, strlen(text));
    free(text);
    return status;
}

sf_status sf_scene_save_cameras(sf_scene *scene, const char *path) {
    return sf_save_cameras(scene, NULL, NULL, path);
}
