/* sample_views.h - measures a sample of the training views between two steps. */
#ifndef SF_FIT_SAMPLE_VIEWS_H
#define SF_FIT_SAMPLE_VIEWS_H

#include "fitter.h"

/* Called for each view of the sample after sf_draw_view. pixels: of the full resolution in one pixel of the
 * render. A failure ends the sampling. */
typedef sf_status (*sf_sample_fn)(sf_fitter *fitter, sf_view_state *state, double pixels, double weight_sum,
                                  void *user);
/* Renders `wanted` (0: all) of the training views that are not in validation and not wholly masked, evenly
 * spread: the same ones each time or, with `others`, different ones after each densification. *there (may be
 * NULL): how many such views there are. SF_ERR_MEMORY, or what `measure` returns. */
sf_status sf_sample_views(sf_fitter *fitter, size_t wanted, int others, sf_sample_fn measure, void *user,
                          size_t *there);

#endif
