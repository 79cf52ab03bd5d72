/* project.c - projects all Gaussians to the screen, and its gradient by the raw parameters. */
#include "workspace.h"

#include <math.h>
#include <string.h>

#include "../base/pool.h"
#include "../cluster/cluster.h"
#include "in_view.h"
#include "near_plane.h"
#include "shard.h"

static size_t tasks_of(size_t count) {
    return (sf_blocks(count) + SF_PROJECT_BLOCKS - 1) / SF_PROJECT_BLOCKS;
}

static sf_status room(sf_workspace *ws, size_t count) {
    size_t need = sf_blocks(count) * SF_LANES + 1;
    const sf_array arrays[] = {
        {&ws->splats, sizeof *ws->splats},           {&ws->state, sizeof *ws->state},
        {&ws->first_row, sizeof *ws->first_row},     {&ws->rows, sizeof *ws->rows},
        {&ws->span_offset, sizeof *ws->span_offset}, {&ws->slot, sizeof *ws->slot},
        {&ws->screen, sizeof *ws->screen},           {&ws->depth_of, sizeof *ws->depth_of},
        {&ws->in_view, sizeof *ws->in_view},
    };
    return sf_grow_together(ws->ctx, arrays, sizeof arrays / sizeof *arrays, &ws->gaussian_capacity, need);
}

/* The highest degree of block `first`, at most `most`, and the end of the blocks of that degree, at most
 * `end`. A block with Gaussians of several degrees has the highest of them: bands that a lane lacks are 0. */
static size_t end_of_degree(const sf_workspace *ws, int most, size_t first, size_t end, int *degree) {
    int d = most;
    while (d && sf_blocks(ws->banded[d]) <= first) d--;
    *degree = d;
    return d && sf_blocks(ws->banded[d]) < end ? sf_blocks(ws->banded[d]) : end;
}

typedef struct project_job {
    sf_workspace *ws;
    sf_project_args args;
    sf_frustum frustum;
} project_job;

/* What the kernel says of Gaussians that are out of view. */
static void leave_out(const sf_workspace *ws, size_t first, size_t end) {
    size_t at = first * SF_LANES, n = (end - first) * SF_LANES;
    memset(ws->state + at, SF_OUT_OF_VIEW, n * sizeof *ws->state);
    memset(ws->rows + at, 0, n * sizeof *ws->rows);
}

static void project_task(void *job_pointer, size_t task, int thread) {
    (void)thread;
    const project_job *job = job_pointer;
    const sf_workspace *ws = job->ws;
    sf_project_args args = job->args;
    size_t first = task * SF_PROJECT_BLOCKS, blocks = sf_blocks(ws->count);
    size_t end = first + SF_PROJECT_BLOCKS < blocks ? first + SF_PROJECT_BLOCKS : blocks;
    ws->in_view[task] = (uint8_t)!sf_are_out_of_view(&job->frustum, &ws->params, first, end);
    if (!ws->in_view[task]) {
        leave_out(ws, first, end);
        return;
    }
    for (size_t until; first < end; first = until) {
        until = end_of_degree(ws, ws->sh_degree, first, end, &args.sh_degree);
        ws->ctx->kernels->project(&args, first, until);
    }
}

static sf_project_args project_args(const sf_workspace *ws) {
    return (sf_project_args){.eye = &ws->eye,
                             .params = ws->params,
                             .sh_degree = ws->sh_degree,
                             .antialiased = ws->antialiased,
                             .splats = ws->splats,
                             .state = ws->state,
                             .first_row = ws->first_row,
                             .rows = ws->rows};
}

/* The eye's lengths in the model's unit. */
static void use_unit(sf_workspace *ws, int unit) {
    sf_eye *eye = &ws->eye;
    int change = ws->unit - unit;
    for (int k = 0; k < 3 && change; k++) {
        eye->t[k] = ldexpf(eye->t[k], change);
        eye->center[k] = ldexpf(eye->center[k], change);
    }
    eye->near_plane = ldexpf(eye->near_plane, change);
    ws->unit = unit;
}

sf_status sf_stage_project(sf_workspace *ws, const sf_model *model, int sh_degree, int antialiased) {
    size_t count = model->count;
    sf_shard_begin(ws);
    sf_status status = room(ws, count);
    if (status) return status;
    use_unit(ws, model->unit);
    if (!(ws->eye.near_plane > 0)) ws->eye.near_plane = sf_near_plane_of(model, &ws->eye, ws->cluster);
    ws->params = model->params;
    ws->count = count;
    memcpy(ws->banded, model->banded, sizeof ws->banded);
    ws->sh_degree = sh_degree;
    ws->antialiased = antialiased;
    project_job job = {ws, project_args(ws), sf_frustum_of(&ws->eye)};
    sf_pool_run(ws->ctx->pool, tasks_of(count), project_task, &job);
    ws->not_finite = 0;
    for (size_t i = 0; i < count; i++) ws->not_finite += ws->state[i] == SF_NOT_FINITE;
    return sf_shard_send(ws);
}

/* Floats of SF_GRAD_BLOCKS blocks of all fields. */
static size_t grads_size(void) {
    size_t size = 0;
    for (int field = 0; field < SF_FIELD_COUNT; field++) size += (size_t)sf_field_components(field);
    return size * SF_LANES * SF_GRAD_BLOCKS;
}

typedef struct project_bwd_job {
    sf_workspace *ws;
    sf_project_bwd_args args;
    double *camera; /* [tasks][SF_CAMERA_SUMS] or NULL */
    sf_grads_fn take;
    void *user;
} project_bwd_job;

/* Points the fields of a degree into the thread's gradient buffer. */
static sf_params grads_of(const sf_workspace *ws, int thread, int degree) {
    sf_params grads = {{NULL}};
    float *at = ws->grads + (size_t)thread * grads_size();
    for (int field = 0; field < SF_FIELD_COUNT && sf_field_stored(field, degree); field++) {
        grads.field[field] = at;
        at += sf_field_components(field) * SF_LANES * SF_GRAD_BLOCKS;
    }
    return grads;
}

/* Clears the gradients of lanes that lack a band but share its last block. */
static void clear_lacking(const sf_workspace *ws, const sf_params *grads, int degree, size_t first,
                          size_t end) {
    for (int band = 1; band <= degree; band++) {
        int n = sf_field_components(SF_FIELD_sh0 + band);
        float *values = grads->field[SF_FIELD_sh0 + band];
        size_t from = ws->banded[band] > first * SF_LANES ? ws->banded[band] : first * SF_LANES;
        for (size_t i = from; i < end * SF_LANES; i++)
            for (int c = 0; c < n; c++) values[sf_at(i - first * SF_LANES, n, c)] = 0;
    }
}

static void project_bwd_task(void *job_pointer, size_t task, int thread) {
    project_bwd_job *job = job_pointer;
    const sf_workspace *ws = job->ws;
    sf_project_bwd_args args = job->args;
    size_t first = task * SF_PROJECT_BLOCKS, blocks = sf_blocks(ws->count);
    size_t end = first + SF_PROJECT_BLOCKS < blocks ? first + SF_PROJECT_BLOCKS : blocks;
    args.camera = job->camera ? job->camera + SF_CAMERA_SUMS * task : NULL;
    args.not_finite = &ws->partial_count[task];
    if (!ws->in_view[task]) {
        memset(ws->screen + first * SF_LANES, 0, (end - first) * SF_LANES * sizeof *ws->screen);
        job->take(job->user, NULL, first, end);
        return;
    }
    for (size_t until; first < end; first = until) {
        int degree;
        until = first + SF_GRAD_BLOCKS < end ? first + SF_GRAD_BLOCKS : end;
        until = end_of_degree(ws, SF_MAX_SH_DEGREE, first, until, &degree);
        args.forward.sh_degree = degree < ws->sh_degree ? degree : ws->sh_degree;
        args.grads = grads_of(ws, thread, degree);
        ws->ctx->kernels->project_bwd(&args, first, until);
        clear_lacking(ws, &args.grads, args.forward.sh_degree, first, until);
        job->take(job->user, &args.grads, first, until);
    }
}

sf_status sf_stage_project_bwd(sf_workspace *ws, double *camera, sf_grads_fn take, void *user) {
    size_t tasks = tasks_of(ws->count), threads = (size_t)sf_pool_threads(ws->ctx->pool);
    sf_status status =
        sf_grow(ws->ctx, &ws->partial, &ws->partial_capacity, 0, SF_CAMERA_SUMS * tasks, sizeof(double));
    if (!status)
        status =
            sf_grow(ws->ctx, &ws->partial_count, &ws->partial_count_capacity, 0, tasks, sizeof(unsigned));
    if (!status)
        status = sf_grow(ws->ctx, &ws->grads, &ws->grads_capacity, 0, threads * grads_size(), sizeof(float));
    if (status) return status;
    for (size_t k = 0; k < SF_CAMERA_SUMS * tasks; k++) ws->partial[k] = 0;
    for (size_t k = 0; k < tasks; k++) ws->partial_count[k] = 0;
    project_bwd_job job = {
        .ws = ws,
        .args = {.forward = project_args(ws), .slot = ws->slot, .sums = ws->sums, .screen = ws->screen},
        .camera = camera ? ws->partial : NULL,
        .take = take,
        .user = user};
    sf_pool_run(ws->ctx->pool, tasks, project_bwd_task, &job);
    for (int k = 0; camera && k < SF_CAMERA_SUMS; k++) camera[k] = 0;
    for (size_t task = 0; task < tasks; task++) {
        ws->not_finite += ws->partial_count[task];
        for (size_t k = 0; camera && k < SF_CAMERA_SUMS; k++)
            camera[k] += ws->partial[SF_CAMERA_SUMS * task + k];
    }
    if (camera && ws->shard) sf_cluster_sum(ws->cluster, camera, SF_CAMERA_SUMS);
    return SF_OK;
}
