/* blur.c - finds blurred training views: motion blur or defocus.
 *
 * The detail of a picture alone does not show blur: walls have little. A model trained on several views has
 * the detail that they share, so its render is the reference: the ratio of the detail of picture and render
 * is similar for all views, and much lower for a blurred one, at least in the direction of the blur.
 */
#include "blur.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "../base/pool.h"
#include "../base/statistics.h"
#include "draw_view.h"

/* Views are judged once, at this fraction of the run: the model is detailed by then, and most steps are still
 * to come. */
#define MEASURE_AT (1 / 3.0)
/* No view is judged where the render has less than this part of the pictures' mean squared difference. */
#define LEAST_DETAIL 0.01
/* Rounding error of 8-bit values: smaller differences are no detail. */
#define ROUNDING (1 / 255.0)

enum {
    FEWEST = 8,         /* the fewest training views to compare */
    FEWEST_ROWS = 96,   /* rows of a picture, evenly spread, that are measured at least */
    BLURRED_PASSES = 4, /* a blurred view is drawn once in this many passes */
    MOST_NAMES = 400    /* characters of view names in the warning */
};

enum { ACROSS, DOWN, DIRECTIONS };

/* Sums over the unmasked pixels and over pairs of neighbours. */
typedef struct detail {
    double sum[SF_CHANNELS], squares, pixels;
    double differences[DIRECTIONS], pairs[DIRECTIONS];
} detail;

typedef struct detail_job {
    const sf_workspace *ws;
    float *const *planes;
    size_t apart;
    detail *rows; /* [rows measured] of a row, with the pairs to the next row of the picture */
} detail_job;

/* One channel of a row, and the row below. No branches or calls for each value: they would take longer than
 * rendering the view. */
typedef struct channel_row {
    const float *value, *below;         /* NULL: the last row */
    const float *weight, *weight_below; /* NULL: no mask */
    size_t width;
} channel_row;

static double clamped(float value) { return value > 0 ? value < 1 ? (double)value : 1 : 0; }

static double is_unmasked(const float *weight, size_t x) { return !weight || weight[x] > 0.999f; }

static void add_row(const channel_row *r, int ch, detail *d) {
    double sum = 0, squares = 0, across = 0, down = 0, last = 0, last_in = 0;
    double pixels = 0, pairs_across = 0, pairs_down = 0;
    for (size_t x = 0; x < r->width; x++) {
        double in = is_unmasked(r->weight, x), value = clamped(r->value[x]);
        double along = value - last, in_along = in * last_in;
        sum += in * value, squares += in * value * value, pixels += in;
        across += in_along * along * along, pairs_across += in_along;
        last = value, last_in = in;
        if (!r->below) continue;
        double to_below = value - clamped(r->below[x]), in_down = in * is_unmasked(r->weight_below, x);
        down += in_down * to_below * to_below, pairs_down += in_down;
    }
    d->sum[ch] = sum, d->squares += squares;
    d->differences[ACROSS] += across, d->differences[DOWN] += down;
    /* the same for every channel */
    d->pixels = pixels, d->pairs[ACROSS] = pairs_across, d->pairs[DOWN] = pairs_down;
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

/* Detail of the target or the render in the workspace. */
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

/* Variance of a value about the mean of its channel, at least that of rounding. */
static double variance(const detail *d) {
    double about_mean = d->squares;
    for (int ch = 0; ch < SF_CHANNELS && d->pixels > 0; ch++)
        about_mean -= d->sum[ch] * d->sum[ch] / d->pixels;
    return fmax(about_mean, 0) / fmax(SF_CHANNELS * d->pixels, 1) + ROUNDING * ROUNDING;
}

static double mean_difference(const detail *d, int direction) {
    return d->differences[direction] / fmax(SF_CHANNELS * d->pairs[direction], 1);
}

/* Measurements of the views that are judged. */
typedef struct judgement {
    size_t count, room;
    uint32_t *ids;
    double *sharper[DIRECTIONS]; /* log of the mean squared difference of the picture relative to that of the
                                    render */
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
    double gain = variance(&target) / variance(&model); /* a different exposure is no blur */
    for (int k = 0; k < DIRECTIONS; k++)
        j->sharper[k][j->count] = log((mean_difference(&target, k) + ROUNDING * ROUNDING) /
                                      (gain * mean_difference(&model, k) + ROUNDING * ROUNDING));
    j->ids[j->count++] = view->id;
    return SF_OK;
}

/* Measures the views at full resolution. */
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

/* Median over the views that are trained on, without validation; *n: how many. */
static double median(const sf_fitter *f, const judgement *j, int direction, size_t *n) {
    *n = 0;
    for (size_t i = 0; i < j->count; i++)
        if (!sf_is_in_validation(&f->validation, j->ids[i])) j->sorted[(*n)++] = j->sharper[direction][i];
    return *n ? sf_median(j->sorted, *n) : 0;
}

/* Stores the ids of the views far below the median. */
static void find_blurred(sf_fitter *f, const judgement *j) {
    double typical[DIRECTIONS], limit = log(f->options.blur);
    size_t trained;
    for (int k = 0; k < DIRECTIONS; k++) typical[k] = median(f, j, k, &trained);
    if (trained < FEWEST || fmax(typical[ACROSS], typical[DOWN]) > -log(LEAST_DETAIL)) return;
    for (size_t i = 0; i < j->count; i++) {
        double lowest = fmin(j->sharper[ACROSS][i] - typical[ACROSS], j->sharper[DOWN][i] - typical[DOWN]);
        if (lowest < limit) f->blur.ids[f->blur.count++] = j->ids[i];
    }
}

static void log_blurred(const sf_fitter *f, size_t judged) {
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
    sf_free(f->ctx, f->blur.ids); /* an empty one from a checkpoint */
    f->blur.ids = sf_alloc(f->ctx, j->room, sizeof *f->blur.ids);
    if (!j->sharper[ACROSS] || !j->sharper[DOWN] || !j->sorted || !f->blur.ids) return SF_ERR_MEMORY;
    status = judge_views(f, j);
    if (!status) find_blurred(f, j);
    return status;
}

/* Not with a random background: seen through holes of the model it has edges that no picture has. */
static int may_measure(const sf_fitter *f) {
    return f->options.blur > 0 && f->options.background != SF_BACKGROUND_RANDOM && !f->blur.judged;
}

sf_status sf_measure_blur(sf_fitter *f, double fraction) {
    judgement j = {0};
    if (!may_measure(f) || fraction < MEASURE_AT) return SF_OK;
    sf_status status = judge(f, &j);
    f->blur.judged = 1;
    if (f->blur.count) log_blurred(f, j.count);
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
        if (!sf_is_blurred(&f->blur, f->sampler.ids[i]) || !sf_rng_below(&f->rng, BLURRED_PASSES))
            f->sampler.ids[kept++] = f->sampler.ids[i];
    f->sampler.count = kept;
}
