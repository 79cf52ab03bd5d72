/* reasons.c - see reasons.h. */
#include "reasons.h"

#include "../base/statistics.h"

/* Features of a photo in the median; 0: there is no memory to tell. */
static double usual_features(const sf_reconstruction *r, int of_placed) {
    double *counts = sf_alloc(r->ctx, r->list.count + 1, sizeof *counts);
    size_t n = 0;
    for (size_t i = 0; counts && i < r->list.count; i++)
        if (!*r->list.photos[i].fault && (!of_placed || r->map->pictures[i].is_placed))
            counts[n++] = (double)r->list.photos[i].features.count;
    double median = n ? sf_median(counts, n) : 0;
    sf_free(r->ctx, counts);
    return median;
}

const char *sf_photo_why_not(const sf_reconstruction *r, size_t index) {
    const double few = 0.35;
    const sf_photo_file *photo = &r->list.photos[index];
    const sf_map_picture *picture = &r->map->pictures[index];
    size_t matched = 0, least = r->map->options.least_seen;
    if (*photo->fault) return photo->fault;
    if (picture->is_elsewhere) return "shows another place, which no photo connects with this one";
    if (photo->features.count < least) return "too few features: blurred, masked or without texture";
    if ((double)photo->features.count < few * usual_features(r, 1))
        return "far fewer features than the other photos: blurred, masked or without texture";
    for (size_t k = 0; k < photo->features.count; k++) matched += picture->track_of[k] != UINT32_MAX;
    if (matched < least) return "too few matches with other photos: no overlap";
    if (sf_map_count_seen(r->map, index, NULL) < least)
        return "too few matches with the photos that were placed: too little overlap";
    return "its matches do not agree with the other photos on where it was";
}

sf_status sf_photos_why_none(const sf_reconstruction *r, const sf_matched_pair *pairs, size_t pair_count) {
    const double few = 60;
    size_t turned = 0;
    double usual = usual_features(r, 0);
    if (usual < few)
        return sf_fail(
            r->ctx, SF_ERR_EMPTY,
            "the photos have too few features, %.0f in the median: they are blurred, masked or without "
            "texture",
            usual);
    if (!pair_count)
        return sf_fail(r->ctx, SF_ERR_EMPTY,
                       "no two photos show the same things: take photos that overlap by more than half");
    for (size_t i = 0; i < pair_count; i++) turned += pairs[i].geometry.kind == SF_PAIR_ROTATION;
    if (2 * turned > pair_count)
        return sf_fail(
            r->ctx, SF_ERR_EMPTY,
            "the camera turned in one place, or did not move: move it sideways from one photo to the next");
    return SF_OK;
}
