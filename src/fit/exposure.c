/* exposure.c - a gain and a bias per channel of each training picture. */
#include "exposure.h"

#include <math.h>

#include "../base/pool.h"
#include "../render/shard.h"
#include "adam.h"

sf_status sf_exposure_room(sf_exposure *e, const sf_workspace *ws) {
    if (e->capacity >= ws->plane_capacity) return SF_OK;
    sf_exposure_free(e, ws->ctx);
    for (int ch = 0; ch < SF_CHANNELS; ch++) {
        e->rgb[ch] = sf_calloc(ws->ctx, ws->plane_capacity, sizeof(float));
        if (!e->rgb[ch]) return SF_ERR_MEMORY;
    }
    e->capacity = ws->plane_capacity;
    return SF_OK;
}

void sf_exposure_free(sf_exposure *e, sf_context *ctx) {
    for (int ch = 0; ch < SF_CHANNELS; ch++) sf_free(ctx, e->rgb[ch]);
    *e = (sf_exposure){0};
}

typedef struct expose_job {
    sf_exposure *exposure;
    sf_workspace *ws;
    float gain[SF_CHANNELS], bias[SF_CHANNELS];
} expose_job;

static expose_job make_job(sf_exposure *e, sf_workspace *ws, const sf_view_state *view) {
    expose_job job = {.exposure = e, .ws = ws};
    for (int ch = 0; ch < SF_CHANNELS; ch++) {
        job.gain[ch] = (float)exp(view->log_gain[ch]);
        job.bias[ch] = (float)view->bias[ch];
    }
    return job;
}

void sf_expose_swap(sf_exposure *e, sf_workspace *ws) {
    for (int ch = 0; ch < SF_CHANNELS; ch++) {
        float *kept = ws->rgb[ch];
        ws->rgb[ch] = e->rgb[ch];
        e->rgb[ch] = kept;
    }
}

static void expose_row(void *job_pointer, size_t row, int thread) {
    (void)thread;
    const expose_job *job = job_pointer;
    for (int ch = 0; ch < SF_CHANNELS; ch++) {
        const float *x = job->ws->rgb[ch] + row * job->ws->stride;
        float *y = job->exposure->rgb[ch] + row * job->ws->stride, gain = job->gain[ch], bias = job->bias[ch];
        for (size_t i = 0; i < (size_t)job->ws->eye.width; i++) y[i] = fminf(gain * x[i] + bias, 1.0f);
    }
}

void sf_expose(sf_exposure *e, sf_workspace *ws, const sf_view_state *view) {
    expose_job job = make_job(e, ws, view);
    sf_pool_run(ws->ctx->pool, (size_t)ws->eye.height, expose_row, &job);
    sf_expose_swap(e, ws);
}

/* ws->partial of a row: sums over x of d_y x and of d_y, by channel; sf_stage_loss has made room for six
 * values a row. */
static void expose_bwd_row(void *job_pointer, size_t row, int thread) {
    (void)thread;
    const expose_job *job = job_pointer;
    double *sums = job->ws->partial + 2 * SF_CHANNELS * row;
    for (int ch = 0; ch < SF_CHANNELS; ch++) {
        const float *x = job->ws->rgb[ch] + row * job->ws->stride;
        const float *y = job->exposure->rgb[ch] + row * job->ws->stride;
        float *d = job->ws->d_rgb[ch] + row * job->ws->stride;
        double with_x = 0, alone = 0;
        for (size_t i = 0; i < (size_t)job->ws->eye.width; i++) {
            if (y[i] >= 1 && d[i] < 0) d[i] = 0; /* clamped at white: only a gradient that darkens passes */
            with_x += (double)d[i] * (double)x[i];
            alone += (double)d[i];
            d[i] *= job->gain[ch];
        }
        sums[ch] = with_x;
        sums[SF_CHANNELS + ch] = alone;
    }
}

void sf_expose_bwd(sf_exposure *e, sf_workspace *ws, const sf_view_state *view, double *gradient) {
    expose_job job = make_job(e, ws, view);
    sf_expose_swap(e, ws);
    sf_pool_run(ws->ctx->pool, (size_t)ws->eye.height, expose_bwd_row, &job);
    for (int k = 0; k < 2 * SF_CHANNELS; k++) gradient[k] = 0;
    size_t first, end;
    sf_shard_rows(ws, &first, &end);
    for (size_t i = 2 * SF_CHANNELS * first; i < 2 * SF_CHANNELS * end; i++)
        gradient[i % (2 * SF_CHANNELS)] += ws->partial[i];
    sf_shard_sum(ws, gradient, 2 * SF_CHANNELS);
    for (int ch = 0; ch < SF_CHANNELS; ch++)
        gradient[ch] *= (double)job.gain[ch]; /* with respect to log_gain */
}

static void center(sf_view_states *views) {
    double mean[2 * SF_CHANNELS] = {0}, n = (double)views->count;
    for (size_t i = 0; i < views->count; i++)
        for (int ch = 0; ch < SF_CHANNELS; ch++) {
            mean[ch] += views->states[i].log_gain[ch] / n;
            mean[SF_CHANNELS + ch] += views->states[i].bias[ch] / n;
        }
    for (size_t i = 0; i < views->count; i++)
        for (int ch = 0; ch < SF_CHANNELS; ch++) {
            views->states[i].log_gain[ch] -= mean[ch];
            views->states[i].bias[ch] -= mean[SF_CHANNELS + ch];
        }
}

void sf_exposure_update(sf_view_states *views, sf_view_state *view, const double *gradient,
                        const sf_fit_options *options, double decay) {
    enum { N = SF_CHANNELS };
    double step[2 * N], *m = view->exposure.m, *v = view->exposure.v;
    int64_t t = ++view->exposure.steps;
    sf_adam_small(options, decay * options->lr_gain, t, N, gradient, (sf_small_moments){m, v}, step);
    sf_adam_small(options, decay * options->lr_bias, t, N, gradient + N, (sf_small_moments){m + N, v + N},
                  step + N);
    for (int ch = 0; ch < SF_CHANNELS; ch++) {
        view->log_gain[ch] -= step[ch];
        view->bias[ch] -= step[SF_CHANNELS + ch];
    }
    center(views);
}
