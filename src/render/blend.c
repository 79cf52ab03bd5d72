/* blend.c - blends every tile, front to back; and its gradient: the sums of each pair of Gaussian and tile.
 */
#include "workspace.h"

#include "../base/pool.h"
#include "shard.h"

typedef struct blend_job {
    sf_workspace *ws;
    size_t first; /* tile */
    int with_depth;
} blend_job;

static sf_blend_args tile_args(const sf_workspace *ws, size_t tile) {
    size_t tiles_x = (size_t)ws->eye.tiles_x, x0 = tile % tiles_x * SF_TILE, y0 = tile / tiles_x * SF_TILE;
    size_t at = y0 * ws->stride + x0;
    uint32_t begin = ws->tile_begin[tile];
    sf_blend_args args = {.splats = ws->splats,
                          .entries = ws->entries + begin,
                          .slots = ws->entry_slots + begin,
                          .count = ws->tile_begin[tile + 1] - begin,
                          .x0 = (int)x0,
                          .y0 = (int)y0,
                          .stride = ws->stride,
                          .transmittance = ws->transmittance + at,
                          .last = ws->last + tile * SF_TILE_PIXELS,
                          .parts = ws->entry_parts + begin,
                          .weight = ws->weight ? ws->weight + at : NULL,
                          .sums = ws->sums};
    for (int ch = 0; ch < SF_CHANNELS; ch++) {
        args.background[ch] = ws->background[ch];
        args.rgb[ch] = ws->rgb[ch] + at;
        args.d_rgb[ch] = ws->d_rgb[ch] + at;
    }
    return args;
}

static void blend_task(void *job_pointer, size_t task, int thread) {
    (void)thread;
    const blend_job *job = job_pointer;
    sf_blend_args args = tile_args(job->ws, job->first + task);
    if (job->with_depth) args.depth = job->ws->depth + (args.transmittance - job->ws->transmittance);
    job->ws->ctx->kernels->blend(&args);
}

/* A task for each tile that this rank draws. */
static void run_tiles(sf_workspace *ws, int with_depth, sf_task_fn task) {
    size_t first, end, tiles_x = (size_t)ws->eye.tiles_x;
    sf_shard_tile_rows(ws, &first, &end);
    blend_job job = {ws, first * tiles_x, with_depth};
    sf_pool_run(ws->ctx->pool, (end - first) * tiles_x, task, &job);
}

void sf_stage_blend(sf_workspace *ws, const float background[3], int with_depth) {
    for (int ch = 0; ch < SF_CHANNELS; ch++) ws->background[ch] = background[ch];
    run_tiles(ws, with_depth, blend_task);
    sf_shard_picture(ws, with_depth);
}

static void blend_bwd_task(void *job_pointer, size_t task, int thread) {
    (void)thread;
    const blend_job *job = job_pointer;
    sf_blend_args args = tile_args(job->ws, job->first + task);
    job->ws->ctx->kernels->blend_bwd(&args);
}

static void blend_importance_task(void *job_pointer, size_t task, int thread) {
    (void)thread;
    const blend_job *job = job_pointer;
    sf_blend_args args = tile_args(job->ws, job->first + task);
    job->ws->ctx->kernels->blend_importance(&args);
}

/* A task for each tile, which fills the sums of its slots. */
static sf_status fill_slots(sf_workspace *ws, sf_task_fn task, sf_status (*filled)(void *), void *user) {
    size_t slots = ws->slot[ws->count];
    sf_status status = sf_grow(ws->ctx, &ws->sums, &ws->sums_capacity, 0, slots, SF_SUMS * sizeof(float));
    if (status) return status;
    run_tiles(ws, 0, task);
    status = filled ? filled(user) : SF_OK;
    return status ? status : sf_shard_return(ws);
}

sf_status sf_stage_blend_bwd(sf_workspace *ws) { return fill_slots(ws, blend_bwd_task, NULL, NULL); }
sf_status sf_stage_blend_importance(sf_workspace *ws, sf_status (*filled)(void *), void *user) {
    return fill_slots(ws, blend_importance_task, filled, user);
}

static void background_task(void *ws_pointer, size_t task, int thread) {
    (void)thread;
    sf_workspace *ws = ws_pointer;
    size_t row, end;
    sf_shard_rows(ws, &row, &end);
    row += task;
    double *sums = ws->partial + SF_CHANNELS * row;
    for (int ch = 0; ch < SF_CHANNELS; ch++) {
        const float *T = ws->transmittance + row * ws->stride, *d = ws->d_rgb[ch] + row * ws->stride;
        sums[ch] = 0;
        for (int x = 0; x < ws->eye.width; x++) sums[ch] += (double)T[x] * (double)d[x];
    }
}

sf_status sf_stage_background_bwd(sf_workspace *ws, double *d_background) {
    size_t rows = (size_t)ws->eye.height;
    sf_status status =
        sf_grow(ws->ctx, &ws->partial, &ws->partial_capacity, 0, SF_CHANNELS * rows, sizeof(double));
    if (status) return status;
    size_t first, end;
    sf_shard_rows(ws, &first, &end);
    sf_pool_run(ws->ctx->pool, end - first, background_task, ws);
    for (int ch = 0; ch < SF_CHANNELS; ch++) {
        d_background[ch] = 0;
        for (size_t row = first; row < end; row++)
            d_background[ch] += ws->partial[SF_CHANNELS * row + (size_t)ch];
    }
    sf_shard_sum(ws, d_background, SF_CHANNELS);
    return SF_OK;
}
