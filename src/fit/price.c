/* price.c - a model of no more Gaussians than the scene needs (README, Size). */
#include "price.h"

#include <math.h>

#include "merge.h"
#include "worth.h"

/* A halving of the model is worth PRICE 10 log10(e) ln 2 dB = 2.1 dB of what it costs at once, before the
 * steps to come make up for it: as measured, a tenth of a decibel after them. */
#define PRICE 0.7
/* Errors below this, of values 0..1, are nobody's: half a step of 8 bits. */
#define NOTHING (0.5 / 255)
/* Two Gaussians that differ from one in less than this part of their square integral become it. */
#define MISFIT 0.1

/* Charging begins at this part of the run, when what has grown has found its place, and ends when so much of
 * the settling is over: what goes later is not made up for. */
#define CHARGE_FROM  0.6
#define CHARGE_UNTIL 0.5

int sf_is_priced(const sf_fitter *f) {
    return f->options.size == SF_SIZE_AUTO && f->options.growth != SF_GROWTH_RELOCATE;
}

int sf_charging_due(const sf_fitter *f, double fraction) {
    double settling = sf_end_of_run(f) - f->settle_from;
    return sf_is_priced(f) && f->step % f->options.grow_every == 0 &&
           fraction >= fmin(CHARGE_FROM, f->settle_from) &&
           fraction <= f->settle_from + CHARGE_UNTIL * settling;
}

/* What a Gaussian must take away of the squared error. */
static double price_of(const sf_fitter *f, const sf_worth *w) {
    return PRICE / f->options.quality * (w->squares + NOTHING * NOTHING * w->values) / (double)w->count;
}

sf_status sf_charge(sf_fitter *f) {
    sf_worth w;
    size_t merged = 0;
    int level = f->level;
    f->level = 0;
    sf_status status = sf_weigh(f, 0, &w);
    f->level = level;
    if (!status && w.views) {
        double price = price_of(f, &w);
        for (size_t i = 0; i < w.count; i++)
            if ((double)w.effect[i] < price) f->screen_sum[i] = -1;
        status = sf_merge_pairs(f, MISFIT, w.effect, INFINITY, &merged);
    }
    sf_worth_free(f->ctx, &w);
    return status;
}
