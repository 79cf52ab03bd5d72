/* scene.c - views and sparse points. */
#include "scene.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../base/statistics.h"

sf_status sf_view_create_bare(sf_context *ctx, const char *name, const sf_camera *camera, sf_split split,
                              sf_view **out) {
    size_t length = strlen(name) + 1;
    sf_view *view = *out = sf_calloc(ctx, 1, sizeof *view);
    if (!view) return SF_ERR_MEMORY;
    view->ctx = ctx;
    atomic_init(&view->references, 1);
    atomic_init(&view->hash, 0);
    view->split = split;
    view->camera = *camera;
    view->name = sf_alloc(ctx, length, 1);
    if (view->name) {
        memcpy(view->name, name, length);
        return SF_OK;
    }
    sf_view_release(view);
    *out = NULL;
    return SF_ERR_MEMORY;
}

sf_status sf_view_create(sf_context *ctx, const char *name, const sf_camera *camera, sf_split split,
                         int with_weight, sf_view **out) {
    size_t pixels = (size_t)camera->width * (size_t)camera->height;
    sf_status status = sf_view_create_bare(ctx, name, camera, split, out);
    if (status) return status;
    sf_view *view = *out;
    view->has_weight = with_weight;
    view->rgb = sf_alloc(ctx, pixels, 3);
    if (with_weight) view->weight = sf_alloc(ctx, pixels, 1);
    if (view->rgb && (view->weight || !with_weight)) return SF_OK;
    sf_view_release(view);
    *out = NULL;
    return SF_ERR_MEMORY;
}

sf_view *sf_view_retain(sf_view *view) {
    atomic_fetch_add(&view->references, 1);
    return view;
}

int sf_view_is_hidden(const sf_view *view) {
    size_t pixels = (size_t)view->camera.width * (size_t)view->camera.height, i = 0;
    if (view->cache) return view->hidden;
    while (view->weight && i < pixels && !view->weight[i]) i++;
    return view->weight && i == pixels;
}

void sf_view_release(sf_view *view) {
    if (!view || atomic_fetch_sub(&view->references, 1) > 1) return;
    sf_context *ctx = view->ctx;
    sf_free(ctx, view->name);
    sf_free(ctx, view->file);
    sf_free(ctx, view->rgb);
    sf_free(ctx, view->weight);
    sf_pixel_cache_release(view->cache);
    sf_free(ctx, view);
}

sf_status sf_scene_create(sf_context *ctx, sf_scene **out) {
    sf_scene *scene = *out = sf_calloc(ctx, 1, sizeof *scene);
    if (!scene) return SF_ERR_MEMORY;
    scene->ctx = ctx;
    scene->next_id = 1;
    pthread_mutex_init(&scene->lock, NULL);
    return SF_OK;
}

void sf_scene_destroy(sf_scene **scene_pointer) {
    sf_scene *scene = *scene_pointer;
    if (!scene) return;
    for (size_t i = 0; i < scene->view_count; i++) sf_view_release(scene->views[i]);
    sf_free(scene->ctx, scene->views);
    sf_free(scene->ctx, scene->points);
    sf_free(scene->ctx, scene->point_colors);
    pthread_mutex_destroy(&scene->lock);
    sf_free(scene->ctx, scene);
    *scene_pointer = NULL;
}

int sf_lens_is_cropped(const sf_lens_note *lens) { return lens->seen - lens->kept >= 3; }

sf_status sf_scene_take_view(sf_scene *scene, sf_view *view) {
    pthread_mutex_lock(&scene->lock);
    sf_status status = sf_grow(scene->ctx, &scene->views, &scene->view_capacity, scene->view_count,
                               scene->view_count + 1, sizeof *scene->views);
    if (!status) {
        view->id = scene->next_id++;
        scene->views[scene->view_count++] = view;
    }
    pthread_mutex_unlock(&scene->lock);
    if (status) sf_view_release(view);
    return status;
}

static void copy_planar(const sf_pixels *pixels, sf_view *view) {
    size_t width = (size_t)view->camera.width, height = (size_t)view->camera.height;
    for (size_t y = 0; y < height; y++)
        for (size_t x = 0; x < width; x++)
            for (size_t ch = 0; ch < 3; ch++)
                view->rgb[(ch * height + y) * width + x] = pixels->rgb[y * pixels->stride + 3 * x + ch];
    if (view->weight) memcpy(view->weight, pixels->mask, width * height);
}

sf_status sf_scene_add_view(sf_scene *scene, const char *name, const sf_camera *camera,
                            const sf_pixels *pixels, sf_split split, uint32_t *id) {
    char made_up[32];
    const char *label = name ? name : "view";
    if (sf_camera_check(camera))
        return sf_fail(scene->ctx, SF_ERR_ARGUMENT,
                       "%s: camera: size, focal length or pose is out of range (%dx%d, fx %g, fy %g)", label,
                       (int)camera->width, (int)camera->height, camera->fx, camera->fy);
    if (!pixels || !pixels->rgb || pixels->stride / 3 < (size_t)camera->width)
        return sf_fail(scene->ctx, SF_ERR_ARGUMENT, "%s: pixels: missing, or a stride below 3 x width",
                       label);
    if (!name) {
        pthread_mutex_lock(&scene->lock);
        snprintf(made_up, sizeof made_up, "view-%u", scene->next_id);
        pthread_mutex_unlock(&scene->lock);
        name = made_up;
    }
    sf_view *view;
    sf_status status = sf_view_create(scene->ctx, name, camera, split, pixels->mask != NULL, &view);
    if (status) return status;
    copy_planar(pixels, view);
    sf_view_retain(view); /* another thread may remove it before its id is read */
    status = sf_scene_take_view(scene, view);
    if (!status && id) *id = view->id;
    sf_view_release(view);
    return status;
}

/* Index of a view; view_count: no such view. With the lock held. */
static size_t find(const sf_scene *scene, uint32_t id) {
    size_t i = 0;
    while (i < scene->view_count && scene->views[i]->id != id) i++;
    return i;
}

sf_status sf_scene_remove_view(sf_scene *scene, uint32_t id) {
    pthread_mutex_lock(&scene->lock);
    size_t i = find(scene, id);
    sf_view *view = i < scene->view_count ? scene->views[i] : NULL;
    if (view) {
        scene->view_count--;
        memmove(&scene->views[i], &scene->views[i + 1], (scene->view_count - i) * sizeof *scene->views);
    }
    pthread_mutex_unlock(&scene->lock);
    if (!view) return sf_fail(scene->ctx, SF_ERR_ARGUMENT, "id: no view %u in the scene", id);
    sf_view_release(view);
    return SF_OK;
}

/* Views never change: a new one with the same pixels replaces the old one. */
static sf_status copy_view(sf_view *from, const sf_camera *camera, sf_view **out) {
    size_t pixels = (size_t)camera->width * (size_t)camera->height;
    sf_status status = from->rgb
                           ? sf_view_create(from->ctx, from->name, camera, from->split, from->has_weight, out)
                           : sf_view_create_bare(from->ctx, from->name, camera, from->split, out);
    if (status) return status;
    sf_view *to = *out;
    to->id = from->id, to->lens = from->lens, to->masked = from->masked, to->alpha = from->alpha;
    to->has_weight = from->has_weight;
    if (from->cache) {
        to->cache = sf_pixel_cache_retain(from->cache);
        to->cached_at = from->cached_at, to->hidden = from->hidden;
        atomic_store(&to->hash, atomic_load(&from->hash));
    }
    if (to->rgb) memcpy(to->rgb, from->rgb, 3 * pixels);
    if (to->weight) memcpy(to->weight, from->weight, pixels);
    return SF_OK;
}

/* A view at another camera takes the place of the old one, which is released. */
static sf_status replace_view(sf_scene *scene, sf_view *old, const sf_camera *camera) {
    sf_view *new = NULL;
    uint32_t id = old->id;
    sf_status status = sf_camera_check(camera)
                           ? sf_fail(scene->ctx, SF_ERR_ARGUMENT,
                                     "pose: of view %u: not a rotation and a finite translation", id)
                           : copy_view(old, camera, &new);
    sf_view_release(old);
    if (status) return status;
    pthread_mutex_lock(&scene->lock);
    size_t i = find(scene, id);
    old = new;
    if (i < scene->view_count) old = scene->views[i], scene->views[i] = new;
    pthread_mutex_unlock(&scene->lock);
    sf_view_release(old); /* or the new one, if the view was removed meanwhile */
    return SF_OK;
}

sf_status sf_scene_set_pose(sf_scene *scene, uint32_t id, const double R_cw[9], const double t_cw[3]) {
    sf_view *old = sf_scene_retain_id(scene, id);
    if (!old) return sf_fail(scene->ctx, SF_ERR_ARGUMENT, "id: no view %u in the scene", id);
    sf_camera camera = old->camera;
    memcpy(camera.R_cw, R_cw, sizeof camera.R_cw);
    memcpy(camera.t_cw, t_cw, sizeof camera.t_cw);
    return replace_view(scene, old, &camera);
}

sf_status sf_scene_set_camera(sf_scene *scene, uint32_t id, const sf_camera *camera) {
    sf_view *old = sf_scene_retain_id(scene, id);
    if (!old) return sf_fail(scene->ctx, SF_ERR_ARGUMENT, "id: no view %u in the scene", id);
    return replace_view(scene, old, camera);
}

sf_view *sf_scene_retain_id(sf_scene *scene, uint32_t id) {
    pthread_mutex_lock(&scene->lock);
    size_t i = find(scene, id);
    sf_view *view = i < scene->view_count ? sf_view_retain(scene->views[i]) : NULL;
    pthread_mutex_unlock(&scene->lock);
    return view;
}

static sf_status retain_views(sf_scene *scene, int training, sf_view ***views, size_t *count) {
    pthread_mutex_lock(&scene->lock);
    *count = 0;
    *views = sf_alloc(scene->ctx, scene->view_count, sizeof **views);
    for (size_t i = 0; *views && i < scene->view_count; i++)
        if (!training || scene->views[i]->split == SF_SPLIT_TRAIN)
            (*views)[(*count)++] = sf_view_retain(scene->views[i]);
    pthread_mutex_unlock(&scene->lock);
    return *views ? SF_OK : SF_ERR_MEMORY;
}

sf_status sf_scene_retain_all(sf_scene *scene, sf_view ***views, size_t *count) {
    return retain_views(scene, 0, views, count);
}

sf_status sf_scene_retain_training(sf_scene *scene, sf_view ***views, size_t *count) {
    return retain_views(scene, 1, views, count);
}

void sf_scene_release_all(sf_scene *scene, sf_view **views, size_t count) {
    for (size_t i = 0; i < count; i++) sf_view_release(views[i]);
    sf_free(scene->ctx, views);
}

sf_status sf_scene_training_ids(sf_scene *scene, uint32_t **ids, size_t *count) {
    pthread_mutex_lock(&scene->lock);
    *count = 0;
    *ids = sf_alloc(scene->ctx, scene->view_count, sizeof **ids);
    for (size_t i = 0; *ids && i < scene->view_count; i++)
        if (scene->views[i]->split == SF_SPLIT_TRAIN) (*ids)[(*count)++] = scene->views[i]->id;
    pthread_mutex_unlock(&scene->lock);
    return *ids ? SF_OK : SF_ERR_MEMORY;
}

sf_status sf_scene_add_points(sf_scene *scene, size_t count, const float *xyz, const uint8_t *rgb) {
    pthread_mutex_lock(&scene->lock);
    size_t used = scene->point_count, need = used + count;
    sf_status status = need < used || need > SIZE_MAX / (3 * sizeof *xyz)
                           ? sf_fail(scene->ctx, SF_ERR_ARGUMENT, "count: %zu points are too many", count)
                           : SF_OK;
    if (!status)
        status = sf_grow(scene->ctx, &scene->points, &scene->point_capacity, used, need, 3 * sizeof *xyz);
    if (!status) status = sf_grow(scene->ctx, &scene->point_colors, &scene->color_capacity, used, need, 3);
    for (size_t i = 0; !status && i < count; i++) {
        const float *p = xyz + 3 * i;
        if (!isfinite(p[0]) || !isfinite(p[1]) || !isfinite(p[2])) {
            if (!scene->skipped_points++) scene->first_skipped_point = used + i;
            continue;
        }
        memcpy(&scene->points[3 * scene->point_count], p, 3 * sizeof *p);
        if (rgb)
            memcpy(&scene->point_colors[3 * scene->point_count], rgb + 3 * i, 3);
        else
            memset(&scene->point_colors[3 * scene->point_count], 128, 3);
        scene->point_count++;
    }
    pthread_mutex_unlock(&scene->lock);
    return status;
}

void sf_scene_get_origin(const sf_scene *scene, double origin[3]) {
    memcpy(origin, scene->origin, sizeof scene->origin);
}

sf_status sf_scene_set_origin(sf_scene *scene, const double origin[3]) {
    for (int k = 0; k < 3; k++)
        if (!isfinite(origin[k]))
            return sf_fail(scene->ctx, SF_ERR_ARGUMENT, "origin: %c: %g is not finite", "xyz"[k], origin[k]);
    memcpy(scene->origin, origin, sizeof scene->origin);
    return SF_OK;
}

sf_status sf_scene_get_view(sf_scene *scene, size_t index, sf_view_info *info) {
    pthread_mutex_lock(&scene->lock);
    size_t count = scene->view_count;
    if (index < count) {
        const sf_view *view = scene->views[index];
        *info = (sf_view_info){.id = view->id,
                               .name = view->name,
                               .split = view->split,
                               .camera = view->camera,
                               .has_mask = view->has_weight,
                               .lens = view->lens.model,
                               .undistorted = view->lens.undistorted,
                               .field_seen = view->lens.seen,
                               .field_kept = view->lens.kept,
                               .file = view->file};
    }
    pthread_mutex_unlock(&scene->lock);
    if (index < count) return SF_OK;
    return sf_fail(scene->ctx, SF_ERR_ARGUMENT, "index: view %zu of %zu", index, count);
}

size_t sf_scene_get_points(sf_scene *scene, size_t first, size_t capacity, float *xyz, uint8_t *rgb) {
    pthread_mutex_lock(&scene->lock);
    size_t left = first < scene->point_count ? scene->point_count - first : 0,
           n = left < capacity ? left : capacity;
    if (n && xyz) memcpy(xyz, scene->points + 3 * first, 3 * n * sizeof *xyz);
    if (n && rgb) memcpy(rgb, scene->point_colors + 3 * first, 3 * n);
    pthread_mutex_unlock(&scene->lock);
    return n;
}
