/* recovery.h - goes back to an earlier model when the fit diverges. */
#ifndef SF_FIT_RECOVERY_H
#define SF_FIT_RECOVERY_H

#include "fitter.h"

/* Before a step: returns to the restore point if the losses of the last steps diverged; saves a restore point
 * from time to time, unless validation chooses the best model (`chosen`). SF_ERR_MEMORY. */
sf_status sf_recovery_step(sf_fitter *fitter, int chosen);
/* Returns to the restore point, halves the learning rates and counts the return. Does nothing without a
 * restore point that is known to be better, nor after 8 returns. SF_ERR_MEMORY. */
sf_status sf_recover(sf_fitter *fitter, double loss);
/* Training views were added or removed: losses before `step` are not comparable with later ones. */
void sf_recovery_forget(sf_recovery *recovery, int64_t step);

#endif
