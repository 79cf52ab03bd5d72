/* shard_return.c - the sums of a band's Gaussians go back to their owners.
 *
 * A message has a bit for each of them, then the sums of those that have any, as floats of 3 bytes: no pixel
 * blended the others. So who receives it learns its length from the bits.
 */
#include <string.h>

#include "../base/pool.h"
#include "../cluster/cluster.h"
#include "float24.h"
#include "shard.h"

/* A Gaussian's sums: blend_bwd's nine; blend_importance has eight. */
enum { SUMS = SF_SHARD_RETURNED / SF_FLOAT24_BYTES, GATHER = 1024 /* Gaussians a task */ };

static size_t ranks_of(const sf_workspace *ws) { return (size_t)ws->cluster->size; }

/* Bytes of the bits of a message, and of a message whose Gaussians all have sums: whole words, so that the
 * bits of the next one are aligned. */
static size_t bit_bytes(size_t count) { return (count + 31) / 32 * sizeof(uint32_t); }
static size_t most_bytes(size_t count) {
    return bit_bytes(count) + (SF_SHARD_RETURNED * count + 3) / sizeof(uint32_t) * sizeof(uint32_t);
}

/* The sums of the Gaussians from `first` on, each with its slots added. */
typedef struct return_job {
    const sf_workspace *ws;
    size_t first, count;
    float *sums; /* [count][SUMS] */
} return_job;

static void add_slots(void *job_pointer, size_t task, int thread) {
    (void)thread;
    const return_job *job = job_pointer;
    const sf_workspace *ws = job->ws;
    for (size_t i = task * GATHER; i < (task + 1) * GATHER && i < job->count; i++) {
        float *sums = job->sums + SUMS * i;
        for (int k = 0; k < SUMS; k++) sums[k] = 0;
        for (size_t slot = ws->slot[job->first + i]; slot < ws->slot[job->first + i + 1]; slot++)
            for (int k = 0; k < SUMS; k++) sums[k] += ws->sums[slot * SF_SUMS + (size_t)k];
    }
}

/* Writes the sums that are not all zero one behind the other over what they are read from, and sets their
 * bits; returns how many they are. */
static size_t pack_sums(const float *sums, size_t count, uint32_t *bits) {
    size_t kept = 0;
    uint8_t *packed = (uint8_t *)(uintptr_t)sums;
    memset(bits, 0, bit_bytes(count));
    for (size_t i = 0; i < count; i++) {
        float from[SUMS];
        int any = 0;
        memcpy(from, sums + SUMS * i, sizeof from);
        for (int k = 0; k < SUMS; k++) any |= from[k] != 0; /* NaN is */
        if (!any) continue;
        bits[i / 32] |= (uint32_t)1 << i % 32;
        for (int k = 0; k < SUMS; k++, packed += SF_FLOAT24_BYTES) sf_put_float24(from[k], packed);
        kept++;
    }
    return kept;
}

/* Writes the message for each owner; send, most: its bytes, and those of one that leaves nothing out. Behind
 * the bits of a message the sums are first floats, which reach over where the next one begins: that is
 * written after it. */
static void write_messages(sf_workspace *ws, char *message, size_t *send, size_t *most) {
    const sf_shard *s = ws->shard;
    return_job job = {.ws = ws};
    for (size_t r = 0; r < ranks_of(ws); r++) {
        job.count = s->receive[r], job.sums = (float *)(void *)(message + bit_bytes(job.count));
        sf_pool_run(ws->ctx->pool, (job.count + GATHER - 1) / GATHER, add_slots, &job);
        size_t kept = pack_sums(job.sums, job.count, (uint32_t *)(void *)message);
        send[r] = bit_bytes(job.count) + SF_SHARD_RETURNED * kept;
        most[r] = most_bytes(job.count);
        if (ws->band_only && r != (size_t)ws->cluster->rank)
            ws->cluster->designed += (double)(kept * SF_SHARD_RETURNED);
        job.first += job.count, message += most[r];
    }
}

/* Puts what came back into slots: one for each band that a Gaussian touches, in the order of the ranks. */
static void take_back(sf_workspace *ws, const char *messages) {
    const sf_shard *s = ws->shard;
    size_t n = ranks_of(ws), slot = 0, *bit = s->ranges, *bits_at = bit + n, *sums_at = bits_at + n;
    const uint32_t *bits = (const uint32_t *)(const void *)messages;
    for (size_t r = 0, at = 0; r < n; at += most_bytes(s->send[r]), r++)
        bit[r] = 0, bits_at[r] = at / sizeof *bits, sums_at[r] = at + bit_bytes(s->send[r]);
    for (size_t i = 0; i < ws->count; i++) {
        ws->slot[i] = (uint32_t)slot;
        if (!ws->rows[i]) continue;
        SF_FOR_BANDS(ws, s, n, i, r, begin, end) {
            float *sums = ws->sums + SF_SUMS * slot++;
            int any = bits[bits_at[r] + bit[r] / 32] >> bit[r] % 32 & 1;
            bit[r]++;
            const uint8_t *from = (const uint8_t *)messages + sums_at[r];
            for (int k = 0; k < SUMS; k++) sums[k] = any ? sf_float24(from + SF_FLOAT24_BYTES * k) : 0;
            if (any) sums_at[r] += SF_SHARD_RETURNED;
        }
    }
    for (size_t i = ws->count; i <= (ws->count + SF_LANES - 1) / SF_LANES * SF_LANES; i++)
        ws->slot[i] = (uint32_t)slot;
}

static size_t bytes_of_all(const size_t *counts, size_t n) {
    size_t bytes = 0;
    for (size_t r = 0; r < n; r++) bytes += most_bytes(counts[r]);
    return bytes;
}

/* What the floats of a message take beyond its bytes, at most. */
static size_t bytes_beyond(const size_t *counts, size_t n) {
    size_t most = 0;
    for (size_t r = 0; r < n; r++)
        if (counts[r] > most) most = counts[r];
    return most * (SUMS * sizeof(float) - SF_SHARD_RETURNED);
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
                               bytes_of_all(s->receive, n) + bytes_beyond(s->receive, n) + 1, 1);
    if (!status)
        status = sf_grow(ws->ctx, &s->outgoing, &s->outgoing_capacity, 0, bytes_of_all(s->send, n) + 1, 1);
    if (status) return status;
    write_messages(ws, s->incoming, send, send_most);
    for (size_t r = 0; r < n; r++) receive_most[r] = most_bytes(s->send[r]);
    sf_cluster_exchange_some(ws->cluster, s->incoming, send, send_most, s->outgoing, receive_most);
    sf_shard_swap(ws);
    status = sf_grow(ws->ctx, &ws->sums, &ws->sums_capacity, 0, slots + 1, SF_SUMS * sizeof(float));
    if (!status) take_back(ws, s->outgoing);
    return status;
}
