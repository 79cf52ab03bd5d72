/* reorder.h - reorders Gaussians and resizes all arrays that follow the model. */
#ifndef SF_FIT_REORDER_H
#define SF_FIT_REORDER_H

#include "fitter.h"

/* Makes the arrays that follow the initial model, with room for `count` Gaussians. SF_ERR_MEMORY. */
sf_status sf_fitter_start_room(sf_fitter *fitter, size_t count);
/* Gives all arrays room for `count` Gaussians, or as many as there are. SF_ERR_MEMORY. */
sf_status sf_fitter_set_room(sf_fitter *fitter, size_t count);
/* Makes room for banded[b] Gaussians with band b in the model and in all arrays that follow it.
 * SF_ERR_MEMORY: their contents are unchanged. */
sf_status sf_fitter_room(sf_fitter *fitter, const size_t banded[SF_BANDS]);
/* Replaces the Gaussians by entries[0..n-1], sorted stably by falling degree (at most the model's sh_degree):
 * each is a copy of Gaussian `from`, with its optimizer state and statistics. Bands above its degree are
 * dropped; new bands and their optimizer state are 0. moved_to[k] (may be NULL): the new index of entries[k].
 * Makes room, and frees what is no longer needed. SF_ERR_MEMORY: nothing has changed. */
sf_status sf_reorder(sf_fitter *fitter, const sf_remap_entry *entries, size_t n, uint32_t *moved_to);
/* The same, before sf_fitter_sort follows: Gaussians keep their places where they can, so that little moves.
 */
sf_status sf_reorder_unsorted(sf_fitter *fitter, const sf_remap_entry *entries, size_t n, uint32_t *moved_to);
/* Lists all Gaussians along a space-filling curve. SF_ERR_MEMORY. */
sf_status sf_list_along_curve(const sf_model *model, sf_remap_entry *entries);
/* Sorts the Gaussians of each degree along a space-filling curve: then invisible Gaussians fill whole blocks,
 * which a step skips, and those of one tile are close in memory. SF_ERR_MEMORY: nothing has changed. */
sf_status sf_fitter_sort(sf_fitter *fitter);

#endif
