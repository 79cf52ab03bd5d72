/* test_pool.c - the thread pool: every task once, on every thread, in turns. */
/* link: -Wl,--wrap=pthread_create */
#define _GNU_SOURCE
#include "testing.h"

#include <errno.h>
#include <float.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/pool.h"

enum { MOST_THREADS = 8, MOST_TASKS = 4097 };

/* Threads that the library starts pass through here; those past the first `threads_left` are refused. */
static int threads_left = 1 << 30;

int __real_pthread_create(pthread_t *thread, const pthread_attr_t *attributes, void *(*start)(void *),
                          void *arg);
int __wrap_pthread_create(pthread_t *thread, const pthread_attr_t *attributes, void *(*start)(void *),
                          void *arg);

/* Threads that start while this is set wait until it is cleared: as if the system gave them no processor. */
static atomic_int held_back;

typedef struct late_start {
    void *(*start)(void *);
    void *arg;
} late_start;

static void *start_late(void *late_pointer) {
    late_start late = *(late_start *)late_pointer;
    free(late_pointer);
    while (held_back) sched_yield();
    return late.start(late.arg);
}

int __wrap_pthread_create(pthread_t *thread, const pthread_attr_t *attributes, void *(*start)(void *),
                          void *arg) {
    if (threads_left-- <= 0) return EAGAIN;
    if (!held_back) return __real_pthread_create(thread, attributes, start, arg);
    late_start *late = malloc(sizeof *late);
    *late = (late_start){start, arg};
    return __real_pthread_create(thread, attributes, start_late, late);
}

typedef struct tally {
    int threads;
    pthread_t caller;
    atomic_int runs[MOST_TASKS];
    atomic_int misplaced; /* a thread's number out of range, or 0 on another thread than the caller's */
} tally;

static void count_task(void *tally_pointer, size_t task, int thread) {
    tally *t = tally_pointer;
    atomic_fetch_add(&t->runs[task], 1);
    int is_caller = pthread_equal(pthread_self(), t->caller) != 0;
    if (thread < 0 || thread >= t->threads || (thread == 0) != is_caller) atomic_fetch_add(&t->misplaced, 1);
}

static void assert_runs_once(struct sf_pool *pool, size_t tasks) {
    static tally t;
    memset(&t, 0, sizeof t);
    t.threads = sf_pool_threads(pool);
    t.caller = pthread_self();
    sf_pool_run(pool, tasks, count_task, &t);
    for (size_t i = 0; i < MOST_TASKS; i++) assert_int_equal(t.runs[i], i < tasks);
    assert_int_equal(t.misplaced, 0);
}

static void every_task_runs_once(void **state) {
    (void)state;
    static const size_t sizes[] = {0, 1, 2, 3, 5, 8, 9, 63, 1000, MOST_TASKS};
    for (int threads = 1; threads <= MOST_THREADS; threads++) {
        sf_context *ctx = test_context_threads(threads);
        assert_int_equal(sf_pool_threads(ctx->pool), threads);
        for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++)
            for (int again = 0; again < 3; again++) assert_runs_once(ctx->pool, sizes[i]);
        sf_context_destroy(&ctx);
    }
}

/* Each thread's first task; none goes on before all have one. */
typedef struct beginnings {
    atomic_int begun;
    int threads;
    int has[MOST_THREADS];
    size_t first[MOST_THREADS];
} beginnings;

static void begin_task(void *beginnings_pointer, size_t task, int thread) {
    beginnings *b = beginnings_pointer;
    if (b->has[thread]) return;
    b->has[thread] = 1, b->first[thread] = task;
    atomic_fetch_add(&b->begun, 1);
    while (b->begun < b->threads) sched_yield();
}

static void count_begun_task(void *beginnings_pointer, size_t task, int thread) {
    (void)task, (void)thread;
    atomic_fetch_add(&((beginnings *)beginnings_pointer)->begun, 1);
}

/* What a thread wrote in one job it reads in the next. */
static void threads_begin_with_their_shares(void **state) {
    (void)state;
    for (int threads = 2; threads <= MOST_THREADS; threads++) {
        sf_context *ctx = test_context_threads(threads);
        for (size_t tasks = (size_t)threads; tasks < 40; tasks += 7) {
            beginnings b = {.threads = threads};
            sf_pool_run(ctx->pool, tasks, begin_task, &b);
            for (int t = 0; t < threads; t++) {
                assert_true(b.has[t]);
                assert_int_equal(b.first[t], (size_t)t * tasks / (size_t)threads);
            }
        }
        sf_context_destroy(&ctx);
    }
}

/* Jobs end without workers that never come, and these take part in later ones. */
static void jobs_do_not_wait_for_who_never_came(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    struct sf_pool *pool;
    held_back = 1;
    assert_ok(ctx, sf_pool_create(ctx, 3, &pool));
    for (size_t tasks = 0; tasks < 40; tasks++) assert_runs_once(pool, tasks);
    held_back = 0;
    beginnings b = {.threads = 3};
    sf_pool_run(pool, 3, begin_task, &b); /* would hang if they did not come */
    for (int t = 0; t < 3; t++) assert_true(b.has[t]);
    sf_pool_destroy(ctx, &pool);
    sf_context_destroy(&ctx);
}

/* Jobs so short that workers come while they are closed, and in the next one. */
static void short_jobs_follow_one_another(void **state) {
    (void)state;
    sf_context *ctx = test_context_threads(4);
    for (int job = 0; job < 3000; job++) {
        beginnings b = {.threads = 1};
        size_t tasks = 2 + (size_t)job % 3;
        sf_pool_run(ctx->pool, tasks, count_begun_task, &b);
        assert_int_equal(b.begun, tasks);
    }
    sf_context_destroy(&ctx);
}

static void pools_live_side_by_side(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    for (int round = 0; round < 200; round++) {
        struct sf_pool *outer, *inner;
        assert_ok(ctx, sf_pool_create(ctx, 1 + round % 4, &outer));
        assert_ok(ctx, sf_pool_create(ctx, 1 + round % 3, &inner));
        assert_runs_once(inner, (size_t)round % 7);
        assert_runs_once(outer, 5);
        sf_pool_destroy(ctx, round % 2 ? &outer : &inner);
        assert_runs_once(round % 2 ? inner : outer, 6);
        sf_pool_destroy(ctx, &outer); /* one of the two is NULL by now */
        sf_pool_destroy(ctx, &inner);
        assert_null(outer);
        assert_null(inner);
    }
    sf_context_destroy(&ctx);
}

/* Several threads that post jobs to one pool. */
enum { CALLERS = 4, CALLS = 50, CALL_TASKS = 20 };

typedef struct crowd {
    struct sf_pool *pool;
    atomic_int inside[CALLERS]; /* tasks of each caller that run now */
    atomic_int overlaps;
} crowd;

typedef struct caller {
    crowd *crowd;
    int number;
    atomic_int done;
} caller;

static void crowded_task(void *caller_pointer, size_t task, int thread) {
    (void)task, (void)thread;
    caller *c = caller_pointer;
    atomic_fetch_add(&c->crowd->inside[c->number], 1);
    sched_yield();
    for (int other = 0; other < CALLERS; other++)
        if (other != c->number && c->crowd->inside[other]) atomic_fetch_add(&c->crowd->overlaps, 1);
    atomic_fetch_sub(&c->crowd->inside[c->number], 1);
    atomic_fetch_add(&c->done, 1);
}

/* Leaves at the first call after which not all of its tasks are done. */
static void *call_often(void *caller_pointer) {
    caller *c = caller_pointer;
    for (int call = 1; call <= CALLS; call++) {
        sf_pool_run(c->crowd->pool, CALL_TASKS, crowded_task, c);
        if (c->done != call * CALL_TASKS) break;
    }
    return NULL;
}

static void callers_take_turns(void **state) {
    (void)state;
    sf_context *ctx = test_context_threads(3);
    crowd shared = {.pool = ctx->pool};
    caller callers[CALLERS];
    pthread_t threads[CALLERS];
    for (int i = 0; i < CALLERS; i++) {
        callers[i] = (caller){.crowd = &shared, .number = i};
        assert_int_equal(pthread_create(&threads[i], NULL, call_often, &callers[i]), 0);
    }
    for (int i = 0; i < CALLERS; i++) pthread_join(threads[i], NULL);
    for (int i = 0; i < CALLERS; i++) assert_int_equal(callers[i].done, CALLS * CALL_TASKS);
    assert_int_equal(shared.overlaps, 0);
    sf_context_destroy(&ctx);
}

/* What each thread finds while tasks run. */
typedef struct survey {
    pthread_barrier_t all; /* holds each task until every thread has one */
    int visits[MOST_THREADS];
    int keeps_denormals[MOST_THREADS], takes_signals[MOST_THREADS];
} survey;

static int keeps_denormals(void) {
    volatile float least = FLT_MIN, half = 0.5f;
    volatile float result = least * half;
    uint32_t bits;
    float value = result;
    memcpy(&bits, &value, sizeof bits);
    return bits != 0;
}

static int takes_signals(void) {
    sigset_t blocked;
    pthread_sigmask(SIG_SETMASK, NULL, &blocked);
    return !sigismember(&blocked, SIGINT) || !sigismember(&blocked, SIGTERM);
}

static void survey_task(void *survey_pointer, size_t task, int thread) {
    (void)task;
    survey *s = survey_pointer;
    s->visits[thread]++;
    s->keeps_denormals[thread] = keeps_denormals();
    s->takes_signals[thread] = takes_signals();
    pthread_barrier_wait(&s->all);
}

static survey surveyed(int threads) {
    survey s = {0};
    sf_context *ctx = test_context_threads(threads);
    assert_int_equal(pthread_barrier_init(&s.all, NULL, (unsigned)threads), 0);
    sf_pool_run(ctx->pool, (size_t)threads, survey_task, &s);
    pthread_barrier_destroy(&s.all);
    sf_context_destroy(&ctx);
    return s;
}

static void all_threads_work_at_once(void **state) {
    (void)state;
    survey s = surveyed(MOST_THREADS); /* would hang at its barrier if they did not */
    for (int t = 0; t < MOST_THREADS; t++) assert_int_equal(s.visits[t], 1);
}

static void denormals_are_flushed_in_tasks_alone(void **state) {
    (void)state;
#if defined(__SSE__) || defined(__aarch64__) || (defined(__arm__) && defined(__ARM_FP))
    assert_true(keeps_denormals());
    survey s = surveyed(4);
    for (int t = 0; t < 4; t++) assert_false(s.keeps_denormals[t]);
    assert_true(keeps_denormals());
#else
    test_skip("no way is known to flush denormals on this machine");
#endif
}

static void workers_leave_signals_to_the_program(void **state) {
    (void)state;
    survey s = surveyed(4);
    assert_true(s.takes_signals[0]);
    for (int t = 1; t < 4; t++) assert_false(s.takes_signals[t]);
    assert_true(takes_signals());
}

static void refused_thread_is_an_error(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    for (int started = 0; started < 4; started++) {
        struct sf_pool *pool = NULL;
        threads_left = started;
        sf_status status = sf_pool_create(ctx, 5, &pool);
        threads_left = 1 << 30;
        assert_int_equal(status, SF_ERR_MEMORY);
        assert_null(pool);
        assert_error_names(ctx, "cannot start thread");
    }
    assert_runs_once(ctx->pool, 10);
    sf_context_destroy(&ctx);
}

static void usable_cpus_follow_the_affinity(void **state) {
    (void)state;
    cpu_set_t all, one;
    assert_int_equal(sched_getaffinity(0, sizeof all, &all), 0);
    int cpus = sf_usable_cpus();
    assert_between(cpus, 1, CPU_COUNT(&all));

    int first = 0;
    while (!CPU_ISSET(first, &all)) first++;
    CPU_ZERO(&one);
    CPU_SET(first, &one);
    assert_int_equal(sched_setaffinity(0, sizeof one, &one), 0);
    int narrowed = sf_usable_cpus();
    assert_int_equal(sched_setaffinity(0, sizeof all, &all), 0);
    assert_int_equal(narrowed, 1);
    assert_int_equal(sf_usable_cpus(), cpus);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_task_runs_once),
        cmocka_unit_test(threads_begin_with_their_shares),
        cmocka_unit_test(jobs_do_not_wait_for_who_never_came),
        cmocka_unit_test(short_jobs_follow_one_another),
        cmocka_unit_test(pools_live_side_by_side),
        cmocka_unit_test(callers_take_turns),
        cmocka_unit_test(all_threads_work_at_once),
        cmocka_unit_test(denormals_are_flushed_in_tasks_alone),
        cmocka_unit_test(workers_leave_signals_to_the_program),
        cmocka_unit_test(refused_thread_is_an_error),
        cmocka_unit_test(usable_cpus_follow_the_affinity),
    };
    return cmocka_run_group_tests_name("pool", tests, NULL, NULL);
}
