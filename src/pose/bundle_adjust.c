/* bundle_adjust.c - the rounds of Levenberg and Marquardt; bundle_equations.c has what they solve. */
#include <math.h>
#include <string.h>

#include "../base/linear.h"
#include "../base/pool.h"
#include "bundle_equations.h"

enum {
    LEAST_SPREAD_COUNT = 8,
    CHUNK = 64 /* points a task */
};

#define FIRST_DAMP 1e-4
#define MOST_DAMP  1e8
#define ENOUGH     5e-4

/* 1. The cost */

static size_t chunks_of(const sf_bundle_work *a) { return (a->b->point_count + CHUNK - 1) / CHUNK; }

static size_t end_of_chunk(const sf_bundle_work *a, size_t chunk) {
    size_t end = (chunk + 1) * CHUNK;
    return end < a->b->point_count ? end : a->b->point_count;
}

static void distances_task(void *pointer, size_t chunk, int thread) {
    sf_bundle_work *a = pointer;
    (void)thread;
    for (size_t i = a->first[chunk * CHUNK]; i < a->first[end_of_chunk(a, chunk)]; i++) {
        const sf_bundle_observation *s = &a->b->observations[i];
        a->distances[i] = sf_bundle_distance(&a->b->views[s->view], a->b->points[s->point].at, s->u, s->v);
    }
}

static void measure_distances(sf_bundle_work *a) {
    sf_pool_run(a->ctx->pool, chunks_of(a), distances_task, a);
}

/* The spread of all distances, by their median. */
static double spread_of(sf_bundle_work *a) {
    size_t count = 0;
    if (a->b->spread > 0) return a->b->spread;
    for (size_t i = 0; i < a->b->observation_count; i++)
        if (isfinite(a->distances[i])) a->finite[count++] = a->distances[i];
    return count < LEAST_SPREAD_COUNT ? 1 : fmax(sf_spread(a->finite, count), SF_LEAST_SPREAD);
}

static double prior_cost(const sf_bundle_view *view) {
    double off[SF_TWIST], cost = 0;
    if (!view->is_free || !view->is_known) return 0;
    sf_rigid_twist(&view->prior.pose, &view->pose, off);
    for (int i = 0; i < SF_TWIST; i++)
        for (int j = 0; j < SF_TWIST; j++)
            cost += off[i] * view->prior.information[i * SF_TWIST + j] * off[j] / 2;
    return cost;
}

static double camera_cost(const sf_bundle_work *a, size_t camera) {
    sf_bundle_camera *c = &a->b->cameras[camera];
    double cost = 0;
    for (int k = 0; k < a->columns[camera].count; k++) {
        int which = a->columns[camera].which[k];
        double off = *sf_bundle_parameter(&c->lens, which) - c->prior[which];
        cost += c->information[which] * off * off / 2;
    }
    return c->lens.fx > 0 && c->lens.fy > 0 ? cost : INFINITY;
}

static double cost_of(const sf_bundle_work *a) {
    double cost = 0, c2 = pow(SF_CAUCHY * a->spread, 2), far = 20 * SF_CAUCHY * a->spread;
    for (size_t i = 0; i < a->b->observation_count; i++) {
        double d = fmin(a->distances[i], far);
        cost += sf_cauchy_cost(d * d, c2) / (a->spread * a->spread);
    }
    for (size_t i = 0; i < a->b->view_count; i++) cost += prior_cost(&a->b->views[i]);
    for (size_t i = 0; i < a->b->camera_count; i++) cost += camera_cost(a, i);
    for (size_t i = 0; i < a->b->point_count; i++) {
        const sf_bundle_point *p = &a->b->points[i];
        double along = 0;
        if (!(p->ray_information > 0)) continue;
        for (int k = 0; k < 3; k++) along += (p->at[k] - a->at[3 * i + (size_t)k]) * p->ray[k];
        cost += p->ray_information * along * along / 2;
    }
    return cost;
}

/* 2. The step */

/* dX = -L^-T (y + Z^T xi), xi of views and lenses */
static void move_point(sf_bundle_work *a, size_t at) {
    const double *L = a->sums[at].L;
    double x[3], *to = a->b->points[at].at;
    if (!(L[0] > 0)) return;
    memcpy(x, a->sums[at].y, sizeof x);
    for (size_t i = a->first[at]; i < a->first[at + 1]; i++) {
        if (a->rank_of[i] == UINT32_MAX) continue;
        const double *xi = a->eq.g + SF_TWIST * (size_t)a->rank_of[i];
        for (int l = 0; l < 3; l++)
            for (int k = 0; k < SF_TWIST; k++) x[l] += a->Z[i][SF_TWIST * l + k] * xi[k];
    }
    for (size_t s = a->first_slot ? a->first_slot[at] : 0; a->first_slot && s < a->first_slot[at + 1]; s++) {
        const sf_bundle_columns *c = &a->columns[a->slots[s].camera];
        const double *xi = a->eq.g + SF_TWIST * a->free_count + c->first;
        for (int k = 0; k < c->count; k++)
            for (int l = 0; l < 3; l++) x[l] += a->slots[s].Z[3 * k + l] * xi[k];
    }
    x[2] /= L[5];
    x[1] = (x[1] - L[4] * x[2]) / L[2];
    x[0] = (x[0] - L[1] * x[1] - L[3] * x[2]) / L[0];
    for (int k = 0; k < 3; k++) to[k] -= x[k];
}

static void move_task(void *pointer, size_t chunk, int thread) {
    sf_bundle_work *a = pointer;
    (void)thread;
    for (size_t at = chunk * CHUNK; at < end_of_chunk(a, chunk); at++) move_point(a, at);
}

static void use_lenses(const sf_bundle_work *a) {
    for (size_t i = 0; a->b->camera_count && i < a->b->view_count; i++)
        a->b->views[i].lens = a->b->cameras[a->b->views[i].camera].lens;
}

static void move_lenses(const sf_bundle_work *a) {
    for (size_t i = 0; i < a->b->camera_count; i++) {
        const sf_bundle_columns *c = &a->columns[i];
        sf_lens *lens = &a->b->cameras[i].lens;
        for (int k = 0; k < c->count; k++)
            *sf_bundle_parameter(lens, c->which[k]) +=
                a->eq.g[SF_TWIST * a->free_count + c->first + (size_t)k];
        if (c->is_tied) lens->fy = c->aspect * lens->fx;
    }
    use_lenses(a);
}

static void step(sf_bundle_work *a) {
    sf_pool_run(a->ctx->pool, chunks_of(a), move_task, a);
    for (size_t i = 0; i < a->b->view_count; i++)
        if (a->rank[i] != SIZE_MAX) sf_rigid_move(&a->b->views[i].pose, a->eq.g + SF_TWIST * a->rank[i]);
    move_lenses(a);
    measure_distances(a);
}

static void keep(const sf_bundle_work *a, double *at) {
    for (size_t i = 0; i < a->b->view_count; i++) a->poses[i] = a->b->views[i].pose;
    for (size_t i = 0; i < a->b->camera_count; i++) a->cameras[i] = a->b->cameras[i];
    for (size_t i = 0; i < a->b->point_count; i++)
        memcpy(at + 3 * i, a->b->points[i].at, sizeof a->b->points[i].at);
}

static void restore(const sf_bundle_work *a, const double *at) {
    for (size_t i = 0; i < a->b->view_count; i++) a->b->views[i].pose = a->poses[i];
    for (size_t i = 0; i < a->b->camera_count; i++) a->b->cameras[i] = a->cameras[i];
    use_lenses(a);
    for (size_t i = 0; i < a->b->point_count; i++)
        memcpy(a->b->points[i].at, at + 3 * i, sizeof a->b->points[i].at);
}

static void adjust(sf_bundle_work *a, int rounds) {
    const sf_bundle *b = a->b;
    double *before = a->at + 3 * b->point_count, damp = FIRST_DAMP;
    double enough = b->enough > 0 ? b->enough : ENOUGH;
    use_lenses(a);
    keep(a, a->at);
    measure_distances(a);
    a->spread = spread_of(a);
    double cost = cost_of(a);
    for (int round = 0; round < rounds && damp < MOST_DAMP; round++) {
        keep(a, before);
        a->damp = damp;
        sf_bundle_equations_fill(a);
        int solved = sf_bundle_equations_solve(a->ctx, &a->eq);
        if (solved) step(a);
        double now = solved ? cost_of(a) : INFINITY;
        if (!(now < cost)) {
            restore(a, before);
            damp *= 10;
            continue;
        }
        double gained = cost - now, spread = spread_of(a);
        cost = now, damp = fmax(damp / 10, 1e-9);
        if (fabs(spread / a->spread - 1) > 0.1) { /* costs of another spread do not compare */
            a->spread = spread, cost = cost_of(a);
            continue;
        }
        if (gained < enough * cost) break;
    }
    measure_distances(a);
    a->spread = spread_of(a);
}

sf_status sf_bundle_adjust(sf_context *ctx, const sf_bundle *b, int rounds, double *spread) {
    sf_bundle_work a = {.ctx = ctx, .b = b};
    int ready = sf_bundle_work_make(&a);
    if (ready && b->observation_count) adjust(&a, rounds);
    *spread = a.spread;
    sf_bundle_work_free(&a);
    return ready ? SF_OK : SF_ERR_MEMORY;
}
