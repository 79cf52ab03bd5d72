/* homography.h - homographies of point pairs by the direct linear transformation (README, P.2). */
#ifndef SF_POSE_HOMOGRAPHY_H
#define SF_POSE_HOMOGRAPHY_H

#include <stddef.h>

/* x -> scale (x - middle): the mean to 0, the mean square to 2 (Hartley). */
typedef struct sf_normalizer {
    double middle[2], scale;
} sf_normalizer;

/* Of points [count][2]; the scale is not finite where all are the same. */
sf_normalizer sf_normalizer_make(const double *points, size_t count);
void sf_normalizer_apply(const sf_normalizer *n, const double in[2], double out[2]);

/* (x, y, 1) ~ H (X, Y, 1). */
void sf_homography_map(const double H[9], const double from[2], double to[2]);

/* The homography that maps from [count][2] to to [count][2], by least squares of the algebraic error with
 * weights [count] (NULL: all 1). 0 where the points do not tell one: fewer than 4, all of `from` in a line.
 */
int sf_homography_fit(const double *from, const double *to, const double *weights, size_t count, double H[9]);

#endif
