/* select.c - model selection: Gaussians and SH bands that lower the error by too little are removed (README,
 * Size). */
#include "select.h"

#include <math.h>
#include <stdlib.h>

#include "ranks.h"
#include "remove.h"
#include "schedule.h"
#include "select_floaters.h"
#include "select_importance.h"
#include "select_merge.h"

/* Prune threshold: the least reduction of the squared error that keeps a Gaussian, in noise variances of a
 * value, where the residuals' correlation area is FULL_AREA values or more; below that area the noise
 * variance falls linearly with it. */
#define THRESHOLD 20.0
#define FULL_AREA 60.0
/* The just noticeable error of a value in 0..1. */
#define VISIBLE (2.25 / 255)
/* A mean squared error below BARELY_VISIBLE times VISIBLE^2 counts as invisible. */
#define BARELY_VISIBLE 4
/* Factor of the threshold of a float of an SH band, relative to one of a Gaussian's floats: much of what
 * bands add fits single views only. */
#define BAND_FACTOR 3
/* Largest relative rise of the squared error that one pruning may cause: RISE normally, INVISIBLE_RISE where
 * errors are invisible, LATE_RISE where too few steps are left to make up for it or where more than half of
 * the Gaussians would go. If the rise is larger, NEXT_PART of them are tried. */
#define RISE           0.05
#define INVISIBLE_RISE 0.5
#define LATE_RISE      0.002
#define NEXT_PART      0.75
/* Densification ends after VAIN_GROWTHS in a row that each lowered the squared error by less than this part.
 */
#define GROWTH_GAIN 0.02
enum { VAIN_GROWTHS = 3 };
/* The number of Gaussians to add is scaled by (FULL_AREA / correlation area)^2, from 1 to MAX_GROWTH_SCALE.
 */
#define MAX_GROWTH_SCALE 2.5
/* The part of its error share that a Gaussian is expected to remove when it is split. */
#define GROWTH_PART 0.25

enum {
    CHANGED_PART = 50,    /* removing less than this part of the model hardly changes its errors */
    ERROR_VIEWS = 16,     /* views by which densification and pruning are judged */
    IMPORTANCE_VIEWS = 64 /* views over which importance is measured */
};

/* Pruning begins at this part of the run. Gaussians pruned later than PRUNE_UNTIL of the cool-down are not
 * made up for by the steps that are left. */
#define PRUNE_FROM  0.6
#define PRUNE_UNTIL 0.25

int sf_selects(const sf_fitter *f) {
    return f->options.size == SF_SIZE_AUTO && f->options.densify != SF_DENSIFY_RELOCATE;
}

/* The steps after a pruning up to here make up for it. */
static double prune_until(const sf_fitter *f) {
    return f->cool_down.from + PRUNE_UNTIL * (sf_end_of_run(f) - f->cool_down.from);
}

/* Every densify_every steps; after prune_until only once, between one and two such intervals before the end
 * of the run, so that a run with a time limit still ends in time. */
static int prune_is_due(const sf_fitter *f, double fraction) {
    double every = (double)f->options.densify_every / fmax((double)f->options.plan_steps, 1);
    if (f->step % f->options.densify_every || fraction < fmin(PRUNE_FROM, f->cool_down.from)) return 0;
    double left = (sf_end_of_run(f) - fraction) / every; /* in such intervals */
    return fraction <= prune_until(f) || (left >= 1 && left < 2);
}

/* Whether tentative merges may begin: densification is over, and there is time left to judge them. */
static int may_merge(const sf_fitter *f, double fraction) {
    double steps = sf_merges_promise(&f->merges) ? SF_MERGE_STEPS : (double)f->options.densify_every;
    double merge_time = steps / fmax((double)f->options.plan_steps, 1);
    return f->options.merge > 0 && (f->densify.ended || fraction > f->options.densify_end) &&
           fraction + merge_time <= prune_until(f);
}

int sf_selection_is_due(const sf_fitter *f, double fraction) {
    if (!sf_selects(f)) return 0;
    if (prune_is_due(f, fraction)) return 1;
    if (!sf_merges_promise(&f->merges) || f->step % SF_MERGE_STEPS) return 0;
    return sf_has_merges(f) || may_merge(f, fraction);
}

/* Noise variance of a value. The minimum so far is kept: pruning raises residuals, and must not make the rest
 * look cheaper. */
static void update_noise_variance(sf_fitter *f, const sf_errors *e) {
    double noise = e->corrected / e->values * fmin(sf_correlation_area(e) / FULL_AREA, 1);
    if (!(f->select.noise_variance > 0 && f->select.noise_variance < noise)) f->select.noise_variance = noise;
}

/* The prune threshold, a squared error. */
static double prune_threshold(const sf_fitter *f) {
    return THRESHOLD / f->options.quality * (f->select.noise_variance + VISIBLE * VISIBLE);
}

static int is_invisible(const sf_errors *e) {
    return e->squares < BARELY_VISIBLE * VISIBLE * VISIBLE * e->values;
}

/* Where errors are invisible, clears the score of Gaussians with a small error share, so that only the others
 * are densified. Where errors are visible the screen gradient chooses better. */
static sf_status densify_erring_only(sf_fitter *f) {
    sf_importance w;
    sf_status status = sf_measure_importance(f, IMPORTANCE_VIEWS, &w);
    if (!status && w.views) {
        double mean = w.errors.squares / w.errors.values;
        double threshold = THRESHOLD / f->options.quality * (mean + VISIBLE * VISIBLE);
        for (size_t i = 0; i < w.count; i++) /* scores of Gaussians to remove are below 0 */
            if (f->densify.gradient_sum[i] > 0 && GROWTH_PART * (double)w.error_share[i] < threshold)
                f->densify.gradient_sum[i] = 0;
    }
    sf_importance_free(f->ctx, &w);
    return status;
}

/* squares: mean squared error of a value at the resolution level of training: steps on coarse pictures do not
 * lower the error of fine ones. */
static void judge_densification(sf_fitter *f, int level, double squares) {
    int compares = f->select.min_error > 0 && level == f->select.min_error_level;
    int gained = compares && squares < f->select.min_error * (1 - GROWTH_GAIN);
    if (compares) f->select.vain_growths = gained ? 0 : f->select.vain_growths + 1;
    if (gained || !compares) f->select.min_error = squares, f->select.min_error_level = level;
    if (f->select.vain_growths < VAIN_GROWTHS) return;
    f->densify.ended = 1;
    sf_log(f->ctx, SF_LOG_INFO,
           "densification ends at %zu Gaussians: each of the last %d lowered the error by less than %g %%",
           sf_total(f, f->model->count), VAIN_GROWTHS, 100 * GROWTH_GAIN);
}

sf_status sf_select_growth(sf_fitter *f, double fraction) {
    sf_errors errors;
    int level = sf_finest_level(f, fraction);
    sf_status status = sf_measure_errors(f, level, ERROR_VIEWS, &errors);
    if (status) return status;
    if (errors.values > 0) judge_densification(f, level, errors.corrected / errors.values);
    double cheaper = FULL_AREA / sf_correlation_area(&errors);
    f->select.growth_scale = fmin(fmax(cheaper * cheaper, 1), MAX_GROWTH_SCALE);
    if (level) status = sf_measure_errors(f, 0, ERROR_VIEWS, &errors);
    if (status) return status;
    return is_invisible(&errors) ? densify_erring_only(f) : SF_OK;
}

/* A Gaussian below the threshold. */
typedef struct prune_candidate {
    float score;
    uint32_t gaussian;
    float logit; /* its logit of the opacity, while the model is measured without it */
} prune_candidate;

static int by_score(const void *a, const void *b) {
    const prune_candidate *x = a, *y = b;
    if (x->score != y->score) return x->score < y->score ? -1 : 1;
    return (x->gaussian > y->gaussian) - (x->gaussian < y->gaussian);
}

/* The squared error of ERROR_VIEWS views without the first n candidates. */
static sf_status measure_without(sf_fitter *f, prune_candidate *list, size_t n, sf_errors *errors) {
    float *logit = f->model->params.field[SF_FIELD_logit_opacity];
    for (size_t k = 0; k < n; k++) {
        list[k].logit = logit[list[k].gaussian];
        logit[list[k].gaussian] = SF_INVISIBLE;
    }
    sf_status status = sf_measure_errors(f, 0, ERROR_VIEWS, errors);
    for (size_t k = 0; k < n; k++) logit[list[k].gaussian] = list[k].logit;
    return status;
}

/* *n: how many of the candidates, least important first, are among the `wanted` least important of all ranks.
 */
static sf_status least_of_all(const sf_fitter *f, const prune_candidate *list, size_t found, size_t wanted,
                              size_t *n) {
    double *scores = sf_alloc(f->ctx, found + 1, sizeof *scores);
    if (!scores) return SF_ERR_MEMORY;
    for (size_t k = 0; k < found; k++) scores[k] = -(double)list[k].score;
    *n = sf_share_of_largest(f, scores, found, wanted);
    sf_free(f->ctx, scores);
    return SF_OK;
}

/* Marks Gaussians below the threshold for removal, the least important first: at most half of all where
 * errors are visible, and no more at once than `rise` allows. Redundant Gaussians have a low score each; when
 * some of them are removed, the importance of the others rises. */
static sf_status mark_pruned(sf_fitter *f, double fraction, double threshold, const sf_importance *w) {
    sf_errors before, after;
    double rise = fraction > prune_until(f) ? LATE_RISE : is_invisible(&w->errors) ? INVISIBLE_RISE : RISE;
    prune_candidate *list = sf_alloc(f->ctx, w->count, sizeof *list);
    size_t n = 0, found = 0, all, half = sf_total(f, w->count) / 2;
    if (!list) return SF_ERR_MEMORY;
    for (size_t i = 0; i < w->count; i++)
        if ((double)w->score[i] < threshold && !(f->densify.gradient_sum[i] < 0) &&
            sf_importance_is_known(w, i))
            list[found++] = (prune_candidate){.score = w->score[i], .gaussian = (uint32_t)i};
    qsort(list, found, sizeof *list, by_score);
    n = found, all = sf_total(f, found);
    sf_status status = sf_measure_errors(f, 0, ERROR_VIEWS, &before);
    while (all && !status) {
        double unseen = VISIBLE * VISIBLE * before.values; /* of the same views as the rise */
        status = measure_without(f, list, n, &after);
        if (after.squares - before.squares <= (all > half ? LATE_RISE : rise) * (before.squares + unseen))
            break;
        all = all > half ? half : (size_t)(NEXT_PART * (double)all);
        status = least_of_all(f, list, found, all, &n);
    }
    for (size_t k = 0; k < n && !status; k++) f->densify.gradient_sum[list[k].gaussian] = -1;
    sf_free(f->ctx, list);
    return status;
}

/* Merges are tried only where errors are invisible; other Gaussians, and those of which no view was measured,
 * get a score of INFINITY. */
static void exclude_visible_errors(sf_importance *w) {
    double most = SF_CHANNELS * BARELY_VISIBLE * VISIBLE * VISIBLE;
    for (size_t i = 0; i < w->count; i++)
        if ((double)w->error_share[i] > most * (double)w->blend_weight[i] || !sf_importance_is_known(w, i))
            w->score[i] = INFINITY;
}

/* Lowers the degree of Gaussians by one where a lower degree is best. The best degree minimises the score of
 * the bands above it plus the threshold for the floats up to it. Only one band is removed, since the others
 * make up for part of it. */
static void lower_degrees(const sf_importance *w, double threshold, uint8_t *degrees) {
    for (size_t i = 0; i < w->count; i++) {
        double least = INFINITY, floats = 0;
        int best = degrees[i];
        if (!sf_importance_is_known(w, i)) continue;
        for (int degree = 0; degree <= degrees[i]; degree++) {
            double without = degree < degrees[i] ? (double)w->bands[i][degree] : 0;
            if (degree) floats += sf_field_components(SF_FIELD_sh0 + degree);
            if (without + threshold * floats < least) least = without + threshold * floats, best = degree;
        }
        if (best < degrees[i]) degrees[i]--;
    }
}

/* Whether selection is due for merges only and a few views show that no merge would hold; counts the vain
 * round. Then only floaters are removed. */
static int skip(sf_fitter *f, double fraction) {
    sf_errors errors;
    if (prune_is_due(f, fraction) || sf_has_merges(f)) return 0;
    if (sf_measure_errors(f, 0, ERROR_VIEWS, &errors) || is_invisible(&errors)) return 0;
    f->merges.in_vain++;
    return 1;
}

sf_status sf_select_mark(sf_fitter *f, double fraction, sf_importance *w, uint8_t *degrees) {
    sf_status status = sf_measure_importance(f, IMPORTANCE_VIEWS, w);
    if (status) return status;
    if (w->views) update_noise_variance(f, &w->errors);
    double threshold = prune_threshold(f);
    int pruning = prune_is_due(f, fraction);
    if (sf_has_merges(f)) sf_merges_decide(f, w, threshold, VISIBLE * VISIBLE);
    if (!w->views) return SF_OK;
    if (pruning) status = mark_pruned(f, fraction, threshold, w);
    if (pruning && fraction <= prune_until(f))
        lower_degrees(w, threshold / SF_MOST_FLOATS * BAND_FACTOR, degrees);
    exclude_visible_errors(w);
    /* where errors are invisible a floater lowers no error */
    if (!status && !is_invisible(&w->errors)) status = sf_mark_floaters(f);
    return status;
}

/* Begins a round of tentative merges where it may pay. importance: as measured before the removal, for the
 * Gaussians that are left; removed: how many were removed. SF_ERR_MEMORY. */
static sf_status merge(sf_fitter *f, double fraction, size_t removed, sf_importance *w) {
    sf_status status = SF_OK;
    if (!w->views || !may_merge(f, fraction)) return SF_OK;
    /* the noise of a camera's pictures is visible, and merges would not hold */
    if (!is_invisible(&w->errors)) {
        f->merges.in_vain++;
        return SF_OK;
    }
    if (sf_total(f, removed) > sf_total(f, f->model->count) /
                                   CHANGED_PART) { /* the importance of the larger model no longer holds */
        if (!sf_merges_promise(&f->merges)) return SF_OK;
        sf_importance_free(f->ctx, w);
        status = sf_measure_importance(f, IMPORTANCE_VIEWS, w);
        if (!status) exclude_visible_errors(w);
    }
    return status ? status : sf_merges_begin(f, w);
}

/* The statistics of densification are no longer needed: gradient_sum carries the scores through the removal.
 */
static sf_status prune_and_merge(sf_fitter *f, double fraction, uint8_t *degrees, int *changed) {
    sf_importance w = {0};
    size_t had = f->model->count, floats = sf_model_floats(f->model);
    for (size_t i = 0; i < had; i++) degrees[i] = (uint8_t)sf_degree_of(f->model, i);
    sf_status status = sf_select_mark(f, fraction, &w, degrees);
    for (size_t i = 0; i < had && !status; i++)
        if (!(f->densify.gradient_sum[i] < 0)) f->densify.gradient_sum[i] = (double)w.score[i];
    if (!status) status = sf_remove_marked(f, degrees);
    size_t removed = had - f->model->count, lost = sf_total(f, floats - sf_model_floats(f->model));
    *changed = lost > sf_total(f, floats) / CHANGED_PART;
    w.count = f->model->count;
    for (size_t i = 0; i < w.count && !status; i++) w.score[i] = (float)f->densify.gradient_sum[i];
    if (!status) status = merge(f, fraction, removed, &w);
    sf_importance_free(f->ctx, &w);
    return status;
}

static sf_status remove_floaters(sf_fitter *f) {
    sf_status status = sf_mark_floaters(f);
    return status ? status : sf_remove_marked(f, NULL);
}

sf_status sf_select_step(sf_fitter *f, double fraction, int *changed) {
    *changed = 0;
    int skipped = skip(f, fraction);
    uint8_t *degrees = skipped ? NULL : sf_alloc(f->ctx, f->model->count, 1);
    sf_status status = skipped   ? remove_floaters(f)
                       : degrees ? prune_and_merge(f, fraction, degrees, changed)
                                 : SF_ERR_MEMORY;
    sf_free(f->ctx, degrees);
    if (status != SF_ERR_MEMORY) return status;
    sf_log(f->ctx, SF_LOG_WARNING, "out of memory: the model stays larger than needed");
    return SF_OK;
}
