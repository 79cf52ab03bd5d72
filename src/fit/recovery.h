/* recovery.h - goes back to an earlier model when the fit diverges. */
#ifndef SF_FIT_RECOVERY_H
#define SF_FIT_RECOVERY_H

#include "fitter.h"

/* Before a step: goes back where the losses of the last steps show divergence; saves a restore point now and
 * then, unless validation chooses the best model (`chosen`). SF_ERR_MEMORY. */
sf_status sf_recovery_step(sf_fitter *fitter, int chosen);
/* Goes back to the restore point, halves the learning rates and counts the return. Does nothing without a
 * restore point that is known to be better, nor after many returns. SF_ERR_MEMORY. */
sf_status sf_recover(sf_fitter *fitter, double loss);
/* Training views were added or removed: the losses of the steps before `step` are no measure for those to
 * come. */
void sf_recovery_forget(sf_recovery *recovery, int64_t step);

#endif
