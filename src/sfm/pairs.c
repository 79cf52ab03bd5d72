/* pairs.c - see pairs.h. */
#include "pairs.h"

#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "../base/pool.h"

sf_pair_options sf_pair_options_default(void) {
    return (sf_pair_options){.all = 200, .few = 128, .partners = 40, .neighbours = 3};
}

/* ---- features of large scales ---- */

typedef struct ranked {
    float scale;
    size_t index;
} ranked;

static int by_scale(const void *a_pointer, const void *b_pointer) {
    const ranked *a = a_pointer, *b = b_pointer;
    if (a->scale != b->scale) return a->scale < b->scale ? 1 : -1;
    return (a->index > b->index) - (a->index < b->index);
}

sf_status sf_pairs_take_few(sf_context *ctx, const sf_features *features, size_t most, sf_features *few) {
    size_t count = features->count < most ? features->count : most;
    ranked *ranks = sf_alloc(ctx, features->count + 1, sizeof *ranks);
    *few = (sf_features){.count = count, .descriptors = sf_alloc(ctx, count + 1, SF_DESCRIPTOR)};
    sf_status status = ranks && few->descriptors ? SF_OK : SF_ERR_MEMORY;
    if (!status) {
        for (size_t i = 0; i < features->count; i++) ranks[i] = (ranked){features->points[i].scale, i};
        qsort(ranks, features->count, sizeof *ranks, by_scale);
        for (size_t i = 0; i < count; i++)
            memcpy(few->descriptors + i * SF_DESCRIPTOR,
                   features->descriptors + ranks[i].index * SF_DESCRIPTOR, SF_DESCRIPTOR);
    } else {
        sf_features_free(ctx, few);
    }
    sf_free(ctx, ranks);
    return status;
}

/* ---- how many each pair shares ---- */

typedef struct comparison {
    sf_context *ctx;
    const sf_features *photos;
    const sf_pair_options *options;
    size_t count;
    sf_features *few; /* [count] */
    uint16_t *scores; /* [count][count], above the diagonal */
    atomic_size_t compared;
    atomic_int status;
} comparison;

static void take_task(void *pointer, size_t task, int thread) {
    comparison *c = pointer;
    (void)thread;
    sf_status status = sf_pairs_take_few(c->ctx, &c->photos[task], c->options->few, &c->few[task]);
    if (status) atomic_store(&c->status, (int)status);
}

/* A photo with all that come after it. */
static void compare_task(void *pointer, size_t task, int thread) {
    comparison *c = pointer;
    sf_match_options options = sf_match_options_default();
    for (size_t other = task + 1; other < c->count && !atomic_load(&c->status); other++) {
        sf_matches matches;
        sf_status status = sf_match_pair(c->ctx, &c->few[task], &c->few[other], &options, &matches);
        if (status) atomic_store(&c->status, (int)status);
        c->scores[task * c->count + other] =
            (uint16_t)(matches.count < UINT16_MAX ? matches.count : UINT16_MAX);
        sf_matches_free(c->ctx, &matches);
    }
    size_t compared = atomic_fetch_add(&c->compared, 1) + 1;
    if (!thread && c->options->done && c->options->done(c->options->user, compared))
        atomic_store(&c->status, SF_ERR_CANCELLED);
}

static sf_status compare(comparison *c) {
    c->few = sf_calloc(c->ctx, c->count, sizeof *c->few);
    if (!c->few) return SF_ERR_MEMORY;
    sf_pool_run(c->ctx->pool, c->count, take_task, c);
    if (!atomic_load(&c->status)) sf_pool_run(c->ctx->pool, c->count, compare_task, c);
    for (size_t i = 0; i < c->count; i++) sf_features_free(c->ctx, &c->few[i]);
    sf_free(c->ctx, c->few);
    return (sf_status)atomic_load(&c->status);
}

/* ---- partners ---- */

static size_t apart(size_t a, size_t b) { return a > b ? a - b : b - a; }

/* Whether a is a better partner of i than b. */
static int is_better(const uint16_t *scores, size_t i, size_t a, size_t b) {
    if (scores[a] != scores[b]) return scores[a] > scores[b];
    if (apart(i, a) != apart(i, b)) return apart(i, a) < apart(i, b);
    return a < b;
}

/* The best so far in order, best first; `other` takes its place among them. Returns how many there are. */
static size_t insert(const uint16_t *scores, size_t i, size_t other, size_t most, uint32_t *order,
                     size_t count) {
    size_t at = count < most ? count++ : most;
    for (; at > 0 && is_better(scores, i, other, order[at - 1]); at--)
        if (at < most) order[at] = order[at - 1];
    if (at < most) order[at] = (uint32_t)other;
    return count;
}

void sf_pairs_mark(const uint16_t *scores, size_t count, size_t partners, size_t neighbours, uint32_t *order,
                   uint8_t *chosen) {
    memset(chosen, 0, count * count);
    for (size_t i = 0; i < count; i++) {
        const uint16_t *row = scores + i * count;
        size_t best = 0;
        for (size_t j = 0; j < count; j++) {
            if (j == i) continue;
            if (apart(i, j) <= neighbours) chosen[i * count + j] = 1;
            if (row[j]) best = insert(row, i, j, partners < count ? partners : count, order, best);
        }
        for (size_t k = 0; k < best; k++) chosen[i * count + order[k]] = chosen[order[k] * count + i] = 1;
    }
}

/* ---- the list ---- */

/* chosen NULL: each photo with `next` photos that come after it. */
static sf_status list(sf_context *ctx, const uint8_t *chosen, size_t next, size_t count,
                      sf_photo_pair **pairs, size_t *pair_count) {
    size_t n = 0;
    for (size_t i = 0; i < count; i++)
        for (size_t j = i + 1; j < count; j++) n += chosen ? chosen[i * count + j] : j - i <= next;
    *pairs = sf_alloc(ctx, n + 1, sizeof **pairs);
    if (!*pairs) return SF_ERR_MEMORY;
    *pair_count = n, n = 0;
    for (size_t i = 0; i < count; i++)
        for (size_t j = i + 1; j < count; j++)
            if (chosen ? chosen[i * count + j] : j - i <= next)
                (*pairs)[n++] = (sf_photo_pair){(uint32_t)i, (uint32_t)j};
    return SF_OK;
}

sf_status sf_pairs_choose(sf_context *ctx, const sf_features *photos, size_t count,
                          const sf_pair_options *options, sf_photo_pair **pairs, size_t *pair_count) {
    *pairs = NULL, *pair_count = 0;
    if (options->sequence || count <= options->all)
        return list(ctx, NULL, options->sequence ? options->sequence : count, count, pairs, pair_count);
    comparison c = {.ctx = ctx, .photos = photos, .options = options, .count = count};
    c.scores = sf_calloc(ctx, count * count, sizeof *c.scores);
    uint8_t *chosen = sf_alloc(ctx, count * count, 1);
    uint32_t *order = sf_alloc(ctx, count, sizeof *order);
    sf_status status = c.scores && chosen && order ? compare(&c) : SF_ERR_MEMORY;
    if (!status) {
        for (size_t i = 0; i < count; i++)
            for (size_t j = 0; j < i; j++) c.scores[i * count + j] = c.scores[j * count + i];
        sf_pairs_mark(c.scores, count, options->partners, options->neighbours, order, chosen);
        status = list(ctx, chosen, 0, count, pairs, pair_count);
    }
    sf_free(ctx, c.scores);
    sf_free(ctx, chosen);
    sf_free(ctx, order);
    return status;
}
