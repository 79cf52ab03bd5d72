/* time_trace.h - the time of each step of a run with a time limit, kept to repeat the run. */
#ifndef SF_FIT_TIME_TRACE_H
#define SF_FIT_TIME_TRACE_H

#include "fitter.h"

/* The part of time_limit that has passed, 0..1: as measured, or as a replayed trace has it; 0 without a
 * limit. */
double sf_time_fraction(const sf_fitter *fitter);
/* The same for the step to come, and adds it to the trace. */
double sf_next_time_fraction(sf_fitter *fitter);
/* SF_ERR_ARGUMENT: ticks that fall, or are not below SF_PLAN_TICKS. */
sf_status sf_time_trace_check(sf_context *ctx, const uint32_t *ticks, size_t count);

#endif
