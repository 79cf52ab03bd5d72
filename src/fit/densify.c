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

#include "opacity.h"
#include "local_units.h"
#include "densify_relocate.h"
#include "densify_score.h"
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

/* The entry that keeps Gaussian i as it is. */
static sf_remap_entry entry_of(const sf_fitter *f, size_t i) {
    return (sf_remap_entry){(uint32_t)i, (uint8_t)sf_degree_of(f->model, i)};
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
static void clone(sf_fitter *f, size_t i, size_t j) {
    const sf_params *p = &f->model->params;
    for (int axis = 0; axis < 3; axis++) {
        float direction[3], scale = expf(*sf_value(p, SF_FIELD_log_scale, j, axis));
        float step = (float)(CLONE_SPREAD * sf_rng_normal(&f->rng)) * scale;
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
    uint32_t index;
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

/* The Gaussians with the largest scores, at most `wanted`, largest first; *n: how many. */
static candidate *find_candidates(const sf_fitter *f, size_t wanted, size_t *n) {
    size_t found = 0, count = f->model->count;
    candidate *candidates = sf_alloc(f->ctx, count, sizeof *candidates);
    if (!candidates) return NULL;
    for (size_t i = 0; i < count; i++) {
        double score =
            f->densify.visible_count[i] ? f->densify.gradient_sum[i] / f->densify.visible_count[i] : 0;
        if (score > 0 && score >= f->options.densify_threshold)
            candidates[found++] = (candidate){score, (uint32_t)i};
    }
    qsort(candidates, found, sizeof *candidates, by_score);
    *n = found < wanted ? found : wanted;
    return candidates;
}

/* Adds a copy of each candidate, of the same degree, and splits or clones it. */
static sf_status add_copies(sf_fitter *f, const candidate *candidates, size_t n) {
    size_t count = f->model->count;
    sf_remap_entry *entries = sf_alloc(f->ctx, count + n, sizeof *entries);
    uint32_t *moved_to = sf_alloc(f->ctx, count + n, sizeof *moved_to);
    sf_status status = entries && moved_to ? SF_OK : SF_ERR_MEMORY;
    if (!status) {
        for (size_t i = 0; i < count; i++) entries[i] = entry_of(f, i);
        for (size_t k = 0; k < n; k++) entries[count + k] = entries[candidates[k].index];
        status = sf_reorder(f, entries, count + n, moved_to);
    }
    for (size_t k = 0; k < n && !status; k++) {
        size_t i = moved_to[candidates[k].index], j = moved_to[count + k];
        int longest = longest_axis(&f->model->params, i);
        double scale = exp((double)*sf_value(&f->model->params, SF_FIELD_log_scale, i, longest));
        if (scale > f->options.split_scale * (double)sf_unit_of(f, i))
            split(f, i, j);
        else
            clone(f, i, j);
    }
    sf_free(f->ctx, entries);
    sf_free(f->ctx, moved_to);
    return status;
}

static sf_status add_gaussians(sf_fitter *f, size_t wanted) {
    size_t n;
    candidate *candidates = find_candidates(f, wanted, &n);
    if (!candidates) return SF_ERR_MEMORY;
    sf_status status = n ? add_copies(f, candidates, n) : SF_OK;
    sf_free(f->ctx, candidates);
    return status;
}

/* How many Gaussians to add. */
static size_t wanted_more(const sf_fitter *f, double fraction) {
    size_t count = f->model->count, planned = sf_planned_count(f, fraction);
    size_t wanted = planned > count ? planned - count : 0;
    size_t most = (size_t)(f->options.densify_rate * (double)count);
    if (wanted > most) wanted = most;
    return f->densify.out_of_memory ? 0 : wanted;
}

sf_status sf_densify_step(sf_fitter *f, double fraction) {
    int kind = f->options.densify;
    if (kind == SF_DENSIFY_ERROR && sf_densify_score(f))
        sf_log(f->ctx, SF_LOG_WARNING, "out of memory: densification uses the screen gradient");
    if (kind == SF_DENSIFY_RELOCATE) return sf_relocate(f, wanted_more(f, fraction));
    if (sf_selects(f) && !f->densify.ended && !f->densify.out_of_memory && sf_select_growth(f, fraction))
        sf_densify_end(f);
    sf_status status = sf_remove_marked(f, NULL);
    size_t wanted = !f->densify.ended && !status ? wanted_more(f, fraction) : 0;
    return wanted ? add_gaussians(f, wanted) : status;
}

void sf_densify_clear(sf_densify *densify, size_t count) {
    memset(densify->gradient_sum, 0, count * sizeof *densify->gradient_sum);
    memset(densify->visible_count, 0, count * sizeof *densify->visible_count);
}
