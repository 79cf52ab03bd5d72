/* price.c - a model of no more Gaussians than the scene needs (README, Size). */
#include "price.h"

#include <math.h>
#include <stdlib.h>

#include "merge.h"
#include "worth.h"

/* A halving of the model is worth PRICE 10 log10(e) ln 2 dB = 2.1 dB of what it costs at once, before the
 * steps to come make up for it: as measured, a tenth of a decibel after them. */
#define PRICE 0.7
/* Errors below this, of values 0..1, nobody sees. */
#define NOTHING (2.0 / 255)
/* Two Gaussians that differ from one in less than this part of their square integral become it. */
#define MISFIT 0.1

/* What goes at once may raise the squared error by this part: the steps to come make up for it. */
#define RISE      0.5
#define INVISIBLE (-20.0f) /* logit-opacity */

/* Growth that has taken away less than this part of the squared error, so many times one after another, ends.
 */
#define GROWTH_GAIN 0.02
enum { GROWTHS_IN_VAIN = 2 };
/* The part of its share of the squared error that a Gaussian may take away when there are two of it. */
#define GROWTH_PART 2.0
/* What went is made up for, and more may go, where the squared error is not larger than this part of what it
 * was when it went. */
#define MADE_UP 1.25

enum {
    TRIED = 16, /* views that a removal is tried on */
    ROUNDS = 6  /* of finding how many may go */
};

/* Charging begins at this part of the run, when what has grown has found its place, and ends when so much of
 * the settling is over: what goes later is not made up for. */
#define CHARGE_FROM  0.6
#define CHARGE_UNTIL 0.5

int sf_is_priced(const sf_fitter *f) {
    return f->options.size == SF_SIZE_AUTO && f->options.growth != SF_GROWTH_RELOCATE;
}

int sf_charging_due(const sf_fitter *f, double fraction) {
    double settling = sf_end_of_run(f) - f->settle_from;
    int64_t every = (f->options.grow_every + 1) / 2;
    double from = f->grown_out ? 0 : fmin(fmax(CHARGE_FROM, f->options.grow_end), f->settle_from);
    return sf_is_priced(f) && f->step % every == 0 && fraction > from &&
           fraction <= f->settle_from + CHARGE_UNTIL * settling;
}

/* What a Gaussian must take away of the squared error. */
static double price_of(const sf_fitter *f, const sf_worth *w) {
    return PRICE / f->options.quality * (w->squares + NOTHING * NOTHING * w->values) / (double)w->count;
}

sf_status sf_consider_growth(sf_fitter *f) {
    sf_worth w;
    int level = f->level;
    f->level = 0;
    sf_status status = sf_weigh(f, TRIED, &w);
    f->level = level;
    if (!status && w.views) {
        int gained = !(f->least_squares > 0) || w.squares < f->least_squares * (1 - GROWTH_GAIN);
        f->growths_in_vain = gained ? 0 : f->growths_in_vain + 1;
        if (gained) f->least_squares = w.squares;
        if (f->growths_in_vain >= GROWTHS_IN_VAIN) f->grown_out = 1;
        double price = price_of(f, &w);
        for (size_t i = 0; i < w.count; i++) /* what is to go is below 0 */
            if (f->screen_sum[i] > 0 && GROWTH_PART * (double)w.share[i] < price) f->screen_sum[i] = 0;
    }
    sf_worth_free(f->ctx, &w);
    return status;
}

/* Gaussians that are worth less than the price, the least first. */
typedef struct poor {
    float effect;
    uint32_t index;
    float logit; /* its opacity, while it is tried without */
} poor;

static int by_effect(const void *a, const void *b) {
    const poor *x = a, *y = b;
    if (x->effect != y->effect) return x->effect < y->effect ? -1 : 1;
    return (x->index > y->index) - (x->index < y->index);
}

static sf_status add_squares(sf_fitter *f, sf_view_state *state, double pixels, void *squares) {
    (void)state;
    *(double *)squares += pixels * sf_squares(&f->workspace);
    return SF_OK;
}

/* The squared error of some views without the first n of them. */
static sf_status try_without(sf_fitter *f, poor *list, size_t n, double *squares) {
    float *logit = f->model->params.field[SF_FIELD_logit_opacity];
    for (size_t k = 0; k < n; k++) {
        list[k].logit = logit[list[k].index];
        logit[list[k].index] = INVISIBLE;
    }
    *squares = 0;
    sf_status status = sf_look_at_views(f, TRIED, 0, add_squares, squares, NULL);
    for (size_t k = 0; k < n; k++) logit[list[k].index] = list[k].logit;
    return status;
}

/* How many of the list may go at once: each alone is not worth its price, but many that do the same may be.
 */
static sf_status find_most(sf_fitter *f, poor *list, size_t n, size_t *most) {
    double before, after;
    size_t low = 0, high = n;
    sf_status status = try_without(f, list, 0, &before);
    for (int round = 0; round < ROUNDS && low < high && !status; round++) {
        size_t tried = round ? low + (high - low + 1) / 2 : n;
        status = try_without(f, list, tried, &after);
        if (after <= before * (1 + RISE))
            low = tried;
        else
            high = tried - 1;
    }
    *most = low;
    return status;
}

static sf_status take_out(sf_fitter *f, const sf_worth *w) {
    double price = price_of(f, w);
    size_t n = 0, most = 0;
    poor *list = sf_alloc(f->ctx, w->count, sizeof *list);
    if (!list) return SF_ERR_MEMORY;
    for (size_t i = 0; i < w->count; i++)
        if ((double)w->effect[i] < price) list[n++] = (poor){.effect = w->effect[i], .index = (uint32_t)i};
    qsort(list, n, sizeof *list, by_effect);
    sf_status status = find_most(f, list, n, &most);
    for (size_t k = 0; k < most && !status; k++) f->screen_sum[list[k].index] = -1;
    sf_free(f->ctx, list);
    return status;
}

sf_status sf_charge(sf_fitter *f) {
    sf_worth w;
    size_t merged = 0;
    int level = f->level;
    f->level = 0;
    sf_status status = sf_weigh(f, 0, &w);
    int made_up = !(f->charged_squares > 0) || w.squares <= MADE_UP * f->charged_squares;
    if (!status && w.views && made_up) {
        f->charged_squares = w.squares;
        status = take_out(f, &w);
        if (!status)
            status = sf_merge_pairs(f, MISFIT, w.effect, RISE * (w.squares + NOTHING * NOTHING * w.values),
                                    &merged);
    }
    f->level = level;
    sf_worth_free(f->ctx, &w);
    return status;
}
