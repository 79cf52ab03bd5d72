/* step.c - a whole step of a fit, stage by stage, as src/fit makes it. */
#include "step.h"

#include <string.h>

#include "../base/pool.h"
#include "../scene/gaussians.h"
#include "clocks.h"

const char *const bench_stage_names[STAGES] = {"project", "bin",       "blend",  "target",
                                               "loss",    "blend_bwd", "update", "total"};

typedef struct target_job {
    sf_workspace *ws;
    const bench_view *view;
} target_job;

static void target_task(void *job_pointer, size_t row, int thread) {
    (void)thread;
    const target_job *job = job_pointer;
    sf_workspace *ws = job->ws;
    size_t width = (size_t)job->view->camera.width, height = (size_t)job->view->camera.height;
    const uint8_t *weight = job->view->weight ? job->view->weight + row * width : NULL;
    for (size_t ch = 0; ch < SF_CHANNELS; ch++)
        ws->ctx->kernels->unpack(job->view->rgb + (ch * height + row) * width, weight, width, 1,
                                 ws->target[ch] + row * ws->stride, (int)width);
    if (weight) ws->ctx->kernels->unpack(NULL, weight, width, 1, ws->weight + row * ws->stride, (int)width);
}

/* The picture to compare with, and the sum of its weights. */
static double load_target(sf_workspace *ws, const bench_view *view) {
    target_job job = {ws, view};
    double sum = (double)ws->eye.width * ws->eye.height;
    sf_pool_run(ws->ctx->pool, (size_t)ws->eye.height, target_task, &job);
    ws->has_weight = view->weight != NULL;
    if (!ws->has_weight) return sum;
    sum = 1e-9; /* never 0, for a view that is masked altogether */
    for (int y = 0; y < ws->eye.height; y++)
        for (int x = 0; x < ws->eye.width; x++) sum += (double)ws->weight[(size_t)y * ws->stride + (size_t)x];
    return sum;
}

typedef struct update_job {
    const sf_workspace *ws;
    const sf_model *model;
    const sf_optimizer_state *moments;
} update_job;

static void update_blocks(void *job_pointer, const sf_params *grads, size_t first, size_t end) {
    static const sf_adam step = {.rate = 0, .beta1 = 0.9f, .beta2 = 0.999f, .v_scale = 1, .epsilon = 1e-15f};
    const update_job *job = job_pointer;
    for (int field = 0; grads && field < SF_FIELD_COUNT; field++) {
        if (!grads->field[field]) continue;
        size_t block = (size_t)sf_field_components(field) * SF_LANES, at = first * block;
        sf_optimizer_step(job->moments, job->ws->ctx->kernels,
                          (sf_value_range){field, at, (end - first) * block},
                          job->model->params.field[field] + at, grads->field[field], &step, 0);
    }
}

/* Ends a stage: its time since the mark, which moves on. */
static void end_stage(const sf_workspace *ws, double *mark, double *seconds) {
    double now = bench_clock(ws->ctx);
    *seconds = now - *mark;
    *mark = now;
}

sf_status bench_step(sf_workspace *ws, const sf_model *model, const sf_optimizer_state *moments,
                     const bench_view *view, double seconds[STAGES]) {
    static const float background[3] = {0.5f, 0.5f, 0.5f};
    sf_loss_value loss;
    double d_background[3];
    sf_status status = sf_workspace_look(ws, &view->camera, view->near_plane);
    if (!status) status = sf_workspace_loss_room(ws);
    if (status) return status;
    double start = bench_clock(ws->ctx), mark = start;
    status = sf_stage_project(ws, model, model->sh_degree, model->antialiased);
    end_stage(ws, &mark, &seconds[STAGE_PROJECT]);
    if (!status) status = sf_stage_bin(ws);
    if (status) return status;
    end_stage(ws, &mark, &seconds[STAGE_BIN]);
    sf_stage_blend(ws, background, 0);
    end_stage(ws, &mark, &seconds[STAGE_BLEND]);
    double weights = load_target(ws, view);
    end_stage(ws, &mark, &seconds[STAGE_TARGET]);
    sf_stage_loss(ws, 0.2, 0, weights, 0, 1, &loss);
    end_stage(ws, &mark, &seconds[STAGE_LOSS]);
    status = sf_stage_blend_bwd(ws);
    if (!status) status = sf_stage_background_bwd(ws, d_background);
    if (status) return status;
    end_stage(ws, &mark, &seconds[STAGE_BLEND_BWD]);
    update_job job = {ws, model, moments};
    status = sf_stage_project_bwd(ws, NULL, update_blocks, &job);
    end_stage(ws, &mark, &seconds[STAGE_UPDATE]);
    seconds[STAGE_TOTAL] = mark - start;
    return status;
}

int bench_parameters(int sh_degree) {
    int sum = 0;
    for (int field = 0; field < SF_FIELD_COUNT; field++)
        if (sf_field_stored(field, sh_degree)) sum += sf_field_components(field);
    return sum;
}

double bench_stage_floor(const bench_step_times *step, int stage, double flops, double bytes) {
    double n = (double)step->gaussians, parameters = bench_parameters(step->sh_degree);
    double pixels = (double)step->width * step->height, record = sizeof(sf_splat);
    const sf_optimizer_state floats = sf_optimizer_moments(SF_MOMENTS_FLOAT, 0);
    switch (stage) {
    case STAGE_PROJECT: /* parameters in, records out */
        return n * (4 * parameters + record) / bytes;
    case STAGE_BIN: /* records in, lists out; between them strips, which a cache may hold */
        return (n * record + step->entries * 8) / bytes;
    case STAGE_BLEND:
        return step->evaluated * BENCH_BLEND_OPERATIONS / flops;
    case STAGE_TARGET: /* bytes in, floats out */
        return pixels * 3 * (1 + 4) / bytes;
    case STAGE_LOSS:
        return pixels * 3 * BENCH_LOSS_OPERATIONS / flops;
    case STAGE_BLEND_BWD:
        return step->evaluated * BENCH_BLEND_BWD_OPERATIONS / flops;
    case STAGE_UPDATE: /* parameters and moments in and out, records and sums in */
        parameters += sf_moment_values(&floats, step->sh_degree);
        return (n * (8 * parameters + record) + step->entries * 4 * SF_SUMS) / bytes;
    default:
        return 0;
    }
}
