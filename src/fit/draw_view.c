/* draw_view.c - renders a training view, and loads the picture that it is compared with. */
#include "draw_view.h"

#include "../base/pool.h"
#include "../scene/pixels.h"
#include "refine.h"

typedef struct target_job {
    sf_workspace *ws;
    const sf_kernels *kernels;
    const sf_camera *camera;
    const sf_view_pixels *pixels;
    int factor;
} target_job;

static void target_task(void *job_pointer, size_t row, int thread) {
    (void)thread;
    const target_job *job = job_pointer;
    sf_workspace *ws = job->ws;
    size_t width = (size_t)job->camera->width, height = (size_t)job->camera->height;
    size_t from = row * (size_t)job->factor * width, to = row * ws->stride;
    const uint8_t *weight = job->pixels->weight ? job->pixels->weight + from : NULL;
    for (size_t ch = 0; ch < SF_CHANNELS; ch++)
        job->kernels->unpack(job->pixels->rgb + ch * width * height + from, weight, width, job->factor,
                             ws->target[ch] + to, ws->eye.width);
    if (weight) job->kernels->unpack(NULL, weight, width, job->factor, ws->weight + to, ws->eye.width);
}

/* Loads the target, and sums its weights. */
static sf_status load_target(sf_fitter *f, const sf_view *view, int factor, double *sum) {
    sf_workspace *ws = &f->workspace;
    sf_view_pixels pixels;
    sf_status status = sf_view_open(view, &pixels);
    if (status) return status;
    target_job job = {ws, f->ctx->kernels, &view->camera, &pixels, factor};
    sf_pool_run(f->ctx->pool, (size_t)ws->eye.height, target_task, &job);
    ws->has_weight = pixels.weight != NULL;
    sf_view_close(view, &pixels);
    *sum = (double)ws->eye.width * ws->eye.height;
    if (!ws->has_weight) return SF_OK;
    *sum = 0;
    for (int y = 0; y < ws->eye.height; y++)
        for (int x = 0; x < ws->eye.width; x++)
            *sum += (double)ws->weight[(size_t)y * ws->stride + (size_t)x];
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
    status = load_target(f, view, 1 << f->level, weight_sum);
    if (status) return status;
    if (!(*weight_sum > 0)) return SF_ERR_EMPTY; /* wholly masked */
    if (exposed) sf_expose(&f->exposure, ws, state);
    return SF_OK;
}
