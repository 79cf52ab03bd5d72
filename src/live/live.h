/* live.h - the inside of a live fit: its state, and the parts that its loop calls in turn. */
#ifndef SF_LIVE_LIVE_H
#define SF_LIVE_LIVE_H

#include "keyframe_exposure.h"
#include "keyframes.h"
#include "live_state.h"
#include "localizer.h"
#include "points.h"

#endif
