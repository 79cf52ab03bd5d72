/* guidance.h - what the user is told: advice with each frame, coverage of the scene in the pauses of the fit.
 */
#ifndef SF_LIVE_GUIDANCE_H
#define SF_LIVE_GUIDANCE_H

#include "live_state.h"

void sf_guidance_init(sf_guidance *guidance, sf_context *ctx);
/* Forgets the scene. */
void sf_guidance_clear(sf_guidance *guidance);
void sf_guidance_free(sf_guidance *guidance);

/* With each frame, when its pose is known or is not. */
void sf_live_advise(sf_live *live);
/* Between steps of the fit, where it is time: looks again at what a keyframe sees, the newest first. */
sf_status sf_live_look_around(sf_live *live);

#endif
