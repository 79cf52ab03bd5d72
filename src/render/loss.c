/* loss.c - L1 + SSIM of a picture, its gradient, and the figures of merit. */
#include "workspace.h"

#include <math.h>

#include "../base/pool.h"

_Static_assert((int)SF_LOSS_BAND == (int)SF_TILE, "a band of the loss is a row of tiles");

typedef struct loss_job {
    sf_workspace *ws;
    float l1_scale, ssim_scale;
    int with_ssim;
} loss_job;

static sf_loss_args band_args(const loss_job *job, size_t task, int thread) {
    sf_workspace *ws = job->ws;
    size_t bands = (size_t)ws->eye.tiles_y, ch = task / bands;
    int first = (int)(task % bands) * SF_LOSS_BAND;
    sf_loss_args args = {.x = ws->has_weight ? ws->weighted[ch] : ws->rgb[ch],
                         .y = ws->target[ch],
                         .width = ws->eye.width,
                         .height = ws->eye.height,
                         .stride = ws->stride,
                         .first_row = first,
                         .end_row =
                             first + SF_LOSS_BAND < ws->eye.height ? first + SF_LOSS_BAND : ws->eye.height,
                         .scratch = ws->scratch + (size_t)thread * SF_LOSS_SCRATCH_ROWS * ws->stride,
                         .l1 = &ws->partial[2 * task],
                         .ssim = job->with_ssim ? &ws->partial[2 * task + 1] : NULL,
                         .l1_scale = job->l1_scale,
                         .ssim_scale = job->ssim_scale,
                         .d_x = ws->d_rgb[ch]};
    for (int k = 0; k < 3; k++) args.map[k] = ws->map[ch][k];
    return args;
}

static void weigh_rows(const sf_workspace *ws, float *to, const float *from, int first, int end) {
    for (size_t at = (size_t)first * ws->stride; at < (size_t)end * ws->stride; at++)
        to[at] = from[at] * ws->weight[at];
}

static void weigh_task(void *job_pointer, size_t task, int thread) {
    const loss_job *job = job_pointer;
    sf_loss_args args = band_args(job, task, thread);
    size_t ch = task / (size_t)job->ws->eye.tiles_y;
    weigh_rows(job->ws, job->ws->weighted[ch], job->ws->rgb[ch], args.first_row, args.end_row);
}

static void loss_task(void *job_pointer, size_t task, int thread) {
    const loss_job *job = job_pointer;
    sf_loss_args args = band_args(job, task, thread);
    job->ws->partial[2 * task] = job->ws->partial[2 * task + 1] = 0;
    job->ws->ctx->kernels->loss(&args);
}

static void loss_bwd_task(void *job_pointer, size_t task, int thread) {
    const loss_job *job = job_pointer;
    sf_loss_args args = band_args(job, task, thread);
    job->ws->ctx->kernels->loss_bwd(&args);
    if (job->ws->has_weight) weigh_rows(job->ws, args.d_x, args.d_x, args.first_row, args.end_row);
}

/* d_rgb must be 0 wherever a tile reaches beyond the picture. */
static void clear_beyond(const sf_workspace *ws) {
    for (int ch = 0; ch < SF_CHANNELS; ch++)
        for (size_t y = 0; y < ws->plane_rows; y++)
            for (size_t x = y < (size_t)ws->eye.height ? (size_t)ws->eye.width : 0; x < ws->stride; x++)
                ws->d_rgb[ch][y * ws->stride + x] = 0;
}

void sf_stage_loss(sf_workspace *ws, double lambda, double weight_sum, int with_ssim, int with_gradient,
                   sf_loss_value *value) {
    double scale = 1.0 / (3.0 * weight_sum);
    loss_job job = {.ws = ws,
                    .l1_scale = (float)((1 - lambda) * scale),
                    .ssim_scale = (float)(-lambda * scale),
                    .with_ssim = with_ssim || lambda > 0};
    size_t tasks = SF_CHANNELS * (size_t)ws->eye.tiles_y;
    if (ws->has_weight) sf_pool_run(ws->ctx->pool, tasks, weigh_task, &job);
    sf_pool_run(ws->ctx->pool, tasks, loss_task, &job);
    double l1 = 0, ssim = 0;
    for (size_t t = 0; t < tasks; t++) {
        l1 += ws->partial[2 * t];
        ssim += ws->partial[2 * t + 1];
    }
    value->l1 = l1 * scale;
    /* Where the weight is 0 both pictures are 0 and S is 1: the sum is made of 1 - S, to which such windows
     * add nothing. */
    double all = 3.0 * ws->eye.width * ws->eye.height;
    value->ssim = job.with_ssim ? 1.0 - (all - ssim) * scale : 0.0;
    value->loss = (1 - lambda) * value->l1 + lambda * (1 - value->ssim);
    if (!with_gradient) return;
    sf_pool_run(ws->ctx->pool, tasks, loss_bwd_task, &job);
    clear_beyond(ws);
}
