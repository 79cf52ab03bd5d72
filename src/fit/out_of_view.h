/* out_of_view.h - the optimizer state of groups of Gaussians that are out of view.
 *
 * Projection leaves out groups of SF_PROJECT_BLOCKS blocks that lie beside the picture. Adam without
 * gradients would still move them by their momentum, and so read and write all of a large scene for a small
 * picture. They are skipped instead, as by a sparse Adam: they keep parameters and momentum until a view sees
 * them again. Their second moments then have fallen as if they had taken part: without that, Gaussians that
 * few views see learn too slowly (MEASURED.md). They fall when a group is in view again, or when something
 * else needs them; the result is the same to the byte whenever that is.
 */
#ifndef SF_FIT_OUT_OF_VIEW_H
#define SF_FIT_OUT_OF_VIEW_H

#include "fitter.h"

/* Whether groups do so: not with 16-bit moments (each step rounds them), a moving average, or noise, which
 * change in every step. */
int sf_skips_out_of_view(const sf_fitter *fitter);

/* Notes for the group with this first block whether it is in view in this step. If it is, its second moments
 * are brought up to date. */
void sf_note_in_view(const sf_fitter *fitter, size_t block, int in_view);

/* Brings the second moments of all groups up to date: before they are copied, moved, or written. */
void sf_update_second_moments(const sf_fitter *fitter);

#endif
