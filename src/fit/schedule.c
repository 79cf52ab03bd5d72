/* schedule.c - resolution, SH degree, learning rates and number of Gaussians at a fraction of the run. */
#include "schedule.h"

#include <limits.h>
#include <math.h>

#include "time_trace.h"

enum { LEAST_SIDE = 32 /* px of the shorter side of the coarsest picture */ };

/* A phase ends after X_STEPS, or after the part X_MOST of a short run. */
#define PYRAMID_STEPS 900
#define PYRAMID_MOST  0.65
#define MIX_STEPS     1250
#define MIX_MOST      0.9
#define SH_STEPS      450
#define SH_MOST       0.3
#define GROW_STEPS    1500
#define GROW_MOST     0.5
/* SH degree 1 starts at this part of sh_end. */
#define SH_START 0.33

/* A run without an end stays at this part of cool_down, just before the cool-down. */
#define BEFORE_COOL_DOWN 0.999

/* Steps between densifications, at most this part of the run. */
#define GROW_EVERY      100
#define GROW_EVERY_MOST 0.125

/* Learning-rate scale of a short run: (RATE_STEPS / steps)^RATE_POWER, at most RATE_MOST. A warm start needs
 * none: its shapes and colours are learned already. */
#define RATE_STEPS 3300.0
#define RATE_POWER 0.75
#define RATE_MOST  6

/* Huber's delta. The square converges faster from large residuals; the absolute value fits small ones better.
 * So delta falls with the number of steps. */
#define SQUARED_STEPS 100
#define DELTA_MOST    0.4

/* MEAN_STEP: mean cost of a step, relative to one at full resolution with the initial Gaussians. STEP_GROWTH:
 * power of the number of Gaussians by which the cost of a step rises. */
#define MEAN_STEP   0.55
#define STEP_GROWTH 0.7

/* The value that the user chose; 0: `steps` of the planned ones, at most the part `most`. */
static double chosen_or_planned(double value, double steps, double most, double planned) {
    return value > 0 ? value : fmin(most, steps / planned);
}

static int is_short(const sf_fitter *f, double steps) {
    return steps < (f->options.steps > 0 ? SF_SHORT_RUN : SF_SHORT_TIME);
}

/* Gaussians to add in a run of this many steps, at most. */
static double most_added(const sf_fitter *f, double steps) {
    return f->options.densify_per_step * (f->select.growth_scale > 0 ? f->select.growth_scale : 1) * steps;
}

double sf_steps_in(const sf_fitter *f, double seconds, double step) {
    const sf_fit_options *o = &f->options;
    double first = fmax((double)f->first_count, 1), steps = 0, count = first;
    for (int round = 0; round < 8; round++) { /* a longer run has more Gaussians, and slower steps */
        steps = seconds / fmax(step * MEAN_STEP * pow(count / first, STEP_GROWTH), 1e-9);
        count = fmin((double)o->max_gaussians, first + most_added(f, steps));
    }
    return steps;
}

/* With few views, Gaussians that they do not need may be needed from elsewhere, and no view can be spared for
 * validation. So model selection is off, and fewer Gaussians are added. */
static void plan_few_views(sf_fitter *f) {
    sf_scene_info info;
    sf_scene_get_info(f->scene, &info);
    if (f->options.size != SF_SIZE_AUTO || info.train_views >= SF_VALIDATE_EVERY) return;
    f->options.size = SF_SIZE_CAP;
    f->select.growth_scale = (double)info.train_views / SF_VALIDATE_EVERY;
}

void sf_plan_schedule(sf_fitter *f, double planned) {
    sf_fit_options *o = &f->options;
    planned = fmax(planned, 1);
    if (!o->plan_steps) o->plan_steps = (int64_t)fmin(planned, 1e8);
    planned = (double)o->plan_steps;
    plan_few_views(f);
    if (is_short(f, planned)) o->size = SF_SIZE_CAP;
    if (!o->steps && is_short(f, planned)) o->blur = 0; /* measuring the views would take the time of steps */
    if (o->validate < 0) o->validate = is_short(f, planned) ? 0 : SF_VALIDATE_EVERY;
    o->pyramid_end = chosen_or_planned(o->pyramid_end, PYRAMID_STEPS, PYRAMID_MOST, planned);
    o->pyramid_mix = chosen_or_planned(o->pyramid_mix, MIX_STEPS, MIX_MOST, planned);
    o->sh_end = chosen_or_planned(o->sh_end, SH_STEPS, SH_MOST, planned);
    if (!o->densify_every) o->densify_every = (int64_t)fmax(fmin(GROW_EVERY, GROW_EVERY_MOST * planned), 1);
    double missing = f->warm_start ? 0 : fmax(1 / planned - 1 / RATE_STEPS, 0);
    if (!(o->huber_delta > 0)) o->huber_delta = fmin(SQUARED_STEPS * missing, DELTA_MOST);
    if (!(o->lr_boost > 0))
        o->lr_boost = f->warm_start ? 1 : fmin(fmax(pow(RATE_STEPS / planned, RATE_POWER), 1), RATE_MOST);
    o->densify_end = chosen_or_planned(o->densify_end, GROW_STEPS, GROW_MOST, planned);
}

/* Where time alone ends a run, its phases follow the planned steps as well, up to the cool-down: the coarse
 * pictures of the start are fast, and by time there would be too many such steps. A short run needs these. */
double sf_fraction_at(const sf_fitter *f, double time) {
    const sf_fit_options *o = &f->options;
    double fraction = 0;
    if (o->steps > 0)
        fraction = (double)f->step / (double)o->steps;
    else if (o->time_limit > 0 && !is_short(f, (double)o->plan_steps))
        fraction = fmin((double)f->step / (double)o->plan_steps, BEFORE_COOL_DOWN * o->cool_down);
    fraction = fmin(fmax(fraction, time), 1);
    return o->open_end ? fmin(fraction, BEFORE_COOL_DOWN * o->cool_down) : fraction;
}

double sf_fraction(const sf_fitter *f) { return sf_fraction_at(f, sf_time_fraction(f)); }

int sf_cools_down_early(const sf_fitter *f) { return f->cool_down.from < f->options.cool_down; }

void sf_cool_down_early(sf_fitter *f, double fraction, double length) {
    f->cool_down.from = fraction;
    f->cool_down.length = fmin(f->cool_down.length, length);
}

double sf_end_of_run(const sf_fitter *f) { return f->cool_down.from + f->cool_down.length; }

/* The part of the cool-down that is done, 0..1. */
static double cooled_part(const sf_fitter *f, double fraction) {
    return fmin(fmax(fraction - f->cool_down.from, 0) / fmax(f->cool_down.length, 1e-9), 1);
}

/* The fraction at which the schedule is read: an early cool-down goes through all that is left of the
 * schedule. */
static double schedule_fraction(const sf_fitter *f, double fraction) {
    if (!sf_cools_down_early(f) || fraction < f->cool_down.from) return fraction;
    return f->cool_down.from + cooled_part(f, fraction) * (1 - f->cool_down.from);
}

int sf_level_within(int level, int width, int height) {
    while (level && (width >> level < LEAST_SIDE || height >> level < LEAST_SIDE)) level--;
    return level;
}

/* Resolution level of the pyramid at this fraction; steps of mixed levels apart. */
static int pyramid_level(const sf_fitter *f, double fraction) {
    int level = 0;
    double end = f->options.pyramid_end;
    while (level < f->options.pyramid_levels && fraction < end) {
        level++;
        end *= f->options.pyramid_ratio;
    }
    return level;
}

int sf_finest_level(const sf_fitter *f, double fraction) {
    return f->warm_start ? 0 : pyramid_level(f, schedule_fraction(f, fraction));
}

int sf_scheduled_level(const sf_fitter *f, double fraction, int width, int height) {
    if (f->warm_start) return 0;
    int level = sf_finest_level(f, fraction);
    /* Every second step: it costs half at half the resolution, and improves the model nearly as much. */
    if (!level && schedule_fraction(f, fraction) < f->options.pyramid_mix && f->options.pyramid_levels)
        level = f->step & 1;
    return sf_level_within(level, width, height);
}

int sf_scheduled_degree(const sf_fitter *f, double fraction) {
    int most = f->model->sh_degree;
    fraction = schedule_fraction(f, fraction);
    if (f->warm_start || fraction >= f->options.sh_end || most == 0) return most;
    double start = SH_START * f->options.sh_end;
    if (fraction < start) return 0;
    double part = (fraction - start) / (f->options.sh_end - start);
    int degree = 1 + (int)(part * (most - 1));
    return degree < most ? degree : most;
}

static double full_rate(const sf_fitter *f, double fraction, int field) {
    const sf_fit_options *o = &f->options;
    switch (field) {
    case SF_FIELD_mean:
        return o->lr_mean * sqrt(o->lr_boost) * pow(o->lr_mean_final, fraction);
    case SF_FIELD_log_scale:
        return o->lr_scale * o->lr_boost;
    case SF_FIELD_quat:
        return o->lr_quat * sqrt(o->lr_boost);
    case SF_FIELD_logit_opacity:
        return o->lr_opacity * sqrt(o->lr_boost);
    case SF_FIELD_sh0:
        return o->lr_sh0;
    default:
        return o->lr_sh_rest * o->lr_boost;
    }
}

/* Learning-rate annealing: it removes the noise that the gradients of single views leave. */
double sf_cooled_rate(const sf_fitter *f, double fraction, double rate) {
    return f->recovery.lr_scale * rate * pow(f->options.cool_down_rate, cooled_part(f, fraction));
}

double sf_scheduled_rate(const sf_fitter *f, double fraction, int field) {
    return sf_cooled_rate(f, fraction, full_rate(f, schedule_fraction(f, fraction), field));
}

/* Relocation continues after densify_end, until the cool-down. An early cool-down ends densification. */
int sf_densification_is_due(const sf_fitter *f, double fraction) {
    const sf_fit_options *o = &f->options;
    double end = o->densify == SF_DENSIFY_RELOCATE ? fmax(o->densify_end, f->cool_down.from) : o->densify_end;
    if (sf_cools_down_early(f)) end = fmin(end, f->cool_down.from);
    return f->step % o->densify_every == 0 && fraction >= o->densify_start && fraction <= end;
}

size_t sf_planned_count(const sf_fitter *f, double fraction) {
    double first = (double)f->first_count, grown = most_added(f, (double)f->options.plan_steps);
    double most = fmin((double)f->options.max_gaussians, first + grown);
    double span = f->options.densify_end - f->options.densify_start;
    double part = span > 0 ? fmin((fraction - f->options.densify_start) / span, 1) : 1;
    return (size_t)(first + fmax(most - first, 0) * part);
}

/* Part of a step's cost that does not depend on the resolution: the work for each Gaussian. */
#define STEP_FLOOR 0.25
static double step_cost(const sf_fitter *f, double fraction) {
    return STEP_FLOOR + (1 - STEP_FLOOR) * pow(0.25, sf_scheduled_level(f, fraction, INT_MAX, INT_MAX));
}

double sf_cost_ahead(const sf_fitter *f, double fraction) {
    enum { SAMPLES = 64 };
    double sum = 0;
    double ahead = fmax(sf_end_of_run(f) - fraction, 0);
    for (int i = 0; i < SAMPLES; i++) sum += step_cost(f, fraction + ahead * (i + 0.5) / SAMPLES);
    return sum / SAMPLES / step_cost(f, fraction);
}
