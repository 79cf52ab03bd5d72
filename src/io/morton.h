/* morton.h - Gaussians in the order of a curve through space. */
#ifndef SF_IO_MORTON_H
#define SF_IO_MORTON_H

#include <splatfit/model.h>
#include <stdint.h>

/* Numbers of a model's Gaussians: those of a higher class first (classes [count], 0..15; NULL: all the same),
 * within one along the Z-curve (Morton's) through their means, so that neighbours in the list are mostly
 * neighbours in space. *order [count] is sf_free'd by the caller, NULL on failure. */
sf_status sf_morton_order(const sf_model *model, const uint8_t *classes, uint32_t **order);

#endif
