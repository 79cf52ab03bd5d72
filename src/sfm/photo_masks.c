/* photo_masks.c - see photo_masks.h. */
#include "photo_masks.h"

#include "../io/mask.h"
#include "../io/paths.h"

sf_status sf_photo_mask_apply(sf_context *ctx, const char *masks, const char *name, sf_picture *picture) {
    char *mask = NULL;
    if (!masks) return SF_OK;
    sf_status status = sf_mask_look_for(ctx, masks, name, &mask);
    if (!status && mask) status = sf_mask_apply(ctx, mask, picture);
    sf_free(ctx, mask);
    return status;
}

uint8_t *sf_photo_mask_reduce(sf_context *ctx, const sf_picture *picture, int factor, int width, int height) {
    size_t n = (size_t)factor, stride = (size_t)picture->width;
    uint8_t *mask = sf_alloc(ctx, (size_t)width, (size_t)height);
    for (size_t y = 0; mask && y < (size_t)height; y++)
        for (size_t x = 0; x < (size_t)width; x++) {
            const uint8_t *at = picture->weight + y * n * stride + x * n;
            uint8_t least = 255;
            for (size_t j = 0; j < n; j++)
                for (size_t i = 0; i < n; i++)
                    if (at[j * stride + i] < least) least = at[j * stride + i];
            mask[y * (size_t)width + x] = least;
        }
    return mask;
}
