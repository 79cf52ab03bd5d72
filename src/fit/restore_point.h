/* restore_point.h - an earlier model to go back to. */
#ifndef SF_FIT_RESTORE_POINT_H
#define SF_FIT_RESTORE_POINT_H

#include "fitter.h"

int sf_has_restore_point(const sf_fitter *fitter);
void sf_drop_restore_point(sf_fitter *fitter);
/* Saves the present model without its tentative merges. SF_ERR_MEMORY: there is no restore point. */
sf_status sf_save_restore_point(sf_fitter *fitter);
/* Makes restore.model of a restore point that is there, to be changed. SF_ERR_MEMORY: nothing has changed. */
sf_status sf_expand_restore_point(sf_fitter *fitter);
/* Replaces the model by the restore point, with new optimizer state. SF_ERR_MEMORY: nothing has changed. */
sf_status sf_go_to_restore_point(sf_fitter *fitter);

#endif
