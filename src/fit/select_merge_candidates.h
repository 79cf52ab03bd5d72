/* select_merge_candidates.h - two Gaussians that do the work of one become one. */
#ifndef SF_FIT_MERGE_H
#define SF_FIT_MERGE_H

#include "fitter.h"

/* Two Gaussians, a the one that stays. */
typedef struct sf_merge_candidate {
    double rise; /* of the squared error, as expected */
    uint32_t a, b;
} sf_merge_candidate;

/* Pairs that one Gaussian of the same mass, mean and covariance stands for but for `misfit`, the part of
 * their square integral that is off; each Gaussian in one of them at most, the cheapest first. What is marked
 * to go in screen_sum, is not to be seen or whose effect on the pictures (select_importance.h, [count]) is not finite is
 * in none. *pairs is the caller's to free. SF_ERR_MEMORY: *pairs is NULL. */
sf_status sf_find_merge_candidates(sf_fitter *fitter, double misfit, const float *effect, sf_merge_candidate **pairs,
                        size_t *count);

/* Gaussian a becomes the one of both, with its own degree, and knows nothing of its gradients; b stays as it
 * is. */
void sf_apply_merge(sf_fitter *fitter, const sf_merge_candidate *pair);

#endif
