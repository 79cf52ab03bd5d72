/* select.h - model selection: which Gaussians and SH bands lower the error by enough to be kept. */
#ifndef SF_FIT_SELECT_H
#define SF_FIT_SELECT_H

#include "fitter.h"
#include "select_importance.h"

enum { SF_MODEL_CHANGED_PART = 50 /* removing less than this part of the model hardly changes its errors */ };

/* Whether Gaussians are pruned by importance: `size` is auto, and growth is not by relocation. (The plan of a
 * short run sets `size` to cap.) */
int sf_selects(const sf_fitter *fitter);

/* Before a densification: ends densification where several in a row did not lower the error (densify.ended),
 * and sets the factor of the number to add (select.growth_scale). SF_ERR_MEMORY: nothing has changed. */
sf_status sf_select_growth(sf_fitter *fitter, double fraction);

/* Whether this step ends with selection: pruning, or, when densification is over, a round of tentative merges
 * (select_merge.h). */
int sf_selection_is_due(const sf_fitter *fitter, double fraction);

/* Whether selection was due for merges alone and a few views show that no merge would hold; the vain round is
 * counted. Then only floaters are removed. */
int sf_skip_selection(sf_fitter *fitter, double fraction);

/* Marks Gaussians for removal in densify.gradient_sum (below 0): floaters, and those whose score in
 * *importance is below the threshold; lowers degrees[i], the SH degree of Gaussian i, by one where its
 * highest band is below the threshold of bands. After the caller has removed them sf_select_merge follows:
 * the scores of Gaussians that it must not merge are INFINITY. SF_ERR_MEMORY: what is marked so far is right.
 */
sf_status sf_select_prune(sf_fitter *fitter, double fraction, sf_importance *importance, uint8_t *degrees);

/* Begins a round of tentative merges where that may pay. importance: as measured before the removal, for the
 * Gaussians that are left; went: how many were removed. SF_ERR_MEMORY. */
sf_status sf_select_merge(sf_fitter *fitter, double fraction, size_t went, sf_importance *importance);

#endif
