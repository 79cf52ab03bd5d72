/* pose_graph.c - see pose_graph.h. */
#include "pose_graph.h"

#include <math.h>
#include <string.h>

#include "../base/linear.h"

enum { N = SF_SIMILAR_TWIST };

#define KNOWN_SCALE 1e6 /* inverse variance of the logarithm of a known pose's scale */
#define FIRST_DAMP  1e-9
#define MOST_DAMP   1e3
#define ENOUGH      1e-6 /* part of the cost that a round takes off, to go on */

/* The normal equations. Rows are stored from their first column that is not 0 on, which is where Cholesky's
 * factor begins, too: most poses are joined to those shortly before them. */
typedef struct equations {
    sf_context *ctx;
    const sf_pose_graph *graph;
    size_t *rank;  /* [poses]: among those that move; SIZE_MAX */
    size_t *first; /* [free]: the first free pose in its rows */
    size_t *begin; /* [n free + 1]: where a row is in `values` */
    double *values, *g;
    sf_similar *before; /* [poses] */
    size_t free_count;
    int n; /* unknowns of a pose */
} equations;

static size_t first_column(const equations *e, size_t row) {
    return e->first[row / (size_t)e->n] * (size_t)e->n;
}

static double *entry(const equations *e, size_t row, size_t column) {
    return &e->values[e->begin[row] + column - first_column(e, row)];
}

/* 1. Memory */

static int make_equations(sf_context *ctx, const sf_pose_graph *graph, equations *e) {
    size_t count = graph->pose_count;
    *e = (equations){.ctx = ctx, .graph = graph, .n = graph->with_scale ? N : SF_TWIST};
    e->rank = sf_alloc(ctx, count + 1, sizeof *e->rank);
    e->first = sf_alloc(ctx, count + 1, sizeof *e->first);
    e->begin = sf_alloc(ctx, N * count + 1, sizeof *e->begin);
    e->g = sf_alloc(ctx, N * count + 1, sizeof *e->g);
    e->before = sf_alloc(ctx, count + 1, sizeof *e->before);
    if (!e->rank || !e->first || !e->begin || !e->g || !e->before) return 0;
    for (size_t i = 0; i < count; i++) {
        e->rank[i] = graph->poses[i].is_fixed ? SIZE_MAX : e->free_count;
        if (!graph->poses[i].is_fixed) e->first[e->free_count] = e->free_count, e->free_count++;
    }
    for (size_t i = 0; i < graph->edge_count; i++) {
        size_t a = e->rank[graph->edges[i].a], b = e->rank[graph->edges[i].b];
        if (a == SIZE_MAX || b == SIZE_MAX) continue;
        size_t later = a > b ? a : b, sooner = a > b ? b : a;
        if (sooner < e->first[later]) e->first[later] = sooner;
    }
    size_t rows = (size_t)e->n * e->free_count;
    e->begin[0] = 0;
    for (size_t row = 0; row < rows; row++)
        e->begin[row + 1] = e->begin[row] + row + 1 - first_column(e, row);
    e->values = sf_alloc(ctx, e->begin[rows] + 1, sizeof *e->values);
    return e->values != NULL;
}

static void free_equations(equations *e) {
    void *const blocks[] = {e->rank, e->first, e->begin, e->values, e->g, e->before};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) sf_free(e->ctx, blocks[i]);
}

/* 2. Sums */

/* Adds J^T W K at the rows of pose `row` and the columns of pose `column`, no later. */
static void add_block(const equations *e, size_t row, size_t column, const double J[N * N],
                      const double W[N * N], const double K[N * N]) {
    for (int i = 0; i < e->n; i++) {
        double left[N] = {0};
        for (int l = 0; l < N; l++)
            for (int m = 0; m < N; m++) left[m] += J[N * l + i] * W[N * l + m];
        size_t at = row * (size_t)e->n + (size_t)i;
        for (int j = 0; j < e->n; j++) {
            size_t other = column * (size_t)e->n + (size_t)j;
            double sum = 0;
            if (other > at) continue;
            for (int m = 0; m < N; m++) sum += left[m] * K[N * m + j];
            *entry(e, at, other) += sum;
        }
    }
}

static void add_gradient(const equations *e, size_t pose, const double J[N * N], const double W[N * N],
                         const double r[N]) {
    for (int l = 0; l < N; l++) {
        double weighted = 0;
        for (int m = 0; m < N; m++) weighted += W[N * l + m] * r[m];
        for (int i = 0; i < e->n; i++) e->g[pose * (size_t)e->n + (size_t)i] += J[N * l + i] * weighted;
    }
}

static double square(const double W[N * N], const double r[N]) {
    double sum = 0;
    for (int k = 0; k < N * N; k++) sum += r[k / N] * W[k] * r[k % N];
    return sum / 2;
}

static void weigh_edge(const sf_graph_edge *edge, double W[N * N]) {
    memset(W, 0, N * N * sizeof *W);
    for (int k = 0; k < N; k++) W[(N + 1) * k] = k < 3 ? edge->move : k < 6 ? edge->turn : edge->scale;
}

/* An edge's part of the cost, added to the equations with `add`. */
static double take_edge(const equations *e, const sf_graph_edge *edge, int add) {
    double r[N], by_a[N * N], by_b[N * N], W[N * N];
    size_t a = e->rank[edge->a], b = e->rank[edge->b];
    const sf_graph_pose *poses = e->graph->poses;
    sf_graph_residual(&poses[edge->a].at, &poses[edge->b].at, &edge->way, r, by_a, by_b);
    weigh_edge(edge, W);
    if (add && a != SIZE_MAX) add_block(e, a, a, by_a, W, by_a), add_gradient(e, a, by_a, W, r);
    if (add && b != SIZE_MAX) add_block(e, b, b, by_b, W, by_b), add_gradient(e, b, by_b, W, r);
    if (add && a != SIZE_MAX && b != SIZE_MAX) {
        if (a > b)
            add_block(e, a, b, by_a, W, by_b);
        else
            add_block(e, b, a, by_b, W, by_a);
    }
    return square(W, r);
}

static double take_prior(const equations *e, size_t at, int add) {
    const sf_graph_pose *pose = &e->graph->poses[at];
    const sf_similar world = {1, {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0}}}, prior = {1, pose->prior.pose};
    double r[N], by_a[N * N], W[N * N] = {0};
    if (!pose->is_known || pose->is_fixed) return 0;
    sf_graph_residual(&pose->at, &world, &prior, r, by_a, NULL);
    for (int i = 0; i < SF_TWIST; i++)
        for (int j = 0; j < SF_TWIST; j++) W[N * i + j] = pose->prior.information[SF_TWIST * i + j];
    W[N * N - 1] = KNOWN_SCALE;
    if (add) add_block(e, e->rank[at], e->rank[at], by_a, W, by_a), add_gradient(e, e->rank[at], by_a, W, r);
    return square(W, r);
}

static double take_all(const equations *e, int add) {
    double cost = 0;
    size_t rows = (size_t)e->n * e->free_count;
    if (add) memset(e->values, 0, e->begin[rows] * sizeof *e->values), memset(e->g, 0, rows * sizeof *e->g);
    for (size_t i = 0; i < e->graph->edge_count; i++) cost += take_edge(e, &e->graph->edges[i], add);
    for (size_t i = 0; i < e->graph->pose_count; i++) cost += take_prior(e, i, add);
    return cost;
}

/* 3. Solving */

/* Row by row, A = L L^T. 0: not positive definite. */
static int factor(const equations *e) {
    size_t rows = (size_t)e->n * e->free_count;
    for (size_t row = 0; row < rows; row++) {
        size_t from = first_column(e, row);
        double *mine = e->values + e->begin[row];
        for (size_t column = from; column <= row; column++) {
            size_t other_from = first_column(e, column), start = from > other_from ? from : other_from;
            const double *other = e->values + e->begin[column];
            double sum = mine[column - from];
            for (size_t k = start; k < column; k++) sum -= mine[k - from] * other[k - other_from];
            if (column == row && !(sum > 0)) return 0;
            mine[column - from] = column == row ? sqrt(sum) : sum / other[column - other_from];
        }
    }
    return 1;
}

static void solve(const equations *e) {
    size_t rows = (size_t)e->n * e->free_count;
    for (size_t row = 0; row < rows; row++) {
        size_t from = first_column(e, row);
        const double *mine = e->values + e->begin[row];
        for (size_t k = from; k < row; k++) e->g[row] -= mine[k - from] * e->g[k];
        e->g[row] /= mine[row - from];
    }
    for (size_t row = rows; row--;) {
        size_t from = first_column(e, row);
        const double *mine = e->values + e->begin[row];
        e->g[row] /= mine[row - from];
        for (size_t k = from; k < row; k++) e->g[k] -= mine[k - from] * e->g[row];
    }
}

static void step(const equations *e) {
    for (size_t i = 0; i < e->graph->pose_count; i++) {
        double twist[N] = {0};
        if (e->rank[i] == SIZE_MAX) continue;
        for (int k = 0; k < e->n; k++) twist[k] = -e->g[e->rank[i] * (size_t)e->n + (size_t)k];
        sf_similar_move(&e->graph->poses[i].at, twist);
    }
}

static void keep(const equations *e, int back) {
    for (size_t i = 0; i < e->graph->pose_count; i++)
        if (back)
            e->graph->poses[i].at = e->before[i];
        else
            e->before[i] = e->graph->poses[i].at;
}

/* A round from the poses at hand. Returns the cost after it; infinite: they stay as they were. */
static double do_round(const equations *e, double cost, double damp) {
    size_t rows = (size_t)e->n * e->free_count;
    take_all(e, 1);
    for (size_t row = 0; row < rows; row++) *entry(e, row, row) *= 1 + damp;
    if (!factor(e)) return INFINITY;
    solve(e);
    keep(e, 0);
    step(e);
    double now = take_all(e, 0);
    if (now <= cost) return now;
    keep(e, 1);
    return INFINITY;
}

sf_status sf_pose_graph_adjust(sf_context *ctx, const sf_pose_graph *graph, int rounds, double *cost) {
    equations e;
    int ready = make_equations(ctx, graph, &e), solved = 0;
    double now = ready ? take_all(&e, 0) : 0, damp = FIRST_DAMP;
    for (int round = 0; ready && e.free_count && round < rounds && damp < MOST_DAMP; round++) {
        double next = do_round(&e, now, damp);
        if (!isfinite(next)) {
            damp = fmax(damp, 1e-6) * 10;
            continue;
        }
        double gained = now - next;
        now = next, damp = fmax(damp / 10, FIRST_DAMP), solved = 1;
        if (gained <= ENOUGH * now) break;
    }
    if (cost) *cost = now;
    solved |= ready && !e.free_count;
    free_equations(&e);
    return !ready ? SF_ERR_MEMORY : solved ? SF_OK : SF_ERR_EMPTY;
}
