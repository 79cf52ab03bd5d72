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

/* Keyframes that show an old place, which stays as it is: they were wrong, not what they see. */
typedef struct sf_loop_back {
    size_t first, count;
} sf_loop_back;

typedef enum sf_loop_found {
    SF_LOOP_NONE,   /* no old place, or a doubtful one */
    SF_LOOP_SAME,   /* its map says the same pose */
    SF_LOOP_DRIFTED /* it says another one, which tracking may have drifted from */
} sf_loop_found;

/* loop_link.c: looks for old keyframes that show the same as one, or as the picture in hand (which: as many
 * as there are), but share no landmarks with it, and for its pose by their map. SF_ERR_MEMORY. */
sf_status sf_live_find_link(sf_live *live, size_t which, sf_loop_link *link, sf_loop_found *found);
/* How far apart two poses are: the greater of the turn, rad, and the move, in distances. */
double sf_loop_gap(const sf_rigid *a, const sf_rigid *b, double distance);

/* When the camera was lost, and again when it was found: whether the last keyframes before show an old place,
 * and have another pose by it. Where several say the same, poses are corrected as below. SF_ERR_MEMORY. */
sf_status sf_live_join_lost(sf_live *live);

/* Before the picture in hand becomes a keyframe: looks for keyframes that show the same but share no
 * landmarks with it, and whose map gives it another pose. Where the keyframe before says the same, poses are
 * corrected, the picture's and the model with them. SF_ERR_MEMORY. */
sf_status sf_live_close_loop(sf_live *live);

/* loop_correction.c: spreads the drift over the pose graph of keyframes whose links are given, and moves
 * keyframes, landmarks and the model. *moved: the picture's new pose; *scale: of the lengths about it.
 * SF_ERR_MEMORY. */
sf_status sf_live_correct_loop(sf_live *live, const sf_loop_link *links, size_t count,
                               const sf_loop_back *back, sf_rigid *moved, double *scale);

#endif
