/* picture_memory.h - where the pixels of a project are kept, and how many pictures are read at once. */
#ifndef SF_IO_PICTURE_MEMORY_H
#define SF_IO_PICTURE_MEMORY_H

#include "../scene/pixel_cache.h"
#include "dataset.h"

/* The lens for a picture whose sides are those of the entry times x and y. */
sf_optics sf_scaled_lens(const sf_entry *entry, double x, double y);

typedef struct sf_picture_plan {
    sf_pixel_cache *cache; /* of pixels that memory does not hold; NULL: they stay in memory */
    size_t at_once;        /* pictures that may be read at the same time */
} sf_picture_plan;

/* Compares what the pictures take with options->memory. The caller releases the cache. SF_ERR_MEMORY: not
 * even a few fit; SF_ERR_IO: too many for the memory, and no disk takes them. */
sf_status sf_plan_pictures(const sf_project *project, const sf_load_options *options, sf_picture_plan *plan);

#endif
