/* ranks_fixture.h - ranks that are threads of one process, each with a context. */
#ifndef TESTS_UNIT_RANKS_FIXTURE_H
#define TESTS_UNIT_RANKS_FIXTURE_H

#include "testing.h"

#include "cluster/cluster.h"

/* What a rank does; it must not assert, as it is not the test's thread. What it returns, the first of the
 * ranks that is not SF_OK, is what ranks_run returns. */
typedef sf_status (*ranks_fn)(sf_context *ctx, int rank, void *user);

/* A network between the ranks, for those that run after it was set: an exchange takes the latency and what a
 * rank sends or receives, whichever is more, over the bandwidth. Zeros: none. */
typedef struct ranks_network {
    double latency, bandwidth; /* s, bytes/s */
} ranks_network;
extern ranks_network ranks_between;

/* Runs `size` ranks with `threads` threads each. A size of 1 has no cluster. */
sf_status ranks_run(int size, int threads, ranks_fn fn, void *user);

#endif
