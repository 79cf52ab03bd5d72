/* sampler.c - the order in which steps draw training views: each once a pass, consecutive ones far apart. */
#include "sampler.h"

#include <math.h>
#include <string.h>

#include "../scene/pixels.h"
#include "blur.h"
#include "misplaced.h"
#include "recovery.h"
#include "refine.h"
#include "validation.h"

enum { AHEAD = 2 /* views whose pictures are read ahead */ };

void sf_sampler_restart(sf_view_sampler *sampler) { sampler->at = sampler->count; }

/* Moves the views that are not in validation to the front; returns their number. */
static size_t without_validation(const sf_fitter *f, uint32_t *ids, size_t count) {
    size_t kept = 0;
    for (size_t i = 0; i < count; i++)
        if (!sf_is_in_validation(&f->validation, ids[i])) ids[kept++] = ids[i];
    return kept;
}

/* When views are added or removed, earlier losses are no longer comparable, nor are the pictures of new views
 * with others'. */
static void note_view_count(sf_fitter *f, size_t count) {
    if (f->sampler.views_before && count != f->sampler.views_before) {
        sf_recovery_forget(&f->recovery, f->step);
        f->misplaced.judged = 1;
    }
    f->sampler.views_before = count;
}

/* Of all training views (ids ascend): assigns new ones to training or validation and creates their states,
 * then leaves those that are trained on in `ids`. */
static sf_status take_up_views(sf_fitter *f, uint32_t *ids, size_t *count) {
    note_view_count(f, *count);
    sf_status status = sf_assign_views(f, ids, *count);
    *count = without_validation(f, ids, *count);
    if (!status && sf_learns_views(f)) status = sf_view_states_sync(&f->views, f->scene, ids, *count);
    if (!status && f->validation.merged)
        sf_begin_at_neighbours(&f->views, f->validation.ids, f->validation.count);
    if (!status && f->options.refine_poses) (f->options.fix_gauge ? sf_hold_two : sf_hold_mean)(&f->views);
    return status;
}

/* The view that is drawn k-th in a pass over n views. Multiples of the golden ratio leave no large gap; the
 * rank of the k-th among the first n makes it a permutation. */
static size_t spread(size_t k, size_t n) {
    double mine = fmod((double)k * SF_GOLDEN, 1);
    size_t rank = 0;
    for (size_t j = 0; j < n; j++) rank += fmod((double)j * SF_GOLDEN, 1) < mine;
    return rank;
}

/* Consecutive views of the list mostly overlap, so the pass spreads them. The first pass starts at a random
 * view, each later one far from earlier starts, so that every view returns after similar times. */
static sf_status spread_order(sf_fitter *f) {
    size_t n = f->sampler.count;
    if (n < 2) return SF_OK;
    uint32_t *order = sf_alloc(f->ctx, n, sizeof *order);
    if (!order) return SF_ERR_MEMORY;
    size_t start = (size_t)(f->sampler.start * (double)n);
    for (size_t k = 0; k < n; k++) order[k] = f->sampler.ids[(start + spread(k, n)) % n];
    sf_free(f->ctx, f->sampler.ids);
    f->sampler.ids = order;
    f->sampler.start = fmod(f->sampler.start + SF_GOLDEN, 1);
    return SF_OK;
}

static sf_status begin_pass(sf_fitter *f) {
    sf_free(f->ctx, f->sampler.ids);
    f->sampler.at = f->sampler.count = 0;
    sf_status status = sf_scene_training_ids(f->scene, &f->sampler.ids, &f->sampler.count);
    if (!status) status = take_up_views(f, f->sampler.ids, &f->sampler.count);
    if (!status) {
        sf_skip_misplaced_views(f);
        sf_skip_blurred_views(f);
        status = spread_order(f);
    }
    if (status) f->sampler.count = 0; /* the pass has not begun */
    return status;
}

/* Inserts views into the pass, before those that are left. */
static sf_status insert_views(sf_fitter *f, const uint32_t *ids, size_t count) {
    size_t left = f->sampler.count - f->sampler.at;
    uint32_t *order = sf_alloc(f->ctx, f->sampler.count + count, sizeof *order);
    if (!order) return SF_ERR_MEMORY;
    memcpy(order, f->sampler.ids, f->sampler.at * sizeof *order);
    memcpy(order + f->sampler.at, ids, count * sizeof *order);
    memcpy(order + f->sampler.at + count, f->sampler.ids + f->sampler.at, left * sizeof *order);
    sf_free(f->ctx, f->sampler.ids);
    f->sampler.ids = order, f->sampler.count += count;
    return SF_OK;
}

/* Draws new views next. They do not wait for the end of the pass. Nor does a new pass begin: if views kept
 * coming, it would be random which of the others are ever drawn again. */
static sf_status take_new_views(sf_fitter *f) {
    uint32_t *ids, newest = f->validation.newest_id;
    size_t count, first = 0;
    sf_status status = sf_scene_training_ids(f->scene, &ids, &count);
    if (status) return status;
    if (count && ids[count - 1] > newest) {
        status = take_up_views(f, ids, &count);
        while (first < count && ids[first] <= newest) first++;
        if (!status && first < count) status = insert_views(f, ids + first, count - first);
    }
    sf_free(f->ctx, ids);
    return status;
}

/* Pictures that are not in memory are read while the views before them are drawn. */
static void expect_next(const sf_fitter *f) {
    for (size_t i = f->sampler.at; i < f->sampler.count && i < f->sampler.at + AHEAD; i++) {
        sf_view *view = sf_scene_retain_id(f->scene, f->sampler.ids[i]);
        if (view) sf_view_expect(view);
        sf_view_release(view);
    }
}

sf_status sf_next_view(sf_fitter *f, sf_view **view) {
    sf_status status = f->sampler.count ? take_new_views(f) : SF_OK;
    for (int passes = 0; passes < 2 && !status;) {
        if (f->sampler.at == f->sampler.count) {
            status = begin_pass(f);
            passes++;
            continue;
        }
        *view = sf_scene_retain_id(f->scene, f->sampler.ids[f->sampler.at++]);
        if (*view && (*view)->split == SF_SPLIT_TRAIN) {
            expect_next(f);
            return SF_OK;
        }
        sf_view_release(*view);
    }
    return status ? status : sf_fail(f->ctx, SF_ERR_EMPTY, "scene: no training view is left");
}
