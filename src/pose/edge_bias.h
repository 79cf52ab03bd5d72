/* edge_bias.h - edges of tags that ink, blooming or sharpening moves outwards (README, P.6). */
#ifndef SF_POSE_EDGE_BIAS_H
#define SF_POSE_EDGE_BIAS_H

#include "view.h"

/* How far outwards the edges of all tags of a picture are seen. */
typedef struct sf_edge_bias {
    double px, variance;    /* px, px^2 */
    double twist[SF_TWIST]; /* by which a px of it would move the pose */
} sf_edge_bias;

/* Moves the corners of tags of which all four are there, one after another, to where they are when the edges
 * are `px` farther outwards. */
void sf_shift_edges(sf_board_corner *corners, size_t count, double px);

/* Least squares in the edge bias and the pose together, where T is the pose of list->corners, which are
 * `corners` without the edge bias of *s: brings both up to date. Where the tags do not tell it from their
 * distance, it stays near 0. 0: there is no pose. */
int sf_estimate_edge_bias(const sf_lens *lens, const sf_rigid *T, const sf_corner_list *list,
                          sf_board_corner *corners, sf_edge_bias *s);

#endif
