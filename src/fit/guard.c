/* guard.c - a fit that diverges goes back to where it did not, and on with lower rates.
 *
 * One bad picture raises the loss of its own steps alone: it takes the median of several. That of a fit that
 * learns falls, and rises by little where pictures get finer or Gaussians go; new pictures are no measure for
 * what old ones gave.
 */
#include "fitter.h"

#include <math.h>

#include "refine.h"

enum {
    MEDIAN_OF = 9,    /* losses */
    MOST_RETURNS = 8, /* what they do not cure, lower rates do not */
    KEEP_EVERY = 100  /* steps, where no views of validation say which model is good */
};

/* The median has diverged where it is beyond so many times the least so far, and above it by so much; it is
 * none to keep beyond that part of the way. */
#define RISE_RATIO 4.0
#define RISE_LEAST 0.15
#define SOUND_PART 0.5
/* What all rates are multiplied by then. */
#define RATE_CUT 0.5

/* Of the last losses; 0: there are too few since the fit began or went back. */
static double median_loss(const sf_fitter *f) {
    double last[MEDIAN_OF];
    if (f->step - f->guard_since < MEDIAN_OF) return 0;
    for (int i = 0; i < MEDIAN_OF; i++) last[i] = f->losses[(f->step - 1 - i) % SF_LOSS_WINDOW];
    return sf_median(last, MEDIAN_OF);
}

/* The loss at which the fit is taken to have diverged, times part; INFINITY before the first median. */
static double limit(const sf_fitter *f, double part) {
    if (!(f->least_loss > 0)) return INFINITY;
    return f->least_loss + part * fmax((RISE_RATIO - 1) * f->least_loss, RISE_LEAST);
}

void sf_guard_forget(sf_fitter *f) {
    f->least_loss = 0;
    f->guard_since = f->step;
}

sf_status sf_guard(sf_fitter *f) {
    double median = median_loss(f);
    if (median > limit(f, 1)) return sf_diverged(f, median);
    if (median > 0 && !(f->least_loss > 0 && f->least_loss <= median)) f->least_loss = median;
    int judged = f->kept_out_count && !f->joined && !isnan(f->best_psnr);
    if (judged || (f->best && f->step % KEEP_EVERY) || median > limit(f, SOUND_PART)) return SF_OK;
    (void)sf_keep_best(f); /* without memory for it there is an older one to go back to, or none */
    return SF_OK;
}

sf_status sf_diverged(sf_fitter *f, double loss) {
    f->guard_since = f->step;
    if (!f->best || !(f->least_loss > 0) || f->diverged == MOST_RETURNS) return SF_OK;
    sf_status status = sf_bring_back(f);
    if (status) return status;
    f->rate_cut *= RATE_CUT;
    f->diverged++;
    sf_log(f->ctx, SF_LOG_WARNING,
           "step %lld: the fit diverged (loss %.3g, the least before %.3g): it goes on from an earlier "
           "model with %.3g of the learning rates",
           (long long)f->step, loss, f->least_loss, f->rate_cut);
    return SF_OK;
}
