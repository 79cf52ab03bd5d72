/* select_merge_candidates.c - finds pairs of Gaussians that one Gaussian can replace.
 *
 * The importance of two overlapping Gaussians says nothing of a merge: each is needed as long as the other
 * stays as it is. The expected rise is the part of both that their merged Gaussian lacks, times their scores
 * (select_merge.c; README, Size).
 */
#include "select_merge_candidates.h"

#include <math.h>
#include <stdlib.h>

#include "../base/linear.h"
#include "../base/pool.h"
#include "../kernels/sh.h"
#include "../scene/nearest.h"
#include "opacity.h"

enum {
    NEIGHBOURS = 8, /* nearest neighbours that each Gaussian is compared with */
    CHUNK = 256     /* Gaussians a task */
};

/* Added to the variances, as a part of the largest, so that the covariance is regular. */
#define LEAST_VARIANCE 1e-8

/* A Gaussian as a function in space: opacity and colour at its mean, and its covariance. */
typedef struct blob {
    double mean[3], C[9], det;
    double opacity, rgb[3];
    double mass; /* opacity times its mean projected area, up to a constant factor */
} blob;

typedef struct merge_job {
    const sf_fitter *fitter;
    const uint32_t *mergeable; /* [count] indices of the Gaussians that may be merged */
    size_t count;
    const sf_nearest *nearest; /* [count][NEIGHBOURS], indices into `mergeable` */
    const float *score;
    double misfit;
    sf_merge_candidate *best; /* [count] the best candidate of each; its rise is INFINITY if there is none */
} merge_job;

static double determinant(const double C[9]) {
    double row[3];
    sf_cross3(C + 3, C + 6, row);
    return sf_dot3(C, row);
}

static double area_of(double det) {
    return cbrt(det);
} /* Mean projected area over all directions, up to a constant factor. */

static void set_mass(blob *b) {
    b->det = determinant(b->C);
    b->mass = b->opacity * area_of(b->det);
}

static blob blob_of(const sf_params *p, size_t i) {
    blob b = {.opacity = (double)sf_sigmoidf(p->field[SF_FIELD_logit_opacity][i])};
    double most = 0;
    for (int axis = 0; axis < 3; axis++) {
        float direction[3];
        double variance = exp(2 * (double)*sf_value(p, SF_FIELD_log_scale, i, axis));
        most = fmax(most, variance);
        sf_axis_of(p, i, axis, direction);
        for (int k = 0; k < 9; k++) b.C[k] += variance * (double)direction[k / 3] * (double)direction[k % 3];
    }
    for (int k = 0; k < 3; k++) {
        b.C[4 * k] += LEAST_VARIANCE * most;
        b.mean[k] = (double)*sf_value(p, SF_FIELD_mean, i, k);
        b.rgb[k] = fmax(0.5 + SF_SH_0 * (double)*sf_value(p, SF_FIELD_sh0, i, k), 0);
    }
    set_mass(&b);
    return b;
}

/* Integral of the product of both as functions with four channels, the opacity and the opacity times each
 * colour, in units of (2 pi)^1.5. */
static double product(const blob *a, const blob *b) {
    double C[9], d[3], x[3], colours = 1;
    for (int k = 0; k < 9; k++) C[k] = a->C[k] + b->C[k];
    for (int k = 0; k < 3; k++) {
        x[k] = d[k] = a->mean[k] - b->mean[k];
        colours += a->rgb[k] * b->rgb[k];
    }
    double det = determinant(C);
    if (!sf_cholesky(3, C)) return 0;
    sf_cholesky_solve(3, C, x);
    return a->opacity * b->opacity * colours * sqrt(a->det * b->det / det) * exp(-0.5 * sf_dot3(d, x));
}

/* The merged Gaussian: the mass, mean and covariance of both. */
static blob merged_of(const blob *a, const blob *b) {
    blob m = {0};
    double part = a->mass / (a->mass + b->mass), rest = 1 - part, d[3];
    for (int k = 0; k < 3; k++) {
        m.mean[k] = part * a->mean[k] + rest * b->mean[k];
        m.rgb[k] = part * a->rgb[k] + rest * b->rgb[k];
        d[k] = a->mean[k] - b->mean[k];
    }
    for (int k = 0; k < 9; k++) m.C[k] = part * a->C[k] + rest * b->C[k] + part * rest * d[k / 3] * d[k % 3];
    /* at most as opaque as both one behind the other */
    double both = 1 - (1 - a->opacity) * (1 - b->opacity);
    m.opacity = fmin((a->mass + b->mass) / area_of(determinant(m.C)), both);
    set_mass(&m);
    return m;
}

/* Square integral of (a + b - merged), relative to that of a + b. */
static double misfit_of(const blob *a, const blob *b) {
    blob m = merged_of(a, b);
    double both = product(a, a) + product(b, b) + 2 * product(a, b);
    return fmax(both + product(&m, &m) - 2 * (product(a, &m) + product(b, &m)), 0) / both;
}

/* Lists the Gaussians that may be merged, and their means. */
static size_t list_mergeable(const sf_fitter *f, const float *score, uint32_t *mergeable, float *points) {
    size_t n = 0;
    for (size_t i = 0; i < f->model->count; i++) {
        int finite = isfinite(score[i]) && f->model->params.field[SF_FIELD_logit_opacity][i] > SF_INVISIBLE;
        for (int k = 0; k < 3; k++) {
            points[3 * n + (size_t)k] = *sf_value(&f->model->params, SF_FIELD_mean, i, k);
            finite &= isfinite(points[3 * n + (size_t)k]) != 0;
        }
        if (finite && !(f->densify.gradient_sum[i] < 0)) mergeable[n++] = (uint32_t)i;
    }
    return n;
}

static sf_merge_candidate best_of(const merge_job *job, size_t k) {
    const sf_params *p = &job->fitter->model->params;
    uint32_t i = job->mergeable[k];
    sf_merge_candidate best = {INFINITY, i, i};
    blob a = blob_of(p, i);
    double reach = sqrt(fmax(fmax(a.C[0], a.C[4]), a.C[8]));
    for (const sf_nearest *n = job->nearest + NEIGHBOURS * k, *end = n + NEIGHBOURS; n < end; n++) {
        if (!((double)n->distance <= 2 * reach)) break;
        uint32_t other = job->mergeable[n->point];
        blob b = blob_of(p, other);
        double misfit = misfit_of(&a, &b),
               rise = misfit * ((double)job->score[i] + (double)job->score[other]);
        if (misfit < job->misfit && rise < best.rise) best = (sf_merge_candidate){rise, i, other};
    }
    return best;
}

static void find_task(void *job_pointer, size_t task, int thread) {
    (void)thread;
    const merge_job *job = job_pointer;
    for (size_t k = task * CHUNK; k < (task + 1) * CHUNK && k < job->count; k++)
        job->best[k] = best_of(job, k);
}

/* A total order, so that any sort gives the same. */
static int by_rise(const void *a, const void *b) {
    const sf_merge_candidate *x = a, *y = b;
    if (x->rise != y->rise) return x->rise < y->rise ? -1 : 1;
    return (x->a > y->a) - (x->a < y->a);
}

/* The quaternion (w x y z) of a rotation whose columns are V's: through its largest component, which no
 * cancellation spoils. */
static void quaternion_of(const double V[9], double q[4]) {
    double trace = V[0] + V[4] + V[8], square[4] = {1 + trace};
    int best = 0;
    for (int k = 0; k < 3; k++) square[k + 1] = 1 + 2 * V[4 * k] - trace;
    for (int k = 1; k < 4; k++)
        if (square[k] > square[best]) best = k;
    const double turn[3] = {V[7] - V[5], V[2] - V[6], V[3] - V[1]};
    double root = sqrt(square[best]), inverse = 0.5 / root;
    q[best] = 0.5 * root;
    for (int k = 0; k < 3; k++) {
        if (best == 0)
            q[k + 1] = turn[k] * inverse;
        else if (k == best - 1)
            q[0] = turn[k] * inverse;
        else
            q[k + 1] = (V[3 * k + best - 1] + V[3 * (best - 1) + k]) * inverse;
    }
}

static void set_shape(const sf_params *p, size_t i, const blob *m) {
    double C[9], V[9], q[4];
    for (int k = 0; k < 9; k++) C[k] = m->C[k];
    sf_eigen(3, C, V);
    if (determinant(V) < 0)
        for (int k = 0; k < 3; k++) V[3 * k + 2] = -V[3 * k + 2];
    quaternion_of(V, q);
    for (int k = 0; k < 3; k++) {
        *sf_value(p, SF_FIELD_mean, i, k) = (float)m->mean[k];
        *sf_value(p, SF_FIELD_log_scale, i, k) = (float)(0.5 * log(C[4 * k]));
    }
    for (int k = 0; k < 4; k++) *sf_value(p, SF_FIELD_quat, i, k) = (float)q[k];
    sf_set_opacity(p, i, (float)m->opacity);
}

/* Value c of a field; 0 if the Gaussian lacks the band. */
static float value_of(const sf_model *m, int field, size_t i, int c) {
    return i < m->banded[sf_field_band(field)] ? *sf_value(&m->params, field, i, c) : 0;
}

void sf_apply_merge(sf_fitter *f, const sf_merge_candidate *candidate) {
    const sf_model *m = f->model;
    const sf_params *p = &m->params;
    blob a = blob_of(p, candidate->a), b = blob_of(p, candidate->b), one = merged_of(&a, &b);
    float part = (float)(a.mass / (a.mass + b.mass));
    for (int field = SF_FIELD_sh0; field < SF_FIELD_COUNT; field++)
        for (int c = 0; candidate->a < m->banded[sf_field_band(field)] && c < sf_field_components(field);
             c++) {
            float *x = sf_value(p, field, candidate->a, c);
            *x = part * *x + (1 - part) * value_of(m, field, candidate->b, c);
        }
    set_shape(p, candidate->a, &one);
    sf_optimizer_restart(&f->moments, m, candidate->a);
}

/* Keeps the pairs of the least rise so that each Gaussian is in one at most; returns their number. */
static size_t choose(sf_merge_candidate *candidates, size_t count, uint8_t *taken) {
    size_t n = 0, chosen = 0;
    for (size_t i = 0; i < count; i++)
        if (candidates[i].rise < INFINITY) candidates[n++] = candidates[i];
    qsort(candidates, n, sizeof *candidates, by_rise);
    for (size_t k = 0; k < n; k++) {
        if (taken[candidates[k].a] || taken[candidates[k].b]) continue;
        taken[candidates[k].a] = taken[candidates[k].b] = 1;
        candidates[chosen++] = candidates[k];
    }
    return chosen;
}

sf_status sf_find_merge_candidates(sf_fitter *f, double misfit, const float *score,
                                   sf_merge_candidate **candidates, size_t *count) {
    size_t all = f->model->count;
    float *points = sf_alloc(f->ctx, all, 3 * sizeof *points);
    sf_nearest *nearest = sf_alloc(f->ctx, all, NEIGHBOURS * sizeof *nearest);
    uint8_t *taken = sf_calloc(f->ctx, all, 1);
    uint32_t *mergeable = sf_alloc(f->ctx, all, sizeof *mergeable);
    *candidates = sf_alloc(f->ctx, all, sizeof **candidates);
    sf_status status = points && nearest && *candidates && taken && mergeable ? SF_OK : SF_ERR_MEMORY;
    size_t n = status ? 0 : list_mergeable(f, score, mergeable, points);
    if (!status) status = sf_find_nearest(f->ctx, points, n, NEIGHBOURS, nearest);
    if (!status) {
        merge_job job = {f, mergeable, n, nearest, score, misfit, *candidates};
        sf_pool_run(f->ctx->pool, (n + CHUNK - 1) / CHUNK, find_task, &job);
        *count = choose(*candidates, n, taken);
    } else {
        sf_free(f->ctx, *candidates);
        *candidates = NULL;
    }
    sf_free(f->ctx, points);
    sf_free(f->ctx, nearest);
    sf_free(f->ctx, taken);
    sf_free(f->ctx, mergeable);
    return status;
}
