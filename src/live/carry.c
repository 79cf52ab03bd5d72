/* carry.c - Gaussians that go with the keyframes whose poses are corrected. */
#include "carry.h"

#include "../base/linear.h"
#include "../scene/neighbours.h"

typedef struct job {
    sf_model *model;
    const sf_correction *corrections;
    size_t count;
} job;

enum { CARRIED = 1024 }; /* Gaussians a task */

/* How far a place goes to be where it was in one picture. 0: it is not in it. */
static int moved_by(const sf_correction *c, const double p[3], double by[3], double *depth) {
    double u, v, at[3];
    if (!sf_camera_sees(&c->camera, p, &u, &v, depth)) return 0;
    for (int k = 0; k < 3; k++) at[k] = sf_dot3(c->camera.R_cw + 3 * k, p) + c->camera.t_cw[k] - c->to.t[k];
    for (int k = 0; k < 3; k++)
        by[k] = c->to.R[k] * at[0] + c->to.R[3 + k] * at[1] + c->to.R[6 + k] * at[2] - p[k];
    return 1;
}

static void carry_one(const job *j, size_t i) {
    double p[3], by[3], depth, sum[3] = {0}, weights = 0;
    for (int k = 0; k < 3; k++) p[k] = (double)*sf_value(&j->model->params, SF_FIELD_mean, i, k);
    for (size_t n = 0; n < j->count; n++) {
        if (!moved_by(&j->corrections[n], p, by, &depth)) continue;
        double weight = 1 / (depth * depth);
        for (int k = 0; k < 3; k++) sum[k] += weight * by[k];
        weights += weight;
    }
    for (int k = 0; k < 3 && weights > 0; k++)
        *sf_value(&j->model->params, SF_FIELD_mean, i, k) = (float)(p[k] + sum[k] / weights);
}

static void carry_task(void *pointer, size_t task, int thread) {
    const job *j = pointer;
    size_t end = (task + 1) * CARRIED;
    (void)thread;
    for (size_t i = task * CARRIED; i < end && i < j->model->count; i++) carry_one(j, i);
}

void sf_carry(struct sf_pool *pool, sf_model *model, const sf_correction *corrections, size_t count) {
    job j = {.model = model, .corrections = corrections, .count = count};
    sf_pool_run(pool, (model->count + CARRIED - 1) / CARRIED, carry_task, &j);
}
