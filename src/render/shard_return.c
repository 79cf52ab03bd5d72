/* shard_return.c - the sums of a band's Gaussians go back to their owners.
 *
 * A message has a bit for each of them, then the sums of those that have any: no pixel blended the others. So
 * who receives it learns its length from the bits.
 */
#include <string.h>

#include "../base/pool.h"
#include "../cluster/cluster.h"
#include "shard.h"

/* Floats of a Gaussian's sums: blend_bwd's nine; blend_importance has eight. */
enum { RETURNED = SF_SHARD_RETURNED / sizeof(float), GATHER = 1024 /* Gaussians a task */ };

static size_t ranks_of(const sf_workspace *ws) { return (size_t)ws->cluster->size; }

/* Words of the bits of a message, and of a message whose Gaussians all have sums. */
static size_t bit_words(size_t count) { return (count + 31) / 32; }
static size_t most_words(size_t count) { return bit_words(count) + RETURNED * count; }

/* The sums of the Gaussians from `first` on, each with its slots added. */
typedef struct return_job {
    const sf_workspace *ws;
    size_t first, count;
    float *sums; /* [count][RETURNED] */
} return_job;

static void add_slots(void *job_pointer, size_t task, int thread) {
    (void)thread;
    const return_job *job = job_pointer;
    const sf_workspace *ws = job->ws;
    for (size_t i = task * GATHER; i < (task + 1) * GATHER && i < job->count; i++) {
        float *sums = job->sums + RETURNED * i;
        for (int k = 0; k < RETURNED; k++) sums[k] = 0;
        for (size_t slot = ws->slot[job->first + i]; slot < ws->slot[job->first + i + 1]; slot++)
            for (int k = 0; k < RETURNED; k++) sums[k] += ws->sums[slot * SF_SUMS + (size_t)k];
    }
}

/* Moves the sums that are not all zero together, and sets their bits; returns how many they are. */
static size_t leave_out_zeros(float *sums, size_t count, uint32_t *bits) {
    size_t kept = 0;
    memset(bits, 0, bit_words(count) * sizeof *bits);
    for (size_t i = 0; i < count; i++) {
        const float *from = sums + RETURNED * i;
        int any = 0;
        for (int k = 0; k < RETURNED; k++) any |= from[k] != 0; /* NaN is */
        if (!any) continue;
        bits[i / 32] |= (uint32_t)1 << i % 32;
        memmove(sums + RETURNED * kept++, from, RETURNED * sizeof *from);
    }
    return kept;
}

/* Writes the message for each owner; send, most: its bytes, and those of one that leaves nothing out. */
static void write_messages(sf_workspace *ws, float *words, size_t *send, size_t *most) {
    const sf_shard *s = ws->shard;
    return_job job = {.ws = ws};
    for (size_t r = 0; r < ranks_of(ws); r++) {
        job.count = s->receive[r], job.sums = words + bit_words(job.count);
        sf_pool_run(ws->ctx->pool, (job.count + GATHER - 1) / GATHER, add_slots, &job);
        size_t kept = leave_out_zeros(job.sums, job.count, (uint32_t *)(void *)words);
        send[r] = (bit_words(job.count) + RETURNED * kept) * sizeof *words;
        most[r] = most_words(job.count) * sizeof *words;
        if (ws->band_only && r != (size_t)ws->cluster->rank)
            ws->cluster->designed += (double)(kept * SF_SHARD_RETURNED);
        job.first += job.count, words += most_words(job.count);
    }
}

/* Puts what came back into slots: one for each band that a Gaussian touches, in the order of the ranks. */
static void take_back(sf_workspace *ws, const float *messages) {
    const sf_shard *s = ws->shard;
    size_t n = ranks_of(ws), slot = 0, *bit = s->ranges, *bits_at = bit + n, *sums_at = bits_at + n;
    const uint32_t *bits = (const uint32_t *)(const void *)messages;
    for (size_t r = 0, at = 0; r < n; at += most_words(s->send[r]), r++)
        bit[r] = 0, bits_at[r] = at, sums_at[r] = at + bit_words(s->send[r]);
    for (size_t i = 0; i < ws->count; i++) {
        ws->slot[i] = (uint32_t)slot;
        if (!ws->rows[i]) continue;
        SF_FOR_BANDS(ws, s, n, i, r, begin, end) {
            float *sums = ws->sums + SF_SUMS * slot++;
            int any = bits[bits_at[r] + bit[r] / 32] >> bit[r] % 32 & 1;
            bit[r]++;
            if (any) {
                memcpy(sums, messages + sums_at[r], RETURNED * sizeof *sums);
                sums_at[r] += RETURNED;
            } else {
                memset(sums, 0, RETURNED * sizeof *sums);
            }
        }
    }
    for (size_t i = ws->count; i <= (ws->count + SF_LANES - 1) / SF_LANES * SF_LANES; i++)
        ws->slot[i] = (uint32_t)slot;
}

static size_t words_of_all(const size_t *counts, size_t n) {
    size_t words = 0;
    for (size_t r = 0; r < n; r++) words += most_words(counts[r]);
    return words;
}

sf_status sf_shard_flags(const sf_workspace *ws, const uint8_t *own, uint8_t **drawn, size_t *capacity) {
    sf_shard *s = ws->shard;
    sf_status status = sf_grow(ws->ctx, drawn, capacity, 0, ws->count + 1, 1);
    if (status) return status;
    if (!s) {
        memcpy(*drawn, own, ws->count);
        return SF_OK;
    }
    const sf_drawn_arrays *mine = &s->other; /* while the workspace has the band's */
    size_t n = ranks_of(ws), sent = 0, *at = s->ranges;
    for (size_t r = 0; r < n; sent += s->send[r], r++) at[r] = sent;
    status = sf_grow(ws->ctx, &s->outgoing, &s->outgoing_capacity, 0, sent + 1, 1);
    if (status) return status;
    for (size_t i = 0; i < mine->count; i++) {
        if (!mine->rows[i]) continue;
        SF_FOR_BANDS(mine, s, n, i, r, begin, end) s->outgoing[at[r]++] = (char)own[i];
    }
    sf_cluster_exchange(ws->cluster, 1, s->outgoing, s->send, *drawn, s->receive);
    return SF_OK;
}

sf_status sf_shard_return(sf_workspace *ws) {
    sf_shard *s = ws->shard;
    if (!s) return SF_OK;
    size_t n = ranks_of(ws), slots = 0, *send = s->ranges, *send_most = send + n,
           *receive_most = send_most + n;
    for (size_t r = 0; r < n; r++) slots += s->send[r];
    sf_status status = sf_grow(ws->ctx, &s->incoming, &s->incoming_capacity, 0,
                               words_of_all(s->receive, n) * sizeof(float) + 1, 1);
    if (!status)
        status = sf_grow(ws->ctx, &s->outgoing, &s->outgoing_capacity, 0,
                         words_of_all(s->send, n) * sizeof(float) + 1, 1);
    if (status) return status;
    write_messages(ws, (float *)(void *)s->incoming, send, send_most);
    for (size_t r = 0; r < n; r++) receive_most[r] = most_words(s->send[r]) * sizeof(float);
    sf_cluster_exchange_some(ws->cluster, s->incoming, send, send_most, s->outgoing, receive_most);
    sf_shard_swap(ws);
    status = sf_grow(ws->ctx, &ws->sums, &ws->sums_capacity, 0, slots + 1, SF_SUMS * sizeof(float));
    if (!status) take_back(ws, (const float *)(const void *)s->outgoing);
    return status;
}
