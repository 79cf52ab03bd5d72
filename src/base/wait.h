/* wait.h - conditions of threads that are awaited until a deadline on the monotonic clock. */
#ifndef SF_BASE_WAIT_H
#define SF_BASE_WAIT_H

#include <pthread.h>
#include <stdint.h>
#include <time.h>

static inline void sf_condition_init(pthread_cond_t *condition) {
    pthread_condattr_t attributes;
    pthread_condattr_init(&attributes);
    pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
    pthread_cond_init(condition, &attributes);
    pthread_condattr_destroy(&attributes);
}

/* Waits for a signal, with `lock` held by the caller; what is waited for may not be there yet. 0: the
 * deadline (sf_clock_ns) is past. */
static inline int sf_condition_wait(pthread_cond_t *condition, pthread_mutex_t *lock, int64_t deadline_ns) {
    struct timespec until = {(time_t)(deadline_ns / 1000000000), (long)(deadline_ns % 1000000000)};
    return pthread_cond_timedwait(condition, lock, &until) == 0;
}

#endif
