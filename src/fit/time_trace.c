/* time_trace.c - the time of each step of a run with a time limit, kept so that the run can be repeated. */
#include "time_trace.h"

#include <string.h>

#include "ranks.h"

enum { LEAST_ROOM = 1 << 14 /* steps: the array rarely grows again */ };

/* The time of a step determines its learning rate and resolution level. It is rounded to ticks before any
 * use, so that the ticks alone repeat the step. */
double sf_time_fraction(const sf_fitter *f) {
    if (f->trace.replayed) {
        size_t step = (size_t)f->step;
        return step < f->trace.count ? (double)f->trace.ticks[step] / SF_PLAN_TICKS : 1;
    }
    if (!(f->options.time_limit > 0)) return 0;
    double part = sf_fit_seconds(f) / f->options.time_limit;
    if (!(part < 1)) return 1;
    return part > 0 ? (double)(uint32_t)(part * SF_PLAN_TICKS) / SF_PLAN_TICKS : 0;
}

/* Adds the time of the step to come, a fraction of the limit, to the trace. */
static void keep(sf_fitter *f, double fraction) {
    size_t step = (size_t)f->step;
    size_t need = step < LEAST_ROOM ? LEAST_ROOM : step + 1;
    if (sf_grow(f->ctx, &f->trace.ticks, &f->trace.capacity, step, need, sizeof *f->trace.ticks)) {
        f->trace.lost = 1;
        sf_log(f->ctx, SF_LOG_WARNING, "out of memory: the run goes on, but cannot be repeated");
        return;
    }
    f->trace.ticks[step] = (uint32_t)(fraction * SF_PLAN_TICKS);
    f->trace.count = step + 1;
}

double sf_next_time_fraction(sf_fitter *f) {
    double time = sf_time_fraction(f);
    if (f->options.time_limit > 0 && !f->trace.replayed && !f->trace.lost && time < 1) {
        if (f->trace.count < (size_t)f->step) /* the limit was set after the first steps */
            f->trace.lost = 1;
        else
            keep(f, time);
    }
    return time;
}

sf_status sf_fitter_get_plan(const sf_fitter *f, uint32_t *ticks, size_t capacity, size_t *count) {
    *count = 0;
    if (f->trace.lost) return sf_fail(f->ctx, SF_ERR_MEMORY, "plan: the time of some step was not kept");
    size_t all = f->trace.count < (size_t)f->step ? f->trace.count : (size_t)f->step;
    *count = all;
    if (ticks && all) memcpy(ticks, f->trace.ticks, (all < capacity ? all : capacity) * sizeof *ticks);
    return SF_OK;
}

sf_status sf_time_trace_check(sf_context *ctx, const uint32_t *ticks, size_t count) {
    for (size_t i = 0; i < count; i++)
        if (ticks[i] >= SF_PLAN_TICKS || (i && ticks[i] < ticks[i - 1]))
            return sf_fail(ctx, SF_ERR_ARGUMENT, "plan: step %zu: %u is not in %u..%u", i, (unsigned)ticks[i],
                           i ? (unsigned)ticks[i - 1] : 0, SF_PLAN_TICKS - 1);
    return SF_OK;
}

sf_status sf_fitter_follow(sf_fitter *f, const uint32_t *ticks, size_t count) {
    if (f->step) return sf_fail(f->ctx, SF_ERR_ARGUMENT, "plan: the run has begun");
    sf_status status = sf_time_trace_check(f->ctx, ticks, count);
    if (!status)
        status = sf_grow(f->ctx, &f->trace.ticks, &f->trace.capacity, 0, count + 1, sizeof *f->trace.ticks);
    if (status) return status;
    if (count) memcpy(f->trace.ticks, ticks, count * sizeof *ticks);
    f->trace.count = count;
    f->trace.replayed = 1;
    return SF_OK;
}
