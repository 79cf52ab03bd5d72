/* bin.c - which Gaussians touch which tile, near to far.
 *
 * Every pair of Gaussian and tile is an entry of the tile's list and owns a slot, numbered Gaussian by
 * Gaussian. The backward pass writes its sums into the slots, and the Gaussians read theirs in order: no
 * atomics, and the same bytes for any number of threads.
 *
 * The lists are dealt out in order of depth, one share of that order a thread: a share's entries of a tile
 * follow those of the shares before it.
 */
#include "workspace.h"

#include <string.h>

#include "../base/pool.h"

enum {
    CHUNK = 1024,       /* Gaussians a task */
    LEAST_SHARE = 4096, /* Gaussians a share: fewer are dealt out sooner by one thread */
    BITS = 11,          /* a digit of the sort */
    DIGITS = 1 << BITS,
    PASSES = 3
};

/* Positive floats sort like their bits. */
static uint32_t depth_key(const sf_splat *splat) {
    uint32_t bits;
    memcpy(&bits, &splat->depth, sizeof bits);
    return bits;
}

static uint32_t digit(uint32_t key, int pass) { return key >> (pass * BITS) & (DIGITS - 1); }

/* What is seen, in order of depth, ties in order of index: a radix sort. */
static void sort_by_depth(sf_workspace *ws) {
    uint32_t at[PASSES][DIGITS] = {{0}};
    size_t n = 0;
    for (size_t i = 0; i < ws->count; i++) {
        if (ws->state[i] != SF_SEEN) continue;
        uint32_t key = depth_key(&ws->splats[i]);
        ws->order[n] = (uint32_t)i;
        ws->key[n++] = key;
        for (int pass = 0; pass < PASSES; pass++) at[pass][digit(key, pass)]++;
    }
    ws->seen = n;
    for (int pass = 0; pass < PASSES && n; pass++) {
        if (at[pass][digit(ws->key[0], pass)] == n) continue; /* all alike: nothing moves */
        uint32_t sum = 0;
        for (int d = 0; d < DIGITS; d++) {
            uint32_t digits = at[pass][d];
            at[pass][d] = sum;
            sum += digits;
        }
        for (size_t k = 0; k < n; k++) {
            uint32_t to = at[pass][digit(ws->key[k], pass)]++;
            ws->key_swap[to] = ws->key[k];
            ws->order_swap[to] = ws->order[k];
        }
        uint32_t *key = ws->key, *order = ws->order;
        ws->key = ws->key_swap, ws->key_swap = key;
        ws->order = ws->order_swap, ws->order_swap = order;
    }
}

/* Task 0 sorts while the others find the tiles of the Gaussians, and how many, in ws->slot. */
static void sort_or_span_task(void *ws_pointer, size_t task, int thread) {
    (void)thread;
    sf_workspace *ws = ws_pointer;
    if (task == 0) {
        sort_by_depth(ws);
        return;
    }
    size_t first = (task - 1) * CHUNK, end = first + CHUNK < ws->count ? first + CHUNK : ws->count;
    ws->ctx->kernels->spans(ws->splats, ws->first_row, ws->rows, ws->span_offset, first, end, ws->eye.tiles_x,
                            ws->spans, ws->slot);
}

/* Exclusive prefix sum in place; [n] receives the total. SF_ERR_MEMORY where 32 bits do not hold it. */
static sf_status prefix_sum(sf_workspace *ws, uint32_t *counts, size_t n) {
    uint64_t sum = 0;
    for (size_t i = 0; i < n; i++) {
        uint32_t count = counts[i];
        counts[i] = (uint32_t)sum;
        sum += count;
    }
    counts[n] = (uint32_t)sum;
    if (sum <= INT32_MAX) return SF_OK;
    return sf_fail(ws->ctx, SF_ERR_MEMORY, "out of memory: %llu pairs of a Gaussian and a tile",
                   (unsigned long long)sum);
}

static sf_status entry_room(sf_workspace *ws, size_t entries) {
    size_t capacity = ws->entry_capacity;
    sf_status status = sf_grow(ws->ctx, &ws->entries, &capacity, 0, entries, sizeof(uint32_t));
    if (status) return status;
    capacity = ws->entry_capacity;
    status = sf_grow(ws->ctx, &ws->entry_parts, &capacity, 0, entries, sizeof(uint64_t));
    if (status) return status;
    capacity = ws->entry_capacity;
    status = sf_grow(ws->ctx, &ws->entry_slots, &capacity, 0, entries, sizeof(uint32_t));
    if (!status) ws->entry_capacity = capacity;
    return status;
}

typedef struct deal_job {
    sf_workspace *ws;
    size_t tiles, shares;
    uint32_t *cursor; /* [shares][tiles] where a share's next entry of each tile goes */
} deal_job;

/* The share's part of ws->order. */
static void share_of(const deal_job *job, size_t share, size_t *first, size_t *end) {
    *first = job->ws->seen * share / job->shares;
    *end = job->ws->seen * (share + 1) / job->shares;
}

/* How many entries of each tile a share has. A span counts where it begins and where it ends; the sums along
 * the row are made afterwards. */
static void count_task(void *job_pointer, size_t share, int thread) {
    (void)thread;
    const deal_job *job = job_pointer;
    const sf_workspace *ws = job->ws;
    size_t first, end, tiles_x = (size_t)ws->eye.tiles_x;
    uint32_t *cursor = job->cursor + share * job->tiles;
    share_of(job, share, &first, &end);
    memset(cursor, 0, job->tiles * sizeof *cursor);
    for (size_t k = first; k < end; k++) {
        uint32_t i = ws->order[k];
        const sf_span *span = ws->spans + ws->span_offset[i];
        size_t tile = ws->first_row[i] * tiles_x;
        for (uint32_t r = 0; r < ws->rows[i]; r++, span++, tile += tiles_x) {
            if (span->x0 >= span->x1) continue;
            cursor[tile + span->x0]++;
            if (span->x1 < tiles_x) cursor[tile + span->x1]--;
        }
    }
    for (size_t row = 0; row < job->tiles; row += tiles_x)
        for (size_t x = 1; x < tiles_x; x++) cursor[row + x] += cursor[row + x - 1];
}

static void deal_task(void *job_pointer, size_t share, int thread) {
    (void)thread;
    const deal_job *job = job_pointer;
    const sf_workspace *ws = job->ws;
    size_t first, end, tiles_x = (size_t)ws->eye.tiles_x;
    uint32_t *cursor = job->cursor + share * job->tiles;
    share_of(job, share, &first, &end);
    for (size_t k = first; k < end; k++) {
        uint32_t i = ws->order[k], slot = ws->slot[i];
        const sf_span *span = ws->spans + ws->span_offset[i];
        uint32_t *row = cursor + ws->first_row[i] * tiles_x;
        for (uint32_t r = 0; r < ws->rows[i]; r++, span++, row += tiles_x)
            for (int x = span->x0; x < span->x1; x++, slot++) {
                uint32_t to = row[x]++;
                ws->entries[to] = i;
                ws->entry_slots[to] = slot;
            }
    }
}

/* Counts the entries of each tile, then deals them out in order of depth. */
static sf_status fill_lists(sf_workspace *ws) {
    size_t threads = (size_t)sf_pool_threads(ws->ctx->pool), most = ws->seen / LEAST_SHARE;
    deal_job job = {.ws = ws, .tiles = (size_t)ws->eye.tiles_x * (size_t)ws->eye.tiles_y};
    job.shares = most < 1 ? 1 : most < threads ? most : threads;
    sf_status status =
        sf_grow(ws->ctx, &ws->tile_cursor, &ws->cursor_capacity, 0, job.shares * job.tiles, sizeof(uint32_t));
    if (status) return status;
    job.cursor = ws->tile_cursor;
    sf_pool_run(ws->ctx->pool, job.shares, count_task, &job);
    uint32_t sum = 0;
    for (size_t t = 0; t < job.tiles; t++) {
        ws->tile_begin[t] = sum;
        for (size_t share = 0; share < job.shares; share++) {
            uint32_t count = job.cursor[share * job.tiles + t];
            job.cursor[share * job.tiles + t] = sum;
            sum += count;
        }
    }
    ws->tile_begin[job.tiles] = sum;
    sf_pool_run(ws->ctx->pool, job.shares, deal_task, &job);
    return SF_OK;
}

sf_status sf_stage_bin(sf_workspace *ws) {
    for (size_t i = 0; i < ws->count; i++) ws->span_offset[i] = ws->rows[i];
    sf_status status = prefix_sum(ws, ws->span_offset, ws->count);
    if (!status)
        status =
            sf_grow(ws->ctx, &ws->spans, &ws->span_capacity, 0, ws->span_offset[ws->count], sizeof(sf_span));
    if (status) return status;
    sf_pool_run(ws->ctx->pool, 1 + (ws->count + CHUNK - 1) / CHUNK, sort_or_span_task, ws);
    status = prefix_sum(ws, ws->slot, ws->count);
    /* one more: tiles point into the lists even where there is no entry */
    if (!status) status = entry_room(ws, (size_t)ws->slot[ws->count] + 1);
    if (status) return status;
    for (size_t i = ws->count; i % SF_LANES; i++) ws->slot[i + 1] = ws->slot[ws->count];
    return fill_lists(ws);
}
