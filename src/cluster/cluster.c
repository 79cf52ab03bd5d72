/* cluster.c - collectives on top of the two that a transport offers. */
#include "cluster.h"

#include <string.h>

sf_status sf_cluster_create(sf_context *ctx, const sf_cluster_ops *ops, void *state, int rank, int size) {
    sf_cluster *c = sf_calloc(ctx, 1, sizeof *c);
    if (!c) return SF_ERR_MEMORY;
    *c = (sf_cluster){.ctx = ctx, .ops = ops, .state = state, .rank = rank, .size = size};
    c->offsets = sf_calloc(ctx, 4 * (size_t)size, sizeof *c->offsets);
    ctx->cluster = c;
    if (c->offsets) return SF_OK;
    sf_cluster_destroy(ctx);
    return SF_ERR_MEMORY;
}

void sf_cluster_destroy(sf_context *ctx) {
    sf_cluster *c = ctx->cluster;
    if (!c) return;
    sf_free(ctx, c->offsets);
    sf_free(ctx, c);
    ctx->cluster = NULL;
}

void sf_cluster_gather_bytes(sf_cluster *c, const void *from, size_t bytes, void *to) {
    c->sent += bytes * (size_t)(c->size - 1);
    c->rounds++;
    c->ops->gather(c, from, bytes, to);
}

/* Sums a few values at a time, on the stack. */
enum { SUMMED = 8, STACK_RANKS = 64 };

static double sum_one(sf_cluster *c, double value) {
    double of_rank[STACK_RANKS], sum = 0, *all = of_rank;
    if (c->size > STACK_RANKS) all = sf_alloc(c->ctx, (size_t)c->size, sizeof *all);
    if (!all) { /* a rank cannot leave a collective alone */
        c->ops->end_all(c, 1);
        return 0;
    }
    sf_cluster_gather_bytes(c, &value, sizeof value, all);
    for (int r = 0; r < c->size; r++) sum += all[r];
    if (all != of_rank) sf_free(c->ctx, all);
    return sum;
}

void sf_cluster_sum(sf_cluster *c, double *values, size_t n) {
    double few[SUMMED * STACK_RANKS];
    if (c->size > STACK_RANKS || n > SUMMED) {
        for (size_t k = 0; k < n; k++) values[k] = sum_one(c, values[k]);
        return;
    }
    sf_cluster_gather_bytes(c, values, n * sizeof *values, few);
    for (size_t k = 0; k < n; k++) {
        values[k] = 0;
        for (size_t r = 0; r < (size_t)c->size; r++) values[k] += few[r * n + k];
    }
}

size_t sf_cluster_sum_count(sf_cluster *c, size_t count) { return (size_t)sum_one(c, (double)count); }

double sf_cluster_first(sf_cluster *c, double value) { return sum_one(c, c->rank ? 0 : value); }

double sf_cluster_most(sf_cluster *c, double value) {
    double most = value;
    for (int r = 0; r < c->size; r++) {
        double of_rank = sum_one(c, r == c->rank ? value : 0);
        if (of_rank > most) most = of_rank;
    }
    return most;
}

void sf_cluster_exchange(sf_cluster *c, size_t size, const void *from, const size_t *send, void *to,
                         const size_t *receive) {
    size_t n = (size_t)c->size, *at = c->offsets;
    size_t sent = 0, received = 0;
    for (size_t r = 0; r < n; r++) {
        at[r] = sent, at[n + r] = send[r] * size;
        at[2 * n + r] = received, at[3 * n + r] = receive[r] * size;
        sent += at[n + r], received += at[3 * n + r];
    }
    c->sent += sent - at[n + (size_t)c->rank];
    c->rounds++;
    const char *outgoing = from;
    char *incoming = to;
    const sf_messages messages = {&outgoing, &incoming, 1, at, at + n, at + 2 * n, at + 3 * n, NULL};
    c->ops->exchange(c, &messages);
}

void sf_cluster_exchange_some(sf_cluster *c, const void *from, const size_t *send, const size_t *send_most,
                              void *to, const size_t *receive_most) {
    size_t n = (size_t)c->size, *at = c->offsets;
    for (size_t r = 0; r < n; r++) {
        at[r] = r ? at[r - 1] + send_most[r - 1] : 0;
        at[2 * n + r] = r ? at[2 * n + r - 1] + receive_most[r - 1] : 0;
        if (r != (size_t)c->rank) c->sent += send[r];
    }
    c->rounds++;
    const char *outgoing = from;
    char *incoming = to;
    const sf_messages messages = {&outgoing, &incoming, 1, at, send, at + 2 * n, receive_most, send_most};
    c->ops->exchange(c, &messages);
}

static size_t most_of(size_t a, size_t b) { return a > b ? a : b; }
static size_t least_of(size_t a, size_t b) { return a < b ? a : b; }

void sf_cluster_share(sf_cluster *c, const sf_shared_ranges *ranges, char *const *arrays, int count) {
    size_t n = (size_t)c->size, me = (size_t)c->rank, size = ranges->size, *at = c->offsets;
    const size_t *begin = ranges->begin, *end = ranges->end, *wanted = ranges->wanted;
    for (size_t r = 0; r < n; r++) {
        /* what rank r wants of mine, and what I want of its */
        size_t first = most_of(begin[me], wanted[2 * r]), last = least_of(end[me], wanted[2 * r + 1]);
        at[r] = first * size, at[n + r] = r != me && last > first ? (last - first) * size : 0;
        first = most_of(begin[r], wanted[2 * me]), last = least_of(end[r], wanted[2 * me + 1]);
        at[2 * n + r] = first * size, at[3 * n + r] = r != me && last > first ? (last - first) * size : 0;
        c->sent += at[n + r] * (size_t)count;
    }
    c->rounds++;
    const sf_messages messages = {
        (const char *const *)arrays, arrays, count, at, at + n, at + 2 * n, at + 3 * n, NULL};
    c->ops->exchange(c, &messages);
}

/* The bits of a double in an order that unsigned integers have. */
static uint64_t key_of(double x) {
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits >> 63 ? ~bits : bits | (uint64_t)1 << 63;
}

/* How many of the values, largest first, have a key of at least `least`. */
static size_t count_from(const double *values, size_t n, uint64_t least) {
    size_t first = 0, end = n;
    while (first < end) {
        size_t middle = first + (end - first) / 2;
        if (key_of(values[middle]) >= least)
            first = middle + 1;
        else
            end = middle;
    }
    return first;
}

size_t sf_cluster_largest(sf_cluster *c, const double *values, size_t n, size_t wanted) {
    if (sf_cluster_sum_count(c, n) <= wanted) return n;
    uint64_t least = 0; /* the largest key that `wanted` values or more have */
    for (int bit = 63; bit >= 0; bit--) {
        uint64_t tried = least | (uint64_t)1 << bit;
        if (sf_cluster_sum_count(c, count_from(values, n, tried)) >= wanted) least = tried;
    }
    size_t above = least == UINT64_MAX ? 0 : count_from(values, n, least + 1);
    size_t equal = count_from(values, n, least) - above, left = wanted - sf_cluster_sum_count(c, above);
    size_t mine = 0;
    for (int r = 0; r < c->size; r++) { /* lower ranks first */
        size_t of_rank = sf_cluster_sum_count(c, r == c->rank ? equal : 0);
        size_t taken = least_of(of_rank, left);
        if (r == c->rank) mine = taken;
        left -= taken;
    }
    return above + mine;
}
