/* essential.h - essential matrices: from five pairs of rays, and the poses that they stand for
 * (GEOMETRY.md, S.11, S.12).
 *
 * Pairs are rays (x, y, 1) of the same points from two cameras, [count][2] each: a from the first, b from the
 * second. The pose T is the second camera's from the first's, b ~ R a + t, |t| = 1; E = [t]x R, b^T E a = 0.
 */
#ifndef SF_SFM_ESSENTIAL_H
#define SF_SFM_ESSENTIAL_H

#include <stddef.h>
#include <stdint.h>

#include "../pose/rigid.h"

enum { SF_ESSENTIAL_MOST = 10 };

/* The essential matrices [most 10][9] of norm 1 that five pairs agree with; sample[5]: which of the pairs.
 * Returns how many. */
int sf_essential_from_5(const double *a, const double *b, const uint32_t sample[5],
                        double E[9 * SF_ESSENTIAL_MOST]);

/* E = [t]x R. */
void sf_essential_of_pose(const sf_rigid *T, double E[9]);

/* The four poses of an essential matrix. 0: E is 0. */
int sf_essential_poses(const double E[9], sf_rigid poses[4]);

/* Of the pairs with members[i] (NULL: all), how many are in front of both cameras. */
size_t sf_count_in_front(const sf_rigid *T, const double *a, const double *b, const uint8_t *members,
                         size_t count);

/* Of E's four poses the one with most of the pairs in front of both cameras. Returns their number. */
size_t sf_essential_pose(const double E[9], const double *a, const double *b, const uint8_t *members,
                         size_t count, sf_rigid *T);

#endif
