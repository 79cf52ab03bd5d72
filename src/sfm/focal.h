/* focal.h - the focal length of a camera from the fundamental matrices of its pairs (GEOMETRY.md, S.22). */
#ifndef SF_SFM_FOCAL_H
#define SF_SFM_FOCAL_H

#include <stddef.h>
#include <stdint.h>

/* A pair of pictures that one camera took: F between pixels from the picture's middle over one scale. */
typedef struct sf_focal_pair {
    double F[9];
    double weight; /* its inliers */
} sf_focal_pair;

/* How far F is from an essential matrix if the focal length is `focal`, in units of the scale of F's
 * coordinates: 1 - s2 / s1 of the singular values, 0..1. */
double sf_focal_misfit(const double F[9], double focal);

/* The mean over the pairs, by their weights, of misfits that are cut off: 0..1, and 0 without pairs. */
double sf_focal_cost(const sf_focal_pair *pairs, size_t count, double focal);

/* The focal length from least..most for which most of the pairs are nearly essential matrices, in units of
 * the scale of F's coordinates. guess: what it is likely to be; it decides what the pairs leave open, as
 * those do whose cameras look at one place from one distance. contrast (may be NULL): 0: the pairs say
 * nothing, 1: they say it strongly. Without pairs the guess. */
double sf_focal_vote(const sf_focal_pair *pairs, size_t count, double least, double most, double guess,
                     double *contrast);

#endif
