/* worth.c - what each Gaussian, and each band of its spherical harmonics, is worth to the training views.
 *
 * The picture is linear in each Gaussian's opacity at a pixel, and in each colour: what taking one out, or
 * changing its colour, does to the squared error is known without drawing it again (README, Worth).
 */
#include "worth.h"

#include <math.h>
#include <string.h>

#include "../base/pool.h"
#include "grow.h"

enum { GATHER = 1024 /* Gaussians a task */ };

typedef struct weigh_job {
    sf_fitter *fitter;
    sf_worth *worth;
    double *tiles; /* [rows of tiles][3]: squares, weights, squared sums of tiles */
    double scale;  /* values of the full resolution in one of the picture */
} weigh_job;

/* One row of tiles: the residual, times the weight, and the weight itself, 0 beyond the picture. */
static void residual_task(void *job_pointer, size_t row, int thread) {
    (void)thread;
    const weigh_job *job = job_pointer;
    sf_workspace *ws = &job->fitter->workspace;
    double *sums = job->tiles + 3 * row;
    sums[0] = sums[1] = sums[2] = 0;
    for (size_t tile = 0; tile < (size_t)ws->eye.tiles_x; tile++) {
        double sum = 0;
        for (size_t y = row * SF_TILE; y < (row + 1) * SF_TILE; y++)
            for (size_t x = tile * SF_TILE; x < (tile + 1) * SF_TILE; x++) {
                size_t at = y * ws->stride + x;
                int inside = y < (size_t)ws->eye.height && x < (size_t)ws->eye.width;
                float weight = !inside ? 0.0f : ws->has_weight ? ws->weight[at] : 1.0f;
                ws->weight[at] = weight;
                for (int ch = 0; ch < SF_CHANNELS; ch++) {
                    float r = inside ? weight * ws->rgb[ch][at] - ws->target[ch][at] : 0.0f;
                    ws->d_rgb[ch][at] = r;
                    sums[0] += (double)(r * r);
                    sums[1] += (double)weight;
                    sum += (double)r;
                }
            }
        sums[2] += sum * sum;
    }
}

static void gather(const weigh_job *job, size_t i) {
    const sf_workspace *ws = &job->fitter->workspace;
    sf_worth *w = job->worth;
    double sums[SF_WORTH_SUMS] = {0};
    if (ws->state[i] != SF_SEEN || ws->slot[i] == ws->slot[i + 1]) return;
    for (uint32_t slot = ws->slot[i]; slot < ws->slot[i + 1]; slot++)
        for (int k = 0; k < SF_WORTH_SUMS; k++)
            sums[k] += (double)ws->sums[(size_t)slot * SF_SUMS + (size_t)k];
    w->removal[i] += (float)(job->scale * (sums[4] - 2 * sums[3]));
    w->share[i] += (float)(job->scale * sums[6]);
    w->weight[i] += (float)(job->scale * sums[7]);
    w->views[i]++;
}

static void gather_task(void *job_pointer, size_t task, int thread) {
    (void)thread;
    const weigh_job *job = job_pointer;
    size_t first = task * GATHER,
           end = first + GATHER < job->worth->count ? first + GATHER : job->worth->count;
    for (size_t i = first; i < end; i++) gather(job, i);
}

static sf_status look_at(sf_fitter *f, const sf_view *view, weigh_job *job) {
    sf_workspace *ws = &f->workspace;
    sf_view_state *state = sf_view_state_of(&f->views, view->id);
    double weight_sum;
    int level = f->level;
    f->level = sf_level_within(level, view->camera.width, view->camera.height);
    job->scale = (double)(1 << 2 * f->level);
    sf_status status = sf_draw_view(f, view, state, &weight_sum);
    f->level = level;
    if (status) return status == SF_ERR_EMPTY ? SF_OK : status;
    size_t rows = (size_t)ws->eye.tiles_y;
    job->tiles = sf_alloc(f->ctx, rows, 3 * sizeof *job->tiles);
    if (!job->tiles) return SF_ERR_MEMORY;
    sf_pool_run(f->ctx->pool, rows, residual_task, job);
    for (size_t row = 0; row < rows; row++) {
        job->worth->squares += job->scale * job->tiles[3 * row];
        job->worth->values += job->scale * job->tiles[3 * row + 1];
        job->worth->clumping += job->tiles[3 * row + 2];
    }
    sf_free(f->ctx, job->tiles);
    status = sf_stage_blend_worth(ws);
    if (status) return status;
    sf_pool_run(f->ctx->pool, (f->model->count + GATHER - 1) / GATHER, gather_task, job);
    return SF_OK;
}

static sf_status make_arrays(sf_fitter *f, sf_worth *w) {
    size_t n = f->model->count + 1;
    *w = (sf_worth){.count = f->model->count,
                    .removal = sf_calloc(f->ctx, n, sizeof *w->removal),
                    .share = sf_calloc(f->ctx, n, sizeof *w->share),
                    .weight = sf_calloc(f->ctx, n, sizeof *w->weight),
                    .views = sf_calloc(f->ctx, n, sizeof *w->views)};
    return w->removal && w->share && w->weight && w->views ? SF_OK : SF_ERR_MEMORY;
}

sf_status sf_weigh(sf_fitter *f, sf_worth *w) {
    sf_status status = make_arrays(f, w);
    uint32_t *ids;
    size_t n;
    weigh_job job = {.fitter = f, .worth = w};
    if (!status) status = sf_scene_training_ids(f->scene, &ids, &n);
    if (status) return status;
    for (size_t k = 0; k < n && !status; k++) {
        sf_view *view = sf_validates(f, ids[k]) ? NULL : sf_scene_retain_id(f->scene, ids[k]);
        if (!view) continue; /* gone since, or kept out */
        status = look_at(f, view, &job);
        sf_view_release(view);
    }
    sf_free(f->ctx, ids);
    if (w->squares > 0) w->clumping = w->clumping / (w->squares / job.scale);
    return status;
}

void sf_worth_free(sf_context *ctx, sf_worth *w) {
    sf_free(ctx, w->removal);
    sf_free(ctx, w->share);
    sf_free(ctx, w->weight);
    sf_free(ctx, w->views);
    memset(w, 0, sizeof *w);
}
