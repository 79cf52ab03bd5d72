/* recovery.c - divergence recovery: back to an earlier model, and on with lower learning rates.
 *
 * The median of several losses is compared, since one bad picture raises the loss of its own steps only.
 * While a fit converges the median falls; it rises a little when pictures get finer or Gaussians are removed.
 * Added views make the losses before incomparable.
 *
 * Learning rates that are too high spoil the first median, too. So it is also compared with the loss of the
 * initial model at full resolution, where the loss is largest.
 */
#include "recovery.h"

#include <math.h>

#include "../base/statistics.h"
#include "restore_point.h"
#include "sample_views.h"
#include "schedule.h"

enum {
    MEDIAN_OF = 9,    /* losses */
    FIRST_VIEWS = 3,  /* in which the loss of the initial model is measured */
    MOST_RETURNS = 8, /* divergence that persists has another cause than the learning rates */
    KEEP_EVERY = 100  /* steps between restore points, where validation does not choose the model */
};

/* Diverged: median > RISE_RATIO x minimum and > minimum + RISE_LEAST, or > initial loss + RISE_LEAST. Beyond
 * SOUND_PART of that margin no restore point is saved. */
#define RISE_RATIO 4.0
#define RISE_LEAST 0.15
#define SOUND_PART 0.5
/* Factor of all learning rates at each return. */
#define RATE_CUT 0.5

/* Median of the last losses; 0: there are too few since the fit began or went back. */
static double median_loss(const sf_fitter *f) {
    double last[MEDIAN_OF];
    if (f->step - f->recovery.since < MEDIAN_OF) return 0;
    for (int i = 0; i < MEDIAN_OF; i++) {
        last[i] = f->losses[(f->step - 1 - i) % SF_LOSS_WINDOW];
        if (isnan(last[i])) return 0; /* not known yet */
    }
    return sf_median(last, MEDIAN_OF);
}

/* RISE_LEAST holds for L1. Huber's loss is smaller: scaled by the ratio at a residual of `off`, typical of an
 * initial model. */
static double rise_least(const sf_fitter *f) {
    const double off = 0.25, lambda = f->options.lambda_dssim, delta = f->options.huber_delta;
    double huber = off < delta ? off * off / (2 * delta) : off - delta / 2;
    return RISE_LEAST * (lambda + (1 - lambda) * huber / off);
}

/* The minimum or the initial loss plus `part` of the margin of divergence; INFINITY: nothing to compare with.
 */
static double limit(const sf_fitter *f, double part) {
    double least = f->recovery.min_loss, most = INFINITY, rise = rise_least(f);
    if (f->recovery.initial_loss > 0) most = f->recovery.initial_loss + part * rise;
    return least > 0 ? fmin(most, least + part * fmax((RISE_RATIO - 1) * least, rise)) : most;
}

/* Losses of the initial model. */
typedef struct initial_losses {
    double loss[FIRST_VIEWS];
    size_t count;
} initial_losses;

static sf_status add_loss(sf_fitter *f, sf_view_state *state, double pixels, double weight_sum, void *user) {
    (void)state, (void)pixels;
    initial_losses *initial = user;
    sf_loss_value loss;
    sf_stage_loss(&f->workspace, f->options.lambda_dssim, f->options.huber_delta, weight_sum, 0, 0, &loss);
    if (isfinite(loss.loss)) initial->loss[initial->count++] = loss.loss;
    return SF_OK;
}

/* Not with random backgrounds: each step has another one, and its loss is not comparable. */
static sf_status measure_start(sf_fitter *f) {
    initial_losses initial = {.count = 0};
    if (f->options.background == SF_BACKGROUND_RANDOM) return SF_OK;
    f->level = 0;
    f->sh_degree = sf_scheduled_degree(f, sf_fraction(f));
    for (int k = 0; k < 3; k++) f->step_background[k] = (float)f->background[k];
    sf_status status = sf_sample_views(f, FIRST_VIEWS, 0, add_loss, &initial, NULL);
    if (!status && initial.count) f->recovery.initial_loss = sf_median(initial.loss, initial.count);
    return status;
}

void sf_recovery_forget(sf_recovery *recovery, int64_t step) {
    recovery->min_loss = recovery->initial_loss = 0;
    recovery->since = step;
}

sf_status sf_recovery_step(sf_fitter *f, int chosen) {
    sf_status status = f->step ? SF_OK : measure_start(f);
    if (status) return status;
    double median = median_loss(f);
    if (median > limit(f, 1)) return sf_recover(f, median);
    if (median > 0 && !(f->recovery.min_loss > 0 && f->recovery.min_loss <= median))
        f->recovery.min_loss = median;
    if (chosen || (sf_has_restore_point(f) && f->step % KEEP_EVERY) || median > limit(f, SOUND_PART))
        return SF_OK;
    (void)sf_save_restore_point(f); /* without memory there is none until the next one */
    return SF_OK;
}

sf_status sf_recover(sf_fitter *f, double loss) {
    f->recovery.since = f->step;
    double before = f->recovery.min_loss > 0 ? f->recovery.min_loss : f->recovery.initial_loss;
    if (!sf_has_restore_point(f) || !(before > 0) || f->recovery.count == MOST_RETURNS) return SF_OK;
    sf_status status = sf_go_to_restore_point(f);
    if (status) return status;
    f->recovery.lr_scale *= RATE_CUT;
    f->recovery.count++;
    sf_log(f->ctx, SF_LOG_WARNING,
           "step %lld: the fit diverged (loss %.3g, the least before %.3g): it continues from an earlier "
           "model with %.3g of the learning rates",
           (long long)f->step, loss, before, f->recovery.lr_scale);
    return SF_OK;
}
