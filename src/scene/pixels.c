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
