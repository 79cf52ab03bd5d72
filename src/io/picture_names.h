/* picture_names.h - which files of a folder are pictures, by their names. */
#ifndef SF_IO_PICTURE_NAMES_H
#define SF_IO_PICTURE_NAMES_H

#include <stddef.h>

/* .jpg, .jpeg and .png are read. */
int sf_is_picture_name(const char *name);
/* What a folder holds of pictures of the kinds that are not read (HEIC, WebP, TIFF, raw files): how many of
 * the most frequent ending, which is written to `ending` with its dot. */
enum { SF_ENDING = 8 };
size_t sf_count_unread_pictures(const char *folder, char ending[SF_ENDING]);

#endif
