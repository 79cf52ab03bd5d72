/* pool.h - the one thread pool. */
#ifndef SF_BASE_POOL_H
#define SF_BASE_POOL_H

#include <stddef.h>

#include "context.h"

/* Runs `task` of `tasks`, on thread `thread` (0 .. threads-1; 0 is the caller's). */
typedef void (*sf_task_fn)(void *arg, size_t task, int thread);

enum { SF_MAX_THREADS = 256 };

/* threads 1..SF_MAX_THREADS, the caller's included. */
sf_status sf_pool_create(sf_context *ctx, int threads, struct sf_pool **pool);
void sf_pool_destroy(sf_context *ctx, struct sf_pool **pool);
int sf_pool_threads(const struct sf_pool *pool);

/* Runs fn(arg, 0..tasks-1) and returns when all are done. A thread begins with its share of them, one after
 * another, the same for as many tasks, and then takes what others have not begun: whatever must not depend on
 * which thread ran a task is indexed by task. Calls from several threads take turns; a task must not call it.
 * Denormals are flushed to zero on every thread while tasks run. */
void sf_pool_run(struct sf_pool *pool, size_t tasks, sf_task_fn fn, void *arg);

/* CPUs that this process may use: affinity mask, limited by the control group's quota; at least 1. */
int sf_usable_cpus(void);

#endif
