/* colmap_files.h - which of COLMAP's files a folder holds. */
#ifndef SF_IO_COLMAP_FILES_H
#define SF_IO_COLMAP_FILES_H

#include <stdint.h>

/* Longer files are refused. */
#define SF_COLMAP_MAX_BYTES ((uint64_t)1 << 36)

/* The names of a file in its two kinds. */
typedef struct sf_colmap_names {
    const char *binary, *text;
} sf_colmap_names;

extern const sf_colmap_names sf_colmap_cameras, sf_colmap_images, sf_colmap_points;

/* The name of the file that the folder holds, binary before text; NULL: neither. */
const char *sf_colmap_file_in(const char *folder, const sf_colmap_names *names);

/* Whether the folder holds cameras or images. Part of a model is enough: what is missing is named when it is
 * read. */
int sf_colmap_holds_model(const char *folder);

/* Whether a path of one of these files is that of a text file. */
int sf_colmap_is_text(const char *path);

#endif
