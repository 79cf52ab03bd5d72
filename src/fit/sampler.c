/* sampler.c - which training view a step draws: each once a pass, views that are far apart one after another.
 */
#include "sampler.h"

#include <math.h>
#include <string.h>

#include "blur.h"
#include "recovery.h"
#include "refine.h"
#include "validation.h"

void sf_sampler_restart(sf_view_sampler *sampler) { sampler->at = sampler->count; }

/* How many of them are trained on; they come first. */
static size_t without_validation(const sf_fitter *f, uint32_t *ids, size_t count) {
    size_t kept = 0;
    for (size_t i = 0; i < count; i++)
        if (!sf_is_in_validation(&f->validation, ids[i])) ids[kept++] = ids[i];
    return kept;
}

/* Views that came or went are no measure for those before. */
static void note_views(sf_fitter *f, size_t count) {
    if (f->sampler.views_before && count != f->sampler.views_before)
        sf_recovery_forget(&f->recovery, f->step);
    f->sampler.views_before = count;
}

/* Of all training views, ascending, what is known of each is made ready, and those that are trained on stay.
 */
static sf_status meet_views(sf_fitter *f, uint32_t *ids, size_t *count) {
    note_views(f, *count);
    sf_status status = sf_assign_views(f, ids, *count);
    *count = without_validation(f, ids, *count);
    if (!status && sf_learns_views(f)) status = sf_view_states_sync(&f->views, f->scene, ids, *count);
    if (!status && f->options.refine_poses) (f->options.fix_gauge ? sf_hold_two : sf_hold_mean)(&f->views);
    return status;
}

/* Place k of a pass over n views, so that those one after another are far apart: multiples of the golden
 * ratio leave no large gap anywhere, here in the order of their fractions. */
static size_t spread(size_t k, size_t n) {
    double mine = fmod((double)k * SF_GOLDEN, 1);
    size_t rank = 0;
    for (size_t j = 0; j < n; j++) rank += fmod((double)j * SF_GOLDEN, 1) < mine;
    return rank;
}

/* Views of one time or file name mostly stand side by side. The first pass begins at a place that is drawn,
 * and each at one far from those before, so that every view comes back after like times. */
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
    if (!status) status = meet_views(f, f->sampler.ids, &f->sampler.count);
    if (!status) {
        sf_skip_blurred_views(f);
        status = spread_order(f);
    }
    if (status) f->sampler.count = 0; /* the pass has not begun */
    return status;
}

/* The pass goes on with these, and then with what it has left. */
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

/* Views that came since the pass began are next. They are not kept waiting for its end; nor does it begin
 * anew with them, for where they come one after another it would be left to chance which of the others are
 * ever seen again. */
static sf_status take_newcomers(sf_fitter *f) {
    uint32_t *ids, newest = f->validation.newest_id;
    size_t count, first = 0;
    sf_status status = sf_scene_training_ids(f->scene, &ids, &count);
    if (status) return status;
    if (count && ids[count - 1] > newest) {
        status = meet_views(f, ids, &count);
        while (first < count && ids[first] <= newest) first++;
        if (!status && first < count) status = insert_views(f, ids + first, count - first);
    }
    sf_free(f->ctx, ids);
    return status;
}

/* The next training view, each once a pass, those far apart after one another; views that came are next, and
 * those that went are passed over. The reference is the caller's. */
sf_status sf_next_view(sf_fitter *f, sf_view **view) {
    sf_status status = f->sampler.count ? take_newcomers(f) : SF_OK;
    for (int passes = 0; passes < 2 && !status;) {
        if (f->sampler.at == f->sampler.count) {
            status = begin_pass(f);
            passes++;
            continue;
        }
        *view = sf_scene_retain_id(f->scene, f->sampler.ids[f->sampler.at++]);
        if (*view && (*view)->split == SF_SPLIT_TRAIN) return SF_OK;
        sf_view_release(*view);
    }
    return status ? status : sf_fail(f->ctx, SF_ERR_EMPTY, "scene: no training view is left");
}
