/* photo_masks.h - which pixels of a photo count: its mask, by the names of projects. */
#ifndef SF_SFM_PHOTO_MASKS_H
#define SF_SFM_PHOTO_MASKS_H

#include "../io/picture.h"

/* Lowers the photo's weights to those of its mask in the folder `masks` (NULL: none), if it has one.
 * SF_ERR_MEMORY; else where it fails, the picture's fault says why. */
sf_status sf_photo_mask_apply(sf_context *ctx, const char *masks, const char *name, sf_picture *picture);

/* The weights of a picture whose sides are divided by factor, [height][width]: the least of the pixels'.
 * NULL: no memory. */
uint8_t *sf_photo_mask_reduce(sf_context *ctx, const sf_picture *picture, int factor, int width, int height);

#endif
