/* ranks.c - see ranks.h. */
#include "ranks.h"

#include <string.h>

#include "../base/clock.h"
#include "../cluster/cluster.h"
#include "reorder.h"

/* Gaussians that stay together when a model is divided: those of a task of the projection. */
enum { PIECE = SF_PROJECT_BLOCKS * SF_LANES };

static sf_cluster *cluster_of(const sf_fitter *f) { return sf_cluster_of(f->ctx); }

sf_status sf_ranks_check(sf_fitter *f) {
    sf_fit_options *o = &f->options;
    const char *what = o->refine_poses                     ? "refine_poses"
                       : o->refine_intrinsics              ? "refine_intrinsics"
                       : o->densify == SF_DENSIFY_RELOCATE ? "densify relocate"
                                                           : NULL;
    if (!sf_is_shared(f)) return SF_OK;
    if (what)
        return sf_fail(f->ctx, SF_ERR_UNSUPPORTED, "%s: does not work with more than one rank yet", what);
    if (o->merge > 0) {
        o->merge = 0;
        sf_log(f->ctx, SF_LOG_INFO, "merge: off, as it does not work with more than one rank yet");
    }
    return SF_OK;
}

void sf_ranks_part(const sf_fitter *f, sf_remap_entry *entries, size_t *count) {
    const sf_cluster *c = cluster_of(f);
    size_t kept = 0;
    for (size_t i = 0; c && i < *count; i++)
        if (i / PIECE % (size_t)c->size == (size_t)c->rank) entries[kept++] = entries[i];
    if (c) *count = kept;
}

/* A little more than its part: growth is uneven. */
size_t sf_room_of_rank(const sf_fitter *f, size_t count) {
    if (!sf_is_shared(f)) return count;
    return count / (size_t)cluster_of(f)->size * 17 / 16 + PIECE;
}

sf_status sf_ranks_divide(sf_fitter *f) {
    sf_model *m = f->model;
    size_t n = m->count;
    if (!sf_is_shared(f)) return SF_OK;
    sf_remap_entry *entries = sf_alloc(f->ctx, n + 1, sizeof *entries);
    if (!entries) return SF_ERR_MEMORY;
    sf_status status = sf_list_along_curve(f, entries);
    sf_ranks_part(f, entries, &n);
    sf_order order;
    if (!status) {
        status = sf_order_create(f->ctx, entries, n, NULL, &order);
        if (!status) status = sf_order_prepare(f->ctx, &order);
        if (!status) sf_model_reorder(m, &order);
        sf_order_free(f->ctx, &order);
    }
    sf_free(f->ctx, entries);
    return status;
}

double sf_fit_seconds(const sf_fitter *f) {
    return sf_is_shared(f) ? f->shared_seconds : sf_clock() - f->start;
}

int sf_ranks_begin_step(sf_fitter *f) {
    double now[3] = {0, atomic_load(&f->cancelled), (double)f->model->count};
    if (!sf_is_shared(f)) return now[1] > 0;
    if (!cluster_of(f)->rank) now[0] = sf_clock() - f->start;
    sf_cluster_sum(cluster_of(f), now, 3);
    f->shared_seconds = now[0];
    f->shared_count = (size_t)now[2];
    return now[1] > 0;
}

size_t sf_total(const sf_fitter *f, size_t count) {
    return sf_is_shared(f) ? sf_cluster_sum_count(cluster_of(f), count) : count;
}

double sf_total_of(const sf_fitter *f, double value) {
    if (sf_is_shared(f)) sf_cluster_sum(cluster_of(f), &value, 1);
    return value;
}

double sf_of_first_rank(const sf_fitter *f, double value) {
    return sf_is_shared(f) ? sf_cluster_first(cluster_of(f), value) : value;
}

double sf_most_of_ranks(const sf_fitter *f, double value) {
    return sf_is_shared(f) ? sf_cluster_most(cluster_of(f), value) : value;
}

size_t sf_share_of_largest(const sf_fitter *f, const double *values, size_t n, size_t wanted) {
    if (sf_is_shared(f)) return sf_cluster_largest(cluster_of(f), values, n, wanted);
    return n < wanted ? n : wanted;
}

/* A function of seed, step and rank, so that it need not be stored. */
sf_rng *sf_rng_of_rank(sf_fitter *f) {
    if (!sf_is_shared(f)) return &f->rng;
    sf_rng_seed(&f->rank_rng, (uint64_t)f->options.seed);
    sf_rng_seed(&f->rank_rng, f->rank_rng.s[0] + (uint64_t)f->step);
    sf_rng_seed(&f->rank_rng, f->rank_rng.s[0] + (uint64_t)cluster_of(f)->rank);
    return &f->rank_rng;
}

/* Gathering: each Gaussian is a row of its values, those of bands that it lacks left out. */

static size_t values_of(int degree) {
    size_t values = 0;
    for (int field = 0; field < SF_FIELD_COUNT && sf_field_stored(field, degree); field++)
        values += (size_t)sf_field_components(field);
    return values;
}

static float *copy_row(const sf_model *m, size_t i, float *row, int back) {
    int degree = sf_degree_of(m, i);
    for (int field = 0; field < SF_FIELD_COUNT && sf_field_stored(field, degree); field++)
        for (int k = 0; k < sf_field_components(field); k++, row++) {
            float *value = sf_value(&m->params, field, i, k);
            if (back)
                *value = *row;
            else
                *row = *value;
        }
    return row;
}

/* The rows of all ranks into a model: of each degree, those of rank 0 first. banded: [ranks][SF_BANDS]. */
static void take_rows(const sf_cluster *c, const uint64_t *banded, const float *rows, sf_model *whole) {
    for (size_t r = 0; r < (size_t)c->size; r++)
        for (int degree = SF_MAX_SH_DEGREE; degree >= 0; degree--) {
            const uint64_t *mine = banded + SF_BANDS * r;
            size_t above = degree < SF_MAX_SH_DEGREE ? whole->banded[degree + 1] : 0, at = above;
            for (size_t before = 0; before < r; before++) {
                const uint64_t *other = banded + SF_BANDS * before;
                at += other[degree] - (degree < SF_MAX_SH_DEGREE ? other[degree + 1] : 0);
            }
            size_t n = mine[degree] - (degree < SF_MAX_SH_DEGREE ? mine[degree + 1] : 0);
            for (size_t i = 0; i < n; i++) {
                copy_row(whole, at + i, (float *)(uintptr_t)rows, 1);
                rows += values_of(degree);
            }
        }
}

sf_status sf_ranks_gather(const sf_fitter *f, const sf_model *part, sf_model **whole) {
    sf_cluster *c = cluster_of(f);
    size_t n = (size_t)c->size, all = 0, mine = 0, banded[SF_BANDS] = {0};
    uint64_t own[SF_BANDS], *of_ranks = sf_alloc(f->ctx, n * SF_BANDS, sizeof *of_ranks);
    size_t *send = sf_calloc(f->ctx, 2 * n, sizeof *send), *receive = send + n;
    if (!of_ranks || !send) return SF_ERR_MEMORY;
    for (int band = 0; band < SF_BANDS; band++) own[band] = part->banded[band];
    sf_cluster_gather_bytes(c, own, sizeof own, of_ranks);
    for (size_t r = 0; r < n; r++) {
        size_t values = 0;
        for (int d = 0; d < SF_BANDS; d++) {
            size_t above = d < SF_MAX_SH_DEGREE ? of_ranks[SF_BANDS * r + (size_t)d + 1] : 0;
            values += (of_ranks[SF_BANDS * r + (size_t)d] - above) * values_of(d);
            if (!c->rank) banded[d] += of_ranks[SF_BANDS * r + (size_t)d];
        }
        if (!c->rank) receive[r] = values, all += values;
        if (r == (size_t)c->rank) send[0] = mine = values;
    }
    float *outgoing = sf_alloc(f->ctx, mine + 1, sizeof *outgoing), *row = outgoing;
    float *incoming = sf_alloc(f->ctx, all + 1, sizeof *incoming);
    sf_status status = sf_model_create_banded(f->ctx, banded, banded[0], part->sh_degree, whole);
    if (!status && (!outgoing || !incoming)) status = SF_ERR_MEMORY;
    if (!status) {
        (*whole)->antialiased = part->antialiased;
        (*whole)->unit = part->unit;
        memcpy((*whole)->origin, part->origin, sizeof part->origin);
        for (size_t i = 0; i < part->count; i++) row = copy_row(part, i, row, 0);
        sf_cluster_exchange(c, sizeof(float), outgoing, send, incoming, receive);
        if (!c->rank) take_rows(c, of_ranks, incoming, *whole);
    }
    sf_free(f->ctx, outgoing);
    sf_free(f->ctx, incoming);
    sf_free(f->ctx, send);
    sf_free(f->ctx, of_ranks);
    return status;
}
