/* swelling.h - squares that seem larger or smaller than they are (README, P.6). */
#ifndef SF_POSE_SWELLING_H
#define SF_POSE_SWELLING_H

#include "view.h"

/* How far outwards the edges of all tags of a picture are seen. */
typedef struct sf_swelling {
    double px, variance;    /* px, px^2 */
    double twist[SF_TWIST]; /* by which a px of it would move the pose */
} sf_swelling;

/* Moves the corners of tags of which all four are there, one after another, to where they are when the edges
 * are `px` farther outwards. */
void sf_swell(sf_board_corner *corners, size_t count, double px);

/* Least squares in the swelling and the pose together, where T is the pose of list->corners, which are
 * `corners` without the swelling of *s: brings both up to date. Where the tags do not tell it from their
 * distance, it stays near 0. 0: there is no pose. */
int sf_find_swelling(const sf_lens *lens, const sf_rigid *T, const sf_corner_list *list,
                     sf_board_corner *corners, sf_swelling *s);

#endif
