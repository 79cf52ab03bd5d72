/* pixels.h - the pixels of a view, for who reads them. */
#ifndef SF_SCENE_PIXELS_H
#define SF_SCENE_PIXELS_H

#include "scene.h"

/* Shapes as in sf_view. */
typedef struct sf_view_pixels {
    const uint8_t *rgb, *weight; /* weight NULL: all have full weight */
} sf_view_pixels;

/* The pixels of a view, valid until sf_view_close. Safe from any thread. SF_ERR_ARGUMENT: they were not read
 * (sf_load_options.no_pixels). */
sf_status sf_view_open(const sf_view *view, sf_view_pixels *pixels);
void sf_view_close(const sf_view *view, sf_view_pixels *pixels);

/* One pixel of a view whose pixels were read: its colour; returns its weight, 255 where all have full weight.
 */
uint8_t sf_view_pixel(const sf_view *view, size_t x, size_t y, uint8_t rgb[3]);

#endif
