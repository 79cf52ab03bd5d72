/* blur.c - training views that are less sharp than the model: moved during the exposure, or out of focus.
 *
 * How much detail a picture has says nothing alone: walls have little. But a model that several views made
 * has the detail that they share, and what it shows of a view's place is a measure for that view: the ratio
 * of both is much the same for all views, and far lower for a blurred one, in the direction of its blur at
 * least.
 */
#include "blur.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "../base/pool.h"
#include "../base/statistics.h"
#include "draw_view.h"

/* Views are judged once, here in the run: the model knows by now what is there, and most is still to come. */
#define JUDGE_AT (1 / 3.0)
/* A model with a smaller part of the pictures' mean square differences is no measure for them. */
#define LEAST_DETAIL 0.01
/* What an 8-bit value does not tell, and so no detail. */
#define ROUNDING (1 / 255.0)

enum {
    FEWEST = 8,        /* views that have something in common */
    FEWEST_ROWS = 96,  /* of a picture, evenly spread, that speak for it */
    PASSES_OF_ONE = 4, /* of a blurred view: it may be the only one that sees something */
    MOST_NAMES = 400   /* characters of them in the warning */
};

enum { ACROSS, DOWN, DIRECTIONS };

/* Sums over the pixels that count, and over pairs of neighbours. */
typedef struct detail {
    double sum[SF_CHANNELS], squares, pixels;
    double differences[DIRECTIONS], pairs[DIRECTIONS];
} detail;

typedef struct detail_job {
    const sf_workspace *ws;
    float *const *planes;
    size_t apart;
    detail *rows; /* of each row that is taken, with the pairs to the next one of the picture */
} detail_job;

/* Counts and sums of one channel of a row, and of its pairs: branches and calls for each value would take
 * longer than drawing the view. */
typedef struct channel_row {
    const float *value, *below;         /* NULL: the last row */
    const float *weight, *weight_below; /* NULL: all count */
    size_t width;
} channel_row;

static double shown(float value) { return value > 0 ? value < 1 ? (double)value : 1 : 0; }

static double counts(const float *weight, size_t x) { return !weight || weight[x] > 0.999f; }

static void add_row(const channel_row *r, int ch, detail *d) {
    double sum = 0, squares = 0, across = 0, down = 0, last = 0, last_counts = 0;
    double pixels = 0, pairs_across = 0, pairs_down = 0;
    for (size_t x = 0; x < r->width; x++) {
        double in = counts(r->weight, x), value = shown(r->value[x]);
        double along = value - last, in_along = in * last_counts;
        sum += in * value, squares += in * value * value, pixels += in;
        across += in_along * along * along, pairs_across += in_along;
        last = value, last_counts = in;
        if (!r->below) continue;
        double to_below = value - shown(r->below[x]), in_down = in * counts(r->weight_below, x);
        down += in_down * to_below * to_below, pairs_down += in_down;
    }
    d->sum[ch] = sum, d->squares += squares;
    d->differences[ACROSS] += across, d->differences[DOWN] += down;
    d->pixels = pixels, d->pairs[ACROSS] = pairs_across, d->pairs[DOWN] = pairs_down; /* of every channel */
}

static void detail_task(void *job_pointer, size_t task, int thread) {
    (void)thread;
    const detail_job *job = job_pointer;
    const sf_workspace *ws = job->ws;
    size_t row = task * job->apart, at = row * ws->stride;
    int last = row + 1 == (size_t)ws->eye.height;
    detail d = {0};
    for (int ch = 0; ch < SF_CHANNELS; ch++) {
        const float *value = job->planes[ch] + at, *weight = ws->has_weight ? ws->weight + at : NULL;
        channel_row r = {.value = value,
                         .below = last ? NULL : value + ws->stride,
                         .weight = weight,
                         .weight_below = weight && !last ? weight + ws->stride : NULL,
                         .width = (size_t)ws->eye.width};
        add_row(&r, ch, &d);
    }
    job->rows[task] = d;
}

/* Of the target or the render that the workspace has. */
static sf_status measure(sf_workspace *ws, float *const *planes, detail *all) {
    size_t height = (size_t)ws->eye.height, apart = height < 2 * FEWEST_ROWS ? 1 : height / FEWEST_ROWS;
    size_t rows = (height + apart - 1) / apart;
    detail_job job = {ws, planes, apart, sf_alloc(ws->ctx, rows, sizeof *job.rows)};
    *all = (detail){0};
    if (!job.rows) return SF_ERR_MEMORY;
    sf_pool_run(ws->ctx->pool, rows, detail_task, &job);
    for (size_t row = 0; row < rows; row++) {
        const detail *d = &job.rows[row];
        for (int ch = 0; ch < SF_CHANNELS; ch++) all->sum[ch] += d->sum[ch];
        for (int k = 0; k < DIRECTIONS; k++)
            all->differences[k] += d->differences[k], all->pairs[k] += d->pairs[k];
        all->squares += d->squares, all->pixels += d->pixels;
    }
    sf_free(ws->ctx, job.rows);
    return SF_OK;
}

/* Of a value, about the mean of its channel; never less than what rounding leaves open. */
static double variance(const detail *d) {
    double about_mean = d->squares;
    for (int ch = 0; ch < SF_CHANNELS && d->pixels > 0; ch++)
        about_mean -= d->sum[ch] * d->sum[ch] / d->pixels;
    return fmax(about_mean, 0) / fmax(SF_CHANNELS * d->pixels, 1) + ROUNDING * ROUNDING;
}

static double mean_difference(const detail *d, int direction) {
    return d->differences[direction] / fmax(SF_CHANNELS * d->pairs[direction], 1);
}

/* What is known of the views that are judged. */
typedef struct judgement {
    size_t count, room;
    uint32_t *ids;
    double *sharper[DIRECTIONS]; /* logarithm: the picture's mean square difference to that of the model */
    double *sorted;              /* scratch */
} judgement;

static sf_status judge_view(sf_fitter *f, const sf_view *view, judgement *j) {
    sf_workspace *ws = &f->workspace;
    double weight_sum;
    detail target, model;
    sf_status status = sf_draw_view(f, view, sf_view_state_of(&f->views, view->id), &weight_sum);
    if (!status) status = measure(ws, ws->target, &target);
    if (!status) status = measure(ws, ws->rgb, &model);
    if (status) return status == SF_ERR_EMPTY ? SF_OK : status;
    double gain = variance(&target) / variance(&model); /* an exposure of its own is no blur */
    for (int k = 0; k < DIRECTIONS; k++)
        j->sharper[k][j->count] = log((mean_difference(&target, k) + ROUNDING * ROUNDING) /
                                      (gain * mean_difference(&model, k) + ROUNDING * ROUNDING));
    j->ids[j->count++] = view->id;
    return SF_OK;
}

/* At full resolution. */
static sf_status judge_views(sf_fitter *f, judgement *j) {
    int level = f->level;
    sf_status status = SF_OK;
    f->level = 0;
    for (size_t i = 0; i < j->room && !status; i++) {
        sf_view *view = sf_scene_retain_id(f->scene, j->ids[i]);
        if (view) status = judge_view(f, view, j);
        sf_view_release(view);
    }
    f->level = level;
    return status;
}

/* Of those that are trained on; views of validation have no part in what is trained on. *n: how many. */
static double median(const sf_fitter *f, const judgement *j, int direction, size_t *n) {
    *n = 0;
    for (size_t i = 0; i < j->count; i++)
        if (!sf_is_in_validation(&f->validation, j->ids[i])) j->sorted[(*n)++] = j->sharper[direction][i];
    return *n ? sf_median(j->sorted, *n) : 0;
}

/* The ids of those far below the others become the fitter's. */
static void find_blurred(sf_fitter *f, const judgement *j) {
    double usual[DIRECTIONS], limit = log(f->options.blur);
    size_t trained;
    for (int k = 0; k < DIRECTIONS; k++) usual[k] = median(f, j, k, &trained);
    if (trained < FEWEST || fmax(usual[ACROSS], usual[DOWN]) > -log(LEAST_DETAIL)) return;
    for (size_t i = 0; i < j->count; i++) {
        double least = fmin(j->sharper[ACROSS][i] - usual[ACROSS], j->sharper[DOWN][i] - usual[DOWN]);
        if (least < limit) f->blur.ids[f->blur.count++] = j->ids[i];
    }
}

static void say_which(const sf_fitter *f, size_t judged) {
    char names[MOST_NAMES + 1] = "";
    size_t used = 0, named = 0;
    for (; named < f->blur.count; named++) {
        sf_view *view = sf_scene_retain_id(f->scene, f->blur.ids[named]);
        const char *name = view ? view->name : "";
        int fits = used + strlen(name) + 2 < sizeof names;
        if (fits) used += (size_t)snprintf(names + used, sizeof names - used, "%s%s", used ? ", " : "", name);
        sf_view_release(view);
        if (!fits) break;
    }
    sf_log(f->ctx, SF_LOG_WARNING,
           "blur: %zu of %zu training views are less sharp than the model, and count less: %s%s",
           f->blur.count, judged, names, named < f->blur.count ? ", ..." : "");
}

static sf_status judge(sf_fitter *f, judgement *j) {
    sf_status status = sf_scene_training_ids(f->scene, &j->ids, &j->room);
    if (status) return status;
    for (int k = 0; k < DIRECTIONS; k++) j->sharper[k] = sf_alloc(f->ctx, j->room, sizeof **j->sharper);
    j->sorted = sf_alloc(f->ctx, j->room, sizeof *j->sorted);
    sf_free(f->ctx, f->blur.ids); /* a checkpoint's, of none */
    f->blur.ids = sf_alloc(f->ctx, j->room, sizeof *f->blur.ids);
    if (!j->sharper[ACROSS] || !j->sharper[DOWN] || !j->sorted || !f->blur.ids) return SF_ERR_MEMORY;
    status = judge_views(f, j);
    if (!status) find_blurred(f, j);
    return status;
}

/* Through a model with holes a background drawn at random shows edges that no picture has. */
static int may_judge(const sf_fitter *f) {
    return f->options.blur > 0 && f->options.background != SF_BACKGROUND_RANDOM && !f->blur.judged;
}

sf_status sf_measure_blur(sf_fitter *f, double fraction) {
    judgement j = {0};
    if (!may_judge(f) || fraction < JUDGE_AT) return SF_OK;
    sf_status status = judge(f, &j);
    f->blur.judged = 1;
    if (f->blur.count) say_which(f, j.count);
    sf_free(f->ctx, j.ids);
    for (int k = 0; k < DIRECTIONS; k++) sf_free(f->ctx, j.sharper[k]);
    sf_free(f->ctx, j.sorted);
    return status;
}

void sf_skip_blurred_views(sf_fitter *f) {
    size_t kept = 0, sharp = 0;
    for (size_t i = 0; i < f->sampler.count; i++) sharp += !sf_is_blurred(&f->blur, f->sampler.ids[i]);
    if (!sharp) return;
    for (size_t i = 0; i < f->sampler.count; i++)
        if (!sf_is_blurred(&f->blur, f->sampler.ids[i]) || !sf_rng_below(&f->rng, PASSES_OF_ONE))
            f->sampler.ids[kept++] = f->sampler.ids[i];
    f->sampler.count = kept;
}
