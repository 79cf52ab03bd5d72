/* place_recognition.h - features of pictures, and the keyframes that look most like one. */
#ifndef SF_LIVE_PLACE_RECOGNITION_H
#define SF_LIVE_PLACE_RECOGNITION_H

#include "live_state.h"

enum { SF_PLACE_FEATURES = 600, SF_PLACE_FEW = 128 };

/* Finds the features of the picture in hand, once: live->input.place. SF_ERR_MEMORY. */
sf_status sf_live_find_features(sf_live *live);
void sf_place_free(sf_context *ctx, sf_place *place);
/* Frees those of all keyframes. */
void sf_places_free(sf_context *ctx, const sf_keyframes *keyframes);

/* A keyframe, and how many of the few features of a place it shares. */
typedef struct sf_place_score {
    size_t keyframe;
    size_t shared;
} sf_place_score;

/* Scores all keyframes, the most alike first, of equal ones the newer. left_out [keyframes]: flags of those
 * that do not count, at the end with 0; NULL: all do. scores [keyframes]. SF_ERR_MEMORY. */
sf_status sf_live_score_places(sf_live *live, const sf_place *place, const uint8_t *left_out,
                               sf_place_score *scores);

/* Depths of a keyframe's features by the model drawn at its pose, unless they are known well enough.
 * *drawn: whether it was drawn. SF_ERR_MEMORY. */
sf_status sf_live_draw_depths(sf_live *live, sf_keyframe *keyframe, int *drawn);

#endif
