/* select_merge.c - tentative merges of two Gaussians; of several ranks each merges its own, and all decide on
 * them together.
 *
 * The rise of the error by a merge is known only after the neighbours have adapted to it. Until then the
 * second Gaussian stays in the model, invisible, and the parameters of the first before the merge are kept
 * (README, Size).
 */
#include "select_merge.h"

#include <math.h>

#include "out_of_view.h"
#include "ranks.h"
#include "select_merge_candidates.h"

/* Part of the Gaussians to merge: in the first round, at least, at most; and the factors by which it changes
 * after a round. */
#define FIRST_PART 0.05
#define LEAST_PART 0.003
#define MOST_PART  0.5
#define MORE       2.0
#define LESS       0.5
#define MUCH_LESS  0.25
/* Parts of the merges of a round that hold: above MANY_HOLD the next round merges more, below FEW_HOLD fewer.
 */
#define MANY_HOLD 0.6
#define FEW_HOLD  0.4
/* A round that removes less than this part of the Gaussians was in vain: it did not pay for measuring
 * importance. */
#define WORTH_MEASURING 0.005

enum {
    PASSES = 4,      /* a merged Gaussian may merge again */
    MOST_IN_VAIN = 3 /* rounds one after another */
};

int sf_merges_promise(const sf_merges *merges) { return merges->in_vain < MOST_IN_VAIN; }

/* Copies all values of Gaussian i to a row, or back. */
static void copy_values(const sf_model *m, size_t i, float *row) {
    for (int field = 0; field < SF_FIELD_COUNT; field++)
        for (int c = 0; i < m->banded[sf_field_band(field)] && c < sf_field_components(field); c++)
            *row++ = *sf_value(&m->params, field, i, c);
}

static void restore_values(const sf_model *m, size_t i, const float *row) {
    for (int field = 0; field < SF_FIELD_COUNT; field++)
        for (int c = 0; i < m->banded[sf_field_band(field)] && c < sf_field_components(field); c++)
            *sf_value(&m->params, field, i, c) = *row++;
}

static void undo(const sf_merge *t, const sf_model *m) {
    restore_values(m, t->a, t->of_a);
    m->params.field[SF_FIELD_logit_opacity][t->b] = t->logit_of_b;
}

void sf_merges_undo(const sf_merges *merges, sf_model *model) {
    for (size_t k = merges->count; k-- > 0;) undo(&merges->list[k], model);
}

static void undo_in_fitter(sf_fitter *f, const sf_merge *t) {
    undo(t, f->model);
    sf_optimizer_restart(&f->moments, f->model, t->a);
    sf_optimizer_restart(&f->moments, f->model, t->b);
}

void sf_merges_undo_all(sf_fitter *f) {
    if (f->merges.count) sf_update_second_moments(f);
    for (size_t k = f->merges.count; k-- > 0;) undo_in_fitter(f, &f->merges.list[k]);
    f->merges.count = 0;
}

void sf_merges_free(sf_fitter *f) {
    sf_free(f->ctx, f->merges.list);
    sf_free(f->ctx, f->merges.tiles);
}

/* Merges a candidate. Its importance score is the sum of both. */
static void merge(sf_fitter *f, const sf_merge_candidate *candidate, float *score) {
    sf_merge *m = &f->merges.list[f->merges.count++];
    float *logit = &f->model->params.field[SF_FIELD_logit_opacity][candidate->b];
    *m = (sf_merge){.a = candidate->a, .b = candidate->b, .leader = candidate->a, .logit_of_b = *logit};
    copy_values(f->model, m->a, m->of_a);
    sf_apply_merge(f, candidate);
    *logit = SF_INVISIBLE;
    score[m->a] += score[m->b];
}

/* Merges at most `most` candidates, the least expected rise first; *merged: how many. */
static sf_status merge_some(sf_fitter *f, size_t most, float *score, size_t *merged) {
    sf_merges *t = &f->merges;
    sf_merge_candidate *candidates;
    size_t n = 0;
    sf_status status = sf_find_merge_candidates(f, f->options.merge, score, &candidates, &n);
    if (n > most) n = most;
    if (!status) status = sf_grow(f->ctx, &t->list, &t->capacity, t->count, t->count + n, sizeof *t->list);
    *merged = status ? 0 : n;
    for (size_t k = 0; k < *merged; k++) merge(f, &candidates[k], score);
    sf_free(f->ctx, candidates);
    return status;
}

/* Sets the leader of each merge: the Gaussian that a was merged into in the end, or a itself. */
static sf_status find_leaders(sf_fitter *f) {
    sf_merges *t = &f->merges;
    uint32_t *leader = sf_alloc(f->ctx, f->model->count, sizeof *leader);
    if (!leader) return SF_ERR_MEMORY;
    for (size_t i = 0; i < f->model->count; i++) leader[i] = (uint32_t)i;
    for (size_t k = t->count; k-- > 0;) t->list[k].leader = leader[t->list[k].b] = leader[t->list[k].a];
    sf_free(f->ctx, leader);
    return SF_OK;
}

sf_status sf_merges_begin(sf_fitter *f, sf_importance *w) {
    sf_merges *t = &f->merges;
    sf_status status = SF_OK;
    if (!(t->part > 0)) t->part = FIRST_PART;
    size_t most = (size_t)ceil(t->part * (double)f->model->count), merged = 1;
    for (int pass = 0; pass < PASSES && merged && t->count < most && !status; pass++)
        status = merge_some(f, most - t->count, w->score, &merged);
    if (!status) status = find_leaders(f);
    if (status) sf_merges_undo_all(f);
    t->on_ranks = sf_is_shared(f) && sf_total(f, t->count) > 0;
    if (!sf_has_merges(f)) return status;
    sf_free(f->ctx, t->tiles);
    t->tiles = w->tiles, t->tile_count = w->tile_count, t->tile_capacity = w->tile_capacity;
    w->tiles = NULL;
    t->squares = w->errors.squares;
    return status;
}

/* Rise of the squared error that is attributed to a merged Gaussian. The error before is scaled by `fell`,
 * the ratio of all errors now and before, and is at least `invisible` for each value. */
static double rise_of(const sf_attributed_error *b, double fell, double invisible) {
    return (double)b->now - fmax(fell * (double)b->before, invisible * (double)b->values);
}

/* Sets the part of the Gaussians to merge next; holding: the part of the merges that held. */
static void adapt_part(sf_merges *t, int failed, double holding, int paid) {
    t->in_vain = paid ? 0 : t->in_vain + 1;
    if (failed)
        t->part = fmax(t->part * MUCH_LESS, LEAST_PART);
    else if (holding < FEW_HOLD)
        t->part *= LESS;
    else if (holding > MANY_HOLD)
        t->part = fmin(t->part * MORE, MOST_PART);
}

/* Number of Gaussians merged into each. */
static uint32_t *count_members(const sf_fitter *f) {
    uint32_t *members = sf_calloc(f->ctx, f->model->count, sizeof *members);
    for (size_t k = 0; k < f->merges.count && members; k++) members[f->merges.list[k].leader]++;
    return members;
}

/* Excludes both Gaussians: importance measured while one was hidden is that of neither. */
static void exclude(const sf_merge *t, sf_importance *w) { w->score[t->a] = w->score[t->b] = INFINITY; }

void sf_merges_decide(sf_fitter *f, sf_importance *w, double threshold, double invisible) {
    sf_merges *t = &f->merges;
    uint32_t *members = count_members(f);
    double fell = fmin(w->errors.squares / t->squares, 1), all = 0;
    size_t n = t->count, holding = 0, of_all = sf_total(f, n);
    t->on_ranks = 0;
    /* where views were added or removed the errors are not comparable */
    if (sf_most_of_ranks(f, !members || w->tile_count != t->tile_count) > 0) {
        sf_free(f->ctx, members);
        for (size_t k = 0; k < n; k++) exclude(&t->list[k], w);
        sf_merges_undo_all(f);
        return;
    }
    for (size_t i = 0; i < w->count; i++)
        if (members[i]) all += rise_of(&w->attributed[i], fell, invisible);
    int failed = sf_total_of(f, all) > threshold * (double)of_all;
    for (size_t k = n; k-- > 0;) {
        const sf_merge *m = &t->list[k];
        double most = threshold * (double)members[m->leader];
        if (!failed && rise_of(&w->attributed[m->leader], fell, invisible) <= most) {
            f->densify.gradient_sum[m->b] = -1;
            holding++;
        } else {
            undo_in_fitter(f, m);
            exclude(m, w);
        }
    }
    holding = sf_total(f, holding);
    adapt_part(t, failed, (double)holding / fmax((double)of_all, 1),
               (double)holding >= WORTH_MEASURING * (double)sf_total(f, w->count));
    t->count = 0;
    sf_free(f->ctx, members);
}
