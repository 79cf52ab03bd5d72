/* bundle_equations.c - see bundle_equations.h. Points meet each other only through views and lenses, so that
 * they are taken out of the equations first (Schur). Tasks are groups of points, and then rows of the
 * equations: no sum is of two tasks, and all are the same for any number of threads. */
#include "bundle_equations.h"

#include <math.h>
#include <string.h>

#include "../base/linear.h"
#include "../base/pool.h"
#include "../kernels/kernels.h"

enum {
    LENS = SF_LENS_PARAMETERS,
    AHEAD = 4,       /* observations that are fetched before they are needed */
    TOGETHER = 2048, /* observations whose Z, 144 bytes each, stay in a cache */
};

double *sf_bundle_parameter(sf_lens *lens, int which) {
    double *const all[LENS] = {&lens->fx, &lens->fy, &lens->cx, &lens->cy,
                               &lens->k1, &lens->k2, &lens->p1, &lens->p2};
    return all[which];
}

/* 1. One observation */

typedef struct derivatives {
    double w, r[2];                    /* weight, residual */
    double J[2 * SF_TWIST], K[6];      /* by the pose's twist [2][6], by the point [2][3], */
    double all[2 * LENS], L[2 * LENS]; /* by all parameters of the lens, and by those that are free [2][n] */
} derivatives;

static int derive(const sf_bundle_view *view, const double at[3], const sf_bundle_observation *s,
                  int with_lens, derivatives *d) {
    double p[3], pixel[2], by_p[6];
    const double *R = view->pose.R;
    sf_rigid_apply(&view->pose, at, p);
    if (!(p[2] > SF_BUNDLE_NEAREST) ||
        !sf_lens_project(&view->lens, p, pixel, by_p, with_lens ? d->all : NULL))
        return 0;
    d->r[0] = pixel[0] - s->u, d->r[1] = pixel[1] - s->v;
    sf_twist_derivative(by_p, p, d->J);
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 3; k++)
            d->K[3 * i + k] = by_p[3 * i] * R[k] + by_p[3 * i + 1] * R[3 + k] + by_p[3 * i + 2] * R[6 + k];
    return 1;
}

/* The columns of a camera out of those of all parameters. */
static void choose_columns(const sf_bundle_columns *c, derivatives *d) {
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < c->count; k++) {
            d->L[c->count * i + k] = d->all[LENS * i + c->which[k]];
            if (c->is_tied && c->which[k] == 0) d->L[c->count * i + k] += c->aspect * d->all[LENS * i + 1];
        }
}

static double weight_of(const sf_bundle_work *a, const double r[2]) {
    double s2 = a->spread * a->spread;
    return sf_cauchy_weight(r[0] * r[0] + r[1] * r[1], SF_CAUCHY * SF_CAUCHY * s2) / s2;
}

static void add_to_view(const derivatives *d, sf_bundle_view_sums *to) {
    const double *J = d->J;
    for (int k = 0; k < SF_TWIST; k++) {
        double x = d->w * J[k], y = d->w * J[SF_TWIST + k];
        to->e[k] += x * d->r[0] + y * d->r[1];
        for (int l = 0; l <= k; l++) to->U[SF_TWIST * k + l] += x * J[l] + y * J[SF_TWIST + l];
    }
}

/* view: NULL of one that is not free. */
static void add_to_lens(const derivatives *d, int n, sf_bundle_view_sums *view, sf_bundle_camera_sums *camera,
                        sf_bundle_slot *slot) {
    const double *L = d->L, *K = d->K, *J = d->J;
    for (int k = 0; k < n; k++) {
        double x = d->w * L[k], y = d->w * L[n + k];
        camera->e[k] += x * d->r[0] + y * d->r[1];
        for (int l = 0; l <= k; l++) camera->U[LENS * k + l] += x * L[l] + y * L[n + l];
        for (int l = 0; l < 3; l++) slot->Z[3 * k + l] += x * K[l] + y * K[3 + l];
        for (int l = 0; view && l < SF_TWIST; l++)
            view->lens[SF_TWIST * k + l] += x * J[l] + y * J[SF_TWIST + l];
    }
}

/* 2. One point */

/* An observation's part in all sums but those of other points; Z is of pose by point, for now. */
static void add_observation(sf_bundle_work *a, size_t i, size_t group, double V[9], double g[3]) {
    const sf_bundle_observation *s = &a->b->observations[i];
    const sf_bundle_view *view = &a->b->views[s->view];
    const sf_bundle_columns *c = a->first_slot ? &a->columns[view->camera] : NULL;
    uint32_t rank = a->rank_of[i];
    double *Z = a->Z[i];
    derivatives d;
    memset(Z, 0, sizeof a->Z[i]);
    if (!derive(view, a->b->points[s->point].at, s, c && c->count, &d)) return;
    const double *J = d.J, *K = d.K, w = d.w = weight_of(a, d.r);
    for (int k = 0; k < 3; k++) {
        g[k] += w * (K[k] * d.r[0] + K[3 + k] * d.r[1]);
        for (int l = 0; l <= k; l++) V[3 * k + l] += w * (K[k] * K[l] + K[3 + k] * K[3 + l]);
    }
    sf_bundle_view_sums *sums = rank == UINT32_MAX ? NULL : &a->view_sums[group * a->free_count + rank];
    if (sums) {
        add_to_view(&d, sums);
        for (int l = 0; l < 3; l++)
            for (int k = 0; k < SF_TWIST; k++)
                Z[SF_TWIST * l + k] = w * (J[k] * K[l] + J[SF_TWIST + k] * K[3 + l]);
    }
    if (!c || !c->count) return;
    choose_columns(c, &d);
    add_to_lens(&d, c->count, sums, &a->camera_sums[group * a->b->camera_count + view->camera],
                &a->slots[a->slot_of[i]]);
}

/* V = L L^T and y = L^-1 g. 0: V is not positive definite. */
static int factor(const double V[9], const double g[3], double damp, sf_bundle_point_sums *to) {
    double A[9], *L = to->L, *y = to->y;
    memcpy(A, V, sizeof A);
    for (int k = 0; k < 3; k++) A[4 * k] *= 1 + damp;
    memset(to, 0, sizeof *to);
    if (!sf_cholesky(3, A)) return 0;
    L[0] = A[0], L[1] = A[3], L[2] = A[4], L[3] = A[6], L[4] = A[7], L[5] = A[8];
    y[0] = g[0] / L[0];
    y[1] = (g[1] - L[1] * y[0]) / L[2];
    y[2] = (g[2] - L[3] * y[0] - L[4] * y[1]) / L[5];
    return 1;
}

/* Z = W L^-T in place of W, its three columns `stride` apart and their n entries `next`; e -= Z y. */
static void divide(const sf_bundle_point_sums *s, double *Z, size_t n, size_t stride, size_t next,
                   double *e) {
    const double *L = s->L, a = L[0] > 0 ? 1 / L[0] : 0, b = L[0] > 0 ? 1 / L[2] : 0;
    const double c = L[0] > 0 ? 1 / L[5] : 0;
    for (size_t k = 0; k < n; k++, Z += next) {
        double x = Z[0] * a, y = (Z[stride] - L[1] * x) * b, z = (Z[2 * stride] - L[3] * x - L[4] * y) * c;
        Z[0] = x, Z[stride] = y, Z[2 * stride] = z;
        if (e) e[k] -= x * s->y[0] + y * s->y[1] + z * s->y[2];
    }
}

static void add_point(sf_bundle_work *a, size_t at, size_t group) {
    const sf_bundle_point *p = &a->b->points[at];
    sf_bundle_point_sums *sums = &a->sums[at];
    double V[9] = {0}, g[3] = {0};
    size_t slot = a->first_slot ? a->first_slot[at] : 0, end = a->first_slot ? a->first_slot[at + 1] : 0;
    for (size_t s = slot; s < end; s++) memset(a->slots[s].Z, 0, sizeof a->slots[s].Z);
    for (size_t i = a->first[at]; i < a->first[at + 1]; i++) add_observation(a, i, group, V, g);
    if (p->ray_information > 0) {
        double along = 0;
        for (int k = 0; k < 3; k++) along += (p->at[k] - a->at[3 * at + (size_t)k]) * p->ray[k];
        for (int k = 0; k < 3; k++) {
            g[k] += p->ray_information * along * p->ray[k];
            for (int l = 0; l <= k; l++) V[3 * k + l] += p->ray_information * p->ray[k] * p->ray[l];
        }
    }
    factor(V, g, a->damp, sums); /* where it cannot, Z is 0, and the point stays where it is */
    for (size_t i = a->first[at]; i < a->first[at + 1]; i++)
        if (a->rank_of[i] != UINT32_MAX)
            divide(sums, a->Z[i], SF_TWIST, SF_TWIST, 1,
                   a->view_sums[group * a->free_count + a->rank_of[i]].e);
    for (size_t s = slot; s < end; s++) {
        uint32_t camera = a->slots[s].camera;
        divide(sums, a->slots[s].Z, (size_t)a->columns[camera].count, 1, 3,
               a->camera_sums[group * a->b->camera_count + camera].e);
    }
}

static void points_task(void *pointer, size_t group, int thread) {
    sf_bundle_work *a = pointer;
    size_t points = a->b->point_count, cameras = a->b->camera_count;
    (void)thread;
    memset(a->view_sums + group * a->free_count, 0, a->free_count * sizeof *a->view_sums);
    memset(a->camera_sums + group * cameras, 0, cameras * sizeof *a->camera_sums);
    for (size_t at = points * group / SF_BUNDLE_GROUPS; at < points * (group + 1) / SF_BUNDLE_GROUPS; at++)
        add_point(a, at, group);
}

/* 3. A view's row of the equations */

/* The sums of all groups, and the prior: the block on the diagonal, the gradient, and the border. */
static void begin_row(sf_bundle_work *a, size_t row, double *diagonal, double *border) {
    const sf_bundle_view *view = &a->b->views[a->view_of[row]];
    double *g = a->eq.g + SF_TWIST * row, off[SF_TWIST];
    const sf_bundle_columns *c = a->first_slot ? &a->columns[view->camera] : NULL;
    memset(diagonal, 0, 36 * sizeof *diagonal), memset(g, 0, SF_TWIST * sizeof *g);
    memset(border, 0, a->eq.lens_columns * SF_TWIST * sizeof *border);
    for (size_t group = 0; group < SF_BUNDLE_GROUPS; group++) {
        const sf_bundle_view_sums *s = &a->view_sums[group * a->free_count + row];
        for (int k = 0; k < 36; k++) diagonal[k] += s->U[k];
        for (int k = 0; k < SF_TWIST; k++) g[k] += s->e[k];
        for (size_t k = 0; c && k < SF_TWIST * (size_t)c->count; k++)
            border[SF_TWIST * c->first + k] += s->lens[k];
    }
    if (view->is_known) {
        sf_rigid_twist(&view->prior.pose, &view->pose, off);
        for (int k = 0; k < SF_TWIST; k++)
            for (int l = 0; l < SF_TWIST; l++) {
                double information = view->prior.information[SF_TWIST * k + l];
                g[k] += information * off[l];
                if (l <= k) diagonal[SF_TWIST * k + l] += information;
            }
    }
    for (int k = 0; k < SF_TWIST; k++) diagonal[7 * k] *= 1 + a->damp;
}

/* Takes a point out of the row of a view that sees it. */
static void take_out(sf_bundle_work *a, size_t row, const sf_bundle_row_entry *s, const uint32_t *table,
                     double *border) {
    const double *Z = a->Z[s->observation];
    const sf_schur_args args = {.Y = Z,
                                .Z = a->Z[s->first],
                                .rank = a->rank_of + s->first,
                                .count = s->end - s->first,
                                .last = (uint32_t)row,
                                .table = table,
                                .blocks = a->eq.blocks};
    a->ctx->kernels->schur(&args);
    if (!a->first_slot) return;
    for (size_t m = a->first_slot[s->point]; m < a->first_slot[s->point + 1]; m++) {
        const sf_bundle_columns *c = &a->columns[a->slots[m].camera];
        const double *lens = a->slots[m].Z;
        double *to = border + SF_TWIST * c->first;
        for (int n = 0; n < c->count; n++, lens += 3, to += SF_TWIST)
            for (int k = 0; k < SF_TWIST; k++)
                to[k] -= lens[0] * Z[k] + lens[1] * Z[SF_TWIST + k] + lens[2] * Z[2 * SF_TWIST + k];
    }
}

/* What take_out will read lies scattered over more than a cache holds. */
static void fetch(const sf_bundle_work *a, const sf_bundle_row_entry *s) {
    const char *at = (const char *)a->Z[s->first], *end = (const char *)a->Z[s->end];
    __builtin_prefetch(&a->rank_of[s->first]);
    if (a->first_slot) __builtin_prefetch(&a->first_slot[s->point]);
    for (; at < end; at += 64) __builtin_prefetch(at);
}

static void view_row(sf_bundle_work *a, size_t row, uint32_t *table) {
    sf_bundle_equations *eq = &a->eq;
    size_t begin = eq->begin[row], end = eq->begin[row + 1]; /* the last one is on the diagonal */
    memset(eq->blocks + 36 * begin, 0, 36 * (end - begin) * sizeof *eq->blocks);
    for (size_t k = begin; k < end; k++) table[eq->column[k]] = (uint32_t)k;
    begin_row(a, row, eq->blocks + 36 * (end - 1), eq->border + row * eq->lens_columns * SF_TWIST);
}

/* The points whose observations begin before `limit`, out of a row; `at` is the row's next point. */
static size_t take_points_out(sf_bundle_work *a, size_t row, size_t at, size_t limit, const uint32_t *table) {
    double *border = a->eq.border + row * a->eq.lens_columns * SF_TWIST;
    for (; at < a->from[row + 1] && a->of_view[at].first < limit; at++) {
        if (at + AHEAD < a->from[row + 1]) fetch(a, &a->of_view[at + AHEAD]);
        take_out(a, row, &a->of_view[at], table, border);
    }
    return at;
}

/* All Z of a large bundle take more than a cache holds, so some rows share what it holds at a time; each row
 * takes its points in their order all the same. */
static void view_rows(sf_bundle_work *a, size_t first, size_t end, int thread) {
    uint32_t *tables = a->eq.table + (size_t)thread * SF_BUNDLE_ROWS * a->eq.rows;
    size_t at[SF_BUNDLE_ROWS], observations = a->b->observation_count;
    for (size_t row = first; row < end; row++) {
        at[row - first] = a->from[row];
        view_row(a, row, tables + (row - first) * a->eq.rows);
    }
    for (size_t limit = TOGETHER; limit < observations + TOGETHER; limit += TOGETHER)
        for (size_t row = first; row < end; row++)
            at[row - first] =
                take_points_out(a, row, at[row - first], limit, tables + (row - first) * a->eq.rows);
}

/* 4. A camera's rows */

static void begin_camera(sf_bundle_work *a, size_t camera, double *corner, double *g) {
    sf_bundle_camera *at = &a->b->cameras[camera];
    const sf_bundle_columns *c = &a->columns[camera];
    for (size_t k = 0; k < (size_t)c->count; k++) {
        double information = at->information[c->which[k]];
        double value = *sf_bundle_parameter(&at->lens, c->which[k]);
        double *row = corner + (c->first + k) * a->eq.lens_columns;
        memset(row, 0, a->eq.lens_columns * sizeof *row);
        g[k] = information * (value - at->prior[c->which[k]]);
        for (size_t group = 0; group < SF_BUNDLE_GROUPS; group++) {
            const sf_bundle_camera_sums *s = &a->camera_sums[group * a->b->camera_count + camera];
            g[k] += s->e[k];
            for (size_t l = 0; l <= k; l++) row[c->first + l] += s->U[LENS * k + l];
        }
        row[c->first + k] = (row[c->first + k] + information) * (1 + a->damp);
    }
}

static void camera_rows(sf_bundle_work *a, size_t camera) {
    const sf_bundle_columns *c = &a->columns[camera];
    double *corner = a->eq.corner, *g = a->eq.g + SF_TWIST * a->eq.rows + c->first;
    if (!c->count) return;
    begin_camera(a, camera, corner, g);
    for (size_t i = a->camera_from[camera]; i < a->camera_from[camera + 1]; i++) {
        const sf_bundle_slot *slot = &a->slots[a->camera_slots[i]];
        for (size_t s = a->first_slot[slot->point]; s < a->first_slot[slot->point + 1]; s++) {
            const sf_bundle_slot *other = &a->slots[s];
            const sf_bundle_columns *d = &a->columns[other->camera];
            if (other->camera > camera) continue;
            for (size_t k = 0; k < (size_t)c->count; k++)
                for (size_t l = 0; l < (size_t)d->count; l++)
                    corner[(c->first + k) * a->eq.lens_columns + d->first + l] -=
                        sf_dot3(slot->Z + 3 * k, other->Z + 3 * l);
        }
    }
}

/* As many rows a task as leave each thread several: those of the last views are the longest. */
static size_t rows_of_task(const sf_bundle_work *a) {
    size_t rows = a->eq.rows / (8 * (size_t)sf_pool_threads(a->ctx->pool));
    return rows < 1 ? 1 : rows > SF_BUNDLE_ROWS ? SF_BUNDLE_ROWS : rows;
}

static size_t row_tasks(const sf_bundle_work *a) {
    size_t rows = rows_of_task(a);
    return (a->eq.rows + rows - 1) / rows;
}

static void rows_task(void *pointer, size_t task, int thread) {
    sf_bundle_work *a = pointer;
    size_t rows = rows_of_task(a), tasks = row_tasks(a);
    if (task >= tasks) {
        camera_rows(a, task - tasks);
        return;
    }
    size_t end = a->eq.rows - rows * task; /* the longest first */
    view_rows(a, end > rows ? end - rows : 0, end, thread);
}

void sf_bundle_equations_fill(sf_bundle_work *a) {
    sf_pool_run(a->ctx->pool, SF_BUNDLE_GROUPS, points_task, a);
    sf_pool_run(a->ctx->pool, row_tasks(a) + (a->first_slot ? a->b->camera_count : 0), rows_task, a);
}
