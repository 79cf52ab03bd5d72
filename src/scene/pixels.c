/* pixels.c - see pixels.h. */
#include "pixels.h"

sf_status sf_view_open(const sf_view *view, sf_view_pixels *pixels) {
    *pixels = (sf_view_pixels){view->rgb, view->weight};
    return view->rgb
               ? SF_OK
               : sf_fail(view->ctx, SF_ERR_ARGUMENT, "%s: its picture was not read (no_pixels)", view->name);
}

void sf_view_close(const sf_view *view, sf_view_pixels *pixels) {
    (void)view;
    *pixels = (sf_view_pixels){NULL, NULL};
}

uint8_t sf_view_pixel(const sf_view *view, size_t x, size_t y, uint8_t rgb[3]) {
    size_t width = (size_t)view->camera.width, pixels = width * (size_t)view->camera.height;
    size_t at = y * width + x;
    for (size_t k = 0; k < 3; k++) rgb[k] = view->rgb[k * pixels + at];
    return view->weight ? view->weight[at] : 255;
}

sf_status sf_scene_get_pixels(sf_scene *scene, uint32_t id, float *rgb, float *weight) {
    sf_view *view = sf_scene_retain_id(scene, id);
    if (!view) return sf_fail(scene->ctx, SF_ERR_ARGUMENT, "id: no view %u in the scene", id);
    sf_view_pixels p;
    sf_status status = sf_view_open(view, &p);
    size_t pixels = (size_t)view->camera.width * (size_t)view->camera.height;
    for (size_t i = 0; i < pixels && !status; i++) {
        for (size_t ch = 0; rgb && ch < 3; ch++) rgb[3 * i + ch] = (float)p.rgb[ch * pixels + i] / 255.0f;
        if (weight) weight[i] = p.weight ? (float)p.weight[i] / 255.0f : 1.0f;
    }
    if (!status) sf_view_close(view, &p);
    sf_view_release(view);
    return status;
}
