/* keyframes.h - which frames become keyframes, and the start of the fit. */
#ifndef SF_LIVE_KEYFRAMES_H
#define SF_LIVE_KEYFRAMES_H

#include "live_state.h"

/* Takes the frame as a keyframe where the camera is far enough from all others and the frame is good enough.
 * *taken: whether. */
sf_status sf_live_offer_keyframe(sf_live *live, int *taken);
/* Moves all keyframes, with their landmarks and the model, to where they are by now: to [keyframes]; scales
 * [keyframes]: of depths, in those of before. The model does not follow `backs` of them from index
 * `first_back` on. SF_ERR_MEMORY. */
sf_status sf_live_move_keyframes(sf_live *live, const sf_rigid *to, const double *scales, size_t first_back,
                                 size_t backs);
/* Begins the fit when there are keyframes from enough places. */
sf_status sf_live_begin(sf_live *live);

#endif
