/* cholesky.h - Cholesky's factors of large matrices, on all threads. */
#ifndef SF_BASE_CHOLESKY_H
#define SF_BASE_CHOLESKY_H

#include <stddef.h>

#include "pool.h"

/* Rows and columns of a tile: sizes are multiples of it. */
enum { SF_CHOLESKY_TILE = 32 };

/* The least such multiple that is not below n. */
static inline size_t sf_cholesky_padded(size_t n) {
    return (n + SF_CHOLESKY_TILE - 1) / SF_CHOLESKY_TILE * SF_CHOLESKY_TILE;
}

/* A = L L^T in place, as sf_cholesky; n is a multiple of SF_CHOLESKY_TILE. panel [SF_CHOLESKY_TILE n] is
 * scratch. The same bytes for any number of threads. 0 if A is not positive definite. */
int sf_cholesky_tiled(struct sf_pool *pool, size_t n, double *A, double *panel);

#endif
