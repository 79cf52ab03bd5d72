/* mask_folder.h - where the masks of a folder of photos are. */
#ifndef SF_SFM_MASK_FOLDER_H
#define SF_SFM_MASK_FOLDER_H

#include "photos.h"

/* Sets list->masks to the folder `wanted`, or, where that is NULL, to masks in the photos' folder or beside
 * it, if one of its masks fits a photo's name (src/io/mask.h). SF_ERR_IO: the folder that is wanted is not
 * there, or holds no photo's mask; SF_ERR_MEMORY. */
sf_status sf_photo_masks_find(sf_context *ctx, const char *folder, const char *wanted, sf_photo_list *list);

#endif
