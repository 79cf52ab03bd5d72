/* schedule.c - what holds at a fraction of the run. */
#include "fitter.h"

#include <limits.h>
#include <math.h>

#include "../base/clock.h"

enum { LEAST_SIDE = 32 /* px of the coarsest picture */ };

double sf_fraction(const sf_fitter *f) {
    double fraction = 0;
    if (f->options.steps > 0) fraction = (double)f->step / (double)f->options.steps;
    if (f->options.time_limit > 0) fraction = fmax(fraction, (sf_clock() - f->start) / f->options.time_limit);
    return fmin(fraction, 1);
}

int sf_scheduled_level(const sf_fitter *f, double fraction, int width, int height) {
    int level = 0;
    if (f->gone_on) return 0;
    double end = f->options.pyramid_end;
    while (level < f->options.pyramid_levels && fraction < end) {
        level++;
        end *= f->options.pyramid_ratio;
    }
    while (level && (width >> level < LEAST_SIDE || height >> level < LEAST_SIDE)) level--;
    return level;
}

int sf_scheduled_degree(const sf_fitter *f, double fraction) {
    int most = f->model->sh_degree;
    if (f->gone_on || fraction >= f->options.sh_end || most == 0) return most;
    if (fraction < f->options.sh_start) return 0;
    double part = (fraction - f->options.sh_start) / (f->options.sh_end - f->options.sh_start);
    int degree = 1 + (int)(part * (most - 1));
    return degree < most ? degree : most;
}

double sf_scheduled_rate(const sf_fitter *f, double fraction, int field) {
    const sf_fit_options *o = &f->options;
    switch (field) {
    case SF_FIELD_mean:
        return o->lr_mean * f->extent * pow(o->lr_mean_final, fraction);
    case SF_FIELD_log_scale:
        return o->lr_scale;
    case SF_FIELD_quat:
        return o->lr_quat;
    case SF_FIELD_logit_opacity:
        return o->lr_opacity;
    case SF_FIELD_sh0:
        return o->lr_sh0;
    default:
        return o->lr_sh_rest;
    }
}

int sf_growth_due(const sf_fitter *f, double fraction) {
    return f->step % f->options.grow_every == 0 && fraction >= f->options.grow_start &&
           fraction <= f->options.grow_end;
}

size_t sf_planned_count(const sf_fitter *f, double fraction) {
    double most = (double)f->options.max_gaussians, first = (double)f->first_count;
    double span = f->options.grow_end - f->options.grow_start;
    double part = span > 0 ? fmin((fraction - f->options.grow_start) / span, 1) : 1;
    return (size_t)(first + fmax(most - first, 0) * part);
}

/* A step of a coarser picture costs less; a tenth stays. */
static double step_cost(const sf_fitter *f, double fraction) {
    return 0.1 + 0.9 * pow(0.25, sf_scheduled_level(f, fraction, INT_MAX, INT_MAX));
}

double sf_cost_ahead(const sf_fitter *f, double fraction) {
    enum { SAMPLES = 64 };
    double sum = 0;
    for (int i = 0; i < SAMPLES; i++) sum += step_cost(f, fraction + (1 - fraction) * (i + 0.5) / SAMPLES);
    return sum / SAMPLES / step_cost(f, fraction);
}
