/* curve.h - sorts points along a space-filling curve. */
#ifndef SF_SCENE_CURVE_H
#define SF_SCENE_CURVE_H

#include "../base/context.h"

/* Sorts the indices of points xyz [n][3]: higher classes first (classes [n], 0..15; NULL: all the same),
 * within a class along Hilbert's curve, so that neighbours in the list are mostly neighbours in space. *order
 * [n] is sf_free'd by the caller, NULL on failure (SF_ERR_MEMORY). */
sf_status sf_curve_order(sf_context *ctx, const float *xyz, size_t n, const uint8_t *classes,
                         uint32_t **order);

#endif
