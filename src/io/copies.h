/* copies.h - files with the same content, told by their sizes and their ends. */
#ifndef SF_IO_COPIES_H
#define SF_IO_COPIES_H

#include "dataset.h"

/* What tells two packed files apart, pictures or videos: they have no change that leaves both ends and the
 * size as they were. All zero but for the hash: the file cannot be read. */
typedef struct sf_file_mark {
    uint64_t size, hash; /* bytes; of up to 64 KB at each end */
} sf_file_mark;

sf_file_mark sf_mark_file(const char *path);

/* Warns where pictures that are held out are copies of training pictures: their quality says nothing of new
 * views. SF_ERR_MEMORY. */
sf_status sf_warn_of_copies(const sf_project *project);

#endif
