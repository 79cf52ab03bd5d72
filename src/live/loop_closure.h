/* loop_closure.h - places seen again after a way round: the drift since is found, and taken away. */
#ifndef SF_LIVE_LOOP_CLOSURE_H
#define SF_LIVE_LOOP_CLOSURE_H

#include "live_state.h"

/* A keyframe, or the picture in hand, that an older keyframe's map says the pose of. */
typedef struct sf_loop_link {
    size_t keyframe; /* index; as many as there are: the picture */
    size_t old;      /* index of the older one */
    sf_rigid pose;   /* world to camera, by its map */
    double scale;    /* the unit of length of the map about the keyframe, in those of the older one's; */
    int is_scaled;   /* 0: not known */
} sf_loop_link;

/* Before the picture in hand becomes a keyframe: looks for keyframes that show the same but share no
 * landmarks with it, and whose map gives it another pose. Where the keyframe before says the same, poses are
 * corrected, the picture's and the model with them. SF_ERR_MEMORY. */
sf_status sf_live_close_loop(sf_live *live);

/* loop_correction.c: spreads the drift over the pose graph of keyframes whose links are given, and moves
 * keyframes, landmarks and the model. *moved: the picture's new pose; *scale: of the lengths about it.
 * SF_ERR_MEMORY. */
sf_status sf_live_correct_loop(sf_live *live, const sf_loop_link *links, size_t count, sf_rigid *moved,
                               double *scale);

#endif
