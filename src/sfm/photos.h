/* photos.h - the photos of a folder, and the features of each. */
#ifndef SF_SFM_PHOTOS_H
#define SF_SFM_PHOTOS_H

#include "features.h"

enum { SF_PHOTO_FAULT = 192 };

/* A photo on its way through the stages. */
typedef struct sf_photo_file {
    char *name;                 /* within the folder, with the folders in it that lead there */
    int width, height;          /* px, as the file has it */
    int factor;                 /* sides were divided by this before features were looked for */
    sf_features features;       /* positions in px of the file */
    uint8_t (*colors)[3];       /* [features]: sRGB bytes */
    char fault[SF_PHOTO_FAULT]; /* why the photo cannot be read; "": it can */
} sf_photo_file;

typedef struct sf_photo_list {
    sf_photo_file *photos; /* by name, numbers in it by value: 9 before 10 */
    size_t count;
    char *masks; /* the folder of their masks; NULL: all pixels count */
} sf_photo_list;

/* Lists the photos of a folder (photo_folder.h) in that order, and logs that it has pictures that are not
 * read. SF_ERR_IO; SF_ERR_EMPTY: it has none; SF_ERR_MEMORY. */
sf_status sf_photos_list(sf_context *ctx, const char *folder, sf_photo_list *list);
/* Refuses photos that take more than `memory` bytes of the whole process (0: 4/5 of what is free) until their
 * cameras are found, by the sizes in their headers: SF_ERR_MEMORY, with what to do. */
sf_status sf_photos_check_memory(sf_context *ctx, const char *folder, int side,
                                 const sf_features_options *options, uint64_t memory,
                                 const sf_photo_list *list);
void sf_photos_free(sf_context *ctx, sf_photo_list *list);

/* Reads each photo, reduced so that no side is longer than `side`, and finds its features; on all threads,
 * one photo a thread at a time. done (may be NULL) is told after each; what it returns, if not 0, ends the
 * work with SF_ERR_CANCELLED. Photos that cannot be read have a fault. SF_ERR_MEMORY. */
typedef int (*sf_photos_done)(void *user, size_t photos);
sf_status sf_photos_find_features(sf_context *ctx, const char *folder, int side,
                                  const sf_features_options *options, sf_photos_done done, void *user,
                                  sf_photo_list *list);

#endif
