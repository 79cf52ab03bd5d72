/* frame_pictures.h - where the pictures of transforms.json are, and how large those are that it names. */
#ifndef SF_IO_FRAME_PICTURES_H
#define SF_IO_FRAME_PICTURES_H

#include "dataset.h"

/* The folder that stands for the images/ of the names: `wanted`, else NULL, which is images/ itself, else,
 * where that is missing, the largest of images_2, images_4, images_8 that exists (logged). */
void sf_frame_images(sf_context *ctx, const char *folder, const char *wanted, const char **images);

/* Completes the path of an entry, which is folder/NAME, by an ending, and puts `images` (may be NULL) in
 * place of images/. An entry without a size gets that of the picture that its name says, as lengths of the
 * lens are in its pixels; 0 if that cannot be read. *named: whether the entry's name begins with images/. */
sf_status sf_frame_find_picture(sf_context *ctx, const char *folder, const char *images, sf_entry *e,
                                int *named);

#endif
