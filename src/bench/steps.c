/* steps.c - whole steps: of the scene at several sizes, and of a fitted model. */
#include "step.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../base/pool.h"
#include "../base/statistics.h"
#include "../scene/gaussians.h"
#include "../scene/pixels.h"
#include "bench.h"
#include "clocks.h"

/* A level on a number of threads. */
typedef struct runner {
    sf_context *ctx;
    sf_workspace ws;
    bench_step_times *times;
} runner;

static sf_status open_runner(sf_context *ctx, const bench_report *report, int level, int threads,
                             bench_step_times *times, runner *r) {
    times->level = level;
    times->threads = threads;
    r->times = times;
    sf_status status = bench_context(ctx, report->level[level].name, threads, &r->ctx);
    if (!status) sf_workspace_init(&r->ws, r->ctx);
    return status;
}

static void close_runner(runner *r) {
    if (r->ctx) sf_workspace_free(&r->ws);
    sf_context_destroy(&r->ctx);
}

/* A failure's message lies with the runner's own context. */
static sf_status pass_on(sf_context *ctx, const runner *r, sf_status status) {
    return status ? sf_fail(ctx, status, "%s", sf_last_error(r->ctx)) : SF_OK;
}

enum { ROUNDS_LEAST = 3, ROUNDS_MOST = 20 };

/* All runners in turn, round after round, until the time is up: what disturbs one disturbs all alike. */
static sf_status run_rounds(sf_context *ctx, runner *runners, int n, const sf_model *model,
                            const sf_optimizer_state *moments, const bench_view *view, double limit) {
    double start = sf_clock();
    for (int round = 0; round < ROUNDS_MOST; round++) {
        if (round >= ROUNDS_LEAST && sf_clock() - start > limit) break;
        for (int i = 0; i < n; i++) {
            double seconds[STAGES] = {0};
            sf_status status = bench_step(&runners[i].ws, model, moments, view, seconds);
            if (status) return pass_on(ctx, &runners[i], status);
            if (!round) continue; /* makes room */
            for (int k = 0; k < STAGES; k++) bench_keep_least(&runners[i].times->seconds[k], seconds[k]);
            runners[i].times->rounds = round;
        }
    }
    return SF_OK;
}

/* How much work the scene is: counted once, in the lists of the first runner. */
static void count_work(const bench_report *report, runner *runners, int n, int with_pairs) {
    const sf_workspace *ws = &runners[0].ws;
    for (int i = 0; i < n; i++) {
        bench_step_times *t = runners[i].times;
        const bench_step_times *before = i ? runners[i - 1].times : NULL;
        const sf_roof *roof = &report->level[t->level].roof;
        t->entries = ws->tile_begin[ws->eye.tiles_x * ws->eye.tiles_y];
        if (!with_pairs) continue;
        bench_pairs pairs;
        if (before && before->level == t->level)
            pairs = (bench_pairs){before->contributing, before->evaluated};
        else
            pairs = bench_count_pairs(ws, roof->block_columns, roof->block_rows);
        t->contributing = pairs.contributing;
        t->evaluated = pairs.evaluated;
    }
}

/* One size: the levels first .. last, each on one thread and on all unless alone. */
typedef struct size {
    size_t gaussians;
    int width, height, first, last, count_pairs, alone;
} size;

/* Adds to a list of times. */
static sf_status run_size(sf_context *ctx, const bench_options *options, const size *s, bench_report *report,
                          bench_step_times *list, int *count) {
    runner runners[2 * BENCH_LEVELS_MOST] = {0};
    bench_scene scene = {0};
    sf_optimizer_state moments = {0};
    int n = 0, all = s->alone ? 1 : report->machine.threads;
    sf_status status = bench_scene_create(ctx, s->gaussians, s->width, s->height, BENCH_SEED, &scene);
    if (!status) status = sf_optimizer_create(scene.model, SF_MOMENTS_FLOAT, 0, &moments);
    for (int level = s->first; level <= s->last; level++)
        for (int many = 0; many < (all > 1 ? 2 : 1) && !status; many++) {
            bench_step_times *times = &list[*count + n];
            *times = (bench_step_times){.gaussians = s->gaussians,
                                        .width = s->width,
                                        .height = s->height,
                                        .sh_degree = SF_MAX_SH_DEGREE};
            status = open_runner(ctx, report, level, many ? all : 1, times, &runners[n++]);
        }
    bench_view view = {.camera = scene.camera, .near_plane = BENCH_NEAR, .rgb = scene.picture};
    if (!status)
        status = run_rounds(ctx, runners, n, scene.model, &moments, &view, options->quick ? 0.2 : 2.0);
    if (!status) count_work(report, runners, n, s->count_pairs);
    if (!status) *count += n;
    for (int i = 0; i < n; i++) close_runner(&runners[i]);
    sf_optimizer_destroy(ctx, &moments);
    bench_scene_destroy(&scene);
    return status;
}

/* Bytes that a size takes: parameters and moments, then for each runner records, keys and lists. */
static double bytes_of(const size *s) {
    double runners = (s->alone ? 1 : 2) * (s->last - s->first + 1), n = (double)s->gaussians;
    return n * (12 * bench_parameters(SF_MAX_SH_DEGREE) + runners * (110 + 3 * 80)) +
           runners * 60.0 * s->width * s->height;
}

sf_status bench_stages(sf_context *ctx, const bench_options *options, bench_report *report) {
    int best = report->levels - 1, far = 0;
    size s = {.gaussians = BENCH_GAUSSIANS,
              .width = BENCH_WIDTH,
              .height = BENCH_HEIGHT,
              .last = best,
              .count_pairs = 1,
              .alone = 1};
    if (options->quick) s.gaussians = 2000, s.width = 120, s.height = 68;
    bench_say(options, "stages");
    sf_status status = run_size(ctx, options, &s, report, report->stage, &report->stages);
    s.width *= 2, s.height *= 2;
    if (!status) status = run_size(ctx, options, &s, report, report->stage, &report->stages);
    bench_machine_clock(&report->machine);
    if (status) return status;
    size one = {.gaussians = 1, .first = best, .last = best, .alone = 1};
    one.gaussians = (size_t)(bench_machine_far(&report->machine, options->quick) / bytes_of(&one));
    one.width = s.width / 2, one.height = s.height / 2;
    return run_size(ctx, options, &one, report, &report->far, &far);
}

static sf_status run_if_room(sf_context *ctx, const bench_options *options, const size *s,
                             bench_report *report) {
    char what[96];
    int fits = bytes_of(s) < bench_machine_room();
    snprintf(what, sizeof what, "steps, %zu Gaussians at %dx%d%s", s->gaussians, s->width, s->height,
             fits ? "" : ": left out, not enough memory");
    bench_say(options, what);
    return fits && report->steps + 2 * BENCH_LEVELS_MOST <= BENCH_STEPS_MOST
               ? run_size(ctx, options, s, report, report->step, &report->steps)
               : SF_OK;
}

enum { COMPARED = 28000 }; /* Gaussians at which all levels are compared */

sf_status bench_steps(sf_context *ctx, const bench_options *options, bench_report *report) {
    static const size_t counts[] = {10000, COMPARED, 100000, 300000, 1000000};
    static const int sizes[][2] = {{240, 135}, {BENCH_WIDTH, BENCH_HEIGHT}, {960, 540}};
    int best = report->levels - 1;
    sf_status status = SF_OK;
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 5 && !status; c++) {
            int compared = counts[c] == COMPARED && sizes[r][0] == BENCH_WIDTH;
            size s = {counts[c], sizes[r][0], sizes[r][1], compared ? 0 : best, best, r == 1, 0};
            if (options->quick ? r || c : options->brief && !compared) continue;
            if (options->quick) s = (size){2000, 120, 68, 0, best, 1, 0};
            status = run_if_room(ctx, options, &s, report);
            bench_machine_clock(&report->machine);
        }
    return status;
}

/* The views of a project, in memory as a fit has them. */
typedef struct views {
    sf_view **view;
    size_t held, n, open; /* that are held; that are timed; of them, whose pixels are open */
    sf_view_pixels *pixels;
    bench_view *shown;
} views;

static void release_views(sf_scene *scene, views *v) {
    for (size_t i = 0; i < v->open; i++) sf_view_close(v->view[i], &v->pixels[i]);
    sf_scene_release_all(scene, v->view, v->held);
    sf_free(scene->ctx, v->pixels);
    sf_free(scene->ctx, v->shown);
}

static sf_status take_views(sf_scene *scene, float near_plane, size_t most, views *v) {
    *v = (views){0};
    sf_status status = sf_scene_retain_training(scene, &v->view, &v->held);
    v->n = v->held < most ? v->held : most;
    if (!status && !v->n) status = sf_fail(scene->ctx, SF_ERR_EMPTY, "scene: no training view");
    if (!status && !(v->shown = sf_calloc(scene->ctx, v->n, sizeof *v->shown))) status = SF_ERR_MEMORY;
    if (!status && !(v->pixels = sf_calloc(scene->ctx, v->n, sizeof *v->pixels))) status = SF_ERR_MEMORY;
    for (; v->open < v->n && !status; v->open += !status) {
        const sf_view *view = v->view[v->open];
        sf_view_pixels *p = &v->pixels[v->open];
        status = sf_view_open(view, p);
        v->shown[v->open] = (bench_view){view->camera, near_plane, p->rgb, p->weight};
    }
    if (status) release_views(scene, v);
    return status;
}

/* Means over the views of each stage's least time; of the whole step the median too. */
static void average(const double (*least)[STAGES], size_t n, double *scratch, bench_step_times *times) {
    for (int k = 0; k < STAGES; k++)
        for (size_t i = 0; i < n; i++) times->seconds[k] += least[i][k] / (double)n;
    for (size_t i = 0; i < n; i++) scratch[i] = least[i][STAGE_TOTAL];
    qsort(scratch, n, sizeof *scratch, sf_compare_doubles);
    times->median_total = n % 2 ? scratch[n / 2] : 0.5 * (scratch[n / 2 - 1] + scratch[n / 2]);
}

/* Every view by every runner, round after round. */
static sf_status run_views(sf_context *ctx, runner *runners, int n, const sf_model *model,
                           const sf_optimizer_state *moments, const views *v, double limit) {
    double(*least)[STAGES] = sf_calloc(ctx, (size_t)n * v->n, sizeof *least), start = sf_clock();
    double *scratch = sf_calloc(ctx, v->n, sizeof *scratch);
    sf_status status = least && scratch ? SF_OK : SF_ERR_MEMORY;
    for (int round = 0; !status && round < ROUNDS_MOST && (!round || sf_clock() - start < limit); round++)
        for (size_t view = 0; view < v->n && !status; view++)
            for (int i = 0; i < n && !status; i++) {
                double seconds[STAGES] = {0}, *kept = least[(size_t)i * v->n + view];
                /* the first step makes room, and is made again */
                for (int again = round || view; again < 2 && !status; again++)
                    status = bench_step(&runners[i].ws, model, moments, &v->shown[view], seconds);
                if (status) pass_on(ctx, &runners[i], status);
                for (int k = 0; k < STAGES; k++) bench_keep_least(&kept[k], seconds[k]);
                runners[i].times->rounds = round + 1;
            }
    for (int i = 0; i < n && !status; i++)
        average((const double(*)[STAGES])least + (size_t)i * v->n, v->n, scratch, runners[i].times);
    sf_free(ctx, least);
    sf_free(ctx, scratch);
    return status;
}

sf_status bench_fit(sf_context *ctx, const bench_options *options, const sf_model *model, sf_scene *scene,
                    float near_plane, bench_report *report) {
    runner runners[2 * BENCH_LEVELS_MOST] = {0};
    sf_optimizer_state moments = {0};
    bench_fitted *f = &report->fitted;
    views v;
    int n = 0, all = report->machine.threads;
    bench_say(options, "steps of the fitted model");
    sf_status status = take_views(scene, near_plane, options->quick ? 2 : SIZE_MAX, &v);
    if (status) return status;
    status = sf_optimizer_create(model, SF_MOMENTS_FLOAT, 0, &moments);
    for (int level = 0; level < report->levels && !status; level++)
        for (int many = 0; many < (all > 1 ? 2 : 1) && !status; many++, n++)
            status = open_runner(ctx, report, level, many ? all : 1, &f->times[n], &runners[n]);
    for (int i = 0; i < n; i++) {
        f->times[i].gaussians = model->count;
        f->times[i].width = v.shown[0].camera.width;
        f->times[i].height = v.shown[0].camera.height;
        f->times[i].sh_degree = model->sh_degree;
    }
    if (!status) status = run_views(ctx, runners, n, model, &moments, &v, options->quick ? 0 : 60.0);
    f->views = v.n;
    f->gaussians = model->count;
    f->width = v.shown[0].camera.width;
    f->height = v.shown[0].camera.height;
    f->count = status ? 0 : n;
    for (int i = 0; i < n; i++) close_runner(&runners[i]);
    sf_optimizer_destroy(ctx, &moments);
    release_views(scene, &v);
    bench_machine_clock(&report->machine);
    return status;
}
