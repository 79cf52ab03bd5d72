/* accuracy.c - blending with cheaper and dearer polynomials for exp2: how far from float64, and how fast. */
#include <math.h>
#include <string.h>

#include "../base/clock.h"
#include "../base/pool.h"
#include "../base/rng.h"
#include "bench.h"
#include "clocks.h"
#include "exact.h"

typedef struct trial {
    sf_context *ctx;
    bench_scene scene;
    sf_workspace ws;
    exact ex;
    double *sums; /* [gaussians][EXACT_SUMS] */
} trial;

/* A gradient of the picture without a pattern, 0 beyond its borders. */
static void draw_gradient(sf_workspace *ws) {
    sf_rng rng;
    sf_rng_seed(&rng, BENCH_SEED);
    for (int ch = 0; ch < SF_CHANNELS; ch++) {
        memset(ws->d_rgb[ch], 0, ws->plane_rows * ws->stride * sizeof(float));
        for (int y = 0; y < ws->eye.height; y++)
            for (int x = 0; x < ws->eye.width; x++)
                ws->d_rgb[ch][(size_t)y * ws->stride + (size_t)x] = (float)sf_rng_normal(&rng);
    }
}

static sf_status open_trial(sf_context *ctx, const bench_level *level, int quick, trial *t) {
    *t = (trial){0};
    sf_status status = bench_context(ctx, level->name, 1, &t->ctx);
    if (status) return status;
    sf_workspace_init(&t->ws, t->ctx);
    status =
        quick ? bench_scene_create(t->ctx, 2000, 120, 68, BENCH_SEED, &t->scene)
              : bench_scene_create(t->ctx, BENCH_GAUSSIANS, BENCH_WIDTH, BENCH_HEIGHT, BENCH_SEED, &t->scene);
    if (!status) status = bench_scene_project(&t->scene, &t->ws);
    if (!status) {
        draw_gradient(&t->ws);
        status = exact_create(&t->ws, &t->ex);
    }
    if (!status) t->sums = sf_alloc(t->ctx, t->ex.gaussians, EXACT_SUMS * sizeof(double));
    if (!status && !t->sums) status = SF_ERR_MEMORY;
    return status ? sf_fail(ctx, status, "%s", sf_last_error(t->ctx)) : SF_OK;
}

static void close_trial(trial *t) {
    if (!t->ctx) return;
    exact_destroy(t->ctx, &t->ex);
    sf_free(t->ctx, t->sums);
    sf_workspace_free(&t->ws);
    bench_scene_destroy(&t->scene);
    sf_context_destroy(&t->ctx);
}

/* Sums of squares and greatest magnitudes of what is compared, and of the difference. */
typedef struct difference {
    double square, most, of_square, of_most;
} difference;

static void compare(difference *d, double got, double expected) {
    double by = got - expected;
    d->square += by * by;
    d->of_square += expected * expected;
    d->most = fmax(d->most, fabs(by));
    d->of_most = fmax(d->of_most, fabs(expected));
}

static void compare_picture(const trial *t, bench_accuracy *a) {
    const sf_workspace *ws = &t->ws;
    difference d = {0};
    for (size_t ch = 0; ch < SF_CHANNELS; ch++)
        for (int y = 0; y < ws->eye.height; y++)
            for (int x = 0; x < ws->eye.width; x++) {
                size_t at = (size_t)y * ws->stride + (size_t)x;
                if (!t->ex.left_out[at])
                    compare(&d, (double)ws->rgb[ch][at], t->ex.rgb[ch * t->ex.pixels + at]);
            }
    a->picture_rms = sqrt(d.square / d.of_square);
    a->picture_max = d.most / d.of_most;
}

/* The slots' sums to sums of each Gaussian. */
static void gather_sums(trial *t) {
    const sf_workspace *ws = &t->ws;
    for (size_t i = 0; i < ws->count; i++)
        for (size_t k = 0; k < EXACT_SUMS; k++) {
            double sum = 0;
            for (uint32_t slot = ws->slot[i]; slot < ws->slot[i + 1]; slot++)
                sum += (double)ws->sums[(size_t)slot * SF_SUMS + k];
            t->sums[i * EXACT_SUMS + k] = sum;
        }
}

static void compare_gradient(trial *t, bench_accuracy *a) {
    gather_sums(t);
    for (size_t k = 0; k < EXACT_SUMS; k++) {
        difference d = {0};
        for (size_t i = 0; i < t->ex.gaussians; i++)
            compare(&d, t->sums[i * EXACT_SUMS + k], t->ex.sums[i * EXACT_SUMS + k]);
        a->gradient_rms = fmax(a->gradient_rms, sqrt(d.square / d.of_square));
        a->gradient_max = fmax(a->gradient_max, d.most / d.of_most);
    }
}

static void set_variant(trial *t, const bench_level *level, int degree) {
    int v = BENCH_EXP2 + degree - 2;
    *t->ctx->kernels = level->kernels;
    if (!level->variant[v].blend) return; /* plain C has the one polynomial */
    t->ctx->kernels->blend = level->variant[v].blend;
    t->ctx->kernels->blend_bwd = level->variant[v].blend_bwd;
}

static sf_status run_variant(trial *t, const bench_level *level, int first, bench_accuracy *a) {
    static const float black[3];
    set_variant(t, level, a->degree);
    double start = bench_thread_clock();
    sf_stage_blend(&t->ws, black, 0);
    double middle = bench_thread_clock();
    sf_status status = sf_stage_blend_bwd(&t->ws);
    if (status) return status;
    double end = bench_thread_clock();
    if (first) { /* the first makes room */
        compare_picture(t, a);
        compare_gradient(t, a);
        return SF_OK;
    }
    bench_keep_least(&a->seconds, middle - start);
    bench_keep_least(&a->seconds_bwd, end - middle);
    return SF_OK;
}

/* A brief report has what the library itself blends with. */
static void list_variants(const bench_options *options, bench_report *report) {
    for (int i = 0; i < report->levels; i++)
        for (int degree = 2; degree <= 6; degree++)
            if (degree == 5 || (report->level[i].variant[BENCH_EXP2].blend && !options->brief))
                report->accuracy[report->accuracies++] =
                    (bench_accuracy){.level = i, .degree = degree, .pairs = report->load.contributing};
}

sf_status bench_accuracies(sf_context *ctx, const bench_options *options, bench_report *report) {
    trial t;
    int rounds = options->quick ? 2 : 21;
    bench_say(options, "accuracy");
    sf_status status = open_trial(ctx, &report->level[0], options->quick, &t);
    if (!status) list_variants(options, report);
    double start = sf_clock();
    for (int round = 0; bench_goes_on(options, round, rounds, start) && !status; round++) {
        for (int i = 0; i < report->accuracies && !status; i++) {
            bench_accuracy *a = &report->accuracy[i];
            status = run_variant(&t, &report->level[a->level], round == 0, a);
        }
        bench_machine_clock(&report->machine);
    }
    for (int y = 0; y < t.ws.eye.height && !status; y++)
        for (int x = 0; x < t.ws.eye.width; x++)
            report->accuracy_left_out += t.ex.left_out[(size_t)y * t.ws.stride + (size_t)x];
    report->accuracy_pixels = t.ws.eye.width * t.ws.eye.height;
    close_trial(&t);
    return status;
}
