/* densify.c - splits and clones.
 *
 * The schedule plans the number of Gaussians. Those with the largest mean screen gradient, or the largest
 * share of the error (densify_score.c), are densified: a small one is cloned, a large one is split along its
 * longest axis. Gaussians that are too faint or not finite are removed, or relocated (densify_relocate.c).
 */
#include "densify.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../base/statistics.h"
#include "opacity.h"
#include "local_units.h"
#include "densify_relocate.h"
#include "densify_score.h"
#include "ranks.h"
#include "remove.h"
#include "reorder.h"
#include "schedule.h"
#include "select.h"

/* A clone is displaced by a normal number times this many standard deviations along each axis; the halves of
 * a split by this many from the centre along the longest axis. */
#define CLONE_SPREAD 0.3
#define SPLIT_SPREAD 0.5
/* Halves of a split: factors of the longest scale, the others and the opacity. Together they cover a little
 * less than their parent, and the next steps fill the rest; if much less, each densification would be
 * visible. */
#define SPLIT_LONG    0.75f
#define SPLIT_OTHERS  0.95f
#define SPLIT_OPACITY 0.7f

static int longest_axis(const sf_params *params, size_t i) {
    int longest = 0;
    for (int k = 1; k < 3; k++)
        if (*sf_value(params, SF_FIELD_log_scale, i, k) > *sf_value(params, SF_FIELD_log_scale, i, longest))
            longest = k;
    return longest;
}

/* Splits Gaussian i; j is a copy of it. */
static void split(sf_fitter *f, size_t i, size_t j) {
    const sf_params *p = &f->model->params;
    int longest = longest_axis(p, i);
    float direction[3], half = (float)SPLIT_SPREAD * expf(*sf_value(p, SF_FIELD_log_scale, i, longest));
    float opacity = SPLIT_OPACITY * sf_sigmoidf(p->field[SF_FIELD_logit_opacity][i]);
    sf_axis_of(p, i, longest, direction);
    for (int k = 0; k < 3; k++) {
        float shrink = logf(k == longest ? SPLIT_LONG : SPLIT_OTHERS);
        *sf_value(p, SF_FIELD_mean, i, k) += half * direction[k];
        *sf_value(p, SF_FIELD_mean, j, k) -= half * direction[k];
        *sf_value(p, SF_FIELD_log_scale, i, k) += shrink;
        *sf_value(p, SF_FIELD_log_scale, j, k) += shrink;
    }
    sf_set_opacity(p, i, opacity);
    sf_set_opacity(p, j, opacity);
    sf_optimizer_restart(&f->moments, f->model, i);
    sf_optimizer_restart(&f->moments, f->model, j);
}

/* Clones Gaussian i: its copy j is displaced, and both together are as opaque as i was. */
static void clone(sf_fitter *f, sf_rng *rng, size_t i, size_t j) {
    const sf_params *p = &f->model->params;
    for (int axis = 0; axis < 3; axis++) {
        float direction[3], scale = expf(*sf_value(p, SF_FIELD_log_scale, j, axis));
        float step = (float)(CLONE_SPREAD * sf_rng_normal(rng)) * scale;
        sf_axis_of(p, j, axis, direction);
        for (int k = 0; k < 3; k++) *sf_value(p, SF_FIELD_mean, j, k) += step * direction[k];
    }
    float opacity = 1.0f - sqrtf(1.0f - sf_sigmoidf(p->field[SF_FIELD_logit_opacity][i]));
    sf_set_opacity(p, i, opacity);
    sf_set_opacity(p, j, opacity);
    sf_optimizer_restart(&f->moments, f->model, j);
}

typedef struct candidate {
    double score;
    uint32_t index; /* among the entries of those that are kept */
} candidate;

/* Largest score first, ties by index: a total order, so that any sort gives the same. */
static int by_score(const void *a, const void *b) {
    const candidate *x = a, *y = b;
    if (x->score != y->score) return x->score < y->score ? 1 : -1;
    return (x->index > y->index) - (x->index < y->index);
}

void sf_densify_end(sf_fitter *f) {
    if (f->densify.out_of_memory) return;
    f->densify.out_of_memory = 1;
    sf_log(f->ctx, SF_LOG_WARNING, "out of memory: the model stays at %zu Gaussians", f->model->count);
}

/* Moves the n first in the order of by_score to the front, in the order of the model. */
static sf_status keep_largest(const sf_fitter *f, candidate *candidates, size_t found, size_t n) {
    if (!n || n == found) return SF_OK;
    double *scores = sf_alloc(f->ctx, found, sizeof *scores);
    if (!scores) return SF_ERR_MEMORY;
    for (size_t k = 0; k < found; k++) scores[k] = candidates[k].score;
    double least = sf_ranked(scores, found, found - n); /* of those kept; of equals the first are */
    sf_free(f->ctx, scores);
    size_t equals = n, kept = 0;
    for (size_t k = 0; k < found; k++) equals -= candidates[k].score > least;
    for (size_t k = 0; k < found; k++) {
        int equal = candidates[k].score == least && equals;
        equals -= (size_t)equal;
        if (equal || candidates[k].score > least) candidates[kept++] = candidates[k];
    }
    return SF_OK;
}

static int falling(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x < y) - (x > y);
}

/* How many of the candidates are among the `wanted` best, of all ranks. */
static sf_status share_wanted(const sf_fitter *f, const candidate *candidates, size_t found, size_t wanted,
                              size_t *added) {
    *added = found < wanted ? found : wanted;
    if (!sf_is_shared(f)) return SF_OK;
    double *scores = sf_alloc(f->ctx, found + 1, sizeof *scores);
    if (!scores) return SF_ERR_MEMORY;
    for (size_t k = 0; k < found; k++) scores[k] = candidates[k].score;
    qsort(scores, found, sizeof *scores, falling);
    *added = sf_share_of_largest(f, scores, found, wanted);
    sf_free(f->ctx, scores);
    return SF_OK;
}

/* Gaussians on their way through a densification. */
typedef struct densification {
    sf_remap_entry *entries; /* [kept + added]: those that are kept, in the order of the model, then copies */
    candidate *candidates;   /* [added], largest score first */
    size_t kept, added;
} densification;

/* The kept Gaussians with the largest scores, at most `wanted`. */
static sf_status find_candidates(const sf_fitter *f, size_t wanted, densification *d) {
    size_t found = 0;
    if (!wanted) return SF_OK;
    d->candidates = sf_alloc(f->ctx, d->kept + 1, sizeof *d->candidates);
    if (!d->candidates) return SF_ERR_MEMORY;
    for (size_t k = 0; k < d->kept; k++) {
        size_t i = d->entries[k].from;
        double score =
            f->densify.visible_count[i] ? f->densify.gradient_sum[i] / f->densify.visible_count[i] : 0;
        if (score > 0 && score >= f->options.densify_threshold)
            d->candidates[found++] = (candidate){score, (uint32_t)k};
    }
    sf_status status = share_wanted(f, d->candidates, found, wanted, &d->added);
    if (!status) status = keep_largest(f, d->candidates, found, d->added);
    if (!status) qsort(d->candidates, d->added, sizeof *d->candidates, by_score);
    return status;
}

/* Removes what is not kept, adds a copy of each candidate, of the same degree, and splits or clones it. */
static sf_status apply(sf_fitter *f, densification *d) {
    size_t all = d->kept + d->added;
    if (all == f->model->count && !d->added) return SF_OK;
    uint32_t *moved_to = sf_alloc(f->ctx, all + 1, sizeof *moved_to);
    for (size_t k = 0; k < d->added; k++) d->entries[d->kept + k] = d->entries[d->candidates[k].index];
    sf_rng *rng = sf_rng_of_rank(f);
    sf_status status = moved_to ? sf_reorder_unsorted(f, d->entries, all, moved_to) : SF_ERR_MEMORY;
    for (size_t k = 0; k < d->added && !status; k++) {
        size_t i = moved_to[d->candidates[k].index], j = moved_to[d->kept + k];
        int longest = longest_axis(&f->model->params, i);
        double scale = exp((double)*sf_value(&f->model->params, SF_FIELD_log_scale, i, longest));
        if (scale > f->options.split_scale * (double)sf_unit_of(f, i))
            split(f, i, j);
        else
            clone(f, rng, i, j);
    }
    sf_free(f->ctx, moved_to);
    return status;
}

/* How many Gaussians to add, on all ranks, to `count` on this one. */
static size_t wanted_more(const sf_fitter *f, double fraction, size_t count) {
    size_t planned = sf_planned_count(f, fraction);
    count = sf_total(f, count);
    size_t wanted = planned > count ? planned - count : 0;
    size_t most = (size_t)(f->options.densify_rate * (double)count);
    if (wanted > most) wanted = most;
    return f->densify.out_of_memory ? 0 : wanted;
}

static sf_status remove_and_add(sf_fitter *f, double fraction) {
    densification d = {0};
    size_t count = f->model->count, planned = sf_planned_count(f, fraction);
    size_t most = count + (size_t)(f->options.densify_rate * (double)count);
    if (sf_is_shared(f))
        most = 2 * count; /* each may be a candidate */
    else if (most > planned)
        most = planned > count ? planned : count;
    d.entries = sf_alloc(f->ctx, most + 1, sizeof *d.entries);
    sf_status status = d.entries ? sf_list_kept(f, d.entries, &d.kept) : SF_ERR_MEMORY;
    if (!status) status = find_candidates(f, f->densify.ended ? 0 : wanted_more(f, fraction, d.kept), &d);
    if (!status) status = apply(f, &d);
    sf_free(f->ctx, d.entries);
    sf_free(f->ctx, d.candidates);
    return status;
}

sf_status sf_densify_step(sf_fitter *f, double fraction) {
    int kind = f->options.densify;
    if (kind == SF_DENSIFY_ERROR && sf_densify_score(f))
        sf_log(f->ctx, SF_LOG_WARNING, "out of memory: densification uses the screen gradient");
    if (kind == SF_DENSIFY_RELOCATE)
        return sf_relocate(f, sf_part_of_rank(f, wanted_more(f, fraction, f->model->count)));
    if (sf_selects(f) && !f->densify.ended && !f->densify.out_of_memory && sf_select_growth(f, fraction))
        sf_densify_end(f);
    return remove_and_add(f, fraction);
}

void sf_densify_clear(sf_densify *densify, size_t count) {
    memset(densify->gradient_sum, 0, count * sizeof *densify->gradient_sum);
    memset(densify->visible_count, 0, count * sizeof *densify->visible_count);
}
