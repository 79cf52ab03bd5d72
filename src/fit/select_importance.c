/* select_importance.c - how much each Gaussian lowers the squared error of the training views.
 *
 * A pixel is linear in the opacity that a Gaussian has there. So the change of the squared error when one
 * Gaussian is removed follows from sums of the backward pass, without another render (README, Size).
 */
#include "select_importance.h"

#include <math.h>
#include <string.h>

#include "../base/pool.h"
#include "../base/statistics.h"
#include "../kernels/sh.h"
#include "../render/shard.h"
#include "ranks.h"
#include "sample_views.h"

enum {
    GATHER = 1024, /* Gaussians a task */
    ATTRIBUTED =
        0 /* index in a slot's sums of its sf_attributed_error: where w d_rgb was, which is not used */
};

/* A variance of the render below this does not determine a gain. The same part of the squared errors is
 * rounding. */
#define LEAST_SPREAD 1e-6

/* Least-squares line y = gain x + bias of one channel, by weight; x: render, y: picture. */
typedef struct channel_line {
    sf_line_sums sums;
    double gain, bias;
} channel_line;

/* Sums of one row of tiles. */
typedef struct band_sums {
    sf_errors errors;
    channel_line lines[SF_CHANNELS];
} band_sums;

typedef struct importance_job {
    sf_workspace *ws;
    sf_importance *importance;
    band_sums *bands;
    channel_line lines[SF_CHANNELS]; /* of the whole picture */
    float gain[SF_CHANNELS];         /* learned exposure gain of the view, else 1 */
    double pixels;                   /* of the full resolution in one pixel of the render */
    uint8_t *merged;                 /* [count] 1: a tentatively merged Gaussian; NULL: there is none */
    uint8_t *drawn; /* the same of the Gaussians that are drawn: of several ranks the band's */
    size_t drawn_capacity;
    const float *before; /* [before_count] squared errors, before the merges, of the tiles of the views not
                            yet measured */
    size_t before_count;
} importance_job;

/* Writes the residuals of a row of pixels, times the weight, and the weights; both are 0 beyond the picture.
 */
static void residual_row(sf_workspace *ws, size_t row, band_sums *sums) {
    size_t from = row * ws->stride, width = row < (size_t)ws->eye.height ? (size_t)ws->eye.width : 0;
    for (size_t x = 0; x < ws->stride; x++) {
        size_t at = from + x;
        float weight = x >= width ? 0.0f : ws->has_weight ? ws->weight[at] : 1.0f;
        ws->weight[at] = weight;
        sums->errors.values += (double)(SF_CHANNELS * weight);
        for (int ch = 0; ch < SF_CHANNELS; ch++) {
            sf_line_sums *t = &sums->lines[ch].sums;
            float drawn = x < width ? ws->rgb[ch][at] : 0, target = x < width ? ws->target[ch][at] : 0;
            float weighted = weight * drawn, r = weighted - target; /* the target has the weight in it */
            ws->d_rgb[ch][at] = r;
            sums->errors.squares += (double)r * (double)r;
            t->w += (double)weight, t->x += (double)weighted, t->y += (double)target;
            t->xx += (double)weighted * (double)drawn, t->xy += (double)target * (double)drawn;
        }
    }
}

static void residual_task(void *job_pointer, size_t band, int thread) {
    (void)thread;
    const importance_job *job = job_pointer;
    band_sums *sums = &job->bands[band];
    for (size_t y = 0; y < SF_TILE; y++) residual_row(job->ws, SF_TILE * band + y, sums);
}

static void fit_channel_line(channel_line *t, const band_sums *bands, size_t count, int channel) {
    *t = (channel_line){0};
    sf_line_sums *s = &t->sums;
    for (size_t band = 0; band < count; band++) {
        const sf_line_sums *part = &bands[band].lines[channel].sums;
        s->w += part->w, s->x += part->x, s->y += part->y, s->xx += part->xx, s->xy += part->xy;
    }
    sf_line_fit(s, LEAST_SPREAD * s->w * s->w, &t->gain, &t->bias);
}

/* Adds the corrected errors of a tile: the residuals after gain and bias of the picture. */
static void add_corrected(const importance_job *job, int channel, size_t from, sf_errors *errors) {
    const sf_workspace *ws = job->ws;
    const channel_line *t = &job->lines[channel];
    double sum = 0;
    for (size_t y = 0; y < SF_TILE; y++)
        for (size_t at = from + y * ws->stride; at < from + y * ws->stride + SF_TILE; at++) {
            double weight = (double)ws->weight[at];
            if (!(weight > 0)) continue;
            double r =
                weight * (t->gain * (double)ws->rgb[channel][at] + t->bias) - (double)ws->target[channel][at];
            sum += r;
            errors->corrected += r * r;
        }
    errors->tile_energy += sum * sum;
}

static void corrected_task(void *job_pointer, size_t band, int thread) {
    (void)thread;
    const importance_job *job = job_pointer;
    for (size_t x = 0; x < job->ws->stride; x += SF_TILE)
        for (int ch = 0; ch < SF_CHANNELS; ch++)
            add_corrected(job, ch, SF_TILE * band * job->ws->stride + x, &job->bands[band].errors);
}

static void add_errors(sf_errors *to, const sf_errors *more, double factor) {
    to->squares += factor * more->squares;
    to->corrected += factor * more->corrected;
    to->tile_energy += factor * more->tile_energy;
    to->values += factor * more->values;
}

double sf_correlation_area(const sf_errors *errors) {
    double most = SF_TILE * SF_TILE; /* also where gain and bias explain all errors */
    return errors->corrected > LEAST_SPREAD * errors->squares
               ? fmin(fmax(errors->tile_energy / errors->corrected, 1), most)
               : most;
}

/* Residuals and error sums of the last render. */
static sf_status measure_residuals(importance_job *job, double pixels) {
    size_t bands = job->ws->plane_rows / SF_TILE;
    job->pixels = pixels;
    job->bands = sf_calloc(job->ws->ctx, bands, sizeof *job->bands);
    if (!job->bands) return SF_ERR_MEMORY;
    sf_pool_run(job->ws->ctx->pool, bands, residual_task, job);
    for (int ch = 0; ch < SF_CHANNELS; ch++) fit_channel_line(&job->lines[ch], job->bands, bands, ch);
    sf_pool_run(job->ws->ctx->pool, bands, corrected_task, job);
    for (size_t band = 0; band < bands; band++)
        add_errors(&job->importance->errors, &job->bands[band].errors, pixels);
    sf_free(job->ws->ctx, job->bands);
    job->importance->views++;
    return SF_OK;
}

static double slot_weight(const importance_job *job, uint32_t entry) {
    const sf_workspace *ws = job->ws;
    if (!job->drawn[ws->entries[entry]]) return 0;
    return (double)ws->sums[(size_t)ws->entry_slots[entry] * SF_SUMS + 7];
}

/* Attributes the squared error of a tile, now and before the merges, to the merged Gaussians in it, by blend
 * weight. */
static void attribute_error(const importance_job *job, size_t tile, double now, double before,
                            double values) {
    const sf_workspace *ws = job->ws;
    double all = 0;
    for (uint32_t e = ws->tile_begin[tile]; e < ws->tile_begin[tile + 1]; e++) all += slot_weight(job, e);
    for (uint32_t e = ws->tile_begin[tile]; e < ws->tile_begin[tile + 1]; e++) {
        float *sums = ws->sums + (size_t)ws->entry_slots[e] * SF_SUMS + ATTRIBUTED;
        double part = all > 0 ? slot_weight(job, e) / all : 0;
        sums[0] = (float)(part * now);
        sums[1] = (float)(part * before);
        sums[2] = (float)(part * values);
    }
}

static void tile_task(void *job_pointer, size_t tile, int thread) {
    (void)thread;
    const importance_job *job = job_pointer;
    const sf_workspace *ws = job->ws;
    size_t across = ws->stride / SF_TILE,
           from = tile / across * SF_TILE * ws->stride + tile % across * SF_TILE;
    double squares = 0, values = 0;
    for (size_t y = 0; y < SF_TILE; y++)
        for (size_t x = 0; x < SF_TILE; x++) {
            size_t at = from + y * ws->stride + x;
            for (int ch = 0; ch < SF_CHANNELS; ch++)
                squares += (double)ws->d_rgb[ch][at] * (double)ws->d_rgb[ch][at];
            values += SF_CHANNELS * (double)ws->weight[at];
        }
    squares *= job->pixels, values *= job->pixels;
    job->importance->tiles[job->importance->tile_count + tile] = (float)squares;
    if (job->merged) attribute_error(job, tile, squares, (double)job->before[tile], values);
}

/* The squared error of each tile. */
static sf_status measure_tiles(void *job_pointer) {
    importance_job *job = job_pointer;
    sf_importance *w = job->importance;
    const sf_workspace *ws = job->ws;
    size_t tiles = ws->stride / SF_TILE * (ws->plane_rows / SF_TILE);
    if (sf_grow(ws->ctx, &w->tiles, &w->tile_capacity, w->tile_count, w->tile_count + tiles,
                sizeof *w->tiles))
        return SF_ERR_MEMORY;
    if (job->merged && job->before_count < tiles)
        job->merged = NULL; /* views were added: their errors before the merges are unknown */
    if (job->merged) {
        sf_status status = sf_shard_flags(job->ws, job->merged, &job->drawn, &job->drawn_capacity);
        if (status) return status;
    }
    sf_pool_run(ws->ctx->pool, tiles, tile_task, job);
    w->tile_count += tiles;
    if (job->merged) job->before += tiles, job->before_count -= tiles;
    return SF_OK;
}

/* Adds the scores of the SH bands of Gaussian i. The bands above d give it the colour c in this direction,
 * with the exposure gain. Without them the pictures change by sum m w^2 |c|^2; m: pixel weight, w: blend
 * weight; squares: sum m w^2. */
static void add_bands(const importance_job *job, size_t i, double squares) {
    const sf_workspace *ws = job->ws;
    double direction[3], Y[(SF_MAX_SH_DEGREE + 1) * (SF_MAX_SH_DEGREE + 1)], rgb[SF_CHANNELS] = {0},
                                                                             length = 0;
    int degree = ws->sh_degree;
    while (degree > 0 && i >= ws->banded[degree]) degree--;
    for (int k = 0; k < 3; k++) {
        direction[k] = (double)*sf_value(&ws->params, SF_FIELD_mean, i, k) - (double)ws->eye.center[k];
        length += direction[k] * direction[k];
    }
    for (int k = 0; k < 3; k++) direction[k] /= sqrt(length);
    sf_sh_basis(degree, direction, Y);
    for (int band = degree; band > 0; band--) {
        double sum = 0;
        for (int c = 0; c < sf_field_components(SF_FIELD_sh0 + band); c++)
            rgb[c % SF_CHANNELS] +=
                Y[band * band + c / SF_CHANNELS] * (double)*sf_value(&ws->params, SF_FIELD_sh0 + band, i, c);
        for (int ch = 0; ch < SF_CHANNELS; ch++) sum += pow((double)job->gain[ch] * rgb[ch], 2);
        job->importance->bands[i][band - 1] += (float)(squares * sum);
    }
}

static void add_gaussian(const importance_job *job, size_t i) {
    const sf_workspace *ws = job->ws;
    sf_importance *w = job->importance;
    double sums[SF_IMPORTANCE_SUMS] = {0};
    if (ws->state[i] != SF_SEEN || ws->slot[i] == ws->slot[i + 1]) return;
    for (uint32_t slot = ws->slot[i]; slot < ws->slot[i + 1]; slot++)
        for (int k = 0; k < SF_IMPORTANCE_SUMS; k++)
            sums[k] += (double)ws->sums[(size_t)slot * SF_SUMS + (size_t)k];
    w->sse_change[i] += (float)(job->pixels * (sums[4] - 2 * sums[3]));
    w->score[i] += (float)(job->pixels * sums[4]);
    w->error_share[i] += (float)(job->pixels * sums[6]);
    w->blend_weight[i] += (float)(job->pixels * sums[7]);
    if (ws->sh_degree > 0) add_bands(job, i, job->pixels * sums[5]);
    if (!job->merged || !job->merged[i]) return;
    for (uint32_t slot = ws->slot[i]; slot < ws->slot[i + 1]; slot++) {
        const float *attributed = ws->sums + (size_t)slot * SF_SUMS + ATTRIBUTED;
        w->attributed[i].now += attributed[0];
        w->attributed[i].before += attributed[1];
        w->attributed[i].values += attributed[2];
    }
}

static void gather_task(void *job_pointer, size_t task, int thread) {
    (void)thread;
    const importance_job *job = job_pointer;
    size_t count = job->importance->count;
    for (size_t i = task * GATHER; i < (task + 1) * GATHER && i < count; i++) add_gaussian(job, i);
}

static void gain_row(void *job_pointer, size_t row, int thread) {
    (void)thread;
    const importance_job *job = job_pointer;
    for (int ch = 0; ch < SF_CHANNELS; ch++) {
        float *x = job->ws->rgb[ch] + row * job->ws->stride;
        for (size_t i = 0; i < (size_t)job->ws->eye.width; i++) x[i] *= job->gain[ch];
    }
}

static void gain_task(void *job_pointer, size_t task, int thread) {
    (void)thread;
    const importance_job *job = job_pointer;
    const sf_workspace *ws = job->ws;
    for (size_t i = task * GATHER; i < (task + 1) * GATHER && i < ws->count; i++)
        for (int ch = 0; ch < SF_CHANNELS && ws->state[i] == SF_SEEN; ch++)
            ws->splats[i].rgb[ch] *= job->gain[ch];
}

/* The residuals are those of the exposed picture, of which a Gaussian contributes its blend weight times its
 * colour times the gain. So the gain goes into the render and into the colours; no Gaussian contributes to
 * the bias. */
static void apply_exposure(sf_fitter *f, const sf_view_state *state, importance_job *job) {
    sf_workspace *ws = job->ws;
    int exposed = state && f->options.exposure;
    for (int ch = 0; ch < SF_CHANNELS; ch++) job->gain[ch] = exposed ? (float)exp(state->log_gain[ch]) : 1;
    if (!exposed) return;
    sf_expose_swap(&f->exposure, ws);
    sf_pool_run(f->ctx->pool, (size_t)ws->eye.height, gain_row, job);
    sf_pool_run(f->ctx->pool, (ws->count + GATHER - 1) / GATHER, gain_task, job);
}

static sf_status add_view_importance(sf_fitter *f, sf_view_state *state, double pixels, double weight_sum,
                                     void *job_pointer) {
    (void)weight_sum;
    importance_job *job = job_pointer;
    sf_status status = measure_residuals(job, pixels);
    if (!status) apply_exposure(f, state, job);
    if (!status) status = sf_stage_blend_importance(job->ws, measure_tiles, job);
    if (!status) sf_pool_run(f->ctx->pool, (job->importance->count + GATHER - 1) / GATHER, gather_task, job);
    return status;
}

static sf_status add_view_errors(sf_fitter *f, sf_view_state *state, double pixels, double weight_sum,
                                 void *job_pointer) {
    (void)f, (void)state, (void)weight_sum;
    return measure_residuals(job_pointer, pixels);
}

static sf_status sample_at_level(sf_fitter *f, int level, size_t views, sf_sample_fn measure,
                                 importance_job *job, size_t *there) {
    int before = f->level;
    f->level = level;
    sf_status status = sf_sample_views(f, views, 0, measure, job, there);
    f->level = before;
    return status;
}

sf_status sf_measure_errors(sf_fitter *f, int level, size_t views, sf_errors *errors) {
    sf_importance w = {0};
    importance_job job = {.ws = &f->workspace, .importance = &w};
    sf_status status = sample_at_level(f, level, views, add_view_errors, &job, NULL);
    *errors = w.errors;
    return status;
}

static sf_status make_arrays(sf_fitter *f, sf_importance *w) {
    size_t n = f->model->count;
    *w = (sf_importance){.count = n,
                         .sse_change = sf_calloc(f->ctx, n, sizeof *w->sse_change),
                         .score = sf_calloc(f->ctx, n, sizeof *w->score),
                         .error_share = sf_calloc(f->ctx, n, sizeof *w->error_share),
                         .blend_weight = sf_calloc(f->ctx, n, sizeof *w->blend_weight),
                         .bands = sf_calloc(f->ctx, n, sizeof *w->bands)};
    return w->sse_change && w->score && w->error_share && w->blend_weight && w->bands ? SF_OK : SF_ERR_MEMORY;
}

/* Scales the sums up from the measured views to all views. */
static void scale_up(sf_importance *w, double factor) {
    add_errors(&w->errors, &w->errors, factor - 1);
    for (size_t i = 0; i < w->count; i++) {
        w->sse_change[i] *= (float)factor;
        w->score[i] *= (float)factor;
        w->error_share[i] *= (float)factor;
        w->blend_weight[i] *= (float)factor;
        for (int band = 0; band < SF_MAX_SH_DEGREE; band++) w->bands[i][band] *= (float)factor;
        if (!w->attributed) continue;
        w->attributed[i].now *= (float)factor;
        w->attributed[i].before *= (float)factor;
        w->attributed[i].values *= (float)factor;
    }
}

/* Prepares the attribution of errors to the tentatively merged Gaussians. */
static sf_status attribute_to_merged(sf_fitter *f, importance_job *job) {
    const sf_merges *t = &f->merges;
    job->merged = sf_calloc(f->ctx, job->importance->count, 1);
    job->importance->attributed =
        sf_calloc(f->ctx, job->importance->count, sizeof *job->importance->attributed);
    if (!job->merged || !job->importance->attributed) return SF_ERR_MEMORY;
    for (size_t k = 0; k < t->count; k++) job->merged[t->list[k].leader] = 1;
    job->before = t->tiles, job->before_count = t->tile_count;
    return SF_OK;
}

sf_status sf_measure_importance(sf_fitter *f, size_t views, sf_importance *w) {
    importance_job job = {.ws = &f->workspace, .importance = w};
    sf_status status = make_arrays(f, w);
    size_t there = 0;
    if (!status && sf_has_merges(f)) status = attribute_to_merged(f, &job);
    uint8_t *merged = job.merged;
    if (!status) status = sample_at_level(f, 0, views, add_view_importance, &job, &there);
    sf_free(f->ctx, merged);
    sf_free(f->ctx, job.drawn);
    w->whole = !views || views >= there;
    if (!status && w->views && w->views < there) scale_up(w, (double)there / (double)w->views);
    return status;
}

int sf_importance_is_known(const sf_importance *w, size_t i) { return w->blend_weight[i] > 0 || w->whole; }

void sf_importance_free(sf_context *ctx, sf_importance *w) {
    sf_free(ctx, w->sse_change);
    sf_free(ctx, w->score);
    sf_free(ctx, w->error_share);
    sf_free(ctx, w->blend_weight);
    sf_free(ctx, w->bands);
    sf_free(ctx, w->attributed);
    sf_free(ctx, w->tiles);
    memset(w, 0, sizeof *w);
}
