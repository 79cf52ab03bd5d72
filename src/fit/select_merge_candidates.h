/* select_merge_candidates.h - finds pairs of Gaussians that one Gaussian can replace. */
#ifndef SF_FIT_SELECT_MERGE_CANDIDATES_H
#define SF_FIT_SELECT_MERGE_CANDIDATES_H

#include "fitter.h"

typedef struct sf_merge_candidate {
    double rise;   /* expected, of the squared error */
    uint32_t a, b; /* a stays */
} sf_merge_candidate;

/* Finds merge candidates: pairs that one Gaussian of the same mass, mean and covariance replaces with a
 * relative error of at most `misfit` of their square integral; the least expected rise first. A Gaussian is
 * in one candidate at most. Gaussians that are marked for removal in densify.gradient_sum, are not drawn, or
 * whose score ([count], of sf_importance) is not finite are in none. *candidates is the caller's to free.
 * SF_ERR_MEMORY: *candidates is NULL. */
sf_status sf_find_merge_candidates(sf_fitter *fitter, double misfit, const float *score,
                                   sf_merge_candidate **candidates, size_t *count);

/* Replaces Gaussian a by the merged one, of a's degree, with new optimizer state; b is unchanged. */
void sf_apply_merge(sf_fitter *fitter, const sf_merge_candidate *candidate);

#endif
