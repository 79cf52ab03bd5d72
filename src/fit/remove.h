/* remove.h - removes Gaussians that are marked, too faint or not finite. */
#ifndef SF_FIT_REMOVE_H
#define SF_FIT_REMOVE_H

#include "fitter.h"

/* The least logit of an opacity that is kept, from option prune_opacity. */
float sf_min_logit_opacity(const sf_fitter *fitter);
/* Whether Gaussian i is finite, no fainter than min_logit, and not marked for removal in
 * densify.gradient_sum. */
int sf_is_kept(const sf_fitter *fitter, size_t i, float min_logit);

/* Lists those that sf_is_kept keeps at sf_min_logit_opacity. entries: [count]. SF_ERR_MEMORY. */
sf_status sf_list_kept(const sf_fitter *fitter, sf_remap_entry *entries, size_t *kept);
/* Removes the Gaussians that sf_is_kept does not keep at sf_min_logit_opacity. degrees: NULL, or [count], new
 * SH degrees no higher than the present ones. SF_ERR_MEMORY: nothing has changed. */
sf_status sf_remove_marked(sf_fitter *fitter, const uint8_t *degrees);
/* Removes the Gaussians with values that are not finite, and logs how many. SF_ERR_MEMORY. */
sf_status sf_remove_not_finite(sf_fitter *fitter);

#endif
