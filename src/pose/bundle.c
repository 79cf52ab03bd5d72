/* bundle.c - see bundle.h. Points meet each other only through the poses, so that they are taken out of the
 * normal equations first (Schur). Tasks are of points, or of views with their rows of the equations: no sum
 * is of two tasks, and all are the same for any number of threads. */
#include "bundle.h"

#include <math.h>
#include <string.h>

#include "../base/linear.h"
#include "../base/pool.h"

enum {
    LEAST_SPREAD_COUNT = 8,
    CHUNK = 64 /* points a task */
};

#define FIRST_DAMP 1e-4
#define MOST_DAMP  1e8
#define ENOUGH     5e-4 /* part of the cost that a step takes off, to go on */
#define CROSS      (3 * SF_TWIST)

/* The sums of one point, kept for the way back. */
typedef struct point_sums {
    double V[9], g[3]; /* the inverse; the gradient */
} point_sums;

typedef struct adjustment {
    sf_context *ctx;
    const sf_bundle *b;
    size_t *rank; /* [views]: among the free ones, SIZE_MAX of others */
    size_t free_count;
    size_t *first;      /* [points + 1]: each one's first observation */
    size_t *of_view;    /* [observations]: those of the free views, by view; */
    size_t *from;       /* [free + 1]: each one's first there */
    double *S, *g;      /* [6 free][6 free], [6 free] */
    double *U;          /* [free][6][6]: before points are taken out */
    double (*W)[CROSS]; /* [observations]: pose by point */
    point_sums *sums;   /* [points] */
    sf_rigid *poses;    /* [views], and */
    double *at;         /* [points][3]: before the step */
    double *distances;  /* [observations], px, */
    double *finite;     /* and those that are finite, for their median */
    double spread, damp;
} adjustment;

/* 1. One observation */

int sf_bundle_pixel(const sf_bundle_view *view, const double p[3], double pixel[2]) {
    if (!(p[2] > 1e-9)) return 0;
    pixel[0] = view->fx * p[0] / p[2] + view->cx;
    pixel[1] = view->fy * p[1] / p[2] + view->cy;
    return 1;
}

double sf_bundle_distance(const sf_bundle_view *view, const double at[3], double u, double v) {
    double p[3], pixel[2];
    sf_rigid_apply(&view->pose, at, p);
    return sf_bundle_pixel(view, p, pixel) ? sqrt(pow(pixel[0] - u, 2) + pow(pixel[1] - v, 2)) : INFINITY;
}

void sf_bundle_derive(const sf_bundle_view *view, const double p[3], double J[2 * SF_TWIST], double d[6]) {
    const double by_p[2][3] = {{view->fx / p[2], 0, -view->fx * p[0] / (p[2] * p[2])},
                               {0, view->fy / p[2], -view->fy * p[1] / (p[2] * p[2])}};
    for (int i = 0; i < 2; i++) {
        memcpy(J + SF_TWIST * i, by_p[i], sizeof by_p[i]);
        sf_cross3(p, by_p[i], J + SF_TWIST * i + 3); /* d . (phi x p) = phi . (p x d) */
    }
    if (d) memcpy(d, by_p, sizeof by_p);
}

/* The residual, and its derivatives by the pose's twist [2][6] and by the point [2][3]. */
static int derive(const sf_bundle_view *view, const sf_bundle_point *point, const sf_bundle_observation *s,
                  double r[2], double J[2 * SF_TWIST], double K[6]) {
    double p[3], pixel[2], d[6];
    const double *R = view->pose.R;
    sf_rigid_apply(&view->pose, point->at, p);
    if (!sf_bundle_pixel(view, p, pixel)) return 0;
    r[0] = pixel[0] - s->u, r[1] = pixel[1] - s->v;
    sf_bundle_derive(view, p, J, d);
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 3; k++)
            K[3 * i + k] = d[3 * i] * R[k] + d[3 * i + 1] * R[3 + k] + d[3 * i + 2] * R[6 + k];
    return 1;
}

/* 2. The cost */

static size_t chunks_of(const adjustment *a) { return (a->b->point_count + CHUNK - 1) / CHUNK; }

static size_t end_of_chunk(const adjustment *a, size_t chunk) {
    size_t end = (chunk + 1) * CHUNK;
    return end < a->b->point_count ? end : a->b->point_count;
}

static void distances_task(void *pointer, size_t chunk, int thread) {
    adjustment *a = pointer;
    (void)thread;
    for (size_t i = a->first[chunk * CHUNK]; i < a->first[end_of_chunk(a, chunk)]; i++) {
        const sf_bundle_observation *s = &a->b->observations[i];
        a->distances[i] = sf_bundle_distance(&a->b->views[s->view], a->b->points[s->point].at, s->u, s->v);
    }
}

static void measure_distances(adjustment *a) { sf_pool_run(a->ctx->pool, chunks_of(a), distances_task, a); }

/* The spread of all distances, by their median. */
static double spread_of(adjustment *a) {
    size_t count = 0;
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

static double cost_of(const adjustment *a) {
    double cost = 0, c2 = pow(SF_CAUCHY * a->spread, 2), far = 20 * SF_CAUCHY * a->spread;
    for (size_t i = 0; i < a->b->observation_count; i++) {
        double d = fmin(a->distances[i], far);
        cost += c2 * log1p(d * d / c2) / 2 / (a->spread * a->spread);
    }
    for (size_t i = 0; i < a->b->view_count; i++) cost += prior_cost(&a->b->views[i]);
    for (size_t i = 0; i < a->b->point_count; i++) {
        const sf_bundle_point *p = &a->b->points[i];
        double along = 0;
        for (int k = 0; k < 3; k++) along += (p->at[k] - a->at[3 * i + k]) * p->ray[k];
        cost += p->ray_information * along * along / 2;
    }
    return cost;
}

/* 3. The normal equations */

/* Its weight. */
static double weight_of(const adjustment *a, const double r[2]) {
    double c2 = pow(SF_CAUCHY * a->spread, 2);
    return c2 / (c2 + r[0] * r[0] + r[1] * r[1]) / (a->spread * a->spread);
}

/* A observation's part in the sums of its point. */
static void add_observation(adjustment *a, size_t i, double V[9], double g[3]) {
    const sf_bundle_observation *s = &a->b->observations[i];
    double r[2], J[2 * SF_TWIST], K[6];
    memset(a->W[i], 0, sizeof a->W[i]);
    if (!derive(&a->b->views[s->view], &a->b->points[s->point], s, r, J, K)) return;
    double w = weight_of(a, r);
    for (int k = 0; k < 3; k++) {
        g[k] += w * (K[k] * r[0] + K[3 + k] * r[1]);
        for (int l = 0; l < 3; l++) V[3 * k + l] += w * (K[k] * K[l] + K[3 + k] * K[3 + l]);
    }
    for (int k = 0; k < SF_TWIST; k++)
        for (int l = 0; l < 3; l++)
            a->W[i][SF_TWIST * l + k] = w * (J[k] * K[l] + J[SF_TWIST + k] * K[3 + l]);
}

/* And in those of its view. */
static void add_to_view(adjustment *a, size_t i, double U[36], double e[SF_TWIST]) {
    const sf_bundle_observation *s = &a->b->observations[i];
    double r[2], J[2 * SF_TWIST], K[6];
    if (!derive(&a->b->views[s->view], &a->b->points[s->point], s, r, J, K)) return;
    double w = weight_of(a, r);
    for (int k = 0; k < SF_TWIST; k++) {
        double x = w * J[k], y = w * J[SF_TWIST + k];
        e[k] += x * r[0] + y * r[1];
        for (int l = 0; l < SF_TWIST; l++) U[6 * k + l] += x * J[l] + y * J[SF_TWIST + l];
    }
}

static void add_priors(adjustment *a) {
    for (size_t i = 0; i < a->b->view_count; i++) {
        const sf_bundle_view *view = &a->b->views[i];
        double off[SF_TWIST];
        if (!view->is_free || !view->is_known) continue;
        sf_rigid_twist(&view->prior.pose, &view->pose, off);
        for (int k = 0; k < SF_TWIST; k++)
            for (int l = 0; l < SF_TWIST; l++) {
                double information = view->prior.information[k * SF_TWIST + l];
                a->U[36 * a->rank[i] + (size_t)(SF_TWIST * k + l)] += information;
                a->g[6 * a->rank[i] + (size_t)k] += information * off[l];
            }
    }
}

/* S -= W_i V^-1 W_j^T, for an observation and all of its point's; the lower triangle. */
static void take_out(adjustment *a, size_t row, size_t i) {
    size_t n = 6 * a->free_count, point = a->b->observations[i].point;
    const point_sums *sums = &a->sums[point];
    const double *W = a->W[i];
    double Y[CROSS];
    for (int k = 0; k < SF_TWIST; k++) {
        const double w[3] = {W[k], W[SF_TWIST + k], W[2 * SF_TWIST + k]};
        for (int l = 0; l < 3; l++) Y[3 * k + l] = sf_dot3(w, sums->V + 3 * l);
        a->g[6 * row + (size_t)k] -= sf_dot3(Y + 3 * k, sums->g);
    }
    for (size_t j = a->first[point]; j < a->first[point + 1]; j++) {
        size_t column = a->rank[a->b->observations[j].view];
        if (column == SIZE_MAX || column > row) continue;
        const double *x = a->W[j], *y = x + SF_TWIST, *z = y + SF_TWIST;
        for (size_t k = 0; k < SF_TWIST; k++) {
            double *S = a->S + (6 * row + k) * n + 6 * column;
            for (size_t l = 0; l < SF_TWIST; l++)
                S[l] -= Y[3 * k] * x[l] + Y[3 * k + 1] * y[l] + Y[3 * k + 2] * z[l];
        }
    }
}

static void add_point(adjustment *a, size_t at) {
    const sf_bundle_point *p = &a->b->points[at];
    point_sums *sums = &a->sums[at];
    double V[9] = {0}, L[9];
    memset(sums, 0, sizeof *sums);
    for (size_t i = a->first[at]; i < a->first[at + 1]; i++) add_observation(a, i, V, sums->g);
    double along = 0;
    for (int k = 0; k < 3; k++) along += (p->at[k] - a->at[3 * at + (size_t)k]) * p->ray[k];
    for (int k = 0; k < 3; k++) {
        sums->g[k] += p->ray_information * along * p->ray[k];
        for (int l = 0; l < 3; l++) V[3 * k + l] += p->ray_information * p->ray[k] * p->ray[l];
    }
    for (int k = 0; k < 3; k++) V[4 * k] *= 1 + a->damp;
    memcpy(L, V, sizeof L);
    if (sf_cholesky(3, L)) sf_cholesky_invert(3, L, sums->V); /* else it stays where it is */
}

static void points_task(void *pointer, size_t chunk, int thread) {
    adjustment *a = pointer;
    (void)thread;
    for (size_t at = chunk * CHUNK; at < end_of_chunk(a, chunk); at++) add_point(a, at);
}

/* A view's rows of the equations, its prior not in them. */
static void rows_task(void *pointer, size_t row, int thread) {
    adjustment *a = pointer;
    size_t n = 6 * a->free_count;
    double *U = a->U + 36 * row, *e = a->g + 6 * row;
    (void)thread;
    memset(a->S + 6 * row * n, 0, 6 * n * sizeof *a->S);
    memset(U, 0, 36 * sizeof *U);
    memset(e, 0, 6 * sizeof *e);
    for (size_t k = a->from[row]; k < a->from[row + 1]; k++) {
        add_to_view(a, a->of_view[k], U, e);
        take_out(a, row, a->of_view[k]);
    }
}

static int solve(adjustment *a, double damp) {
    size_t n = 6 * a->free_count;
    a->damp = damp;
    sf_pool_run(a->ctx->pool, chunks_of(a), points_task, a);
    sf_pool_run(a->ctx->pool, a->free_count, rows_task, a);
    add_priors(a);
    for (size_t i = 0; i < a->free_count; i++)
        for (size_t k = 0; k < SF_TWIST; k++)
            for (size_t l = 0; l < SF_TWIST; l++)
                a->S[(6 * i + k) * n + 6 * i + l] += a->U[36 * i + 6 * k + l] * (k == l ? 1 + damp : 1);
    if (!sf_cholesky((int)n, a->S)) return 0;
    sf_cholesky_solve((int)n, a->S, a->g);
    for (size_t k = 0; k < n; k++) a->g[k] = -a->g[k];
    return 1;
}

/* 4. The step */

/* dX = V^-1 (-g - W^T xi) */
static void move_points(adjustment *a) {
    for (size_t at = 0; at < a->b->point_count; at++) {
        double rhs[3], step[3];
        for (int k = 0; k < 3; k++) rhs[k] = -a->sums[at].g[k];
        for (size_t i = a->first[at]; i < a->first[at + 1]; i++) {
            size_t rank = a->rank[a->b->observations[i].view];
            if (rank == SIZE_MAX) continue;
            for (size_t l = 0; l < 3; l++)
                for (size_t k = 0; k < SF_TWIST; k++)
                    rhs[l] -= a->W[i][SF_TWIST * l + k] * a->g[6 * rank + k];
        }
        sf_mat3_vec(a->sums[at].V, rhs, step);
        for (int k = 0; k < 3; k++) a->b->points[at].at[k] += step[k];
    }
}

static void step(adjustment *a) {
    move_points(a);
    for (size_t i = 0; i < a->b->view_count; i++)
        if (a->rank[i] != SIZE_MAX) sf_rigid_move(&a->b->views[i].pose, a->g + 6 * a->rank[i]);
    measure_distances(a);
}

static void keep(const adjustment *a, sf_rigid *poses, double *at) {
    for (size_t i = 0; i < a->b->view_count; i++) poses[i] = a->b->views[i].pose;
    for (size_t i = 0; i < a->b->point_count; i++)
        memcpy(at + 3 * i, a->b->points[i].at, sizeof a->b->points[i].at);
}

static void restore(const adjustment *a, const sf_rigid *poses, const double *at) {
    for (size_t i = 0; i < a->b->view_count; i++) a->b->views[i].pose = poses[i];
    for (size_t i = 0; i < a->b->point_count; i++)
        memcpy(a->b->points[i].at, at + 3 * i, sizeof a->b->points[i].at);
}

static void adjust(adjustment *a, int rounds) {
    const sf_bundle *b = a->b;
    double *before = a->at + 3 * b->point_count, damp = FIRST_DAMP;
    sf_rigid *poses = a->poses;
    keep(a, poses, a->at);
    measure_distances(a);
    a->spread = spread_of(a);
    double cost = cost_of(a);
    for (int round = 0; round < rounds && damp < MOST_DAMP; round++) {
        keep(a, poses, before);
        int solved = solve(a, damp);
        if (solved) step(a);
        double now = solved ? cost_of(a) : INFINITY;
        if (!(now < cost)) {
            restore(a, poses, before);
            damp *= 10;
            continue;
        }
        double gained = cost - now, spread = spread_of(a);
        cost = now, damp = fmax(damp / 10, 1e-9);
        if (fabs(spread / a->spread - 1) > 0.1) { /* costs of another spread do not compare */
            a->spread = spread, cost = cost_of(a);
            continue;
        }
        if (gained < ENOUGH * cost) break;
    }
    measure_distances(a);
    a->spread = spread_of(a);
}

/* Where the observations of each point begin, and which are those of each free view. */
static void sort_observations(adjustment *a) {
    const sf_bundle *b = a->b;
    for (size_t i = 0; i < b->observation_count; i++) {
        size_t rank = a->rank[b->observations[i].view];
        a->first[b->observations[i].point + 1]++;
        if (rank != SIZE_MAX) a->from[rank + 2]++;
    }
    for (size_t i = 1; i <= b->point_count; i++) a->first[i] += a->first[i - 1];
    for (size_t i = 2; i <= a->free_count; i++) a->from[i] += a->from[i - 1];
    for (size_t i = 0; i < b->observation_count; i++) {
        size_t rank = a->rank[b->observations[i].view];
        if (rank != SIZE_MAX) a->of_view[a->from[rank + 1]++] = i;
    }
}

static int make_room(adjustment *a) {
    const sf_bundle *b = a->b;
    size_t n = 6 * a->free_count;
    a->first = sf_calloc(a->ctx, b->point_count + 1, sizeof *a->first);
    a->of_view = sf_alloc(a->ctx, b->observation_count + 1, sizeof *a->of_view);
    a->from = sf_calloc(a->ctx, a->free_count + 2, sizeof *a->from);
    a->S = sf_alloc(a->ctx, n * n + 1, sizeof *a->S);
    a->g = sf_alloc(a->ctx, n + 1, sizeof *a->g);
    a->U = sf_alloc(a->ctx, 36 * a->free_count + 1, sizeof *a->U);
    a->W = sf_alloc(a->ctx, b->observation_count + 1, sizeof *a->W);
    a->sums = sf_alloc(a->ctx, b->point_count + 1, sizeof *a->sums);
    a->poses = sf_alloc(a->ctx, b->view_count + 1, sizeof *a->poses);
    a->at = sf_alloc(a->ctx, 6 * b->point_count + 1, sizeof *a->at);
    a->distances = sf_alloc(a->ctx, b->observation_count + 1, sizeof *a->distances);
    a->finite = sf_alloc(a->ctx, b->observation_count + 1, sizeof *a->finite);
    return a->first && a->of_view && a->from && a->finite && a->S && a->g && a->U && a->W && a->sums &&
           a->poses && a->at && a->distances;
}

static void free_all(adjustment *a) {
    void *const blocks[] = {a->rank, a->first, a->of_view, a->from, a->S,         a->g,     a->U,
                            a->W,    a->sums,  a->poses,   a->at,   a->distances, a->finite};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) sf_free(a->ctx, blocks[i]);
}

sf_status sf_bundle_adjust(sf_context *ctx, const sf_bundle *b, int rounds, double *spread) {
    adjustment a = {.ctx = ctx, .b = b};
    a.rank = sf_alloc(ctx, b->view_count + 1, sizeof *a.rank);
    for (size_t i = 0; a.rank && i < b->view_count; i++)
        a.rank[i] = b->views[i].is_free ? a.free_count++ : SIZE_MAX;
    int ready = a.rank && make_room(&a);
    if (ready) sort_observations(&a);
    if (ready && b->observation_count) adjust(&a, rounds);
    *spread = a.spread;
    free_all(&a);
    return ready ? SF_OK : SF_ERR_MEMORY;
}
