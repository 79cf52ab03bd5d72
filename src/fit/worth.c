/* worth.c - what each Gaussian is worth to the training views.
 *
 * A pixel is linear in the opacity that each Gaussian has there: what taking one out does to the squared
 * error is known without drawing it again (README, Size).
 */
#include "worth.h"

#include <string.h>

#include "../base/pool.h"

enum { GATHER = 1024 /* Gaussians a task */ };

typedef struct weigh_job {
    sf_workspace *ws;
    sf_worth *worth;
    double *sums;  /* [rows of the picture][2]: squares, weights */
    double pixels; /* of the full resolution in one of the picture */
} weigh_job;

/* The residual, times the weight, and the weight itself, 0 beyond the picture. */
static void residual_task(void *job_pointer, size_t row, int thread) {
    (void)thread;
    const weigh_job *job = job_pointer;
    sf_workspace *ws = job->ws;
    size_t from = row * ws->stride, width = row < (size_t)ws->eye.height ? (size_t)ws->eye.width : 0;
    double squares = 0, weights = 0;
    for (size_t x = 0; x < ws->stride; x++) {
        size_t at = from + x;
        float weight = x >= width ? 0.0f : ws->has_weight ? ws->weight[at] : 1.0f;
        ws->weight[at] = weight;
        weights += (double)weight;
        for (int ch = 0; ch < SF_CHANNELS; ch++) {
            float r = x < width ? weight * ws->rgb[ch][at] - ws->target[ch][at] : 0.0f;
            ws->d_rgb[ch][at] = r;
            squares += (double)r * (double)r;
        }
    }
    job->sums[2 * row] = squares;
    job->sums[2 * row + 1] = weights;
}

/* Of the picture that was drawn last. */
static sf_status residual(weigh_job *job, double pixels) {
    size_t rows = job->ws->plane_rows;
    job->pixels = pixels;
    job->sums = sf_alloc(job->ws->ctx, rows, 2 * sizeof *job->sums);
    if (!job->sums) return SF_ERR_MEMORY;
    sf_pool_run(job->ws->ctx->pool, rows, residual_task, job);
    for (size_t row = 0; row < rows; row++) {
        job->worth->squares += pixels * job->sums[2 * row];
        job->worth->values += pixels * SF_CHANNELS * job->sums[2 * row + 1];
    }
    sf_free(job->ws->ctx, job->sums);
    job->worth->views++;
    return SF_OK;
}

static void weigh_in(const weigh_job *job, size_t i) {
    const sf_workspace *ws = job->ws;
    sf_worth *w = job->worth;
    double sums[SF_WORTH_SUMS] = {0};
    if (ws->state[i] != SF_SEEN || ws->slot[i] == ws->slot[i + 1]) return;
    for (uint32_t slot = ws->slot[i]; slot < ws->slot[i + 1]; slot++)
        for (int k = 0; k < SF_WORTH_SUMS; k++)
            sums[k] += (double)ws->sums[(size_t)slot * SF_SUMS + (size_t)k];
    w->removal[i] += (float)(job->pixels * (sums[4] - 2 * sums[3]));
    w->effect[i] += (float)(job->pixels * sums[4]);
    w->share[i] += (float)(job->pixels * sums[6]);
}

static void gather_task(void *job_pointer, size_t task, int thread) {
    (void)thread;
    const weigh_job *job = job_pointer;
    size_t count = job->worth->count;
    for (size_t i = task * GATHER; i < (task + 1) * GATHER && i < count; i++) weigh_in(job, i);
}

static sf_status look_at(sf_fitter *f, sf_view_state *state, double pixels, void *job_pointer) {
    (void)state;
    weigh_job *job = job_pointer;
    sf_status status = residual(job, pixels);
    if (!status) status = sf_stage_blend_worth(job->ws);
    if (!status) sf_pool_run(f->ctx->pool, (job->worth->count + GATHER - 1) / GATHER, gather_task, job);
    return status;
}

static sf_status glance_at(sf_fitter *f, sf_view_state *state, double pixels, void *job_pointer) {
    (void)f, (void)state;
    return residual(job_pointer, pixels);
}

sf_status sf_look_for_squares(sf_fitter *f, size_t views, double *squares) {
    sf_worth w = {0};
    weigh_job job = {.ws = &f->workspace, .worth = &w};
    sf_status status = sf_look_at_views(f, views, 0, glance_at, &job, NULL);
    *squares = w.squares;
    return status;
}

static sf_status make_arrays(sf_fitter *f, sf_worth *w) {
    size_t n = f->model->count;
    *w = (sf_worth){.count = n,
                    .removal = sf_calloc(f->ctx, n, sizeof *w->removal),
                    .effect = sf_calloc(f->ctx, n, sizeof *w->effect),
                    .share = sf_calloc(f->ctx, n, sizeof *w->share)};
    return w->removal && w->effect && w->share ? SF_OK : SF_ERR_MEMORY;
}

/* To as many views as are trained on. */
static void scale_up(sf_worth *w, double factor) {
    w->squares *= factor;
    w->values *= factor;
    for (size_t i = 0; i < w->count; i++) {
        w->removal[i] *= (float)factor;
        w->effect[i] *= (float)factor;
        w->share[i] *= (float)factor;
    }
}

sf_status sf_weigh(sf_fitter *f, size_t views, sf_worth *w) {
    weigh_job job = {.ws = &f->workspace, .worth = w};
    sf_status status = make_arrays(f, w);
    size_t there = 0;
    if (!status) status = sf_look_at_views(f, views, 0, look_at, &job, &there);
    if (!status && views && views < there) scale_up(w, (double)there / (double)views);
    return status;
}

void sf_worth_free(sf_context *ctx, sf_worth *w) {
    sf_free(ctx, w->removal);
    sf_free(ctx, w->effect);
    sf_free(ctx, w->share);
    memset(w, 0, sizeof *w);
}
