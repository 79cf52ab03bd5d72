/* loss.c - L1 (or Huber) + SSIM of a picture, and its gradient. */
#include "workspace.h"

#include <string.h>

#include "../base/pool.h"
#include "shard.h"

/* Tasks of a channel: enough to keep many threads busy on a small picture. Bands of fewer rows than
 * LEAST_BAND would spend more time on the rows around them. */
enum { LEAST_BAND = 24 };

typedef struct loss_job {
    sf_workspace *ws;
    float delta, l1_scale, ssim_scale;
    int with_ssim, with_gradient;
    int band, bands;        /* rows of a task; tasks of a channel */
    int first_row, end_row; /* of all */
} loss_job;

static void loss_task(void *job_pointer, size_t task, int thread) {
    const loss_job *job = job_pointer;
    sf_workspace *ws = job->ws;
    size_t ch = task / (size_t)job->bands, height = (size_t)ws->eye.height;
    int first = job->first_row + (int)(task % (size_t)job->bands) * job->band, end = first + job->band;
    double *row_sums = ws->partial + 2 * ch * height + (size_t)first;
    sf_loss_args args = {.x = ws->rgb[ch],
                         .y = ws->target[ch],
                         .weight = ws->has_weight ? ws->weight : NULL,
                         .width = ws->eye.width,
                         .height = ws->eye.height,
                         .stride = ws->stride,
                         .first_row = first,
                         .end_row = end < job->end_row ? end : job->end_row,
                         .scratch = ws->scratch + (size_t)thread * sf_loss_scratch(ws->stride),
                         .delta = job->delta,
                         .l1 = row_sums,
                         .ssim = job->with_ssim ? row_sums + height : NULL,
                         .l1_scale = job->l1_scale,
                         .ssim_scale = job->ssim_scale,
                         .d_x = job->with_gradient ? ws->d_rgb[ch] : NULL};
    ws->ctx->kernels->loss(&args);
}

/* Clears d_rgb in the rows of tiles beyond the picture; the kernel clears the columns. */
static void clear_below(const sf_workspace *ws) {
    size_t from = (size_t)ws->eye.height * ws->stride, end = ws->plane_rows * ws->stride;
    for (int ch = 0; ch < SF_CHANNELS; ch++) memset(ws->d_rgb[ch] + from, 0, (end - from) * sizeof(float));
}

void sf_stage_loss(sf_workspace *ws, double lambda, double delta, double weight_sum, int with_ssim,
                   int with_gradient, sf_loss_value *value) {
    double scale = 1.0 / (3.0 * weight_sum);
    size_t height = (size_t)ws->eye.height, first_row, end_row;
    sf_shard_rows(ws, &first_row, &end_row);
    int rows = (int)(end_row - first_row);
    /* sums are stored by row, since the number of bands may depend on the number of threads */
    int threads = sf_pool_threads(ws->ctx->pool), per_channel = threads < 2 ? 1 : (4 * threads + 2) / 3;
    loss_job job = {.ws = ws,
                    .delta = (float)delta,
                    .l1_scale = (float)((1 - lambda) * scale),
                    .ssim_scale = (float)(-lambda * scale),
                    .with_ssim = with_ssim || lambda > 0,
                    .with_gradient = with_gradient,
                    .first_row = (int)first_row,
                    .end_row = (int)end_row};
    job.band = (rows + per_channel - 1) / per_channel;
    if (job.band < LEAST_BAND) job.band = LEAST_BAND;
    job.bands = (rows + job.band - 1) / job.band;
    sf_pool_run(ws->ctx->pool, SF_CHANNELS * (size_t)job.bands, loss_task, &job);
    double total[2] = {0}; /* L1 and SSIM */
    for (size_t row = 0; row < SF_CHANNELS * height; row++) {
        if (row % height < first_row || row % height >= end_row) continue;
        const double *sums = ws->partial + row / height * 2 * height + row % height;
        total[0] += sums[0];
        if (job.with_ssim) total[1] += sums[height];
    }
    sf_shard_sum(ws, total, 2);
    value->l1 = total[0] * scale;
    /* Where the weight is 0 both pictures are 0 and S is 1. So the sum is of 1 - S, to which such windows add
     * nothing. */
    double all = 3.0 * ws->eye.width * ws->eye.height;
    value->ssim = job.with_ssim ? 1.0 - (all - total[1]) * scale : 0.0;
    value->loss = (1 - lambda) * value->l1 + lambda * (1 - value->ssim);
    if (with_gradient) clear_below(ws);
}
