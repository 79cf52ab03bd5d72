/* select_importance.c - what each Gaussian is worth to the training views.
 *
 * A pixel is linear in the opacity that each Gaussian has there: what taking one out does to the squared
 * error is known without drawing it again (README, Size).
 */
#include "select_importance.h"

#include <math.h>
#include <string.h>

#include "../base/pool.h"
#include "../base/statistics.h"
#include "../kernels/sh.h"
#include "sample_views.h"

enum {
    GATHER = 1024,             /* Gaussians a task */
    BLAME = SF_IMPORTANCE_SUMS /* a slot's sums from here on: its sf_attributed_error */
};

/* Variance below which what is drawn tells nothing of a gain; part of the squared errors that is rounding. */
#define LEAST_SPREAD 1e-6

/* Of one channel, render x and picture y, by weight: what the line of least squares through them is made of,
 * and the line, y = gain x + bias. */
typedef struct tone {
    sf_line_sums sums;
    double gain, bias;
} tone;

/* Of a row of tiles. */
typedef struct band_sums {
    sf_errors errors;
    tone tones[SF_CHANNELS];
} band_sums;

typedef struct weigh_job {
    sf_workspace *ws;
    sf_importance *worth;
    band_sums *bands;
    tone tones[SF_CHANNELS]; /* of the picture */
    float gain[SF_CHANNELS]; /* what the exposure makes of a Gaussian's part */
    double pixels;           /* of the full resolution in one of the picture */
    uint8_t *tried;          /* [count] whether it stands for a pair on trial; NULL: none does */
    const float *before;     /* squared errors of the tiles of the views to come; there are so many */
    size_t before_count;
} weigh_job;

/* The residuals of a row of pixels, times the weight, and the weight itself, 0 beyond the picture. */
static void residual_row(sf_workspace *ws, size_t row, band_sums *sums) {
    size_t from = row * ws->stride, width = row < (size_t)ws->eye.height ? (size_t)ws->eye.width : 0;
    for (size_t x = 0; x < ws->stride; x++) {
        size_t at = from + x;
        float weight = x >= width ? 0.0f : ws->has_weight ? ws->weight[at] : 1.0f;
        ws->weight[at] = weight;
        sums->errors.values += (double)(SF_CHANNELS * weight);
        for (int ch = 0; ch < SF_CHANNELS; ch++) {
            sf_line_sums *t = &sums->tones[ch].sums;
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
    const weigh_job *job = job_pointer;
    band_sums *sums = &job->bands[band];
    for (size_t y = 0; y < SF_TILE; y++) residual_row(job->ws, SF_TILE * band + y, sums);
}

static void find_tone(tone *t, const band_sums *bands, size_t count, int channel) {
    *t = (tone){0};
    sf_line_sums *s = &t->sums;
    for (size_t band = 0; band < count; band++) {
        const sf_line_sums *part = &bands[band].tones[channel].sums;
        s->w += part->w, s->x += part->x, s->y += part->y, s->xx += part->xx, s->xy += part->xy;
    }
    sf_line_fit(s, LEAST_SPREAD * s->w * s->w, &t->gain, &t->bias);
}

/* A tile's residuals with the tone of the picture. */
static void add_toned(const weigh_job *job, int channel, size_t from, sf_errors *errors) {
    const sf_workspace *ws = job->ws;
    const tone *t = &job->tones[channel];
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

static void toned_task(void *job_pointer, size_t band, int thread) {
    (void)thread;
    const weigh_job *job = job_pointer;
    for (size_t x = 0; x < job->ws->stride; x += SF_TILE)
        for (int ch = 0; ch < SF_CHANNELS; ch++)
            add_toned(job, ch, SF_TILE * band * job->ws->stride + x, &job->bands[band].errors);
}

static void add_errors(sf_errors *to, const sf_errors *more, double factor) {
    to->squares += factor * more->squares;
    to->corrected += factor * more->corrected;
    to->tile_energy += factor * more->tile_energy;
    to->values += factor * more->values;
}

double sf_correlation_area(const sf_errors *errors) {
    double most = SF_TILE * SF_TILE; /* also where nothing is left */
    return errors->corrected > LEAST_SPREAD * errors->squares
               ? fmin(fmax(errors->tile_energy / errors->corrected, 1), most)
               : most;
}

/* Of the picture that was drawn last. */
static sf_status residual(weigh_job *job, double pixels) {
    size_t bands = job->ws->plane_rows / SF_TILE;
    job->pixels = pixels;
    job->bands = sf_calloc(job->ws->ctx, bands, sizeof *job->bands);
    if (!job->bands) return SF_ERR_MEMORY;
    sf_pool_run(job->ws->ctx->pool, bands, residual_task, job);
    for (int ch = 0; ch < SF_CHANNELS; ch++) find_tone(&job->tones[ch], job->bands, bands, ch);
    sf_pool_run(job->ws->ctx->pool, bands, toned_task, job);
    for (size_t band = 0; band < bands; band++)
        add_errors(&job->worth->errors, &job->bands[band].errors, pixels);
    sf_free(job->ws->ctx, job->bands);
    job->worth->views++;
    return SF_OK;
}

static double slot_part(const weigh_job *job, uint32_t entry) {
    const sf_workspace *ws = job->ws;
    if (!job->tried[ws->entries[entry]]) return 0;
    return (double)ws->sums[(size_t)ws->entry_slots[entry] * SF_SUMS + 7];
}

/* What happened in a tile to the slots of those on trial. */
static void blame_slots(const weigh_job *job, size_t tile, double now, double before, double values) {
    const sf_workspace *ws = job->ws;
    double all = 0;
    for (uint32_t e = ws->tile_begin[tile]; e < ws->tile_begin[tile + 1]; e++) all += slot_part(job, e);
    for (uint32_t e = ws->tile_begin[tile]; e < ws->tile_begin[tile + 1]; e++) {
        float *sums = ws->sums + (size_t)ws->entry_slots[e] * SF_SUMS + BLAME;
        double part = all > 0 ? slot_part(job, e) / all : 0;
        sums[0] = (float)(part * now);
        sums[1] = (float)(part * before);
        sums[2] = (float)(part * values);
    }
}

static void tile_task(void *job_pointer, size_t tile, int thread) {
    (void)thread;
    const weigh_job *job = job_pointer;
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
    job->worth->tiles[job->worth->tile_count + tile] = (float)squares;
    if (job->tried) blame_slots(job, tile, squares, (double)job->before[tile], values);
}

/* The squared error of each tile. */
static sf_status weigh_tiles(weigh_job *job) {
    sf_importance *w = job->worth;
    const sf_workspace *ws = job->ws;
    size_t tiles = ws->stride / SF_TILE * (ws->plane_rows / SF_TILE);
    if (sf_grow(ws->ctx, &w->tiles, &w->tile_capacity, w->tile_count, w->tile_count + tiles,
                sizeof *w->tiles))
        return SF_ERR_MEMORY;
    if (job->tried && job->before_count < tiles)
        job->tried = NULL; /* views came: there is nothing to compare with */
    sf_pool_run(ws->ctx->pool, tiles, tile_task, job);
    w->tile_count += tiles;
    if (job->tried) job->before += tiles, job->before_count -= tiles;
    return SF_OK;
}

/* Where each pixel has the part w of a Gaussian of which the bands above d make the colour c in this
 * direction, as the picture is exposed, they make sum m w^2 |c|^2; squares: sum m w^2. */
static void weigh_bands(const weigh_job *job, size_t i, double squares) {
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
        job->worth->bands[i][band - 1] += (float)(squares * sum);
    }
}

static void weigh_in(const weigh_job *job, size_t i) {
    const sf_workspace *ws = job->ws;
    sf_importance *w = job->worth;
    double sums[SF_IMPORTANCE_SUMS] = {0};
    if (ws->state[i] != SF_SEEN || ws->slot[i] == ws->slot[i + 1]) return;
    for (uint32_t slot = ws->slot[i]; slot < ws->slot[i + 1]; slot++)
        for (int k = 0; k < SF_IMPORTANCE_SUMS; k++)
            sums[k] += (double)ws->sums[(size_t)slot * SF_SUMS + (size_t)k];
    w->sse_change[i] += (float)(job->pixels * (sums[4] - 2 * sums[3]));
    w->score[i] += (float)(job->pixels * sums[4]);
    w->error_share[i] += (float)(job->pixels * sums[6]);
    w->blend_weight[i] += (float)(job->pixels * sums[7]);
    if (ws->sh_degree > 0) weigh_bands(job, i, job->pixels * sums[5]);
    if (!job->tried || !job->tried[i]) return;
    for (uint32_t slot = ws->slot[i]; slot < ws->slot[i + 1]; slot++) {
        const float *blame = ws->sums + (size_t)slot * SF_SUMS + BLAME;
        w->attributed[i].now += blame[0];
        w->attributed[i].before += blame[1];
        w->attributed[i].values += blame[2];
    }
}

static void gather_task(void *job_pointer, size_t task, int thread) {
    (void)thread;
    const weigh_job *job = job_pointer;
    size_t count = job->worth->count;
    for (size_t i = task * GATHER; i < (task + 1) * GATHER && i < count; i++) weigh_in(job, i);
}

static void gain_row(void *job_pointer, size_t row, int thread) {
    (void)thread;
    const weigh_job *job = job_pointer;
    for (int ch = 0; ch < SF_CHANNELS; ch++) {
        float *x = job->ws->rgb[ch] + row * job->ws->stride;
        for (size_t i = 0; i < (size_t)job->ws->eye.width; i++) x[i] *= job->gain[ch];
    }
}

static void gain_task(void *job_pointer, size_t task, int thread) {
    (void)thread;
    const weigh_job *job = job_pointer;
    const sf_workspace *ws = job->ws;
    for (size_t i = task * GATHER; i < (task + 1) * GATHER && i < ws->count; i++)
        for (int ch = 0; ch < SF_CHANNELS && ws->state[i] == SF_SEEN; ch++)
            ws->splats[i].rgb[ch] *= job->gain[ch];
}

/* The residuals are those of the exposed picture. Of that a Gaussian's part is what the render has of it
 * times the gain, so the render and the Gaussians' colours come back with the gain in them, without the bias,
 * which no Gaussian has a part in. */
static void take_exposure(sf_fitter *f, const sf_view_state *state, weigh_job *job) {
    sf_workspace *ws = job->ws;
    int exposed = state && f->options.exposure;
    for (int ch = 0; ch < SF_CHANNELS; ch++) job->gain[ch] = exposed ? (float)exp(state->log_gain[ch]) : 1;
    if (!exposed) return;
    sf_expose_swap(&f->exposure, ws);
    sf_pool_run(f->ctx->pool, (size_t)ws->eye.height, gain_row, job);
    sf_pool_run(f->ctx->pool, (ws->count + GATHER - 1) / GATHER, gain_task, job);
}

static sf_status look_at(sf_fitter *f, sf_view_state *state, double pixels, double weight_sum,
                         void *job_pointer) {
    (void)weight_sum;
    weigh_job *job = job_pointer;
    sf_status status = residual(job, pixels);
    if (!status) take_exposure(f, state, job);
    if (!status) status = sf_stage_blend_importance(job->ws);
    if (!status) status = weigh_tiles(job);
    if (!status) sf_pool_run(f->ctx->pool, (job->worth->count + GATHER - 1) / GATHER, gather_task, job);
    return status;
}

static sf_status glance_at(sf_fitter *f, sf_view_state *state, double pixels, double weight_sum,
                           void *job_pointer) {
    (void)f, (void)state, (void)weight_sum;
    return residual(job_pointer, pixels);
}

static sf_status look_at_level(sf_fitter *f, int level, size_t views, sf_sample_fn look, weigh_job *job,
                               size_t *there) {
    int before = f->level;
    f->level = level;
    sf_status status = sf_sample_views(f, views, 0, look, job, there);
    f->level = before;
    return status;
}

sf_status sf_measure_errors(sf_fitter *f, int level, size_t views, sf_errors *errors) {
    sf_importance w = {0};
    weigh_job job = {.ws = &f->workspace, .worth = &w};
    sf_status status = look_at_level(f, level, views, glance_at, &job, NULL);
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

/* To as many views as are trained on. */
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

/* Marks those that stand for pairs on trial. */
static sf_status watch_trials(sf_fitter *f, weigh_job *job) {
    const sf_merges *t = &f->merges;
    job->tried = sf_calloc(f->ctx, job->worth->count, 1);
    job->worth->attributed = sf_calloc(f->ctx, job->worth->count, sizeof *job->worth->attributed);
    if (!job->tried || !job->worth->attributed) return SF_ERR_MEMORY;
    for (size_t k = 0; k < t->count; k++) job->tried[t->list[k].leader] = 1;
    job->before = t->tiles, job->before_count = t->tile_count;
    return SF_OK;
}

sf_status sf_measure_importance(sf_fitter *f, size_t views, sf_importance *w) {
    weigh_job job = {.ws = &f->workspace, .worth = w};
    sf_status status = make_arrays(f, w);
    size_t there = 0;
    if (!status && f->merges.count) status = watch_trials(f, &job);
    uint8_t *tried = job.tried;
    if (!status) status = look_at_level(f, 0, views, look_at, &job, &there);
    sf_free(f->ctx, tried);
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
