/* clock.h - seconds on the monotonic clock. */
#ifndef SF_BASE_CLOCK_H
#define SF_BASE_CLOCK_H

#include <time.h>

static inline double sf_clock(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

#endif
