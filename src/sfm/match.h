/* match.h - which features of two photos are the same (README.md, S.7). */
#ifndef SF_SFM_MATCH_H
#define SF_SFM_MATCH_H

#include "features.h"

/* Feature a of the first photo is feature b of the second. */
typedef struct sf_match {
    uint32_t a, b;
} sf_match;

/* By a, ascending. Free with sf_matches_free. */
typedef struct sf_matches {
    size_t count;
    sf_match *items;
} sf_matches;

typedef struct sf_match_options {
    double ratio; /* of the distances to the best and to the second best, which must be below it; above 0 */
    double distance; /* greatest between descriptors, of 0..2 where their length is 1 */
} sf_match_options;

sf_match_options sf_match_options_default(void);

/* Matches features that are each other's best, on the calling thread. Of equal ones the first is the best.
 * Where the other photo has one feature alone, the ratio is not asked. The result does not depend on level or
 * machine. SF_ERR_MEMORY: matches is empty. */
sf_status sf_match_pair(sf_context *ctx, const sf_features *a, const sf_features *b,
                        const sf_match_options *options, sf_matches *matches);

/* Photos first and second of a list. */
typedef struct sf_photo_pair {
    uint32_t first, second;
} sf_photo_pair;

/* Matches `count` pairs, on all threads of the context. On failure all of `matches` ([count]) are empty. */
sf_status sf_match_all(sf_context *ctx, const sf_features *photos, const sf_photo_pair *pairs, size_t count,
                       const sf_match_options *options, sf_matches *matches);

void sf_matches_free(sf_context *ctx, sf_matches *matches);

#endif
