/* ranks_divide.c - see ranks_divide.h. */
#include "ranks_divide.h"

#include "../base/clock.h"
#include "../cluster/cluster.h"
#include "ranks.h"
#include "reorder.h"
#include "schedule.h"
#include "select_merge.h"

/* A task of the projection tells whether its Gaussians are out of view. */
_Static_assert(SF_PIECE == SF_PROJECT_BLOCKS * SF_LANES, "a piece is a task of the projection");

static sf_cluster *cluster_of(const sf_fitter *f) { return sf_cluster_of(f->ctx); }

/* Pieces are dealt in turn along the curve, so that each rank has about the same of every view. */
static void keep_part(const sf_fitter *f, sf_remap_entry *entries, size_t *count) {
    const sf_cluster *c = cluster_of(f);
    size_t kept = 0;
    for (size_t i = 0; c && i < *count; i++)
        if (i / SF_PIECE % (size_t)c->size == (size_t)c->rank) entries[kept++] = entries[i];
    if (c) *count = kept;
}

/* A little more than its part: growth is uneven. */
size_t sf_room_of_rank(const sf_fitter *f, size_t count) {
    if (!sf_is_shared(f)) return count;
    return count / (size_t)cluster_of(f)->size * 17 / 16 + SF_PIECE;
}

/* Entries of this rank's part of a model: those that it had when the numbers `had` were written, [ranks]
 * [SF_BANDS] (NULL: unknown), or pieces along the curve. */
static sf_status list_part(const sf_fitter *f, const sf_model *m, const uint64_t *had,
                           sf_remap_entry *entries, size_t *n) {
    const sf_cluster *c = cluster_of(f);
    *n = m->count;
    if (!had) {
        sf_status status = sf_list_along_curve(m, entries);
        keep_part(f, entries, n);
        return status;
    }
    *n = 0;
    for (int d = m->sh_degree; d >= 0; d--) {
        size_t at = d < m->sh_degree ? m->banded[d + 1] : 0;
        for (int rank = 0; rank <= c->rank; rank++) {
            const uint64_t *banded = had + SF_BANDS * (size_t)rank;
            size_t of_degree = banded[d] - (d < SF_MAX_SH_DEGREE ? banded[d + 1] : 0);
            for (size_t k = 0; k < of_degree && rank == c->rank; k++)
                entries[(*n)++] = (sf_remap_entry){(uint32_t)(at + k), (uint8_t)d};
            at += of_degree;
        }
    }
    return SF_OK;
}

/* Keeps this rank's part of a model that nothing follows. */
static sf_status divide_model(const sf_fitter *f, const uint64_t *had, sf_model *m) {
    size_t n;
    sf_order order;
    sf_remap_entry *entries = sf_alloc(f->ctx, m->count + 1, sizeof *entries);
    if (!entries) return SF_ERR_MEMORY;
    sf_status status = list_part(f, m, had, entries, &n);
    if (!status) {
        status = sf_order_create(f->ctx, entries, n, NULL, &order);
        if (!status) status = sf_order_prepare(f->ctx, &order);
        if (!status) sf_model_reorder(m, &order);
        sf_order_free(f->ctx, &order);
    }
    sf_free(f->ctx, entries);
    return status;
}

sf_status sf_ranks_divide(sf_fitter *f, const sf_model *from) {
    if (!sf_is_shared(f)) return SF_OK;
    if (!sf_is_part(f, from)) return divide_model(f, NULL, f->model);
    f->first_count = f->shared_count = sf_total(f, f->model->count);
    return SF_OK;
}

/* Keeps the tentative merges of this rank's part: entry k went to moved_to[k]. */
static sf_status keep_merges(sf_fitter *f, size_t had, const sf_remap_entry *entries, size_t n,
                             const uint32_t *moved_to) {
    sf_merges *t = &f->merges;
    size_t kept = 0;
    uint32_t *now = t->count ? sf_alloc(f->ctx, had, sizeof *now) : NULL;
    if (t->count && !now) return SF_ERR_MEMORY;
    for (size_t i = 0; now && i < had; i++) now[i] = UINT32_MAX;
    for (size_t k = 0; now && k < n; k++) now[entries[k].from] = moved_to[k];
    for (size_t k = 0; k < t->count; k++) {
        sf_merge m = t->list[k];
        m.a = now[m.a], m.b = now[m.b], m.leader = now[m.leader];
        if (m.a != UINT32_MAX) t->list[kept++] = m; /* a rank has all three */
    }
    t->count = kept;
    sf_free(f->ctx, now);
    return SF_OK;
}

static sf_status divide_fit(sf_fitter *f, const uint64_t *had) {
    size_t n, count = f->model->count;
    if (!had) sf_merges_undo_all(f); /* their Gaussians may go to different ranks */
    sf_remap_entry *entries = sf_alloc(f->ctx, count + 1, sizeof *entries);
    uint32_t *moved_to = sf_alloc(f->ctx, count + 1, sizeof *moved_to);
    sf_status status = entries && moved_to ? list_part(f, f->model, had, entries, &n) : SF_ERR_MEMORY;
    if (!status) status = sf_reorder(f, entries, n, moved_to);
    if (!status) status = keep_merges(f, count, entries, n, moved_to);
    sf_free(f->ctx, entries);
    sf_free(f->ctx, moved_to);
    return status;
}

sf_status sf_ranks_divide_restored(sf_fitter *f, const uint64_t *had, const uint64_t *had_best) {
    if (!sf_is_shared(f)) return SF_OK;
    sf_status status = divide_fit(f, had);
    f->merges.on_ranks = sf_total(f, f->merges.count) > 0;
    f->shared_count = sf_total(f, f->model->count);
    f->shared_seconds = sf_of_first_rank(f, sf_clock() - f->start);
    if (!status) status = sf_fitter_set_room(f, sf_room_of_rank(f, sf_planned_count(f, 1)));
    if (!status && f->restore.model) {
        status = divide_model(f, had_best, f->restore.model);
        for (int band = 0; band <= f->restore.model->sh_degree && !status; band++)
            status = sf_model_set_room(f->restore.model, band, f->restore.model->banded[band]);
    }
    return status;
}
