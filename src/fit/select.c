/* select.c - a model of no more Gaussians than the scene needs (README, Size). */
#include "select.h"

#include <math.h>
#include <stdlib.h>

#include "densify.h"
#include "select_merge.h"

/* What a Gaussian must take away of the squared error, in mean squared errors of a value, where so many
 * values err together as if they were one, or more; where fewer do, so much less. */
#define PRICE    20.0
#define TOGETHER 60.0
/* Errors below this, of values 0..1, nobody sees. */
#define NOTHING (2.25 / 255)
/* What a float of an SH band must take away, in those of a Gaussian's: much of what bands make serves to
 * please single views. */
#define BAND_PRICE 3
/* So many times their square is hardly seen. */
#define HARDLY_SEEN 4
/* What goes at once may raise the squared error by this part where that is seen, and where it is hardly seen;
 * when few steps are left, to make up for it, or where it is more than half of all, by the last. Where it is
 * too much, the part of those tried that is tried next. */
#define RISE        0.05
#define UNSEEN_RISE 0.5
#define LATE_RISE   0.002
#define NEXT_PART   0.75
/* Growth that has taken away less than this part of the squared error, so many times one after another, ends.
 */
#define GROWTH_GAIN 0.02
enum { GROWTHS_IN_VAIN = 3 };
/* Where Gaussians are cheap it pays to try more of them, by the square of how much cheaper, at most so many
 * times as many. */
#define MOST_GROWTH 2.5
/* The part of its share of the squared error that a Gaussian may take away when there are two of it. */
#define GROWTH_PART 0.25

enum {
    LOOKED = 16, /* views that growth and removal are judged by */
    WEIGHED = 64 /* and what each Gaussian is worth, and its bands */
};

/* Charging begins at this part of the run, when what has grown has found its place. When so much of the
 * settling is over what goes is no longer made up for. */
#define CHARGE_FROM  0.6
#define CHARGE_UNTIL 0.25

int sf_selects(const sf_fitter *f) {
    return f->options.size == SF_SIZE_AUTO && f->options.growth != SF_GROWTH_RELOCATE;
}

/* Until here what goes is made up for. */
static double charge_until(const sf_fitter *f) {
    return f->cool_down.from + CHARGE_UNTIL * (sf_end_of_run(f) - f->cool_down.from);
}

/* Where what goes is not made up for any more, only once: before the last steps, which do what they can, and
 * early enough for a run that time ends to end in time. */
static int taking_out(const sf_fitter *f, double fraction) {
    double every = (double)f->options.grow_every / fmax((double)f->options.plan_steps, 1);
    if (f->step % f->options.grow_every || fraction < fmin(CHARGE_FROM, f->cool_down.from)) return 0;
    double left = (sf_end_of_run(f) - fraction) / every; /* in such intervals */
    return fraction <= charge_until(f) || (left >= 1 && left < 2);
}

/* Whether pairs may be put on trial: nothing grows any more, and there is time for the verdict. */
static int may_try(const sf_fitter *f, double fraction) {
    double steps = sf_merges_promise(f) ? SF_MERGE_STEPS : (double)f->options.grow_every;
    double trial = steps / fmax((double)f->options.plan_steps, 1);
    return f->options.merge > 0 && (f->densify.ended || fraction > f->options.grow_end) &&
           fraction + trial <= charge_until(f);
}

int sf_selection_is_due(const sf_fitter *f, double fraction) {
    if (!sf_selects(f)) return 0;
    if (taking_out(f, fraction)) return 1;
    if (!sf_merges_promise(f) || f->step % SF_MERGE_STEPS) return 0;
    return f->merges.count || may_try(f, fraction);
}

/* What a value's error counts for, against what chance does. What has gone may have cost something: that does
 * not make the others worth less, so the least counts. */
static void hear_noise(sf_fitter *f, const sf_errors *e) {
    double noise = e->toned / e->values * fmin(sf_correlation_area(e) / TOGETHER, 1);
    if (!(f->select.noise_variance > 0 && f->select.noise_variance < noise)) f->select.noise_variance = noise;
}

/* What a Gaussian must take away of the squared error. */
static double price_of(const sf_fitter *f) {
    return PRICE / f->options.quality * (f->select.noise_variance + NOTHING * NOTHING);
}

static int hardly_seen(const sf_errors *e) {
    return e->squares < HARDLY_SEEN * NOTHING * NOTHING * e->values;
}

/* Where errors are hardly seen only those grow that have a part in them: elsewhere this chooses worse than
 * the gradient does. */
static sf_status spare_the_good(sf_fitter *f) {
    sf_importance w;
    sf_status status = sf_measure_importance(f, WEIGHED, &w);
    if (!status && w.views) {
        double mean = w.errors.squares / w.errors.values;
        double price = PRICE / f->options.quality * (mean + NOTHING * NOTHING);
        for (size_t i = 0; i < w.count; i++) /* what is to go is below 0 */
            if (f->densify.gradient_sum[i] > 0 && GROWTH_PART * (double)w.share[i] < price)
                f->densify.gradient_sum[i] = 0;
    }
    sf_importance_free(f->ctx, &w);
    return status;
}

/* squares: of a value, for views may come. Pictures as coarse as those that are trained on: what coarse ones
 * teach makes fine ones no better. */
static void judge_growth(sf_fitter *f, int level, double squares) {
    int compares = f->select.min_error > 0 && level == f->select.min_error_level;
    int gained = compares && squares < f->select.min_error * (1 - GROWTH_GAIN);
    if (compares) f->select.vain_growths = gained ? 0 : f->select.vain_growths + 1;
    if (gained || !compares) f->select.min_error = squares, f->select.min_error_level = level;
    if (f->select.vain_growths < GROWTHS_IN_VAIN) return;
    f->densify.ended = 1;
    sf_log(f->ctx, SF_LOG_INFO,
           "growth ends at %zu Gaussians: %d times one after another it took away less than %g %% of the "
           "error",
           f->model->count, GROWTHS_IN_VAIN, 100 * GROWTH_GAIN);
}

sf_status sf_select_growth(sf_fitter *f, double fraction) {
    sf_errors errors;
    int level = sf_finest_level(f, fraction);
    sf_status status = sf_measure_errors(f, level, LOOKED, &errors);
    if (status) return status;
    if (errors.values > 0) judge_growth(f, level, errors.toned / errors.values);
    double cheaper = TOGETHER / sf_correlation_area(&errors);
    f->select.growth_scale = fmin(fmax(cheaper * cheaper, 1), MOST_GROWTH);
    if (level) status = sf_measure_errors(f, 0, LOOKED, &errors);
    if (status) return status;
    return hardly_seen(&errors) ? spare_the_good(f) : SF_OK;
}

/* What has an effect, the least first. */
typedef struct poor {
    float effect;
    uint32_t gaussian;
    float logit; /* its opacity, while it is tried without */
} poor;

static int by_effect(const void *a, const void *b) {
    const poor *x = a, *y = b;
    if (x->effect != y->effect) return x->effect < y->effect ? -1 : 1;
    return (x->gaussian > y->gaussian) - (x->gaussian < y->gaussian);
}

/* The squared error of some views without the first n of the list. */
static sf_status try_without(sf_fitter *f, poor *list, size_t n, sf_errors *errors) {
    float *logit = f->model->params.field[SF_FIELD_logit_opacity];
    for (size_t k = 0; k < n; k++) {
        list[k].logit = logit[list[k].gaussian];
        logit[list[k].gaussian] = SF_INVISIBLE;
    }
    sf_status status = sf_measure_errors(f, 0, LOOKED, errors);
    for (size_t k = 0; k < n; k++) logit[list[k].gaussian] = list[k].logit;
    return status;
}

/* What is not worth its price goes, but half of all at most where that is seen, and no more than the steps to
 * come make up for: where many do the same none is worth much, and what is left of them is worth more. */
static sf_status take_out(sf_fitter *f, double fraction, double price, const sf_importance *w) {
    sf_errors before, after;
    double rise = fraction > charge_until(f) ? LATE_RISE : hardly_seen(&w->errors) ? UNSEEN_RISE : RISE;
    poor *list = sf_alloc(f->ctx, w->count, sizeof *list);
    size_t n = 0, half = w->count / 2;
    if (!list) return SF_ERR_MEMORY;
    for (size_t i = 0; i < w->count; i++)
        if ((double)w->effect[i] < price && !(f->densify.gradient_sum[i] < 0) && sf_importance_is_known(w, i))
            list[n++] = (poor){.effect = w->effect[i], .gaussian = (uint32_t)i};
    qsort(list, n, sizeof *list, by_effect);
    sf_status status = sf_measure_errors(f, 0, LOOKED, &before);
    while (n && !status) {
        double unseen = NOTHING * NOTHING * before.values; /* of the same views as the rise */
        status = try_without(f, list, n, &after);
        if (after.squares - before.squares <= (n > half ? LATE_RISE : rise) * (before.squares + unseen))
            break;
        n = n > half ? half : (size_t)(NEXT_PART * (double)n);
    }
    for (size_t k = 0; k < n && !status; k++) f->densify.gradient_sum[list[k].gaussian] = -1;
    sf_free(f->ctx, list);
    return status;
}

/* Pairs are tried where the errors are such as hardly anybody sees: elsewhere each Gaussian has work to do,
 * or nobody has looked. */
static void leave_visible_alone(sf_importance *w) {
    double most = SF_CHANNELS * HARDLY_SEEN * NOTHING * NOTHING;
    for (size_t i = 0; i < w->count; i++)
        if ((double)w->share[i] > most * (double)w->mass[i] || !sf_importance_is_known(w, i)) w->effect[i] = INFINITY;
}

/* The degree at which what the bands above it make and the price of those up to it are the least, or the one
 * below its own: what is left of the bands can make up for some of those that went. Bands are paid by the
 * float. */
static void lower_degrees(const sf_importance *w, double price, uint8_t *degrees) {
    for (size_t i = 0; i < w->count; i++) {
        double least = INFINITY, floats = 0;
        int best = degrees[i];
        if (!sf_importance_is_known(w, i)) continue;
        for (int degree = 0; degree <= degrees[i]; degree++) {
            double without = degree < degrees[i] ? (double)w->bands[i][degree] : 0;
            if (degree) floats += sf_field_components(SF_FIELD_sh0 + degree);
            if (without + price * floats < least) least = without + price * floats, best = degree;
        }
        if (best < degrees[i]) degrees[i]--;
    }
}

int sf_skip_selection(sf_fitter *f, double fraction) {
    sf_errors errors;
    if (taking_out(f, fraction) || f->merges.count) return 0;
    if (sf_measure_errors(f, 0, LOOKED, &errors) || hardly_seen(&errors)) return 0;
    f->merges.in_vain++;
    return 1;
}

sf_status sf_select_prune(sf_fitter *f, double fraction, sf_importance *w, uint8_t *degrees) {
    sf_status status = sf_measure_importance(f, WEIGHED, w);
    if (status) return status;
    if (w->views) hear_noise(f, &w->errors);
    double price = price_of(f);
    int taking = taking_out(f, fraction);
    if (f->merges.count) sf_merges_decide(f, w, price, NOTHING * NOTHING);
    if (!w->views) return SF_OK;
    if (taking) status = take_out(f, fraction, price, w);
    if (taking && fraction <= charge_until(f)) lower_degrees(w, price / SF_MOST_FLOATS * BAND_PRICE, degrees);
    leave_visible_alone(w);
    /* pictures that are all but right leave nothing for a veil to gain */
    if (!status && !hardly_seen(&w->errors)) status = sf_mark_floaters(f);
    return status;
}

sf_status sf_select_merge(sf_fitter *f, double fraction, size_t went, sf_importance *w) {
    sf_status status = SF_OK;
    if (!w->views || !may_try(f, fraction)) return SF_OK;
    if (!hardly_seen(&w->errors)) { /* a photograph's */
        f->merges.in_vain++;
        return SF_OK;
    }
    if (went > f->model->count / SF_MODEL_CHANGED_PART) { /* the errors are others now */
        if (!sf_merges_promise(f)) return SF_OK;
        sf_importance_free(f->ctx, w);
        status = sf_measure_importance(f, WEIGHED, w);
        if (!status) leave_visible_alone(w);
    }
    return status ? status : sf_merges_begin(f, w);
}
