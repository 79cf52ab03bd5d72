/* morton.h - points in the order of a curve through space. */
#ifndef SF_SCENE_MORTON_H
#define SF_SCENE_MORTON_H

#include "../base/context.h"

/* Numbers of points xyz [n][3]: those of a higher class first (classes [n], 0..15; NULL: all the same),
 * within one along the Z-curve (Morton's) through them, so that neighbours in the list are mostly neighbours
 * in space. *order [n] is sf_free'd by the caller, NULL on failure (SF_ERR_MEMORY). */
sf_status sf_morton_order(sf_context *ctx, const float *xyz, size_t n, const uint8_t *classes,
                          uint32_t **order);

#endif
