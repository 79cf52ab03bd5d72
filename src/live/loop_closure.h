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

/* Keyframes at the end of the loop, which show the old place: the Gaussians that they see stay, and only
 * their poses move. */
typedef struct sf_loop_back {
    size_t first, count;
} sf_loop_back;

typedef enum sf_loop_found {
    SF_LOOP_NONE,   /* no old place, or a doubtful one */
    SF_LOOP_SAME,   /* the pose by its map is the tracked one */
    SF_LOOP_DRIFTED /* it is another one, near enough for drift to explain the difference */
} sf_loop_found;

/* loop_link.c: looks for old keyframes that show the same as keyframe `which` but share few landmarks with
 * it, and finds its pose in their map. `which` equal to the number of keyframes means the present frame.
 * SF_ERR_MEMORY. */
sf_status sf_live_find_link(sf_live *live, size_t which, sf_loop_link *link, sf_loop_found *found);
/* The pose of such a keyframe, or of the present frame, as tracking has it. */
const sf_rigid *sf_loop_tracked_pose(const sf_live *live, size_t which);
/* The difference of two poses: the greater of the rotation, rad, and the translation in units of `distance`.
 */
double sf_loop_gap(const sf_rigid *a, const sf_rigid *b, double distance);

/* Called with each frame. After a loss, and again after the camera was found, compares the last keyframes
 * before the loss with old ones. Where several of them agree on the drift, it is corrected as below.
 * SF_ERR_MEMORY. */
sf_status sf_live_join_lost(sf_live *live);

/* Before the picture in hand becomes a keyframe: looks for keyframes that show the same but share no
 * landmarks with it, and whose map gives it another pose. Where the link of the keyframe before agrees with
 * its own, corrects all poses, the picture's included, and the model. SF_ERR_MEMORY. */
sf_status sf_live_close_loop(sf_live *live);

/* loop_correction.c: spreads the drift over the pose graph of keyframes whose links are given, and moves
 * keyframes, landmarks and the model. *moved: the picture's new pose; *scale: of the lengths about it.
 * SF_ERR_MEMORY. */
sf_status sf_live_correct_loop(sf_live *live, const sf_loop_link *links, size_t count,
                               const sf_loop_back *back, sf_rigid *moved, double *scale);

#endif
