/* pairs.h - which pairs of photos are matched (README.md, S.8). */
#ifndef SF_SFM_PAIRS_H
#define SF_SFM_PAIRS_H

#include "match.h"

/* Told while photos are compared; what it returns, if not 0, ends the work with SF_ERR_CANCELLED. */
typedef int (*sf_pairs_done)(void *user, size_t photos);

typedef struct sf_pair_options {
    size_t sequence;    /* each photo with so many next ones of the list, and no others; 0: not so */
    size_t all;         /* of so many photos at most, every pair */
    size_t few;         /* of more: the features of each photo, of the largest scales, that are compared; */
    size_t partners;    /* the other photos that share most of them with a photo, */
    size_t neighbours;  /* and those so near to it in the list are its partners */
    sf_pairs_done done; /* NULL: nobody is told */
    void *user;         /* for done */
} sf_pair_options;

/* 200 photos, 128 features, 40 partners, 3 neighbours on each side. */
sf_pair_options sf_pair_options_default(void);

/* Lists the pairs of `count` photos that are to be matched, first < second, by first and then second; *pairs
 * is sf_free'd by the caller. On all threads; the same list for any number of them.
 * SF_ERR_MEMORY, SF_ERR_CANCELLED: *pairs is NULL. */
sf_status sf_pairs_choose(sf_context *ctx, const sf_features *photos, size_t count,
                          const sf_pair_options *options, sf_photo_pair **pairs, size_t *pair_count);

/* 1. Parts of it. */

/* The descriptors of the `most` features of the largest scales, ascending by index where scales are equal;
 * points is NULL. Free with sf_features_free. SF_ERR_MEMORY: few is empty. */
sf_status sf_pairs_take_few(sf_context *ctx, const sf_features *features, size_t most, sf_features *few);

/* Marks in chosen [count][count], symmetric, the `partners` of each photo that have the greatest scores
 * [count][count], of equal ones those nearest in the list, none with a score of 0; and the neighbours.
 * order [count] is for its own use. */
void sf_pairs_mark(const uint16_t *scores, size_t count, size_t partners, size_t neighbours, uint32_t *order,
                   uint8_t *chosen);

#endif
