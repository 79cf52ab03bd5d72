/* mask_folder.c - see mask_folder.h. */
#include "mask_folder.h"

#include <stdio.h>

#include "../io/mask.h"
#include "../io/paths.h"

#include <splatfit/sfm.h>

/* Photos that have a mask in a folder. */
static sf_status count_masks(sf_context *ctx, const char *masks, const sf_photo_list *list, size_t *count) {
    *count = 0;
    for (size_t i = 0; i < list->count; i++) {
        char *mask = NULL;
        if (sf_mask_look_for(ctx, masks, list->photos[i].name, &mask)) return SF_ERR_MEMORY;
        *count += mask != NULL;
        sf_free(ctx, mask);
    }
    return SF_OK;
}

/* Takes the folder if it is there and holds masks of the photos. */
static sf_status try_folder(sf_context *ctx, char *masks, sf_photo_list *list) {
    size_t count = 0;
    sf_status status = masks ? SF_OK : SF_ERR_MEMORY;
    if (!status && sf_is_folder(masks)) status = count_masks(ctx, masks, list, &count);
    if (count) {
        sf_log(ctx, SF_LOG_INFO, "%s: masks of %zu of %zu photos: black is ignored", masks, count,
               list->count);
        list->masks = masks;
        return status;
    }
    sf_free(ctx, masks);
    return status;
}

sf_status sf_photo_masks_find(sf_context *ctx, const char *folder, const char *wanted, sf_photo_list *list) {
    if (wanted) {
        sf_status status = try_folder(ctx, sf_text_copy(ctx, wanted), list);
        if (status || list->masks) return status;
        return sf_fail(ctx, SF_ERR_IO, "%s: no folder with a mask of a photo: looked for %s.png and its like",
                       wanted, list->photos[0].name);
    }
    sf_status status = try_folder(ctx, sf_path_join(ctx, folder, "masks"), list);
    if (status || list->masks) return status;
    return try_folder(ctx, sf_path_join(ctx, folder, "../masks"), list);
}

sf_status sf_sfm_find_masks(sf_context *ctx, const char *photos, char *masks, size_t size) {
    sf_photo_list list;
    *masks = 0;
    sf_status status = sf_photos_list(ctx, photos, &list);
    if (status) return status;
    status = sf_photo_masks_find(ctx, photos, NULL, &list);
    int length = list.masks ? snprintf(masks, size, "%s", list.masks) : 0;
    if (!status && (size_t)length >= size)
        status = sf_fail(ctx, SF_ERR_ARGUMENT, "%s: is too long", list.masks);
    sf_photos_free(ctx, &list);
    return status;
}
