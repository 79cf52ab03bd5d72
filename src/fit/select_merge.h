/* select_merge.h - tentative merges: one Gaussian replaces two until the rise of the error is known. */
#ifndef SF_FIT_SELECT_MERGE_H
#define SF_FIT_SELECT_MERGE_H

#include "fitter.h"
#include "select_importance.h"

enum { SF_MERGE_STEPS = 100 /* in which the neighbours adapt before merges are judged */ };

/* Whether it pays to measure importance for merges alone; if not, merges are tried only when it is measured
 * anyway. */
int sf_merges_promise(const sf_merges *merges);

/* Begins a round: merges the candidates with the least expected rise of the error. importance: of the model
 * as it is; its tiles, which the round takes over, are the error before the merges. SF_ERR_MEMORY: nothing is
 * merged. */
sf_status sf_merges_begin(sf_fitter *fitter, sf_importance *importance);

/* Ends the round. A merge holds if the squared error attributed to it rose by at most `threshold` for each
 * Gaussian that it saves; error below `invisible`, a squared error of a value, does not count. If the total
 * rise exceeds the total threshold, every merge is undone. Where a merge holds, b is marked for removal in
 * densify.gradient_sum. Undone merges set the scores of their Gaussians to INFINITY. */
void sf_merges_decide(sf_fitter *fitter, sf_importance *importance, double threshold, double invisible);

/* Undoes all merges of the round, which is over then. */
void sf_merges_undo_all(sf_fitter *fitter);
void sf_merges_free(sf_fitter *fitter);

/* Undoes all merges in `model`: the fitter's, or a copy made since the round began. */
void sf_merges_undo(const sf_merges *merges, sf_model *model);

#endif
