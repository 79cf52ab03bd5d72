/* clocks.h - time as the benchmark takes it. */
#ifndef BENCH_CLOCKS_H
#define BENCH_CLOCKS_H

#include <time.h>

#include "../base/clock.h"
#include "../base/pool.h"

/* Seconds of processor time of this thread: the turns of other programs do not count. */
static inline double bench_thread_clock(void) {
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* What a context of one thread does is timed by that thread's clock, so that a busy machine distorts it less;
 * what several do, by the wall's. */
static inline double bench_clock(const sf_context *ctx) {
    return sf_pool_threads(ctx->pool) == 1 ? bench_thread_clock() : sf_clock();
}

/* Keeps the least that was seen; 0 is nothing yet. */
static inline void bench_keep_least(double *least, double seconds) {
    if (*least == 0 || seconds < *least) *least = seconds;
}

#endif
