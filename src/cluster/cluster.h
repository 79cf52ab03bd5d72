/* cluster.h - what ranks exchange: the few collectives that a fit on several ranks needs.
 *
 * A rank calls them in the same order as all others. Sums are made in the order of the ranks, so that all get
 * the same bytes, whatever the timing.
 */
#ifndef SF_CLUSTER_CLUSTER_H
#define SF_CLUSTER_CLUSTER_H

#include "../base/context.h"

#include <splatfit/cluster.h>

typedef struct sf_cluster sf_cluster;

/* Arrays of a rank of which others get parts, the same parts of each: send_bytes[r] at send_at[r] go to rank
 * r, this one included, and receive_bytes[r] from rank r are put at receive_at[r]. */
typedef struct sf_messages {
    const char *const *from;
    char *const *to;
    int arrays;
    const size_t *send_at, *send_bytes, *receive_at, *receive_bytes;
    const size_t *send_most; /* NULL, or receive_bytes of the receiver, who may get less */
} sf_messages;

/* What carries the bytes: MPI, or threads of one process in tests. */
typedef struct sf_cluster_ops {
    /* to: [size][bytes], the block of each rank in the order of the ranks. */
    void (*gather)(sf_cluster *cluster, const void *from, size_t bytes, void *to);
    void (*exchange)(sf_cluster *cluster, const sf_messages *messages);
    void (*end_all)(const sf_cluster *cluster, int exit_code);
    void (*leave)(sf_cluster *cluster);
} sf_cluster_ops;

struct sf_cluster {
    sf_context *ctx;
    const sf_cluster_ops *ops;
    void *state; /* of ops */
    int rank, size;
    uint64_t sent, rounds;
    uint64_t in_steps; /* of `sent`: sf_cluster_info */
    double designed;
    size_t *offsets; /* [4 size], scratch of sf_cluster_exchange */
};

/* The cluster of a context with more than one rank, else NULL. */
static inline sf_cluster *sf_cluster_of(const sf_context *ctx) { return ctx->cluster; }

/* Makes a cluster and gives it to the context. SF_ERR_MEMORY. */
sf_status sf_cluster_create(sf_context *ctx, const sf_cluster_ops *ops, void *state, int rank, int size);
/* Frees what sf_cluster_create made; NULL is allowed. */
void sf_cluster_destroy(sf_context *ctx);

/* to: [size][bytes]. */
void sf_cluster_gather_bytes(sf_cluster *cluster, const void *from, size_t bytes, void *to);
/* Replaces each value by its sum over the ranks. */
void sf_cluster_sum(sf_cluster *cluster, double *values, size_t n);
size_t sf_cluster_sum_count(sf_cluster *cluster, size_t count);
/* The largest of the ranks' values; the value of rank 0. */
double sf_cluster_most(sf_cluster *cluster, double value);
double sf_cluster_first(sf_cluster *cluster, double value);

/* Exchanges items of `size` bytes: those for rank r are from[send[0] + ... + send[r-1]] and the send[r] - 1
 * after it; likewise for what is received. */
void sf_cluster_exchange(sf_cluster *cluster, size_t size, const void *from, const size_t *send, void *to,
                         const size_t *receive);

/* Exchanges bytes of which who receives them knows but the most: those for rank r begin at
 * from[send_most[0] + ... + send_most[r-1]]; likewise for what is received. */
void sf_cluster_exchange_some(sf_cluster *cluster, const void *from, const size_t *send,
                              const size_t *send_most, void *to, const size_t *receive_most);

/* Ranges of the ranks, in items of `size` bytes: rank r has begin[r] .. end[r]-1, and wants wanted[2 r] ..
 * wanted[2 r + 1]-1 of all. */
typedef struct sf_shared_ranges {
    size_t size;
    const size_t *begin, *end, *wanted;
} sf_shared_ranges;

/* Arrays that every rank has: of each, the ranges are copied to the ranks that want them, in one exchange. */
void sf_cluster_share(sf_cluster *cluster, const sf_shared_ranges *ranges, char *const *arrays, int count);

/* values: of this rank, largest first. Returns how many of them are among the `wanted` largest of all ranks;
 * of equal ones, those of lower ranks are first. Together the ranks' numbers are `wanted`, or all that there
 * are. */
size_t sf_cluster_largest(sf_cluster *cluster, const double *values, size_t n, size_t wanted);

/* Implemented by mpi.c where MPI is built in: sf_cluster_join. */
sf_status sf_mpi_join(sf_context *ctx, int expected);

#endif
