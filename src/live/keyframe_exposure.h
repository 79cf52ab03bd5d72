/* keyframe_exposure.h - exposures of keyframes: from their light, from their neighbours, from the fit. */
#ifndef SF_LIVE_KEYFRAME_EXPOSURE_H
#define SF_LIVE_KEYFRAME_EXPOSURE_H

#include <splatfit/fitter.h>

#include "keyframe_list.h"

/* Tells the fit which poses to hold, and which exposures to start with, as soon as it has taken up the views.
 */
void sf_tell_fit(sf_keyframes *keyframes, sf_fitter *fitter);
/* A keyframe's exposure as it is known by now: what the fit learned; before that what its light says, or the
 * exposures of its neighbours. Gain 1 and bias 0 where there is no such keyframe. */
void sf_keyframe_exposure(const sf_keyframes *keyframes, const sf_fitter *fitter, uint32_t id, double gain[3],
                          double bias[3]);
/* The mean of what the fit learned of the training keyframes before and after keyframe `at`, in the light
 * that this one had. 0, and nothing changes: there are none. */
int sf_neighbours_exposure(const sf_keyframes *keyframes, const sf_fitter *fitter, size_t at, double gain[3],
                           double bias[3]);

#endif
