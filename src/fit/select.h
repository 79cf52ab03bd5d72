/* select.h - model selection: which Gaussians and SH bands lower the error by enough to be kept. */
#ifndef SF_FIT_SELECT_H
#define SF_FIT_SELECT_H

#include "fitter.h"
#include "select_importance.h"

/* Whether Gaussians are pruned by importance: `size` is auto, and densification is not by relocation. (The
 * schedule of a short run sets `size` to cap.) */
int sf_selects(const sf_fitter *fitter);

/* Before a densification: ends densification where several in a row did not lower the error (densify.ended),
 * and sets the factor of the number to add (select.growth_scale). SF_ERR_MEMORY: nothing has changed. */
sf_status sf_select_growth(sf_fitter *fitter, double fraction);

/* Whether this step ends with selection: pruning, or, when densification is over, a round of tentative merges
 * (select_merge.h). */
int sf_selection_is_due(const sf_fitter *fitter, double fraction);

/* Removes Gaussians and bands below the thresholds and floaters; decides on the tentative merges of the round
 * before, and begins the next. *changed: whether the model became so much smaller that its errors are not
 * comparable with those before. Where memory is short the model stays larger, with a warning. */
sf_status sf_select_step(sf_fitter *fitter, double fraction, int *changed);

/* The first part of sf_select_step. Marks Gaussians for removal in densify.gradient_sum (below 0): floaters,
 * and those whose score in *importance is below the threshold. Lowers degrees[i], the SH degree of Gaussian
 * i, by one where its highest band is below the threshold of bands. The scores of Gaussians that must not be
 * merged become INFINITY. The arrays of *importance are the caller's to free. SF_ERR_MEMORY: the marks so far
 * hold. */
sf_status sf_select_mark(sf_fitter *fitter, double fraction, sf_importance *importance, uint8_t *degrees);

#endif
