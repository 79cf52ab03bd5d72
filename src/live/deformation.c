/* deformation.c - map deformation: Gaussians follow the corrected poses of keyframes. */
#include "deformation.h"

#include <math.h>

#include "../base/linear.h"
#include "../base/pool.h"
#include "../base/select.h"
#include "../fit/online.h"

/* A correction as lanes read it, in the model's unit: the camera sees x at R x + t, and x moves by A x + b.
 */
typedef struct motion {
    float R[9], t[3], A[9], b[3];
    float fx, fy, cx, cy, width, height;
} motion;

typedef struct job {
    sf_context *ctx;
    sf_model *model;
    const sf_correction *corrections;
    motion *cameras;
    size_t count;
} job;

enum { BLOCKS = 64 }; /* blocks a task */

static motion camera_motion(const sf_correction *c, int unit) {
    const sf_camera *from = &c->camera;
    motion s = {.fx = (float)from->fx, .fy = (float)from->fy, .cx = (float)from->cx, .cy = (float)from->cy};
    s.width = (float)from->width, s.height = (float)from->height;
    const double D[3] = {c->scale / c->zoom, c->scale / c->zoom, c->scale};
    double off[3];
    for (int k = 0; k < 3; k++) off[k] = D[k] * from->t_cw[k] - c->to.t[k];
    for (int i = 0; i < 3; i++) {
        const double column[3] = {c->to.R[i], c->to.R[3 + i], c->to.R[6 + i]};
        for (int k = 0; k < 3; k++) {
            const double of_from[3] = {D[0] * from->R_cw[k], D[1] * from->R_cw[3 + k],
                                       D[2] * from->R_cw[6 + k]};
            s.R[3 * i + k] = (float)from->R_cw[3 * i + k];
            s.A[3 * i + k] = (float)(sf_dot3(column, of_from) - (i == k));
        }
        s.t[i] = (float)ldexp(from->t_cw[i], -unit);
        s.b[i] = (float)ldexp(sf_dot3(column, off), -unit);
    }
    return s;
}

/* Adds, for each lane that the camera sees, its displacement times its weight, and the weight. */
static void add_camera(const motion *s, const float *restrict x, float *restrict sum) {
    const float *y = x + SF_LANES, *z = y + SF_LANES;
    const float *R = s->R, *A = s->A;
    for (int i = 0; i < SF_LANES; i++) {
        float p = R[0] * x[i] + R[1] * y[i] + R[2] * z[i] + s->t[0];
        float q = R[3] * x[i] + R[4] * y[i] + R[5] * z[i] + s->t[1];
        float depth = R[6] * x[i] + R[7] * y[i] + R[8] * z[i] + s->t[2];
        float u = s->fx * p + s->cx * depth, v = s->fy * q + s->cy * depth; /* px times depth */
        int seen = (depth > 0) & (u >= 0) & (u < s->width * depth) & (v >= 0) & (v < s->height * depth);
        float weight = sf_select(seen, 1 / (depth * depth), 0);
        sum[i] += weight * (A[0] * x[i] + A[1] * y[i] + A[2] * z[i] + s->b[0]);
        sum[SF_LANES + i] += weight * (A[3] * x[i] + A[4] * y[i] + A[5] * z[i] + s->b[1]);
        sum[2 * SF_LANES + i] += weight * (A[6] * x[i] + A[7] * y[i] + A[8] * z[i] + s->b[2]);
        sum[3 * SF_LANES + i] += weight;
    }
}

static void deform_block(const job *j, size_t block) {
    float *mean = j->model->params.field[SF_FIELD_mean] + 3 * SF_LANES * block, sum[4 * SF_LANES] = {0};
    size_t left = j->model->count - SF_LANES * block, lanes = left < SF_LANES ? left : SF_LANES;
    for (size_t n = 0; n < j->count; n++) add_camera(&j->cameras[n], mean, sum);
    for (size_t i = 0; i < lanes; i++)
        for (size_t k = 0; k < 3 && sum[3 * SF_LANES + i] > 0; k++)
            mean[SF_LANES * k + i] += sum[SF_LANES * k + i] / sum[3 * SF_LANES + i];
}

static void deform_task(void *pointer, size_t task, int thread) {
    const job *j = pointer;
    size_t blocks = sf_blocks(j->model->count), end = (task + 1) * BLOCKS;
    (void)thread;
    for (size_t i = task * BLOCKS; i < end && i < blocks; i++) deform_block(j, i);
}

static sf_status prepare(sf_context *ctx, job *j, const sf_correction *corrections, size_t count) {
    *j = (job){.ctx = ctx,
               .corrections = corrections,
               .count = count,
               .cameras = sf_alloc(ctx, count, sizeof *j->cameras)};
    return count && !j->cameras ? SF_ERR_MEMORY : SF_OK;
}

static void deform(sf_model *model, void *pointer) {
    job *j = pointer;
    j->model = model;
    for (size_t i = 0; i < j->count; i++) j->cameras[i] = camera_motion(&j->corrections[i], model->unit);
    sf_pool_run(j->ctx->pool, (sf_blocks(model->count) + BLOCKS - 1) / BLOCKS, deform_task, j);
    sf_model_note_change(model);
}

sf_status sf_deform_map(sf_context *ctx, sf_model *model, const sf_correction *corrections, size_t count) {
    job j;
    sf_status status = prepare(ctx, &j, corrections, count);
    if (!status) deform(model, &j);
    sf_free(ctx, j.cameras);
    return status;
}

sf_status sf_deform_fit(sf_context *ctx, sf_fitter *fitter, const sf_correction *corrections, size_t count) {
    job j;
    sf_status status = prepare(ctx, &j, corrections, count);
    if (!status) sf_online_move_means(fitter, deform, &j);
    sf_free(ctx, j.cameras);
    return status;
}
