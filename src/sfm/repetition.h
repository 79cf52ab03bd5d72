/* repetition.h - maps of places where things repeat: windows of a facade, tiles (README, S.8). */
#ifndef SF_SFM_REPETITION_H
#define SF_SFM_REPETITION_H

#include "mapper.h"

/* Pairs of pictures that follow one another by number. */
typedef struct sf_order {
    const sf_matched_pair *pairs;
    size_t count;
    int is_known; /* the map is to be made of such pairs as it is: there is nothing to try beside it */
} sf_order;

/* As sf_mapper_run. Where more than a tenth of the matches contradict others, a map is made of the pairs in
 * order as well, and taken if it has nearly all pictures and its matches agree. The log says so in either
 * case. */
sf_status sf_map_photos(sf_context *ctx, const sf_map_input *input, const sf_order *order,
                        const sf_map_options *options, sf_mapper_progress progress, void *user, sf_map **map);

#endif
