/* pool.c - the thread pool: workers sleep on a condition until a job is posted, then take its tasks. A step
 * posts a job every half millisecond: before a thread sleeps it looks out for a moment. A job ends when its
 * tasks are done: a worker that the system has not woken by then finds it closed. */
#define _GNU_SOURCE
#include "pool.h"

#include <sched.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>

#include "clock.h"

#if defined(__SSE__)
#include <xmmintrin.h>
#endif

/* The tasks that a thread takes first; when it has none left it helps the others with theirs. So a block of
 * Gaussians mostly stays with one thread from job to job and from step to step, and in the caches of its
 * processor: what another one wrote last has to come from there, which is far where they share no cache. */
typedef struct share {
    _Alignas(64) atomic_size_t next;
    size_t end;
} share;

typedef struct worker {
    struct sf_pool *pool;
    int thread;
    pthread_t id;
} worker;

/* The gate: a job's number, whether threads may still enter it, and how many workers are inside. Nobody waits
 * for a worker that did not enter: where the system gave it no processor, the others do its tasks. A worker
 * enters by changing the gate as it saw it, so that it is inside an open job or not at all. */
enum { INSIDE = SF_MAX_THREADS - 1, OPEN = SF_MAX_THREADS, NUMBER = 2 * SF_MAX_THREADS };

struct sf_pool {
    int threads;
    share *shares;   /* one a thread */
    worker *workers; /* threads - 1 */
    pthread_mutex_t turn;
    pthread_mutex_t lock; /* of who opens the gate or sets `stop`, and of the last to leave a closed job */
    pthread_cond_t posted, done;
    atomic_uint gate;
    atomic_int stop;
    sf_task_fn fn; /* this and the shares change while the gate is closed and nobody is inside */
    void *arg;
};

/* Denormals cost a hundred cycles each and mean nothing here. Returns the old state. */
static uint32_t flush_denormals(void) {
    uint32_t old = 0;
#if defined(__SSE__)
    old = _mm_getcsr();
    _mm_setcsr(old | 0x8040u); /* flush to zero, denormals are zero */
#elif defined(__aarch64__)
    uint64_t state;
    __asm__ volatile("mrs %0, fpcr" : "=r"(state));
    old = (uint32_t)state;
    __asm__ volatile("msr fpcr, %0" : : "r"(state | 1u << 24));
#elif defined(__arm__) && defined(__ARM_FP)
    __asm__ volatile("vmrs %0, fpscr" : "=r"(old));
    __asm__ volatile("vmsr fpscr, %0" : : "r"(old | 1u << 24));
#endif
    return old;
}

static void restore_denormals(uint32_t old) {
#if defined(__SSE__)
    _mm_setcsr(old);
#elif defined(__aarch64__)
    uint64_t state = old;
    __asm__ volatile("msr fpcr, %0" : : "r"(state));
#elif defined(__arm__) && defined(__ARM_FP)
    __asm__ volatile("vmsr fpscr, %0" : : "r"(old));
#else
    (void)old;
#endif
}

/* How long a thread looks out before it sleeps: to be woken takes longer than most of what a step does
 * between its jobs. After a moment of it the processor is offered to whoever waits for one at each look. */
static const double LOOK_OUT_SECONDS = 0.5e-3, MOMENT_SECONDS = 20e-6;

static void pause_a_little(double looked_out) {
    if (looked_out > MOMENT_SECONDS) {
        sched_yield();
        return;
    }
#if defined(__x86_64__) || defined(__i386__)
    __builtin_ia32_pause();
#elif defined(__arm__) || defined(__aarch64__)
    __asm__ volatile("yield");
#endif
}

/* Whether the gate is open to a worker that was last inside when it was `seen`. The number may come round
 * again while a worker sleeps: then that worker misses a job, which ends without it. */
static int is_new(unsigned gate, unsigned seen) { return (gate & OPEN) && gate / NUMBER != seen / NUMBER; }

/* Whether a new job is posted, or all are to stop, before it is time to sleep. */
static int looked_out_for_job(struct sf_pool *pool, unsigned seen) {
    double start = sf_clock();
    for (double passed = 0; passed < LOOK_OUT_SECONDS; passed = sf_clock() - start) {
        if (is_new(atomic_load(&pool->gate), seen) || atomic_load(&pool->stop)) return 1;
        pause_a_little(passed);
    }
    return 0;
}

static void wait_for_job(struct sf_pool *pool, unsigned seen) {
    if (looked_out_for_job(pool, seen)) return;
    pthread_mutex_lock(&pool->lock);
    while (!is_new(atomic_load(&pool->gate), seen) && !atomic_load(&pool->stop))
        pthread_cond_wait(&pool->posted, &pool->lock);
    pthread_mutex_unlock(&pool->lock);
}

/* Enters the posted job; *seen: the gate. 0: it is closed again. */
static int enter(struct sf_pool *pool, unsigned *seen) {
    unsigned gate = atomic_load(&pool->gate);
    while (is_new(gate, *seen))
        if (atomic_compare_exchange_weak(&pool->gate, &gate, gate + 1)) {
            *seen = gate;
            return 1;
        }
    return 0;
}

static void leave(struct sf_pool *pool) {
    unsigned gate = atomic_fetch_sub(&pool->gate, 1);
    if ((gate & OPEN) || (gate & INSIDE) > 1) return;
    pthread_mutex_lock(&pool->lock);
    pthread_cond_signal(&pool->done);
    pthread_mutex_unlock(&pool->lock);
}

/* Closes the job, all of whose tasks are begun, and waits until those inside have left. */
static void close_job(struct sf_pool *pool) {
    atomic_fetch_and(&pool->gate, ~(unsigned)OPEN);
    double start = sf_clock();
    for (double passed = 0; passed < LOOK_OUT_SECONDS; passed = sf_clock() - start) {
        if (!(atomic_load(&pool->gate) & INSIDE)) return;
        pause_a_little(passed);
    }
    pthread_mutex_lock(&pool->lock);
    while (atomic_load(&pool->gate) & INSIDE) pthread_cond_wait(&pool->done, &pool->lock);
    pthread_mutex_unlock(&pool->lock);
}

static void open_job(struct sf_pool *pool) {
    pthread_mutex_lock(&pool->lock);
    unsigned number = atomic_load(&pool->gate) / NUMBER + 1;
    atomic_store(&pool->gate, number * NUMBER | OPEN);
    pthread_cond_broadcast(&pool->posted);
    pthread_mutex_unlock(&pool->lock);
}

static void take_tasks(struct sf_pool *pool, int thread) {
    size_t task;
    for (int i = 0; i < pool->threads; i++) {
        share *s = &pool->shares[(thread + i) % pool->threads];
        while ((task = atomic_fetch_add_explicit(&s->next, 1, memory_order_relaxed)) < s->end)
            pool->fn(pool->arg, task, thread);
    }
}

static void *work(void *worker_pointer) {
    worker *self = worker_pointer;
    struct sf_pool *pool = self->pool;
    unsigned seen = 0;
    flush_denormals();
    for (;;) {
        wait_for_job(pool, seen);
        if (atomic_load(&pool->stop)) return NULL;
        if (!enter(pool, &seen)) continue;
        take_tasks(pool, self->thread);
        leave(pool);
    }
}

/* Starts one worker with all signals blocked, so that signal handlers run on the program's threads. */
static int start_worker(struct sf_pool *pool, int thread) {
    worker *w = &pool->workers[thread - 1];
    *w = (worker){.pool = pool, .thread = thread};
    sigset_t all, old;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &old);
    int error = pthread_create(&w->id, NULL, work, w);
    pthread_sigmask(SIG_SETMASK, &old, NULL);
    return error;
}

sf_status sf_pool_create(sf_context *ctx, int threads, struct sf_pool **out) {
    *out = NULL;
    struct sf_pool *pool = sf_calloc(ctx, 1, sizeof *pool);
    if (!pool) return SF_ERR_MEMORY;
    pool->threads = 1;
    pthread_mutex_init(&pool->turn, NULL);
    pthread_mutex_init(&pool->lock, NULL);
    pthread_cond_init(&pool->posted, NULL);
    pthread_cond_init(&pool->done, NULL);
    pool->workers = sf_calloc(ctx, (size_t)threads, sizeof *pool->workers);
    pool->shares = sf_calloc(ctx, (size_t)threads, sizeof *pool->shares);
    sf_status status = pool->workers && pool->shares ? SF_OK : SF_ERR_MEMORY;
    for (int t = 1; t < threads && !status; t++) {
        if (start_worker(pool, t))
            status = sf_fail(ctx, SF_ERR_MEMORY, "threads: cannot start thread %d", t);
        else
            pool->threads++;
    }
    *out = pool;
    if (status) sf_pool_destroy(ctx, out);
    return status;
}

void sf_pool_destroy(sf_context *ctx, struct sf_pool **pool_pointer) {
    struct sf_pool *pool = *pool_pointer;
    if (!pool) return;
    pthread_mutex_lock(&pool->lock);
    atomic_store(&pool->stop, 1);
    pthread_cond_broadcast(&pool->posted);
    pthread_mutex_unlock(&pool->lock);
    for (int t = 1; t < pool->threads; t++) pthread_join(pool->workers[t - 1].id, NULL);
    pthread_cond_destroy(&pool->posted);
    pthread_cond_destroy(&pool->done);
    pthread_mutex_destroy(&pool->lock);
    pthread_mutex_destroy(&pool->turn);
    sf_free(ctx, pool->workers);
    sf_free(ctx, pool->shares);
    sf_free(ctx, pool);
    *pool_pointer = NULL;
}

int sf_pool_threads(const struct sf_pool *pool) { return pool->threads; }

/* floor(tasks t / n), where share t of n begins; the product may be more than a size_t holds. */
static size_t share_begin(size_t tasks, size_t t, size_t n) { return tasks / n * t + tasks % n * t / n; }

void sf_pool_run(struct sf_pool *pool, size_t tasks, sf_task_fn fn, void *arg) {
    if (!tasks) return;
    pthread_mutex_lock(&pool->turn);
    uint32_t old = flush_denormals();
    pool->fn = fn;
    pool->arg = arg;
    for (size_t t = 0, n = (size_t)pool->threads; t < n; t++) {
        atomic_store_explicit(&pool->shares[t].next, share_begin(tasks, t, n), memory_order_relaxed);
        pool->shares[t].end = share_begin(tasks, t + 1, n);
    }
    int shared = pool->threads > 1 && tasks > 1;
    if (shared) open_job(pool);
    take_tasks(pool, 0);
    if (shared) close_job(pool);
    restore_denormals(old);
    pthread_mutex_unlock(&pool->turn);
}

/* CPUs that the quota of the control group allows, rounded up; 0: no quota. Version 2, then version 1.
 */
static int quota_cpus(void) {
    double quota = -1, period = 0;
    FILE *f = fopen("/sys/fs/cgroup/cpu.max", "r");
    if (f) {
        if (fscanf(f, "%lf %lf", &quota, &period) != 2) quota = -1; /* "max" */
        fclose(f);
    } else {
        f = fopen("/sys/fs/cgroup/cpu/cpu.cfs_quota_us", "r");
        if (f && fscanf(f, "%lf", &quota) != 1) quota = -1;
        if (f) fclose(f);
        f = fopen("/sys/fs/cgroup/cpu/cpu.cfs_period_us", "r");
        if (f && fscanf(f, "%lf", &period) != 1) quota = -1;
        if (f) fclose(f);
    }
    if (!(quota > 0) || !(period > 0)) return 0;
    double cpus = quota / period;
    return cpus < SF_MAX_THREADS ? (int)(cpus + 0.999) : 0;
}

int sf_usable_cpus(void) {
    cpu_set_t set;
    int cpus = sched_getaffinity(0, sizeof set, &set) == 0 ? CPU_COUNT(&set) : 1;
    int quota = quota_cpus();
    if (quota > 0 && quota < cpus) cpus = quota;
    if (cpus > SF_MAX_THREADS) cpus = SF_MAX_THREADS;
    return cpus < 1 ? 1 : cpus;
}
