/* ranks_divide.h - each of several ranks takes its part of the Gaussians. With one rank nothing happens. */
#ifndef SF_FIT_RANKS_DIVIDE_H
#define SF_FIT_RANKS_DIVIDE_H

#include "fitter.h"

/* Room for Gaussians on each rank, where all have `count`. */
size_t sf_room_of_rank(const sf_fitter *fitter, size_t count);

/* Keeps this rank's part of the fit's first model, which every rank has whole unless `from`, which it was
 * copied from (NULL: none), was read in parts. Arrays that follow the model must not exist yet.
 * SF_ERR_MEMORY.
 */
sf_status sf_ranks_divide(sf_fitter *fitter, const sf_model *from);

/* Of a fit that every rank has read whole: keeps this rank's part. had, had_best: [ranks][SF_BANDS], the
 * Gaussians with each band that each rank had when the fit was written by as many ranks, so that each gets
 * its own again; else NULL. SF_ERR_MEMORY. */
sf_status sf_ranks_divide_restored(sf_fitter *fitter, const uint64_t *had, const uint64_t *had_best);

#endif
