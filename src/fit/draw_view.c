/* draw_view.c - renders a training view, and loads the picture that it is compared with. */
#include "draw_view.h"

#include "../base/pool.h"
#include "../render/shard.h"
#include "../scene/pixels.h"
#include "refine.h"

typedef struct target_job {
    sf_workspace *ws;
    const sf_kernels *kernels;
    const sf_camera *camera;
    const sf_view_pixels *pixels;
    int factor;
    size_t first;  /* row of the target that the pixels begin with */
    size_t height; /* rows of pixels */
} target_job;

static void target_task(void *job_pointer, size_t row, int thread) {
    (void)thread;
    const target_job *job = job_pointer;
    sf_workspace *ws = job->ws;
    size_t width = (size_t)job->camera->width, plane = width * job->height;
    size_t from = row * (size_t)job->factor * width, to = (job->first + row) * ws->stride;
    const uint8_t *weight = job->pixels->weight ? job->pixels->weight + from : NULL;
    for (size_t ch = 0; ch < SF_CHANNELS; ch++)
        job->kernels->unpack(job->pixels->rgb + ch * plane + from, weight, width, job->factor,
                             ws->target[ch] + to, ws->eye.width);
    if (weight) job->kernels->unpack(NULL, weight, width, job->factor, ws->weight + to, ws->eye.width);
}

/* The weights of the rows that this rank compares, summed over the ranks. */
static double sum_weights(const sf_workspace *ws) {
    size_t first, end;
    double sum = 0;
    sf_shard_rows(ws, &first, &end);
    for (size_t y = first; y < end; y++)
        for (size_t x = 0; x < (size_t)ws->eye.width; x++) sum += (double)ws->weight[y * ws->stride + x];
    sf_shard_sum(ws, &sum, 1);
    return sum;
}

/* Of several ranks each reads but the rows that its loss does. */
static sf_status load_rows(sf_fitter *f, const sf_view *view, target_job *job) {
    sf_workspace *ws = &f->workspace;
    size_t first, end, factor = (size_t)job->factor, width = (size_t)view->camera.width;
    sf_view_pixels pixels;
    sf_shard_loss_rows(ws, &first, &end);
    job->first = first, job->height = (end - first) * factor;
    if (end * factor > (size_t)view->camera.height)
        job->height = (size_t)view->camera.height - first * factor;
    sf_status status = sf_grow(f->ctx, &f->band_pixels, &f->band_pixels_capacity, 0,
                               job->height * width * sf_view_pixel_bytes(view) + 1, 1);
    if (!status)
        status =
            sf_view_read_rows(view, first * factor, first * factor + job->height, f->band_pixels, &pixels);
    if (status) return status;
    job->pixels = &pixels;
    sf_pool_run(f->ctx->pool, end - first, target_task, job);
    return SF_OK;
}

sf_status sf_load_target(sf_fitter *f, const sf_view *view, int factor, double *sum) {
    sf_workspace *ws = &f->workspace;
    sf_view_pixels pixels;
    target_job job = {ws, f->ctx->kernels, &view->camera, &pixels, factor, 0, (size_t)view->camera.height};
    if (ws->shard && ws->band_only) {
        ws->has_weight = view->has_weight;
        sf_status status = load_rows(f, view, &job);
        if (status) return status;
    } else {
        sf_status status = sf_view_open(view, &pixels);
        if (status) return status;
        ws->has_weight = pixels.weight != NULL;
        sf_pool_run(f->ctx->pool, (size_t)ws->eye.height, target_task, &job);
        sf_view_close(view, &pixels);
    }
    *sum = ws->has_weight ? sum_weights(ws) : (double)ws->eye.width * ws->eye.height;
    return SF_OK;
}

sf_status sf_draw_view(sf_fitter *f, const sf_view *view, const sf_view_state *state, double *weight_sum) {
    sf_workspace *ws = &f->workspace;
    sf_camera camera = view->camera;
    int exposed = state && f->options.exposure;
    sf_view_expect(view); /* and it is read while the model is drawn */
    sf_refine_camera(&f->views, view->id, &camera);
    camera = sf_camera_downscaled(&camera, 1 << f->level);
    sf_status status = sf_workspace_look(ws, &camera, f->near_plane);
    if (!status) sf_workspace_reduced(ws, 1 << f->level);
    if (!status) status = sf_workspace_loss_room(ws);
    if (!status) status = sf_stage_project(ws, f->model, f->sh_degree, f->model->antialiased);
    if (!status) status = sf_stage_bin(ws);
    if (!status && exposed) status = sf_exposure_room(&f->exposure, ws);
    if (status) return status;
    sf_stage_blend(ws, f->step_background, 0);
    status = sf_load_target(f, view, 1 << f->level, weight_sum);
    if (status) return status;
    if (!(*weight_sum > 0)) return SF_ERR_EMPTY; /* wholly masked */
    if (exposed) sf_expose(&f->exposure, ws, state);
    return SF_OK;
}
