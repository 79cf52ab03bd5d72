/* tracks.h - keypoints that are one point of the world, from the matches of pairs (GEOMETRY.md, S.23). */
#ifndef SF_SFM_TRACKS_H
#define SF_SFM_TRACKS_H

#include <stddef.h>
#include <stdint.h>

#include "../base/context.h"
#include "two_view.h"

/* A pair of pictures whose geometry is known. */
typedef struct sf_matched_pair {
    uint32_t first, second; /* pictures */
    uint32_t *matches;      /* [count][2]: keypoints of the first and of the second, those that agree */
    size_t count;
    sf_two_view geometry;
} sf_matched_pair;

/* Where a track is seen. */
typedef struct sf_track_observation {
    uint32_t picture, keypoint;
} sf_track_observation;

/* Tracks, each of at least two pictures, no picture twice in one: observations[first[i]] .. of track i, by
 * picture. */
typedef struct sf_tracks {
    size_t count;
    size_t matches, contradictions; /* that were given; left out, as sf_tracks_make says */
    size_t *first;                  /* [count + 1] */
    sf_track_observation *observations;
} sf_tracks;

/* Joins matches to tracks; keypoint_counts [pictures]. Pairs with more matches come first; a match that would
 * put two keypoints of one picture into a track is left out: it contradicts them. SF_ERR_MEMORY leaves
 * *tracks empty. */
sf_status sf_tracks_make(sf_context *ctx, const sf_matched_pair *pairs, size_t pair_count,
                         const size_t *keypoint_counts, size_t pictures, sf_tracks *tracks);
void sf_tracks_free(sf_context *ctx, sf_tracks *tracks);

#endif
