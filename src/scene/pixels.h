/* pixels.h - the pixels of a view, for who reads them: in memory, or from the file that they were moved to.
 */
#ifndef SF_SCENE_PIXELS_H
#define SF_SCENE_PIXELS_H

#include "scene.h"

/* Shapes as in sf_view. */
typedef struct sf_view_pixels {
    const uint8_t *rgb, *weight; /* weight NULL: all have full weight */
} sf_view_pixels;

/* The pixels of a view, valid until sf_view_close. Safe from any thread. SF_ERR_ARGUMENT: they were not read
 * (sf_load_options.no_pixels). Of a view whose pixels are in a file also SF_ERR_IO, SF_ERR_MEMORY. */
sf_status sf_view_open(const sf_view *view, sf_view_pixels *pixels);
void sf_view_close(const sf_view *view, sf_view_pixels *pixels);

/* Copies rows first .. end-1 of a view to a buffer of as much room as those have in the planes of a view of
 * end-first rows, which *pixels then is. Errors as sf_view_open. */
sf_status sf_view_read_rows(const sf_view *view, size_t first, size_t end, uint8_t *buffer,
                            sf_view_pixels *pixels);
/* Bytes of a pixel: 3, or 4 with its weight. */
size_t sf_view_pixel_bytes(const sf_view *view);

/* The weight of a single pixel, 255 where all have full weight; its colour. Errors as sf_view_open. Where the
 * pixels are in a file each reads it: for more than a few the view is opened. */
sf_status sf_view_weight(const sf_view *view, size_t x, size_t y, uint8_t *weight);
sf_status sf_view_color(const sf_view *view, size_t x, size_t y, uint8_t rgb[3]);
/* Whether it is better to open a view than to read so many single pixels of it. */
int sf_view_is_worth_opening(const sf_view *view, size_t pixels);

/* Has the system read the pixels ahead, where they are in a file: the view will be opened soon. */
void sf_view_expect(const sf_view *view);

/* Moves the pixels of a view that nobody else has yet to the file. Errors as sf_pixel_cache_add. */
sf_status sf_view_move_out(sf_view *view, sf_pixel_cache *cache);

#endif
