/* bin.c - which Gaussians touch which tile, near to far.
 *
 * Every pair of Gaussian and tile is an entry of the tile's list and owns a slot, numbered Gaussian by
 * Gaussian. The backward pass writes its sums into the slots, and the Gaussians read theirs in order: no
 * atomics, and the same bytes for any number of threads.
 */
#include "workspace.h"

#include <string.h>

#include "../base/pool.h"

enum { CHUNK = 1024 }; /* Gaussians a task */

/* Positive floats sort like their bits. */
static uint32_t depth_key(const sf_splat *splat) {
    uint32_t bits;
    memcpy(&bits, &splat->depth, sizeof bits);
    return bits;
}

/* What is seen, in order of depth, ties in order of index: a radix sort of 3 x 11 bits. */
static void sort_by_depth(sf_workspace *ws) {
    enum { BITS = 11, DIGITS = 1 << BITS };
    static const int shifts[] = {0, BITS, 2 * BITS};
    size_t n = 0;
    for (size_t i = 0; i < ws->count; i++) {
        if (ws->state[i] != SF_SEEN) continue;
        ws->order[n] = (uint32_t)i;
        ws->key[n++] = depth_key(&ws->splats[i]);
    }
    ws->seen = n;
    for (int pass = 0; pass < 3; pass++) {
        uint32_t at[DIGITS] = {0}, sum = 0;
        for (size_t k = 0; k < n; k++) at[ws->key[k] >> shifts[pass] & (DIGITS - 1)]++;
        for (int d = 0; d < DIGITS; d++) {
            uint32_t digits = at[d];
            at[d] = sum;
            sum += digits;
        }
        for (size_t k = 0; k < n; k++) {
            uint32_t to = at[ws->key[k] >> shifts[pass] & (DIGITS - 1)]++;
            ws->key_swap[to] = ws->key[k];
            ws->order_swap[to] = ws->order[k];
        }
        uint32_t *key = ws->key, *order = ws->order;
        ws->key = ws->key_swap, ws->key_swap = key;
        ws->order = ws->order_swap, ws->order_swap = order;
    }
}

static void spans_task(void *ws_pointer, size_t task, int thread) {
    (void)thread;
    sf_workspace *ws = ws_pointer;
    size_t first = task * CHUNK, end = first + CHUNK < ws->count ? first + CHUNK : ws->count;
    ws->ctx->kernels->spans(ws->splats, ws->first_row, ws->rows, ws->span_offset, first, end, ws->eye.tiles_x,
                            ws->spans, ws->slot); /* counts now, sums of them later */
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

/* Counts the entries of each tile, then deals them out in order of depth. */
static void fill_lists(sf_workspace *ws) {
    size_t tiles_x = (size_t)ws->eye.tiles_x, tiles = tiles_x * (size_t)ws->eye.tiles_y;
    memset(ws->tile_cursor, 0, (tiles + 1) * sizeof(uint32_t));
    for (size_t i = 0; i < ws->count; i++)
        for (uint32_t r = 0; r < ws->rows[i]; r++) {
            sf_span span = ws->spans[ws->span_offset[i] + r];
            uint32_t *row = ws->tile_cursor + (ws->first_row[i] + r) * tiles_x;
            for (int x = span.x0; x < span.x1; x++) row[x]++;
        }
    uint32_t sum = 0;
    for (size_t t = 0; t <= tiles; t++) {
        uint32_t count = ws->tile_cursor[t];
        ws->tile_begin[t] = ws->tile_cursor[t] = sum;
        sum += count;
    }
    for (size_t k = 0; k < ws->seen; k++) {
        uint32_t i = ws->order[k], slot = ws->slot[i];
        for (uint32_t r = 0; r < ws->rows[i]; r++) {
            sf_span span = ws->spans[ws->span_offset[i] + r];
            uint32_t *row = ws->tile_cursor + (ws->first_row[i] + r) * tiles_x;
            for (int x = span.x0; x < span.x1; x++, slot++) {
                ws->entries[row[x]] = i;
                ws->entry_slots[row[x]++] = slot;
            }
        }
    }
}

sf_status sf_stage_bin(sf_workspace *ws) {
    sort_by_depth(ws);
    for (size_t i = 0; i < ws->count; i++) ws->span_offset[i] = ws->rows[i];
    sf_status status = prefix_sum(ws, ws->span_offset, ws->count);
    if (!status)
        status =
            sf_grow(ws->ctx, &ws->spans, &ws->span_capacity, 0, ws->span_offset[ws->count], sizeof(sf_span));
    if (status) return status;
    sf_pool_run(ws->ctx->pool, (ws->count + CHUNK - 1) / CHUNK, spans_task, ws);
    status = prefix_sum(ws, ws->slot, ws->count);
    /* one more: tiles point into the lists even where there is no entry */
    if (!status) status = entry_room(ws, (size_t)ws->slot[ws->count] + 1);
    if (status) return status;
    for (size_t i = ws->count; i % SF_LANES; i++) ws->slot[i + 1] = ws->slot[ws->count];
    fill_lists(ws);
    return SF_OK;
}
