/* pixels.c - see pixels.h. */
#include "pixels.h"

#include <string.h>

static size_t pixels_of(const sf_view *view) {
    return (size_t)view->camera.width * (size_t)view->camera.height;
}

size_t sf_view_pixel_bytes(const sf_view *view) { return view->has_weight ? 4 : 3; }

static size_t bytes_of(const sf_view *view) { return sf_view_pixel_bytes(view) * pixels_of(view); }

static sf_status not_read(const sf_view *view) {
    return sf_fail(view->ctx, SF_ERR_ARGUMENT, "%s: its picture was not read (no_pixels)", view->name);
}

sf_status sf_view_open(const sf_view *view, sf_view_pixels *pixels) {
    *pixels = (sf_view_pixels){view->rgb, view->weight};
    if (view->rgb) return SF_OK;
    if (!view->cache) return not_read(view);
    sf_status status = sf_pixel_cache_open(view->cache, view->cached_at, bytes_of(view), &pixels->rgb);
    if (!status && view->has_weight) pixels->weight = pixels->rgb + 3 * pixels_of(view);
    return status;
}

void sf_view_close(const sf_view *view, sf_view_pixels *pixels) {
    if (view->cache && pixels->rgb) sf_pixel_cache_close(view->cache, view->cached_at);
    *pixels = (sf_view_pixels){NULL, NULL};
}

sf_status sf_view_read_rows(const sf_view *view, size_t first, size_t end, uint8_t *buffer,
                            sf_view_pixels *pixels) {
    size_t width = (size_t)view->camera.width, plane = pixels_of(view), n = (end - first) * width;
    *pixels = (sf_view_pixels){buffer, view->has_weight ? buffer + 3 * n : NULL};
    if (!view->rgb && !view->cache) return not_read(view);
    sf_status status = SF_OK;
    for (size_t c = 0; c < sf_view_pixel_bytes(view) && !status; c++) {
        if (view->rgb)
            memcpy(buffer + c * n, (c < 3 ? view->rgb + c * plane : view->weight) + first * width, n);
        else
            status = sf_pixel_cache_peek(view->cache, view->cached_at, c * plane + first * width,
                                         buffer + c * n, n);
    }
    return status;
}

sf_status sf_view_weight(const sf_view *view, size_t x, size_t y, uint8_t *weight) {
    size_t at = y * (size_t)view->camera.width + x;
    *weight = 255;
    if (!view->has_weight) return SF_OK;
    if (view->weight) *weight = view->weight[at];
    if (view->weight) return SF_OK;
    if (!view->cache) return not_read(view);
    return sf_pixel_cache_peek(view->cache, view->cached_at, 3 * pixels_of(view) + at, weight, 1);
}

sf_status sf_view_color(const sf_view *view, size_t x, size_t y, uint8_t rgb[3]) {
    size_t at = y * (size_t)view->camera.width + x, plane = pixels_of(view);
    if (!view->rgb && !view->cache) return not_read(view);
    sf_status status = SF_OK;
    for (size_t c = 0; c < 3 && !status; c++)
        if (view->rgb)
            rgb[c] = view->rgb[c * plane + at];
        else
            status = sf_pixel_cache_peek(view->cache, view->cached_at, c * plane + at, &rgb[c], 1);
    return status;
}

/* Each value of a pixel is on a page of its own. */
int sf_view_is_worth_opening(const sf_view *view, size_t pixels) {
    const size_t page = 4096, values = view->has_weight ? 4 : 3;
    return view->rgb || pixels * values * page > bytes_of(view);
}

void sf_view_expect(const sf_view *view) {
    if (view->cache) sf_pixel_cache_expect(view->cache, view->cached_at, bytes_of(view));
}

sf_status sf_view_move_out(sf_view *view, sf_pixel_cache *cache) {
    uint64_t hash;
    sf_status status = sf_view_hash(view, &hash); /* while they are at hand */
    view->hidden = sf_view_is_hidden(view);
    if (!status)
        status = sf_pixel_cache_add(cache, view->rgb, view->weight, pixels_of(view), &view->cached_at);
    if (status) return status;
    sf_free(view->ctx, view->rgb);
    sf_free(view->ctx, view->weight);
    view->rgb = view->weight = NULL;
    view->cache = sf_pixel_cache_retain(cache);
    return SF_OK;
}

int sf_scene_is_unread(sf_scene *scene) {
    int unread = 0;
    pthread_mutex_lock(&scene->lock);
    for (size_t i = 0; i < scene->view_count; i++) unread |= !scene->views[i]->rgb && !scene->views[i]->cache;
    pthread_mutex_unlock(&scene->lock);
    return unread;
}

uint64_t sf_scene_missing_bytes(sf_scene *scene, uint64_t budget) {
    uint64_t unread = 0, largest = 0, missing = 0;
    sf_pixel_cache *cache = NULL;
    pthread_mutex_lock(&scene->lock);
    for (size_t i = 0; i < scene->view_count; i++) {
        const sf_view *v = scene->views[i];
        if (v->cache) cache = v->cache;
        if (v->rgb || v->cache) continue;
        unread += bytes_of(v);
        if (bytes_of(v) > largest) largest = bytes_of(v);
    }
    if (cache) missing = sf_pixel_cache_missing(cache);
    pthread_mutex_unlock(&scene->lock);
    if (!sf_pixels_exceed((double)unread, (double)budget)) return unread + missing;
    return sf_pixel_buffers((double)budget, (double)largest) * largest + missing;
}

sf_status sf_scene_get_pixels(sf_scene *scene, uint32_t id, float *rgb, float *weight) {
    sf_view *view = sf_scene_retain_id(scene, id);
    if (!view) return sf_fail(scene->ctx, SF_ERR_ARGUMENT, "id: no view %u in the scene", id);
    sf_view_pixels p;
    sf_status status = sf_view_open(view, &p);
    size_t pixels = pixels_of(view);
    for (size_t i = 0; i < pixels && !status; i++) {
        for (size_t ch = 0; rgb && ch < 3; ch++) rgb[3 * i + ch] = (float)p.rgb[ch * pixels + i] / 255.0f;
        if (weight) weight[i] = p.weight ? (float)p.weight[i] / 255.0f : 1.0f;
    }
    if (!status) sf_view_close(view, &p);
    sf_view_release(view);
    return status;
}
