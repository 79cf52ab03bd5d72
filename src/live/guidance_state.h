/* guidance_state.h - what is known of the advice and the coverage. */
#ifndef SF_LIVE_GUIDANCE_STATE_H
#define SF_LIVE_GUIDANCE_STATE_H

#include "advice.h"
#include "coverage.h"

typedef struct sf_guidance {
    sf_adviser adviser;
    double brightness; /* of the frame, in that of the model there; NAN: not known */
    sf_coverage coverage;
    double extent;        /* that the cells were made for */
    double next, ms;      /* s of the clock: of the next look; how long one takes, moving average */
    double next_in_sight; /* s of the clock, when `in_sight` is looked up again */
    double in_sight;      /* mean coverage of what the camera sees; NAN: not known */
    size_t turn;          /* of the keyframes */
} sf_guidance;

#endif
