/* price.h - a model of no more Gaussians than the scene needs. */
#ifndef SF_FIT_PRICE_H
#define SF_FIT_PRICE_H

#include "fitter.h"

/* Whether Gaussians have to pay for themselves: `size` is auto, none is relocated, and the run is not short.
 */
int sf_is_priced(const sf_fitter *fitter);

/* Looks, before a growth, whether those before it have taken away from the error: where several have not,
 * growth ends (grown_out). SF_ERR_MEMORY: nothing has changed. */
sf_status sf_consider_growth(sf_fitter *fitter);

/* Whether this step ends with charging: after growth, until the model must be left to settle. */
int sf_charging_due(const sf_fitter *fitter, double fraction);

/* Marks in screen_sum what is worth less than its price, and merges what one Gaussian can stand for.
 * SF_ERR_MEMORY: what is marked is marked rightly, the rest is left. */
sf_status sf_charge(sf_fitter *fitter);

#endif
