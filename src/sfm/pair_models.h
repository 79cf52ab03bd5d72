/* pair_models.h - essential, fundamental and homography as models of a random sample consensus
 * (GEOMETRY.md, S.20). */
#ifndef SF_SFM_PAIR_MODELS_H
#define SF_SFM_PAIR_MODELS_H

#include "ransac.h"

/* Pairs a, b [count][2]. */
typedef struct sf_pairs {
    const double *a, *b;
    size_t count;
} sf_pairs;

/* `pairs` is the problem's user. Models: the matrix; of a homography also its inverse, [18]. Errors:
 * Sampson's distance; of a homography the root of the mean of both squared transfer errors, which is twice as
 * strict: what is nearly a plane is to count as none. */
sf_ransac_problem sf_essential_problem(const sf_pairs *pairs);
sf_ransac_problem sf_fundamental_problem(const sf_pairs *pairs);
sf_ransac_problem sf_homography_problem(const sf_pairs *pairs);

/* H's inverse behind it, both of them [9]. 0: it has none. */
int sf_homography_invert(double H[18]);

/* The square of a pair's error, of H and its inverse. */
double sf_homography_error(const double H[18], const double a[2], const double b[2]);

#endif
