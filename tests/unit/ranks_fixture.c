/* ranks_fixture.c - see ranks_fixture.h. */
#include "ranks_fixture.h"

#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { MOST_RANKS = 8 };

/* What a rank shows to the others between two barriers. */
typedef struct shown {
    const char *const *from;
    int arrays;
    size_t send_at[MOST_RANKS], send_bytes[MOST_RANKS];
} shown;

typedef struct ranks {
    pthread_barrier_t barrier;
    shown shown[MOST_RANKS];
    int size, threads;
    ranks_fn fn;
    void *user;
} ranks;

typedef struct one_rank {
    ranks *all;
    int rank;
    sf_status status;
} one_rank;

ranks_network ranks_between;

static void travel(const sf_cluster *c, const sf_messages *m) {
    size_t sent = 0, received = 0;
    if (!(ranks_between.bandwidth > 0)) return;
    for (int r = 0; r < c->size; r++) {
        if (r == c->rank) continue;
        sent += m->send_bytes[r] * (size_t)m->arrays, received += m->receive_bytes[r] * (size_t)m->arrays;
    }
    double seconds =
        ranks_between.latency + (double)(sent > received ? sent : received) / ranks_between.bandwidth;
    struct timespec left = {(time_t)seconds, (long)(1e9 * (seconds - floor(seconds)))};
    while (nanosleep(&left, &left)) continue;
}

/* What rank r has for this one. */
static void take(const sf_cluster *c, const shown *other, int r, const sf_messages *m) {
    size_t bytes = other->send_bytes[c->rank];
    if (bytes > m->receive_bytes[r] || (!m->send_most && bytes < m->receive_bytes[r]) ||
        other->arrays != m->arrays) {
        fprintf(stderr, "rank %d expects %zu bytes of rank %d, which sends %zu\n", c->rank,
                m->receive_bytes[r], r, bytes);
        abort();
    }
    for (int a = 0; a < m->arrays && bytes; a++)
        memcpy(m->to[a] + m->receive_at[r], other->from[a] + other->send_at[c->rank], bytes);
}

static void exchange(sf_cluster *c, const sf_messages *m) {
    ranks *all = c->state;
    shown *mine = &all->shown[c->rank];
    mine->from = m->from, mine->arrays = m->arrays;
    memcpy(mine->send_at, m->send_at, (size_t)c->size * sizeof *m->send_at);
    memcpy(mine->send_bytes, m->send_bytes, (size_t)c->size * sizeof *m->send_bytes);
    travel(c, m);
    pthread_barrier_wait(&all->barrier);
    for (int r = 0; r < c->size; r++) take(c, &all->shown[r], r, m);
    pthread_barrier_wait(&all->barrier);
}

static void gather(sf_cluster *c, const void *from, size_t bytes, void *to) {
    size_t send_at[MOST_RANKS] = {0}, send[MOST_RANKS], at[MOST_RANKS];
    const char *outgoing = from;
    char *incoming = to;
    for (int r = 0; r < c->size; r++) send[r] = bytes, at[r] = bytes * (size_t)r;
    const sf_messages messages = {&outgoing, &incoming, 1, send_at, send, at, send, NULL};
    exchange(c, &messages);
}

static void end_all(const sf_cluster *c, int exit_code) {
    (void)c, (void)exit_code;
    abort();
}

static void leave(sf_cluster *c) { (void)c; }

static const sf_cluster_ops threads_ops = {gather, exchange, end_all, leave};

static void *run_rank(void *rank_pointer) {
    one_rank *r = rank_pointer;
    sf_context *ctx;
    const sf_context_options options = {.threads = r->all->threads};
    r->status = sf_context_create(&ctx, &options);
    if (!r->status && r->all->size > 1)
        r->status = sf_cluster_create(ctx, &threads_ops, r->all, r->rank, r->all->size);
    if (!r->status) r->status = r->all->fn(ctx, r->rank, r->all->user);
    if (r->status) fprintf(stderr, "rank %d: %s\n", r->rank, sf_last_error(ctx));
    sf_cluster_destroy(ctx);
    sf_context_destroy(&ctx);
    return NULL;
}

sf_status ranks_run(int size, int threads, ranks_fn fn, void *user) {
    ranks all = {.size = size, .threads = threads, .fn = fn, .user = user};
    one_rank rank[MOST_RANKS];
    pthread_t thread[MOST_RANKS];
    sf_status status = SF_OK;
    (void)test_folder(); /* the first call makes it, which ranks must not do at the same time */
    pthread_barrier_init(&all.barrier, NULL, (unsigned)size);
    for (int r = 0; r < size; r++) {
        rank[r] = (one_rank){&all, r, SF_OK};
        pthread_create(&thread[r], NULL, run_rank, &rank[r]);
    }
    for (int r = 0; r < size; r++) {
        pthread_join(thread[r], NULL);
        if (!status) status = rank[r].status;
    }
    pthread_barrier_destroy(&all.barrier);
    return status;
}
