/* misplaced.h - training views far from all others whose pictures the model does not explain. */
#ifndef SF_FIT_MISPLACED_H
#define SF_FIT_MISPLACED_H

#include "fitter.h"

/* Compares the pictures of training views whose cameras lie far from all others (sf_scene_far_views) with
 * renders of the model, once, when it is due. Where a picture fits much worse than the others' do, the pose
 * is taken to be wrong: the view is logged and trained on no more. SF_ERR_MEMORY. */
sf_status sf_find_misplaced_views(sf_fitter *fitter, double fraction);
/* Leaves misplaced views out of a pass that has just begun. */
void sf_skip_misplaced_views(sf_fitter *fitter);

#endif
