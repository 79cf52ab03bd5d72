/* densify_score.c - densification by error: each Gaussian's share of the error of several training views.
 *
 * The backward pass of blending sums w d_rgb over the pixels of a Gaussian; w: its blend weight. With the
 * error in place of d_rgb this is the Gaussian's error share; with 1 it is its blend weight.
 */
#include "densify_score.h"

#include <math.h>
#include <string.h>

#include "../base/pool.h"
#include "sample_views.h"

enum {
    GATHER = 1024,  /* Gaussians a task */
    LEAST_VIEWS = 2 /* in which a Gaussian must have an error to get a score, and be visible to be removed */
};

/* A Gaussian of less blend weight than this in all views together, px, is removed. */
#define LEAST_WEIGHT 0.05f

/* Sums of one Gaussian. */
typedef struct error_share {
    double log_sum; /* sum over the views of the logarithm of its error share, px */
    float weight;   /* blend weight, sum over the views, px */
    uint16_t with_error, visible;
} error_share;

typedef struct gather_job {
    const sf_workspace *ws;
    error_share *error_shares;
    float pixel;  /* pixels of the full resolution in one pixel of the render */
    size_t views; /* measured */
} gather_job;

/* Writes the mean absolute error of the channels to d_rgb[0], 1 to d_rgb[1]; 0 beyond the picture. */
static void error_row(void *ws_pointer, size_t row, int thread) {
    (void)thread;
    const sf_workspace *ws = ws_pointer;
    size_t from = row * ws->stride, width = row < (size_t)ws->eye.height ? (size_t)ws->eye.width : 0;
    float *error = ws->d_rgb[0] + from, *one = ws->d_rgb[1] + from;
    for (int ch = 0; ch < SF_CHANNELS; ch++) memset(ws->d_rgb[ch] + from, 0, ws->stride * sizeof(float));
    for (size_t x = 0; x < width; x++) {
        float weight = ws->has_weight ? ws->weight[from + x] : 1.0f, sum = 0;
        for (int ch = 0; ch < SF_CHANNELS; ch++)
            sum += fminf(fabsf(weight * ws->rgb[ch][from + x] - ws->target[ch][from + x]), 1.0f);
        error[x] = sum / SF_CHANNELS;
        one[x] = 1;
    }
}

static void gather_task(void *job_pointer, size_t task, int thread) {
    (void)thread;
    const gather_job *job = job_pointer;
    const sf_workspace *ws = job->ws;
    size_t first = task * GATHER, end = first + GATHER < ws->count ? first + GATHER : ws->count;
    for (size_t i = first; i < end; i++) {
        double error = 0, weight = 0;
        if (ws->state[i] != SF_SEEN || ws->slot[i] == ws->slot[i + 1]) continue;
        for (uint32_t slot = ws->slot[i]; slot < ws->slot[i + 1]; slot++) {
            error += (double)ws->sums[(size_t)slot * SF_SUMS];
            weight += (double)ws->sums[(size_t)slot * SF_SUMS + 1];
        }
        error_share *s = &job->error_shares[i];
        float of_view = (float)error * job->pixel;
        if (of_view > 0) s->log_sum += log((double)of_view);
        s->with_error += of_view > 0;
        s->weight += (float)weight * job->pixel;
        s->visible++;
    }
}

static sf_status add_view(sf_fitter *f, sf_view_state *state, double pixels, double weight_sum,
                          void *job_pointer) {
    (void)weight_sum;
    gather_job *job = job_pointer;
    sf_workspace *ws = &f->workspace;
    job->views++;
    job->pixel = (float)pixels;
    sf_pool_run(f->ctx->pool, ws->plane_rows, error_row, ws);
    if (state && f->options.exposure) sf_expose_swap(&f->exposure, ws);
    sf_status status = sf_stage_blend_bwd(ws);
    if (status) return status;
    sf_pool_run(f->ctx->pool, (ws->count + GATHER - 1) / GATHER, gather_task, job);
    return SF_OK;
}

/* The geometric mean over the views: an error that one view alone shows counts for little. */
static double score_of(const error_share *s, unsigned least) {
    if (s->visible >= least && s->weight < LEAST_WEIGHT) return -1;
    return s->with_error < least ? 0 : exp((double)s->log_sum / s->with_error);
}

sf_status sf_densify_score(sf_fitter *f) {
    size_t count = f->model->count;
    error_share *error_shares = sf_calloc(f->ctx, count, sizeof *error_shares);
    gather_job job = {.ws = &f->workspace, .error_shares = error_shares};
    sf_status status = error_shares
                           ? sf_sample_views(f, (size_t)f->options.error_views, 1, add_view, &job, NULL)
                           : SF_ERR_MEMORY;
    unsigned least = job.views < LEAST_VIEWS ? 1 : LEAST_VIEWS;
    for (size_t i = 0; i < count && !status; i++) {
        f->densify.gradient_sum[i] = score_of(&error_shares[i], least);
        f->densify.visible_count[i] = f->densify.gradient_sum[i] > 0;
    }
    sf_free(f->ctx, error_shares);
    return status;
}
