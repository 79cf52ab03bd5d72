/* repetition.c - see repetition.h. */
#include "repetition.h"

/* Windows or tiles that look the same are matched across different places, and the map is wrong without large
 * errors. Such matches contradict others (S.23): 17 % and more where a facade's map was wrong, at most 6 %
 * where maps were right. */
#define REPETITION 0.1
#define AGREEMENT  0.03

static double contradictions(const sf_map *map) {
    const sf_tracks *t = &map->tracks;
    return t->matches ? (double)t->contradictions / (double)t->matches : 0;
}

static void tell_of_order(const sf_map *first, const sf_map *in_order) {
    sf_log(first->ctx, SF_LOG_WARNING,
           "photos: %.0f %% of the matches contradict others: things look the same (windows, tiles). So each "
           "photo was "
           "matched with the next one by name alone, as --sequence 1 does (%.1f %% contradict): if the "
           "photos were not "
           "taken in that order, or these things do not differ at all, cameras may still be in a wrong "
           "place: look at "
           "them with \"splatfit view\"",
           100 * contradictions(first), 100 * contradictions(in_order));
}

static void warn(const sf_map *map) {
    sf_log(map->ctx, SF_LOG_WARNING,
           "photos: %.0f %% of the matches contradict others: things that look the same (windows, tiles) may "
           "have put "
           "cameras in a wrong place: look at them with \"splatfit view\"; name the photos in the order in "
           "which they "
           "were taken",
           100 * contradictions(map));
}

sf_status sf_map_photos(sf_context *ctx, const sf_map_input *input, const sf_order *order,
                        const sf_map_options *options, sf_mapper_progress progress, void *user,
                        sf_map **map) {
    sf_map_input pairs_in_order = *input;
    sf_map *other = NULL;
    sf_status status = sf_mapper_run(ctx, input, options, progress, user, map);
    if (status || contradictions(*map) <= REPETITION) return status;
    pairs_in_order.pairs = order->pairs, pairs_in_order.pair_count = order->count;
    if (!order->is_known) status = sf_mapper_run(ctx, &pairs_in_order, options, progress, user, &other);
    if (status == SF_ERR_EMPTY) status = SF_OK;
    if (other && 10 * other->placed_count >= 9 * (*map)->placed_count && contradictions(other) < AGREEMENT) {
        sf_map *first = *map;
        tell_of_order(first, other);
        *map = other, other = first;
    } else if (!status) {
        warn(*map);
    }
    sf_map_destroy(&other);
    if (status) sf_map_destroy(map);
    return status;
}
