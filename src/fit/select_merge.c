/* select_merge.c - pairs of Gaussians on trial.
 *
 * What a merger costs is known only when its neighbours have had the time to make up for it: until then the
 * one that is not to be seen keeps its place, and what the other was is kept (README, Size).
 */
#include "select_merge.h"

#include <math.h>

#include "select_merge_candidates.h"

/* Part of the Gaussians that a first trial takes away, and any; by what it changes after a trial. */
#define FIRST_PART 0.05
#define LEAST_PART 0.003
#define MOST_PART  0.5
#define MORE       2.0
#define LESS       0.5
#define MUCH_LESS  0.25
/* A part of good pairs from which on there are more of them next, and below which there are fewer. */
#define MANY_GOOD 0.6
#define FEW_GOOD  0.4
/* A trial that takes away less than this part of the Gaussians was not worth looking at the views for. */
#define WORTH_LOOKING 0.005

enum {
    PASSES = 4,      /* what has merged may merge again */
    MOST_IN_VAIN = 3 /* one after another */
};

int sf_merges_promise(const sf_merges *merges) { return merges->in_vain < MOST_IN_VAIN; }

/* All values of Gaussian i, to or from a row. */
static void keep_values(const sf_model *m, size_t i, float *row) {
    for (int field = 0; field < SF_FIELD_COUNT; field++)
        for (int c = 0; i < m->banded[sf_field_band(field)] && c < sf_field_components(field); c++)
            *row++ = *sf_value(&m->params, field, i, c);
}

static void put_values(const sf_model *m, size_t i, const float *row) {
    for (int field = 0; field < SF_FIELD_COUNT; field++)
        for (int c = 0; i < m->banded[sf_field_band(field)] && c < sf_field_components(field); c++)
            *sf_value(&m->params, field, i, c) = *row++;
}

static void undo(const sf_merge *t, const sf_model *m) {
    put_values(m, t->a, t->of_a);
    m->params.field[SF_FIELD_logit_opacity][t->b] = t->logit_of_b;
}

void sf_merges_undo(const sf_merges *trials, sf_model *model) {
    for (size_t k = trials->count; k-- > 0;) undo(&trials->list[k], model);
}

static void undo_and_forget(sf_fitter *f, const sf_merge *t) {
    undo(t, f->model);
    sf_optimizer_restart(&f->moments, f->model, t->a);
    sf_optimizer_restart(&f->moments, f->model, t->b);
}

void sf_merges_undo_all(sf_fitter *f) {
    for (size_t k = f->merges.count; k-- > 0;) undo_and_forget(f, &f->merges.list[k]);
    f->merges.count = 0;
}

void sf_merges_free(sf_fitter *f) {
    sf_free(f->ctx, f->merges.list);
    sf_free(f->ctx, f->merges.tiles);
}

/* One that stands for two costs what both would. */
static void merge(sf_fitter *f, const sf_merge_candidate *pair, float *score) {
    sf_merge *one = &f->merges.list[f->merges.count++];
    float *logit = &f->model->params.field[SF_FIELD_logit_opacity][pair->b];
    *one = (sf_merge){.a = pair->a, .b = pair->b, .leader = pair->a, .logit_of_b = *logit};
    keep_values(f->model, one->a, one->of_a);
    sf_apply_merge(f, pair);
    *logit = SF_INVISIBLE;
    score[one->a] += score[one->b];
}

/* At most so many of the cheapest pairs; *merged: how many. */
static sf_status merge_some(sf_fitter *f, size_t most, float *score, size_t *merged) {
    sf_merges *t = &f->merges;
    sf_merge_candidate *pairs;
    size_t n = 0;
    sf_status status = sf_find_merge_candidates(f, f->options.merge, score, &pairs, &n);
    if (n > most) n = most;
    if (!status) status = sf_grow(f->ctx, &t->list, &t->capacity, t->count, t->count + n, sizeof *t->list);
    *merged = status ? 0 : n;
    for (size_t k = 0; k < *merged; k++) merge(f, &pairs[k], score);
    sf_free(f->ctx, pairs);
    return status;
}

/* What stands for others may have got one that stands for it. */
static sf_status name_leaders(sf_fitter *f) {
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
    if (!status) status = name_leaders(f);
    if (status) sf_merges_undo_all(f);
    if (status || !t->count) return status;
    sf_free(f->ctx, t->tiles);
    t->tiles = w->tiles, t->tile_count = w->tile_count, t->tile_capacity = w->tile_capacity;
    w->tiles = NULL;
    t->squares = w->errors.squares;
    return SF_OK;
}

/* What a pair has raised the squared error by, beyond what nobody sees; `fell`: what all errors did
 * meanwhile. */
static double rise_of(const sf_attributed_error *b, double fell, double nothing) {
    return (double)b->now - fmax(fell * (double)b->before, nothing * (double)b->values);
}

/* How many to try next, by how it went: `good` is the part of the pairs that were. */
static void learn(sf_merges *t, int failed, double good, int worthwhile) {
    t->in_vain = worthwhile ? 0 : t->in_vain + 1;
    if (failed)
        t->part = fmax(t->part * MUCH_LESS, LEAST_PART);
    else if (good < FEW_GOOD)
        t->part *= LESS;
    else if (good > MANY_GOOD)
        t->part = fmin(t->part * MORE, MOST_PART);
}

/* How many each stands for beside itself, by Gaussian. */
static uint32_t *count_members(const sf_fitter *f) {
    uint32_t *members = sf_calloc(f->ctx, f->model->count, sizeof *members);
    for (size_t k = 0; k < f->merges.count && members; k++) members[f->merges.list[k].leader]++;
    return members;
}

/* What was weighed while one of them was hidden says nothing of either. */
static void leave(const sf_merge *t, sf_importance *w) { w->score[t->a] = w->score[t->b] = INFINITY; }

void sf_merges_decide(sf_fitter *f, sf_importance *w, double price, double nothing) {
    sf_merges *t = &f->merges;
    uint32_t *members = count_members(f);
    double fell = fmin(w->errors.squares / t->squares, 1), all = 0;
    size_t n = t->count, good = 0;
    if (!members || w->tile_count != t->tile_count) { /* views came or went: nothing to compare */
        sf_free(f->ctx, members);
        for (size_t k = 0; k < n; k++) leave(&t->list[k], w);
        sf_merges_undo_all(f);
        return;
    }
    for (size_t i = 0; i < w->count; i++)
        if (members[i]) all += rise_of(&w->attributed[i], fell, nothing);
    int failed = all > price * (double)n;
    for (size_t k = n; k-- > 0;) {
        const sf_merge *one = &t->list[k];
        double most = price * (double)members[one->leader];
        if (!failed && rise_of(&w->attributed[one->leader], fell, nothing) <= most) {
            f->densify.gradient_sum[one->b] = -1;
            good++;
        } else {
            undo_and_forget(f, one);
            leave(one, w);
        }
    }
    learn(t, failed, (double)good / (double)n, (double)good >= WORTH_LOOKING * (double)w->count);
    t->count = 0;
    sf_free(f->ctx, members);
}
