/* ranks_gather.c - brings the Gaussians of all ranks together on rank 0.
 *
 * A Gaussian travels as a row of 4-byte words: what its columns have of it. In the whole model those of a
 * degree stand in the order of the ranks, so that each rank finds its own again.
 */
#include <string.h>

#include "../cluster/cluster.h"
#include "ranks.h"

/* An array that follows the Gaussians. */
typedef struct column {
    uint32_t *words;
    int components;  /* of a blocked array; 0: a plain one */
    int band, plain; /* words of a Gaussian in a plain one */
} column;

enum { MOST_COLUMNS = SF_FIELD_COUNT * (1 + SF_MOMENT_PARTS) + 3 };

typedef struct columns {
    column list[MOST_COLUMNS];
    size_t count;
} columns;

static void add(columns *c, void *words, int components, int band, int plain) {
    c->list[c->count++] = (column){words, components, band, plain};
}

static columns columns_of_model(const sf_model *m) {
    columns c = {.count = 0};
    for (int field = 0; field < SF_FIELD_COUNT && sf_field_stored(field, m->sh_degree); field++)
        add(&c, m->params.field[field], sf_field_components(field), sf_field_band(field), 0);
    return c;
}

static columns columns_of_fitter(const sf_fitter *f) {
    const sf_model *m = f->model;
    columns c = columns_of_model(m);
    for (int part = 0; part < SF_MOMENT_PARTS; part++)
        for (int field = 0; field < SF_FIELD_COUNT && sf_field_stored(field, m->sh_degree); field++) {
            int n = sf_moment_components(&f->moments, part, field);
            if (n) add(&c, f->moments.part[part][field], n, sf_field_band(field), 0);
        }
    add(&c, f->densify.gradient_sum, 0, 0, sizeof *f->densify.gradient_sum / sizeof(uint32_t));
    add(&c, f->densify.visible_count, 0, 0, sizeof *f->densify.visible_count / sizeof(uint32_t));
    add(&c, f->units.inverse, 0, 0, sizeof *f->units.inverse / sizeof(uint32_t));
    return c;
}

static size_t words_of(const columns *c, int degree) {
    size_t words = 0;
    for (size_t k = 0; k < c->count; k++)
        if (c->list[k].band <= degree) words += (size_t)(c->list[k].components + c->list[k].plain);
    return words;
}

/* Copies what the columns have of Gaussian i to a row, or back; returns the row's end. */
static uint32_t *copy_row(const columns *c, int degree, size_t i, uint32_t *row, int back) {
    for (size_t k = 0; k < c->count; k++) {
        const column *from = &c->list[k];
        int n = from->components ? from->components : from->plain;
        for (int w = 0; w < n && from->band <= degree; w++, row++) {
            size_t at = from->components ? sf_at(i, n, w) : (size_t)n * i + (size_t)w;
            if (back)
                from->words[at] = *row;
            else
                *row = from->words[at];
        }
    }
    return row;
}

static size_t of_degree(const uint64_t *banded, int degree) {
    return (size_t)(banded[degree] - (degree < SF_MAX_SH_DEGREE ? banded[degree + 1] : 0));
}

/* The rows of one rank. */
static void take_rows(const uint64_t *banded, size_t rank, uint32_t *rows, const sf_model *whole,
                      const columns *to) {
    for (int degree = SF_MAX_SH_DEGREE; degree >= 0; degree--) {
        size_t at = degree < SF_MAX_SH_DEGREE ? whole->banded[degree + 1] : 0;
        for (size_t before = 0; before < rank; before++) at += of_degree(banded + SF_BANDS * before, degree);
        size_t n = of_degree(banded + SF_BANDS * rank, degree);
        for (size_t i = 0; i < n; i++) rows = copy_row(to, degree, at + i, rows, 1);
    }
}

/* Sends what rank r has to rank 0, which puts it into the columns of the whole. */
static sf_status send_rank(const sf_fitter *f, size_t r, const sf_model *part, const columns *from,
                           const uint64_t *banded, const sf_model *whole, const columns *to) {
    sf_cluster *c = sf_cluster_of(f->ctx);
    size_t n = (size_t)c->size, me = (size_t)c->rank, words = 0;
    for (int d = 0; d < SF_BANDS; d++) words += of_degree(banded + SF_BANDS * r, d) * words_of(from, d);
    size_t *send = sf_calloc(f->ctx, 2 * n, sizeof *send), *receive = send + n;
    uint32_t *outgoing = sf_alloc(f->ctx, me == r ? words + 1 : 1, sizeof *outgoing), *row = outgoing;
    uint32_t *incoming = sf_alloc(f->ctx, me ? 1 : words + 1, sizeof *incoming);
    sf_status status = send && outgoing && incoming ? SF_OK : SF_ERR_MEMORY;
    if (!status) {
        send[0] = me == r ? words : 0, receive[r] = me ? 0 : words;
        for (size_t i = 0; me == r && i < part->count; i++)
            row = copy_row(from, sf_degree_of(part, i), i, row, 0);
        sf_cluster_exchange(c, sizeof *row, outgoing, send, incoming, receive);
        if (!me) take_rows(banded, r, incoming, whole, to);
    }
    sf_free(f->ctx, outgoing);
    sf_free(f->ctx, incoming);
    sf_free(f->ctx, send);
    return status;
}

/* One rank after another, so that rank 0 needs little more memory than for the whole. */
static sf_status send_rows(const sf_fitter *f, const sf_model *part, const columns *from,
                           const uint64_t *banded, const sf_model *whole, const columns *to) {
    sf_status status = SF_OK;
    for (size_t r = 0; r < (size_t)sf_cluster_of(f->ctx)->size && !status; r++)
        status = send_rank(f, r, part, from, banded, whole, to);
    return status;
}

/* A model with room for the Gaussians of all ranks on rank 0, for none on the others. */
static sf_status make_whole(const sf_fitter *f, const sf_model *part, uint64_t *banded, sf_model **whole) {
    sf_cluster *c = sf_cluster_of(f->ctx);
    uint64_t own[SF_BANDS];
    size_t all[SF_BANDS] = {0};
    for (int band = 0; band < SF_BANDS; band++) own[band] = part->banded[band];
    sf_cluster_gather_bytes(c, own, sizeof own, banded);
    for (size_t k = 0; !c->rank && k < SF_BANDS * (size_t)c->size; k++)
        all[k % SF_BANDS] += (size_t)banded[k];
    sf_status status = sf_model_create_banded(f->ctx, all, all[0], part->sh_degree, whole);
    if (status) return status;
    (*whole)->antialiased = part->antialiased;
    (*whole)->unit = part->unit;
    memcpy((*whole)->origin, part->origin, sizeof part->origin);
    return SF_OK;
}

sf_status sf_ranks_gather(const sf_fitter *f, const sf_model *part, uint64_t *banded, sf_model **whole) {
    uint64_t *own =
        banded ? NULL : sf_alloc(f->ctx, SF_BANDS * (size_t)sf_cluster_of(f->ctx)->size, sizeof *own);
    *whole = NULL;
    if (!banded && !own) return SF_ERR_MEMORY;
    sf_status status = make_whole(f, part, banded ? banded : own, whole);
    if (!status) {
        columns from = columns_of_model(part), to = columns_of_model(*whole);
        status = send_rows(f, part, &from, banded ? banded : own, *whole, &to);
    }
    if (status) sf_model_destroy(whole);
    sf_free(f->ctx, own);
    return status;
}

/* The index in the whole model of rank r's Gaussian i. */
static uint32_t whole_index(const sf_model *whole, const uint64_t *banded, size_t r, uint32_t i) {
    const uint64_t *own = banded + SF_BANDS * r;
    int degree = SF_MAX_SH_DEGREE;
    while (degree > 0 && i >= own[degree]) degree--;
    size_t at = degree < SF_MAX_SH_DEGREE ? whole->banded[degree + 1] : 0;
    for (size_t before = 0; before < r; before++) at += of_degree(banded + SF_BANDS * before, degree);
    return (uint32_t)(at + i - (degree < SF_MAX_SH_DEGREE ? own[degree + 1] : 0));
}

/* The tentative merges of all ranks, by rank; their tiles are the same on all. */
static sf_status gather_merges(const sf_fitter *f, const uint64_t *banded, sf_fitter *whole) {
    sf_cluster *c = sf_cluster_of(f->ctx);
    size_t n = (size_t)c->size, all = 0, *counts = sf_calloc(f->ctx, 2 * n, sizeof *counts),
           *send = counts + n;
    uint64_t mine = f->merges.count, *of_ranks = sf_alloc(f->ctx, n, sizeof *of_ranks);
    sf_status status = counts && of_ranks ? SF_OK : SF_ERR_MEMORY;
    if (!status) {
        sf_cluster_gather_bytes(c, &mine, sizeof mine, of_ranks);
        for (size_t r = 0; r < n; r++) all += of_ranks[r], counts[r] = c->rank ? 0 : of_ranks[r];
        send[0] = mine;
        whole->merges.list = sf_alloc(f->ctx, c->rank ? 1 : all + 1, sizeof *whole->merges.list);
        if (!whole->merges.list) status = SF_ERR_MEMORY;
    }
    if (!status) {
        sf_cluster_exchange(c, sizeof *f->merges.list, f->merges.list, send, whole->merges.list, counts);
        whole->merges.count = c->rank ? 0 : all;
        for (size_t r = 0, k = 0; r < n; r++)
            for (size_t end = k + counts[r]; k < end; k++) {
                sf_merge *m = &whole->merges.list[k];
                m->a = whole_index(whole->model, banded, r, m->a);
                m->b = whole_index(whole->model, banded, r, m->b);
                m->leader = whole_index(whole->model, banded, r, m->leader);
            }
    }
    sf_free(f->ctx, counts);
    sf_free(f->ctx, of_ranks);
    return status;
}

sf_status sf_ranks_gather_all(const sf_fitter *f, uint64_t *banded, uint64_t *banded_best, sf_fitter *whole) {
    sf_context *ctx = f->ctx;
    memcpy(whole, f, sizeof *whole);
    whole->model = whole->restore.model = NULL;
    whole->moments = sf_optimizer_moments((int)f->options.moments, f->options.ema_steps);
    whole->densify.gradient_sum = NULL, whole->densify.visible_count = NULL;
    whole->units.inverse = NULL;
    whole->merges.list = NULL, whole->merges.count = 0;
    whole->skipped_values = sf_total(f, f->skipped_values);
    sf_status status = make_whole(f, f->model, banded, &whole->model);
    if (status) return status;
    size_t room = whole->model->capacity[0] + 1;
    status =
        sf_optimizer_create(whole->model, (int)f->options.moments, f->options.ema_steps, &whole->moments);
    whole->densify.gradient_sum = sf_calloc(ctx, room, sizeof *whole->densify.gradient_sum);
    whole->densify.visible_count = sf_calloc(ctx, room, sizeof *whole->densify.visible_count);
    whole->units.inverse = sf_calloc(ctx, room, sizeof *whole->units.inverse);
    if (!whole->densify.gradient_sum || !whole->densify.visible_count || !whole->units.inverse)
        status = SF_ERR_MEMORY;
    if (!status) {
        columns from = columns_of_fitter(f), to = columns_of_fitter(whole);
        status = send_rows(f, f->model, &from, banded, whole->model, &to);
    }
    if (!status) status = gather_merges(f, banded, whole);
    if (!status && f->restore.model)
        status = sf_ranks_gather(f, f->restore.model, banded_best, &whole->restore.model);
    return status;
}

void sf_ranks_free_gathered(sf_fitter *whole) {
    sf_model_destroy(&whole->model);
    sf_model_destroy(&whole->restore.model);
    sf_optimizer_destroy(whole->ctx, &whole->moments);
    sf_free(whole->ctx, whole->densify.gradient_sum);
    sf_free(whole->ctx, whole->densify.visible_count);
    sf_free(whole->ctx, whole->units.inverse);
    sf_free(whole->ctx, whole->merges.list);
}
