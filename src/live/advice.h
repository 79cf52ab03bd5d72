/* advice.h - what a user is told to do, steady enough to be read. */
#ifndef SF_LIVE_ADVICE_H
#define SF_LIVE_ADVICE_H

#include <splatfit/live.h>

/* What is known with a frame. NAN: not known. */
typedef struct sf_advice_facts {
    double seconds; /* of the frames' clock */
    sf_live_state state;
    int blurred;       /* the frame is */
    double speed;      /* of the camera: rad, or distances to what it sees, in a second, whichever is more */
    double brightness; /* of the picture, in that of the model there */
    double coverage;   /* mean, of what is in sight, 0..1 */
} sf_advice_facts;

/* 0 at the start. */
typedef struct sf_adviser {
    sf_live_advice shown, wanted;            /* wanted: by the last frame */
    double shown_since, wanted_since, right; /* s; right: when `shown` was wanted last */
} sf_adviser;

/* A wish is shown when all frames of RAISE seconds have it, for KEEP at least, and until it was absent for
 * CLEAR. Once shown, less is enough for it to be wanted. */
#define SF_ADVICE_RAISE 0.3
#define SF_ADVICE_KEEP  1.5
#define SF_ADVICE_CLEAR 0.8

/* With the next frame; what is shown from then on. */
sf_live_advice sf_advise(sf_adviser *adviser, const sf_advice_facts *facts);

#endif
