/* ranks.h - a fit on several ranks, each of which has a part of the Gaussians (src/cluster/README.md).
 *
 * Every rank takes the same decisions, from values that are the same on all of them: sums over the ranks, and
 * what rank 0 says of time. With one rank all of this is the identity.
 */
#ifndef SF_FIT_RANKS_H
#define SF_FIT_RANKS_H

#include "fitter.h"

/* Whether this is the rank that writes. */
int sf_is_first_rank(const sf_fitter *fitter);
/* Whether there are other ranks. */
static inline int sf_is_shared(const sf_fitter *fitter) { return fitter->ctx->cluster != NULL; }

/* Whether a model was read in as many parts as there are ranks, so that each rank has one. from: NULL
 * allowed.
 */
int sf_is_part(const sf_fitter *fitter, const sf_model *from);
/* Gaussians of a first model, of all ranks. All must call it. */
size_t sf_count_from(const sf_fitter *fitter, const sf_model *from);

/* Whether there are tentative merges, on any rank. */
static inline int sf_has_merges(const sf_fitter *fitter) {
    return sf_is_shared(fitter) ? fitter->merges.on_ranks : fitter->merges.count > 0;
}

/* SF_ERR_ARGUMENT: the ranks have different scenes. */
sf_status sf_ranks_check(sf_fitter *fitter);

/* Seconds of the fit, as rank 0 said at the beginning of the step. */
double sf_fit_seconds(const sf_fitter *fitter);
/* At the beginning of a step: time, and whether a rank was cancelled. */
int sf_ranks_begin_step(sf_fitter *fitter);

/* Bytes that this rank has sent; counts those after `before` as a step's. */
uint64_t sf_ranks_sent(const sf_fitter *fitter);
void sf_ranks_count_step(const sf_fitter *fitter, uint64_t before);

/* Over all ranks. */
size_t sf_total(const sf_fitter *fitter, size_t count);
double sf_total_of(const sf_fitter *fitter, double value);
double sf_of_first_rank(const sf_fitter *fitter, double value);
double sf_most_of_ranks(const sf_fitter *fitter, double value);

/* This rank's part of `count` things. */
size_t sf_part_of_rank(const sf_fitter *fitter, size_t count);
/* A number that a Gaussian of one rank alone has: its index, and the rank. */
uint64_t sf_place_of(const sf_fitter *fitter, size_t i);

/* How many of this rank's values, largest first, are among the `wanted` largest of all. */
size_t sf_share_of_largest(const sf_fitter *fitter, const double *values, size_t n, size_t wanted);

/* The random numbers of what is done to this rank's Gaussians alone: the fit's with one rank. */
sf_rng *sf_rng_of_rank(sf_fitter *fitter);

/* ranks_gather.c */

/* On rank 0 the Gaussians of all ranks, on the others none: *whole is the caller's. banded: NULL or [ranks]
 * [SF_BANDS], what each has. SF_ERR_MEMORY. */
sf_status sf_ranks_gather(const sf_fitter *fitter, const sf_model *part, uint64_t *banded, sf_model **whole);

/* Writes the model of all ranks as a .ply on rank 0, a part at a time. part: this rank's Gaussians, whose
 * coordinates may change. A failure of one rank is one of all. */
sf_status sf_ranks_save_ply(const sf_fitter *fitter, sf_model *part, const char *path,
                            const sf_model_file_options *options);

/* The same of all that follows the Gaussians: *whole is a copy of the fitter with the arrays of all ranks,
 * which sf_ranks_free_gathered frees. banded, banded_best: [ranks][SF_BANDS]. */
sf_status sf_ranks_gather_all(const sf_fitter *fitter, uint64_t *banded, uint64_t *banded_best,
                              sf_fitter *whole);
void sf_ranks_free_gathered(sf_fitter *whole);

#endif
