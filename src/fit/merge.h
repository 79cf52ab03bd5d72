/* merge.h - two Gaussians that do the work of one become one. */
#ifndef SF_FIT_MERGE_H
#define SF_FIT_MERGE_H

#include "fitter.h"

/* Pairs that one Gaussian of the same mass, mean and covariance stands for but for `misfit`, the part of
 * their square integral that is off, become that one: the other's place in screen_sum is marked to go. What
 * is marked already is left alone. effect: of each Gaussian on the pictures (worth.h); the cheapest pair of
 * each comes first. *merged: how many. SF_ERR_MEMORY: what is merged is merged. */
sf_status sf_merge_pairs(sf_fitter *fitter, double misfit, const float *effect, size_t *merged);

#endif
