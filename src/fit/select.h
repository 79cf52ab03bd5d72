/* select.h - a model of no more Gaussians than the scene needs. */
#ifndef SF_FIT_PRICE_H
#define SF_FIT_PRICE_H

#include "fitter.h"
#include "select_importance.h"

enum { SF_MODEL_CHANGED_PART = 50 /* what takes less of the model away than this part hardly changes its errors */ };

/* Whether Gaussians have to pay for themselves: `size` is auto, none is relocated, and the run is not short.
 */
int sf_selects(const sf_fitter *fitter);

/* Looks, before a growth, whether those before it have taken away from the error: where several have not,
 * growth ends (grown_out); and how much of it pays here (growth_pays). SF_ERR_MEMORY: nothing has changed. */
sf_status sf_select_growth(sf_fitter *fitter, double fraction);

/* Whether this step ends with charging: with those that are not worth their price, while what goes is made up
 * for and once before the end, or, when nothing grows any more, with pairs on trial (select_merge.h). */
int sf_selection_is_due(const sf_fitter *fitter, double fraction);

/* Whether it was due for pairs alone, and a glance shows that none is worth a trial, which this keeps count
 * of: then no more than veils goes. */
int sf_skip_selection(sf_fitter *fitter, double fraction);

/* Marks in screen_sum what is worth less than its price, as worth has it, and veils, and lowers degrees[i],
 * its own, by one where Gaussian i does not pay for that. Then those marked and those bands can go, and
 * sf_select_merge follow: the effects of those that it must leave alone are INFINITY. SF_ERR_MEMORY: what is
 * marked is marked rightly. */
sf_status sf_select_prune(sf_fitter *fitter, double fraction, sf_importance *worth, uint8_t *degrees);

/* Puts pairs on trial where that pays. worth: of before, for the Gaussians that are left; `went`: so many are
 * not. SF_ERR_MEMORY. */
sf_status sf_select_merge(sf_fitter *fitter, double fraction, size_t went, sf_importance *worth);

#endif
