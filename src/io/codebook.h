/* codebook.h - scalar and vector quantisation: few values, or few vectors, that stand for many. */
#ifndef SF_IO_CODEBOOK_H
#define SF_IO_CODEBOOK_H

#include "../base/context.h"

enum { SF_CODEBOOK = 256 };

/* 256 ascending levels for n >= 1 finite values, by Lloyd's algorithm from levels as dense as the cube root
 * of the values' density. SF_ERR_MEMORY. */
sf_status sf_codebook_make(sf_context *ctx, const float *values, size_t n, float levels[SF_CODEBOOK]);

/* The number of the nearest level. */
uint8_t sf_codebook_nearest(const float levels[SF_CODEBOOK], float value);

typedef struct sf_vectors {
    const float *values; /* [n][dims] */
    size_t n, dims;
} sf_vectors;

/* At most `most` (>= 1) vectors that stand for these: the set with the greatest squared error is
 * split by two-means until there are so many. Writes the centroids [most][dims], which one stands for each
 * vector to labels [n], and how many there are. The same for any number of threads. SF_ERR_MEMORY. */
sf_status sf_palette_make(sf_context *ctx, const sf_vectors *vectors, size_t most, float *centroids,
                          uint32_t *labels, size_t *made);

#endif
