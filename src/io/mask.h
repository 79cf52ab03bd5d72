/* mask.h - which pixels of a picture count: masks and alpha channels, in one place for all kinds of projects.
 *
 * In a mask black is ignored and white counts; grey counts in part. In one without a value of 128 or more, as
 * of 0 and 1, all but 0 counts, as in COLMAP. In an alpha channel 0 is ignored and the largest value counts,
 * or, blended, 0 shows the background and the largest value the picture.
 */
#ifndef SF_IO_MASK_H
#define SF_IO_MASK_H

#include "dataset.h"

/* Gives each entry without a mask the one in the folder that the options name, or, where they
 * name none, in masks/. For the picture images/a/b.jpg those are, in this order, a/b.jpg.png, a/b.png,
 * a/b.jpg, a/b.jpeg, a/b_mask.png or .jpg, a/b.jpg.mask.png and a/b.mask.png, with images/ in front or
 * without. Takes all masks away where the options want none. SF_ERR_IO: the folder that the options name is
 * not there, or holds no picture's mask. */
sf_status sf_masks_find(sf_project *project, const sf_load_options *options);

/* The mask of the picture `name` in a folder, by the same names: *mask is sf_free'd by the caller, and left
 * alone where there is none. SF_ERR_MEMORY. */
sf_status sf_mask_look_for(sf_context *ctx, const char *folder, const char *name, char **mask);

/* Lowers a picture's weights to the mask's. A mask of another size is scaled (each pixel takes the nearest
 * one's) where its sides are in the same ratio to within a pixel. On failure the picture's fault is set. */
sf_status sf_mask_apply(sf_context *ctx, const char *path, sf_picture *picture);

/* Takes the weight of all pixels that are less than `border` pixels from a side. SF_ERR_MEMORY. */
sf_status sf_mask_border(sf_context *ctx, int border, sf_picture *picture);

/* Whether the mask's header promises one that sf_mask_apply takes; else the picture's fault is set. */
sf_status sf_mask_look(sf_context *ctx, const char *path, sf_picture *picture);

/* Makes of a picture's alpha channel what the options say, `blends` where they leave it open. */
void sf_alpha_apply(sf_context *ctx, const sf_load_options *options, int blends, sf_picture *picture);
/* Whether the channel then gives the picture's weights. */
int sf_alpha_is_weight(const sf_load_options *options, int blends);
/* The same in words. */
const char *sf_alpha_says(const sf_load_options *options, int blends);

#endif
