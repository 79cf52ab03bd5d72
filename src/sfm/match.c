/* match.c - which features of two photos are the same. */
#include "match.h"

#include <string.h>

#include "../base/pool.h"

sf_match_options sf_match_options_default(void) { return (sf_match_options){.ratio = 0.8, .distance = 0.7}; }

/* The greatest two products of a feature; index NONE: there is none. */
#define NONE UINT32_MAX
typedef struct best_two {
    uint32_t product[2], index[2];
} best_two;

/* What a pair takes. */
typedef struct workspace {
    const sf_features *a, *b;
    best_two *of_a, *of_b;
    uint32_t *length_a, *length_b; /* squared, of the descriptors */
    uint8_t *columns;              /* a block of b, as the kernel takes it */
    uint8_t *rows;                 /* the last rows of a, filled up */
    uint32_t *keys[4];             /* best and second of rows, of columns */
    sf_match *kept;
} workspace;

/* ---- the block's keys to what is known ------------------------------------------------------------------
 */

static void take(best_two *t, uint32_t product, uint32_t index) {
    if (t->index[0] == NONE || product > t->product[0]) {
        t->product[1] = t->product[0], t->index[1] = t->index[0];
        t->product[0] = product, t->index[0] = index;
    } else if (t->index[1] == NONE || product > t->product[1]) {
        t->product[1] = product, t->index[1] = index;
    }
}

/* Of `count` features from one block against `others` from another that begins at `first`: what was filled up
 * is left out. */
static void take_keys(best_two *t, const uint32_t *best, const uint32_t *second, size_t count, size_t first,
                      size_t others) {
    for (size_t i = 0; i < count; i++) {
        uint32_t keys[2] = {best[i], second[i]};
        for (int k = 0; k < 2; k++)
            if (keys[k] && sf_match_index(keys[k]) < others)
                take(&t[i], sf_match_product(keys[k]), (uint32_t)first + sf_match_index(keys[k]));
    }
}

/* ---- blocks ---------------------------------------------------------------------------------------------
 */

static size_t padded(size_t count, size_t to) { return (count + to - 1) / to * to; }

/* Columns first .. first+count-1 of b in the kernel's order, and 0s. */
static void pack(const sf_features *b, size_t first, size_t count, uint8_t *columns) {
    memset(columns, 0, padded(count, 2 * SF_LANES) * SF_DESCRIPTOR);
    for (size_t c = 0; c < count; c++) {
        const uint8_t *from = b->descriptors + (first + c) * SF_DESCRIPTOR;
        uint8_t *to = columns + c / SF_LANES * SF_LANES * SF_DESCRIPTOR + c % SF_LANES * 4;
        for (size_t k = 0; k < SF_DESCRIPTOR; k += 4) memcpy(to + k * SF_LANES, from + k, 4);
    }
}

static void match_block(const sf_kernels *kernels, workspace *w, size_t row, size_t rows, size_t column,
                        size_t columns) {
    sf_match_args args = {.a = w->a->descriptors + row * SF_DESCRIPTOR,
                          .b = w->columns,
                          .rows = padded(rows, SF_MATCH_ROWS),
                          .columns = padded(columns, 2 * SF_LANES),
                          .row_best = w->keys[0],
                          .row_second = w->keys[1],
                          .column_best = w->keys[2],
                          .column_second = w->keys[3]};
    if (rows % SF_MATCH_ROWS) { /* fewer than one group: the last */
        memset(w->rows, 0, SF_MATCH_ROWS * SF_DESCRIPTOR);
        memcpy(w->rows, args.a, rows * SF_DESCRIPTOR);
        args.a = w->rows;
    }
    kernels->match(&args);
    take_keys(w->of_a + row, w->keys[0], w->keys[1], rows, column, columns);
    take_keys(w->of_b + column, w->keys[2], w->keys[3], columns, row, rows);
}

static size_t at_most(size_t a, size_t b) { return a < b ? a : b; }

static void match_blocks(const sf_kernels *kernels, workspace *w) {
    size_t n = w->a->count, whole = n / SF_MATCH_ROWS * SF_MATCH_ROWS;
    for (size_t column = 0; column < w->b->count; column += SF_MATCH_BLOCK) {
        size_t columns = at_most(w->b->count - column, SF_MATCH_BLOCK);
        pack(w->b, column, columns, w->columns);
        for (size_t row = 0; row < whole; row += SF_MATCH_BLOCK)
            match_block(kernels, w, row, at_most(whole - row, SF_MATCH_BLOCK), column, columns);
        if (whole < n) match_block(kernels, w, whole, n - whole, column, columns);
    }
}

/* ---- which are kept -------------------------------------------------------------------------------------
 */

static void measure(const sf_features *f, uint32_t *lengths, best_two *best) {
    for (size_t i = 0; i < f->count; i++) {
        uint32_t sum = 0;
        for (size_t k = 0; k < SF_DESCRIPTOR; k++) {
            uint32_t byte = f->descriptors[i * SF_DESCRIPTOR + k];
            sum += byte * byte;
        }
        lengths[i] = sum;
        best[i] = (best_two){{0, 0}, {NONE, NONE}};
    }
}

/* Of quantised descriptors: squared, exact. */
static double distance_of(uint32_t length, uint32_t other, uint32_t product) {
    return (double)length + (double)other - 2 * (double)product;
}

static int is_clear(const best_two *t, uint32_t length, const uint32_t *others, const sf_match_options *o) {
    double nearest = distance_of(length, others[t->index[0]], t->product[0]);
    if (nearest > o->distance * o->distance * 512 * 512) return 0;
    if (t->index[1] == NONE) return 1;
    return nearest < o->ratio * o->ratio * distance_of(length, others[t->index[1]], t->product[1]);
}

static size_t keep_matches(const workspace *w, const sf_match_options *options, sf_match *items) {
    size_t count = 0;
    for (size_t i = 0; i < w->a->count; i++) {
        uint32_t j = w->of_a[i].index[0];
        if (w->of_b[j].index[0] != i) continue;
        if (!is_clear(&w->of_a[i], w->length_a[i], w->length_b, options)) continue;
        if (!is_clear(&w->of_b[j], w->length_b[j], w->length_a, options)) continue;
        items[count++] = (sf_match){(uint32_t)i, j};
    }
    return count;
}

/* ---- pairs ----------------------------------------------------------------------------------------------
 */

/* For photos of n and m features at most. */
static sf_status open_workspace(sf_context *ctx, size_t n, size_t m, workspace *w) {
    int failed = 0;
    w->of_a = sf_alloc(ctx, n, sizeof *w->of_a);
    w->of_b = sf_alloc(ctx, m, sizeof *w->of_b);
    w->length_a = sf_alloc(ctx, n, sizeof *w->length_a);
    w->length_b = sf_alloc(ctx, m, sizeof *w->length_b);
    w->columns = sf_alloc(ctx, padded(at_most(m, SF_MATCH_BLOCK), 2 * SF_LANES), SF_DESCRIPTOR);
    w->rows = sf_alloc(ctx, SF_MATCH_ROWS, SF_DESCRIPTOR);
    for (int k = 0; k < 4; k++) {
        w->keys[k] = sf_alloc(ctx, SF_MATCH_BLOCK, sizeof *w->keys[k]);
        failed |= !w->keys[k];
    }
    w->kept = sf_alloc(ctx, at_most(n, m), sizeof *w->kept);
    failed |= !w->of_a || !w->of_b || !w->length_a || !w->length_b || !w->columns || !w->rows || !w->kept;
    return failed ? SF_ERR_MEMORY : SF_OK;
}

static void close_workspace(sf_context *ctx, workspace *w) {
    void *blocks[] = {w->of_a,    w->of_b,    w->length_a, w->length_b, w->columns, w->rows,
                      w->keys[0], w->keys[1], w->keys[2],  w->keys[3],  w->kept};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) sf_free(ctx, blocks[i]);
}

static sf_status match_within(sf_context *ctx, workspace *w, const sf_match_options *options,
                              sf_matches *matches) {
    measure(w->a, w->length_a, w->of_a);
    measure(w->b, w->length_b, w->of_b);
    match_blocks(ctx->kernels, w);
    size_t count = keep_matches(w, options, w->kept);
    if (!count) return SF_OK;
    matches->items = sf_alloc(ctx, count, sizeof *matches->items);
    if (!matches->items) return SF_ERR_MEMORY;
    memcpy(matches->items, w->kept, count * sizeof *w->kept);
    matches->count = count;
    return SF_OK;
}

sf_status sf_match_pair(sf_context *ctx, const sf_features *a, const sf_features *b,
                        const sf_match_options *options, sf_matches *matches) {
    workspace w = {.a = a, .b = b};
    *matches = (sf_matches){0};
    if (!a->count || !b->count) return SF_OK;
    sf_status status = open_workspace(ctx, a->count, b->count, &w);
    if (!status) status = match_within(ctx, &w, options, matches);
    close_workspace(ctx, &w);
    return status;
}

typedef struct batch {
    sf_context *ctx;
    const sf_features *photos;
    const sf_photo_pair *pairs;
    const sf_match_options *options;
    sf_matches *matches;
    sf_status *statuses;
    workspace *workspaces; /* [threads]: a new one for each pair would cost as many page faults again */
} batch;

static void match_one(void *batch_pointer, size_t task, int thread) {
    const batch *b = batch_pointer;
    workspace *w = &b->workspaces[thread];
    w->a = &b->photos[b->pairs[task].first], w->b = &b->photos[b->pairs[task].second];
    if (w->a->count && w->b->count)
        b->statuses[task] = match_within(b->ctx, w, b->options, &b->matches[task]);
}

static sf_status open_workspaces(batch *b, size_t pairs, size_t threads) {
    size_t most = 0;
    for (size_t i = 0; i < pairs; i++) {
        size_t n = b->photos[b->pairs[i].first].count, m = b->photos[b->pairs[i].second].count;
        if (n > most) most = n;
        if (m > most) most = m;
    }
    b->workspaces = sf_calloc(b->ctx, threads, sizeof *b->workspaces);
    sf_status status = b->workspaces ? SF_OK : SF_ERR_MEMORY;
    for (size_t i = 0; i < threads && most && !status; i++)
        status = open_workspace(b->ctx, most, most, &b->workspaces[i]);
    return status;
}

sf_status sf_match_all(sf_context *ctx, const sf_features *photos, const sf_photo_pair *pairs, size_t count,
                       const sf_match_options *options, sf_matches *matches) {
    batch b = {ctx, photos, pairs, options, matches, NULL, NULL};
    size_t threads = (size_t)sf_pool_threads(ctx->pool);
    for (size_t i = 0; i < count; i++) matches[i] = (sf_matches){0};
    if (!count) return SF_OK;
    b.statuses = sf_calloc(ctx, count, sizeof *b.statuses);
    if (!b.statuses) return SF_ERR_MEMORY;
    sf_status status = open_workspaces(&b, count, threads);
    if (!status) sf_pool_run(ctx->pool, count, match_one, &b);
    for (size_t i = 0; b.workspaces && i < threads; i++) close_workspace(ctx, &b.workspaces[i]);
    for (size_t i = 0; i < count && !status; i++) status = b.statuses[i];
    for (size_t i = 0; i < count && status; i++) sf_matches_free(ctx, &matches[i]);
    sf_free(ctx, b.workspaces);
    sf_free(ctx, b.statuses);
    return status;
}

void sf_matches_free(sf_context *ctx, sf_matches *matches) {
    sf_free(ctx, matches->items);
    *matches = (sf_matches){0};
}
