/* roofs.c - what this machine could do at best: multiply-adds of each level, and the way to memory. */
#include "bench.h"

#include <string.h>

#include "../base/pool.h"
#include "clocks.h"

/* Multiply-adds on all threads of a pool: a few tasks a thread, so that none waits long for the last. */
typedef struct arithmetic {
    const sf_roof *roof;
    size_t rounds;
} arithmetic;

enum { TASKS_A_THREAD = 4 };

static void arithmetic_task(void *job_pointer, size_t task, int thread) {
    (void)task, (void)thread;
    const arithmetic *job = job_pointer;
    job->roof->multiply_add(job->rounds);
}

static double gflops(sf_context *ctx, const sf_roof *roof, int quick) {
    enum { ROUNDS = 100000, QUICK_ROUNDS = 2000 };
    arithmetic job = {roof, quick ? QUICK_ROUNDS : ROUNDS};
    size_t tasks = TASKS_A_THREAD * (size_t)sf_pool_threads(ctx->pool);
    double least = 0, each = roof->multiply_add(1) * (double)job.rounds;
    for (int i = 0; i < (quick ? 3 : 30); i++) {
        double start = bench_clock(ctx);
        sf_pool_run(ctx->pool, tasks, arithmetic_task, &job);
        bench_keep_least(&least, bench_clock(ctx) - start);
    }
    return each * (double)tasks / least * 1e-9;
}

/* Loads and stores, cut into pieces of a page's multiple. */
enum { PIECE = 1 << 18 /* floats */ };

typedef struct traffic {
    const sf_roof *roof;
    float *array;
    int kind; /* 0 read, 1 write, 2 update */
} traffic;

static void traffic_task(void *job_pointer, size_t task, int thread) {
    (void)thread;
    const traffic *job = job_pointer;
    float *piece = job->array + task * PIECE;
    if (job->kind == 0) job->roof->read(piece, PIECE);
    if (job->kind == 1) job->roof->write(piece, PIECE, 1.0f);
    if (job->kind == 2) job->roof->update(piece, PIECE, 1.0f);
}

static double gigabytes(sf_context *ctx, const sf_roof *roof, float *array, size_t pieces, int kind,
                        int times) {
    traffic job = {roof, array, kind};
    double least = 0, bytes = (double)pieces * PIECE * sizeof(float) * (kind == 2 ? 2 : 1);
    for (int i = 0; i < times; i++) {
        double start = bench_clock(ctx);
        sf_pool_run(ctx->pool, pieces, traffic_task, &job);
        bench_keep_least(&least, bench_clock(ctx) - start);
    }
    return bytes / least * 1e-9;
}

static sf_status bandwidth(sf_context *one, sf_context *all, const sf_roof *roof, int quick,
                           bench_report *report) {
    bench_bandwidth *b = &report->bandwidth;
    size_t pieces = (size_t)(bench_machine_far(&report->machine, quick) / (PIECE * sizeof(float))) + 1;
    float *array = sf_alloc(one, pieces, PIECE * sizeof(float));
    if (!array) return SF_ERR_MEMORY;
    memset(array, 0, pieces * PIECE * sizeof(float));
    b->bytes = (double)pieces * PIECE * sizeof(float);
    for (int i = 0; i < 2; i++) {
        sf_context *ctx = i ? all : one;
        b->read[i] = gigabytes(ctx, roof, array, pieces, 0, quick ? 2 : 6);
        b->write[i] = gigabytes(ctx, roof, array, pieces, 1, quick ? 2 : 6);
        b->update[i] = gigabytes(ctx, roof, array, pieces, 2, quick ? 2 : 6);
    }
    sf_free(one, array);
    return SF_OK;
}

sf_status bench_roofs(sf_context *ctx, const bench_options *options, bench_report *report) {
    sf_context *one = NULL, *all = NULL;
    const bench_level *best = &report->level[report->levels - 1];
    bench_say(options, "roofs");
    bench_machine_clock(&report->machine);
    sf_status status = bench_context(ctx, best->name, 1, &one);
    if (!status) status = bench_context(ctx, best->name, report->machine.threads, &all);
    for (int i = 0; i < report->levels && !status; i++) {
        bench_level *level = &report->level[i];
        level->gflops[0] = gflops(one, &level->roof, options->quick);
        level->gflops[1] = gflops(all, &level->roof, options->quick);
    }
    if (!status) status = bandwidth(one, all, &best->roof, options->quick, report);
    if (status == SF_ERR_MEMORY) sf_fail(ctx, status, "out of memory: arrays of the bandwidth");
    bench_machine_clock(&report->machine);
    sf_context_destroy(&one);
    sf_context_destroy(&all);
    return status;
}
