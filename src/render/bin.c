/* bin.c - makes the tile lists: for each tile the Gaussians that touch it, near to far.
 *
 * A Gaussian is cut into strips, one for each row of tiles that it touches. The strips are distributed to
 * their rows in the order of the model; each row then sorts its strips by depth and distributes them to its
 * tiles. Memory is therefore accessed in order or within a cache. First chunks of Gaussians, then rows are
 * parallel tasks.
 *
 * Each pair of Gaussian and tile is an entry of the tile's list and owns a slot; slots are numbered Gaussian
 * by Gaussian. The backward pass writes its sums into the slots, and each Gaussian adds its own in order: no
 * atomics, and the same bytes for any number of threads.
 */
#include "workspace.h"

#include <string.h>

#include "../base/pool.h"
#include "../scene/gaussians.h"

enum {
    LINE = 16,                                /* counts in a cache line */
    CHUNK = 4 * SF_PROJECT_BLOCKS * SF_LANES, /* Gaussians a task: 1,024 */
    PASSES = 3,                               /* of the radix sort */
    MOST_BITS = 11,
    MOST_DIGITS = 1 << MOST_BITS /* 3 passes of 11 bits: any float */
};

typedef struct bin_job {
    sf_workspace *ws;
    size_t tiles_x, tiles_y, chunks, pitch;
    uint32_t *spans;     /* [chunks] spans, then spans before the chunk's */
    uint32_t *slots;     /* [chunks] the same for slots */
    uint32_t *strips;    /* [chunks][pitch] strips in each row, then where the chunk's next one goes */
    uint32_t *pairs;     /* [chunks][pitch] entries in each row */
    uint32_t *row_begin; /* [tiles_y + 1] strips before the row's */
    uint32_t *next;      /* [tiles_y][tiles_x + 1] where each tile's next entry goes */
} bin_job;

static size_t end_of_chunk(const bin_job *job, size_t chunk) {
    size_t end = (chunk + 1) * CHUNK;
    return end < job->ws->count ? end : job->ws->count;
}

/* Whether all Gaussians of a chunk are known to be out of view. */
static int is_empty(const bin_job *job, size_t chunk) {
    size_t first = chunk * (CHUNK / (SF_PROJECT_BLOCKS * SF_LANES)), in_view = 0;
    for (size_t k = first; k * SF_PROJECT_BLOCKS * SF_LANES < end_of_chunk(job, chunk); k++)
        in_view += job->ws->in_view[k];
    return !in_view;
}

/* Counts a Gaussian at the rows where its strips begin and end; prefix sums follow later. */
static void count_strips_task(void *job_pointer, size_t chunk, int thread) {
    (void)thread;
    const bin_job *job = job_pointer;
    const sf_workspace *ws = job->ws;
    uint32_t *strips = job->strips + chunk * job->pitch, sum = 0;
    memset(strips, 0, (job->tiles_y + 1) * sizeof *strips);
    job->spans[chunk] = 0;
    if (is_empty(job, chunk)) return;
    for (size_t i = chunk * CHUNK; i < end_of_chunk(job, chunk); i++) {
        uint32_t rows = ws->rows[i], first = rows ? ws->first_row[i] : 0;
        strips[first]++;
        strips[first + rows]--;
        sum += rows;
    }
    for (size_t row = 1; row < job->tiles_y; row++) strips[row] += strips[row - 1];
    job->spans[chunk] = sum;
}

/* The tiles of each strip; slots from 0 in each chunk. */
static void span_task(void *job_pointer, size_t chunk, int thread) {
    (void)thread;
    const bin_job *job = job_pointer;
    const sf_workspace *ws = job->ws;
    size_t first = chunk * CHUNK, end = end_of_chunk(job, chunk);
    uint32_t offset = job->spans[chunk], slot = 0;
    job->slots[chunk] = 0;
    if (is_empty(job, chunk)) return;
    for (size_t i = first; i < end; i++) {
        ws->span_offset[i] = offset;
        offset += ws->rows[i];
    }
    ws->ctx->kernels->spans(ws->splats, ws->first_row, ws->rows, ws->span_offset, first, end,
                            (int)job->tiles_x, ws->spans, ws->slot, ws->depth_of);
    for (size_t i = first; i < end; i++) {
        uint32_t tiles = ws->slot[i];
        ws->slot[i] = slot;
        slot += tiles;
    }
    job->slots[chunk] = slot;
}

static void deal_strips_task(void *job_pointer, size_t chunk, int thread) {
    (void)thread;
    const bin_job *job = job_pointer;
    const sf_workspace *ws = job->ws;
    uint32_t *strips = job->strips + chunk * job->pitch;
    uint32_t *pairs = job->pairs + chunk * job->pitch;
    memset(pairs, 0, (job->tiles_y + 1) * sizeof *pairs);
    if (is_empty(job, chunk)) { /* a Gaussian's slots end where those of the next one begin */
        ws->slot[chunk * CHUNK] = job->slots[chunk];
        return;
    }
    for (size_t i = chunk * CHUNK; i < end_of_chunk(job, chunk); i++) {
        uint32_t rows = ws->rows[i], row = ws->first_row[i], slot = ws->slot[i] += job->slots[chunk];
        const sf_span *span = ws->spans + ws->span_offset[i];
        sf_strip strip = {.gaussian = (uint32_t)i};
        memcpy(&strip.depth, &ws->depth_of[i], sizeof strip.depth);
        for (; rows; rows--, span++, row++) {
            uint32_t tiles = (uint32_t)(span->x1 - span->x0);
            strip.slot = slot;
            strip.span = *span;
            ws->strips[strips[row]++] = strip;
            pairs[row] += tiles;
            slot += tiles;
        }
    }
}

/* Sorts n strips stably by depth: a radix sort with `spare` as second buffer. Returns the buffer with the
 * result. Positive floats sort like their bits. The keys are differences from the least depth of the row,
 * which need fewer bits. */
static sf_strip *sort_strips(sf_strip *strips, sf_strip *spare, size_t n) {
    uint32_t at[PASSES][MOST_DIGITS], least = UINT32_MAX, most = 0;
    for (size_t k = 0; k < n; k++) {
        least = strips[k].depth < least ? strips[k].depth : least;
        most = strips[k].depth > most ? strips[k].depth : most;
    }
    int bits = 1;
    while (bits < MOST_BITS && (most - least) >> (PASSES * bits)) bits++;
    uint32_t digits = 1u << bits;
    for (int pass = 0; pass < PASSES; pass++) memset(at[pass], 0, digits * sizeof **at);
    for (size_t k = 0; k < n; k++)
        for (int pass = 0; pass < PASSES; pass++)
            at[pass][(strips[k].depth - least) >> (pass * bits) & (digits - 1)]++;
    for (int pass = 0; pass < PASSES; pass++) {
        uint32_t sum = 0;
        for (uint32_t d = 0; d < digits; d++) {
            uint32_t count = at[pass][d];
            at[pass][d] = sum;
            sum += count;
        }
        for (size_t k = 0; k < n; k++)
            spare[at[pass][(strips[k].depth - least) >> (pass * bits) & (digits - 1)]++] = strips[k];
        sf_strip *sorted = spare;
        spare = strips, strips = sorted;
    }
    return strips;
}

/* Makes the lists of a row of tiles. */
static void row_task(void *job_pointer, size_t row, int thread) {
    (void)thread;
    const bin_job *job = job_pointer;
    const sf_workspace *ws = job->ws;
    size_t begin = job->row_begin[row], n = job->row_begin[row + 1] - begin;
    const sf_strip *strips = sort_strips(ws->strips + begin, ws->strips_swap + begin, n);
    uint32_t *next = job->next + row * (job->tiles_x + 1), *tile_begin = ws->tile_begin + row * job->tiles_x;
    memset(next, 0, (job->tiles_x + 1) * sizeof *next);
    for (size_t k = 0; k < n; k++) {
        next[strips[k].span.x0]++;
        next[strips[k].span.x1]--;
    }
    uint32_t sum = tile_begin[0], count = 0;
    for (size_t x = 0; x < job->tiles_x; x++) {
        count += next[x];
        tile_begin[x] = next[x] = sum;
        sum += count;
    }
    for (size_t k = 0; k < n; k++) {
        uint32_t gaussian = strips[k].gaussian, slot = strips[k].slot;
        uint32_t tiles = (uint32_t)(strips[k].span.x1 - strips[k].span.x0), *at = next + strips[k].span.x0;
        /* Branchless: whether a strip has one tile or two is unpredictable. */
        if (!tiles) continue;
        uint32_t two = tiles > 1, to = at[0]++, second = at[1];
        at[1] += two;
        second = two ? second : to;
        ws->entries[to] = gaussian;
        ws->entry_slots[to] = slot;
        ws->entries[second] = gaussian;
        ws->entry_slots[second] = slot + two;
        for (uint32_t x = 2; x < tiles; x++) {
            to = at[x]++;
            ws->entries[to] = gaussian;
            ws->entry_slots[to] = slot + x;
        }
    }
}

/* Exclusive prefix sum in place; returns the total. */
static uint64_t prefix_sum(uint32_t *counts, size_t n) {
    uint64_t sum = 0;
    for (size_t i = 0; i < n; i++) {
        uint32_t count = counts[i];
        counts[i] = (uint32_t)sum;
        sum += count;
    }
    return sum;
}

/* Turns counts by chunk and row into the index at which the chunk's strips of the row begin. */
static void place_strips(const bin_job *job) {
    uint32_t sum = 0;
    for (size_t row = 0; row < job->tiles_y; row++) {
        job->row_begin[row] = sum;
        for (size_t chunk = 0; chunk < job->chunks; chunk++) {
            uint32_t *at = &job->strips[chunk * job->pitch + row], count = *at;
            *at = sum;
            sum += count;
        }
    }
    job->row_begin[job->tiles_y] = sum;
}

/* Sets the first entry of each row, at its first tile. */
static void place_entries(const bin_job *job) {
    uint32_t sum = 0;
    for (size_t row = 0; row < job->tiles_y; row++) {
        job->ws->tile_begin[row * job->tiles_x] = sum;
        for (size_t chunk = 0; chunk < job->chunks; chunk++) sum += job->pairs[chunk * job->pitch + row];
    }
    job->ws->tile_begin[job->tiles_y * job->tiles_x] = sum;
}

static sf_status too_many(const sf_workspace *ws, uint64_t pairs, const char *of) {
    return sf_fail(ws->ctx, SF_ERR_MEMORY, "out of memory: %llu pairs of a Gaussian and a %s",
                   (unsigned long long)pairs, of);
}

static sf_status count_room(bin_job *job) {
    sf_workspace *ws = job->ws;
    size_t rows = job->tiles_y + 1, tiles = job->tiles_y * (job->tiles_x + 1);
    job->pitch = (rows + LINE - 1) / LINE * LINE; /* no two threads write into the same line */
    size_t need = job->chunks * (2 + 2 * job->pitch) + rows + tiles;
    sf_status status = sf_grow(ws->ctx, &ws->bin_counts, &ws->bin_counts_capacity, 0, need, sizeof(uint32_t));
    if (status) return status;
    job->strips = ws->bin_counts;
    job->pairs = job->strips + job->chunks * job->pitch;
    job->spans = job->pairs + job->chunks * job->pitch;
    job->slots = job->spans + job->chunks;
    job->row_begin = job->slots + job->chunks;
    job->next = job->row_begin + rows;
    return SF_OK;
}

/* Strips are needed only until the lists are made, the sums only after that. */
static sf_status strip_room(sf_workspace *ws, size_t strips) {
    size_t slots =
        (2 * strips * sizeof *ws->strips + SF_SUMS * sizeof(float) - 1) / (SF_SUMS * sizeof(float));
    sf_status status = sf_grow(ws->ctx, &ws->spans, &ws->strip_capacity, 0, strips, sizeof *ws->spans);
    if (!status) status = sf_grow(ws->ctx, &ws->sums, &ws->sums_capacity, 0, slots, SF_SUMS * sizeof(float));
    ws->strips = (sf_strip *)ws->sums;
    ws->strips_swap = ws->strips ? ws->strips + strips : NULL;
    return status;
}

static sf_status entry_room(sf_workspace *ws, size_t entries) {
    const sf_array arrays[] = {
        {&ws->entries, sizeof *ws->entries},
        {&ws->entry_parts, sizeof *ws->entry_parts},
        {&ws->entry_slots, sizeof *ws->entry_slots},
    };
    return sf_grow_together(ws->ctx, arrays, sizeof arrays / sizeof *arrays, &ws->entry_capacity, entries);
}

sf_status sf_stage_bin(sf_workspace *ws) {
    struct sf_pool *pool = ws->ctx->pool;
    bin_job job = {.ws = ws,
                   .tiles_x = (size_t)ws->eye.tiles_x,
                   .tiles_y = (size_t)ws->eye.tiles_y,
                   .chunks = (ws->count + CHUNK - 1) / CHUNK};
    sf_status status = count_room(&job);
    if (status) return status;

    sf_pool_run(pool, job.chunks, count_strips_task, &job);
    uint64_t strips = prefix_sum(job.spans, job.chunks);
    if (strips > INT32_MAX) return too_many(ws, strips, "row of tiles");
    status = strip_room(ws, (size_t)strips + 1); /* tasks point into the array even if there are no strips */
    if (status) return status;
    place_strips(&job);

    sf_pool_run(pool, job.chunks, span_task, &job);
    uint64_t slots = prefix_sum(job.slots, job.chunks);
    if (slots > INT32_MAX) return too_many(ws, slots, "tile");
    status = entry_room(ws, (size_t)slots + 1); /* tiles point into the lists even if there is no entry */
    if (status) return status;

    sf_pool_run(pool, job.chunks, deal_strips_task, &job);
    for (size_t i = ws->count; i <= sf_blocks(ws->count) * SF_LANES; i++) ws->slot[i] = (uint32_t)slots;
    place_entries(&job);
    sf_pool_run(pool, job.tiles_y, row_task, &job);
    return SF_OK;
}
