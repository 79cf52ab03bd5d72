/* fingerprint.c - hashes by which a scene is recognised. */
#include "scene.h"

#include <string.h>

#include "../base/hash.h"
#include "pixels.h"

/* Views never change, so the hash is made once. If two threads make it, it is the same. */
sf_status sf_view_hash(sf_view *view, uint64_t *hash) {
    *hash = atomic_load(&view->hash);
    if (*hash) return SF_OK;
    sf_view_pixels p;
    sf_status status = sf_view_open(view, &p);
    if (status) return status;
    size_t pixels = (size_t)view->camera.width * (size_t)view->camera.height;
    *hash = sf_hash(SF_HASH_SEED, p.rgb, 3 * pixels);
    if (p.weight) *hash = sf_hash(*hash, p.weight, pixels);
    *hash += !*hash;
    atomic_store(&view->hash, *hash);
    sf_view_close(view, &p);
    return SF_OK;
}

static uint64_t add_number(uint64_t hash, uint64_t value) {
    uint8_t bytes[8];
    for (int i = 0; i < 8; i++) bytes[i] = (uint8_t)(value >> (8 * i));
    return sf_hash(hash, bytes, sizeof bytes);
}

static uint64_t add_double(uint64_t hash, double value) {
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    return add_number(hash, bits);
}

static uint64_t add_view(uint64_t hash, const sf_view *view, uint64_t of_pixels) {
    const sf_camera *c = &view->camera;
    const double lens[] = {c->fx, c->fy, c->cx, c->cy};
    hash = sf_hash(hash, view->name, strlen(view->name));
    hash = add_number(hash, (uint64_t)view->split);
    hash = add_number(hash, (uint64_t)c->width);
    hash = add_number(hash, (uint64_t)c->height);
    for (int k = 0; k < 4; k++) hash = add_double(hash, lens[k]);
    for (int k = 0; k < 9; k++) hash = add_double(hash, c->R_cw[k]);
    for (int k = 0; k < 3; k++) hash = add_double(hash, c->t_cw[k]);
    return add_number(hash, of_pixels);
}

static uint64_t add_points(uint64_t hash, sf_scene *scene) {
    pthread_mutex_lock(&scene->lock);
    for (size_t i = 0; i < 3 * scene->point_count; i++) {
        uint32_t bits;
        memcpy(&bits, &scene->points[i], sizeof bits);
        hash = add_number(hash, (uint64_t)scene->point_colors[i] << 32 | bits);
    }
    pthread_mutex_unlock(&scene->lock);
    return hash;
}

sf_status sf_scene_fingerprint(sf_scene *scene, uint64_t *fingerprint) {
    sf_view **views;
    size_t count;
    sf_status status = sf_scene_retain_all(scene, &views, &count);
    if (status) return status;
    uint64_t hash = SF_HASH_SEED, of_pixels;
    for (size_t i = 0; i < count && !status; i++) {
        status = sf_view_hash(views[i], &of_pixels);
        if (!status) hash = add_view(hash, views[i], of_pixels);
    }
    if (!status) *fingerprint = add_points(hash, scene);
    sf_scene_release_all(scene, views, count);
    return status;
}
