/* carry.c - Gaussians that go with the keyframes whose poses are corrected. */
#include "carry.h"

#include "../base/linear.h"
#include "../base/pool.h"
#include "../base/select.h"

/* A correction as lanes take it: x is seen at R x + t, and goes by A x + b. */
typedef struct sight {
    float R[9], t[3], A[9], b[3];
    float fx, fy, cx, cy, width, height;
} sight;

typedef struct job {
    sf_model *model;
    sight *sights;
    size_t count;
} job;

enum { CARRIED = 64 }; /* blocks a task */

static sight sight_of(const sf_correction *c) {
    const sf_camera *from = &c->camera;
    sight s = {.fx = (float)from->fx, .fy = (float)from->fy, .cx = (float)from->cx, .cy = (float)from->cy};
    s.width = (float)from->width, s.height = (float)from->height;
    double off[3];
    for (int k = 0; k < 3; k++) off[k] = from->t_cw[k] - c->to.t[k];
    for (int i = 0; i < 3; i++) {
        const double column[3] = {c->to.R[i], c->to.R[3 + i], c->to.R[6 + i]};
        for (int k = 0; k < 3; k++) {
            const double of_from[3] = {from->R_cw[k], from->R_cw[3 + k], from->R_cw[6 + k]};
            s.R[3 * i + k] = (float)from->R_cw[3 * i + k];
            s.A[3 * i + k] = (float)(sf_dot3(column, of_from) - (i == k));
        }
        s.t[i] = (float)from->t_cw[i];
        s.b[i] = (float)sf_dot3(column, off);
    }
    return s;
}

/* What a camera adds to the sums of a block's lanes: by how much they go times their weight, and that. */
static void add_sight(const sight *s, const float *restrict x, float *restrict sum) {
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

static void carry_block(const job *j, size_t block) {
    float *mean = j->model->params.field[SF_FIELD_mean] + 3 * SF_LANES * block, sum[4 * SF_LANES] = {0};
    size_t left = j->model->count - SF_LANES * block, lanes = left < SF_LANES ? left : SF_LANES;
    for (size_t n = 0; n < j->count; n++) add_sight(&j->sights[n], mean, sum);
    for (size_t i = 0; i < lanes; i++)
        for (size_t k = 0; k < 3 && sum[3 * SF_LANES + i] > 0; k++)
            mean[SF_LANES * k + i] += sum[SF_LANES * k + i] / sum[3 * SF_LANES + i];
}

static void carry_task(void *pointer, size_t task, int thread) {
    const job *j = pointer;
    size_t blocks = sf_blocks(j->model->count), end = (task + 1) * CARRIED;
    (void)thread;
    for (size_t i = task * CARRIED; i < end && i < blocks; i++) carry_block(j, i);
}

static sf_status find_sights(sf_context *ctx, job *j, const sf_correction *corrections, size_t count) {
    *j = (job){.count = count, .sights = sf_alloc(ctx, count, sizeof *j->sights)};
    if (count && !j->sights) return SF_ERR_MEMORY;
    for (size_t i = 0; i < count; i++) j->sights[i] = sight_of(&corrections[i]);
    return SF_OK;
}

static void carry(sf_context *ctx, job *j, sf_model *model) {
    j->model = model;
    sf_pool_run(ctx->pool, (sf_blocks(model->count) + CARRIED - 1) / CARRIED, carry_task, j);
    sf_model_note_change(model);
}

sf_status sf_carry(sf_context *ctx, sf_model *model, const sf_correction *corrections, size_t count) {
    job j;
    sf_status status = find_sights(ctx, &j, corrections, count);
    if (!status) carry(ctx, &j, model);
    sf_free(ctx, j.sights);
    return status;
}

sf_status sf_carry_fit(sf_fitter *f, const sf_correction *corrections, size_t count) {
    job j;
    sf_status status = find_sights(f->ctx, &j, corrections, count);
    if (!status) {
        sf_trials_end(f);
        carry(f->ctx, &j, f->model);
        if (f->restore.model) carry(f->ctx, &j, f->restore.model);
    }
    sf_free(f->ctx, j.sights);
    return status;
}
