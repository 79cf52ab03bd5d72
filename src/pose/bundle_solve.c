/* bundle_solve.c - the memory of a bundle's equations, and their solution: by Cholesky's factors, or by
 * conjugate gradients where there are many views (README, P.9). */
#include <math.h>
#include <string.h>

#include "../base/cholesky.h"
#include "../base/linear.h"
#include "bundle_equations.h"

/* Free views up to which factors are faster. */
enum { DENSE_MOST = 300 };

/* 1. The pattern */

/* The columns of a row: views of a rank up to its own that see one of its points; marks [rows] of what is
 * counted already. Returns their number; `to` may be NULL. */
static size_t columns_of_row(const sf_bundle_work *a, size_t row, size_t *marks, uint32_t *to) {
    size_t count = 0;
    for (size_t k = a->from[row]; k < a->from[row + 1]; k++) {
        for (size_t j = a->of_view[k].first; j < a->of_view[k].end; j++)
            if (a->rank_of[j] < row && marks[a->rank_of[j]] != row) {
                marks[a->rank_of[j]] = row;
                count++;
            }
    }
    for (size_t k = 0, n = 0; to && k < row; k++)
        if (marks[k] == row) to[n++] = (uint32_t)k;
    if (to) to[count] = (uint32_t)row;
    return count + 1;
}

/* The blocks in which a view is the column, by view. */
static void make_upper(sf_bundle_equations *eq) {
    for (size_t row = 0; row < eq->rows; row++)
        for (size_t k = eq->begin[row]; k < eq->begin[row + 1]; k++)
            if (eq->column[k] != row) eq->upper_begin[eq->column[k] + 2]++;
    for (size_t row = 2; row < eq->rows + 2; row++) eq->upper_begin[row] += eq->upper_begin[row - 1];
    for (size_t row = 0; row < eq->rows; row++)
        for (size_t k = eq->begin[row]; k < eq->begin[row + 1]; k++) {
            if (eq->column[k] == row) continue;
            size_t at = eq->upper_begin[eq->column[k] + 1]++;
            eq->upper[at] = (uint32_t)k, eq->upper_row[at] = (uint32_t)row;
        }
}

static size_t size_of(const sf_bundle_equations *eq) { return SF_TWIST * eq->rows + eq->lens_columns; }

static int make_solver(sf_context *ctx, sf_bundle_equations *eq, size_t dense_most) {
    size_t n = size_of(eq), padded = sf_cholesky_padded(n), blocks = eq->begin[eq->rows];
    if (eq->rows <= dense_most) {
        eq->dense = sf_alloc(ctx, padded * padded + 1, sizeof *eq->dense);
        eq->panel = sf_alloc(ctx, padded * SF_CHOLESKY_TILE + padded + 1, sizeof *eq->panel);
        return eq->dense && eq->panel;
    }
    eq->vectors =
        sf_alloc(ctx, 5 * n + 36 * eq->rows + eq->lens_columns * eq->lens_columns, sizeof *eq->vectors);
    eq->upper_begin = sf_calloc(ctx, eq->rows + 2, sizeof *eq->upper_begin);
    eq->upper = sf_alloc(ctx, blocks, sizeof *eq->upper);
    eq->upper_row = sf_alloc(ctx, blocks, sizeof *eq->upper_row);
    if (!eq->vectors || !eq->upper_begin || !eq->upper || !eq->upper_row) return 0;
    make_upper(eq);
    return 1;
}

int sf_bundle_equations_make(sf_bundle_work *a) {
    sf_bundle_equations *eq = &a->eq;
    sf_context *ctx = a->ctx;
    size_t rows = a->free_count, lens = eq->lens_columns;
    size_t *marks = sf_alloc(ctx, rows + 1, sizeof *marks);
    eq->rows = rows;
    eq->begin = sf_calloc(ctx, rows + 1, sizeof *eq->begin);
    eq->border = sf_alloc(ctx, rows * lens * SF_TWIST + 1, sizeof *eq->border);
    eq->corner = sf_calloc(ctx, lens * lens + 1, sizeof *eq->corner);
    eq->g = sf_calloc(ctx, size_of(eq) + 1, sizeof *eq->g);
    eq->table =
        sf_alloc(ctx, SF_BUNDLE_ROWS * (size_t)sf_pool_threads(ctx->pool) * rows + 1, sizeof *eq->table);
    int ready = marks && eq->begin && eq->border && eq->corner && eq->g && eq->table;
    for (size_t row = 0; ready && row < rows; row++) marks[row] = SIZE_MAX;
    for (size_t row = 0; ready && row < rows; row++)
        eq->begin[row + 1] = eq->begin[row] + columns_of_row(a, row, marks, NULL);
    if (ready) {
        eq->column = sf_alloc(ctx, eq->begin[rows] + 1, sizeof *eq->column);
        eq->blocks = sf_alloc(ctx, 36 * eq->begin[rows] + 1, sizeof *eq->blocks);
        ready = eq->column && eq->blocks;
    }
    for (size_t row = 0; ready && row < rows; row++) marks[row] = SIZE_MAX;
    for (size_t row = 0; ready && row < rows; row++)
        columns_of_row(a, row, marks, eq->column + eq->begin[row]);
    sf_free(ctx, marks);
    return ready && make_solver(ctx, eq, a->b->dense_most ? a->b->dense_most : DENSE_MOST);
}

void sf_bundle_equations_free(sf_context *ctx, sf_bundle_equations *eq) {
    void *const blocks[] = {eq->begin,       eq->column, eq->blocks,   eq->border, eq->corner,
                            eq->g,           eq->table,  eq->dense,    eq->panel,  eq->vectors,
                            eq->upper_begin, eq->upper,  eq->upper_row};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) sf_free(ctx, blocks[i]);
}

/* 2. Cholesky */

static void make_dense(const sf_bundle_equations *eq, size_t n, double *A) {
    size_t views = SF_TWIST * eq->rows;
    memset(A, 0, n * n * sizeof *A);
    for (size_t row = 0; row < eq->rows; row++)
        for (size_t k = eq->begin[row]; k < eq->begin[row + 1]; k++)
            for (size_t i = 0; i < SF_TWIST; i++)
                memcpy(A + (SF_TWIST * row + i) * n + SF_TWIST * eq->column[k],
                       eq->blocks + 36 * k + SF_TWIST * i, SF_TWIST * sizeof *A);
    for (size_t m = 0; m < eq->lens_columns; m++) {
        double *to = A + (views + m) * n;
        for (size_t row = 0; row < eq->rows; row++)
            memcpy(to + SF_TWIST * row, eq->border + (row * eq->lens_columns + m) * SF_TWIST,
                   SF_TWIST * sizeof *A);
        memcpy(to + views, eq->corner + m * eq->lens_columns, (m + 1) * sizeof *A);
    }
    for (size_t i = size_of(eq); i < n; i++) A[i * n + i] = 1;
}

static int solve_dense(sf_context *ctx, sf_bundle_equations *eq) {
    size_t used = size_of(eq), n = sf_cholesky_padded(used);
    double *x = eq->panel + n * SF_CHOLESKY_TILE;
    make_dense(eq, n, eq->dense);
    if (!sf_cholesky_tiled(ctx->pool, n, eq->dense, eq->panel)) return 0;
    for (size_t i = 0; i < n; i++) x[i] = i < used ? -eq->g[i] : 0;
    sf_cholesky_solve((int)n, eq->dense, x);
    memcpy(eq->g, x, used * sizeof *x);
    return 1;
}

/* 3. Conjugate gradients, preconditioned by the blocks on the diagonal */

typedef struct product {
    const sf_bundle_equations *eq;
    const double *x;
    double *y;
} product;

/* y += B x, and y += B^T x, of a block. */
static void multiply(const double *B, const double *x, double *y) {
    for (int i = 0; i < SF_TWIST; i++)
        for (int k = 0; k < SF_TWIST; k++) y[i] += B[SF_TWIST * i + k] * x[k];
}

static void multiply_turned(const double *B, const double *x, double *y) {
    for (int i = 0; i < SF_TWIST; i++)
        for (int k = 0; k < SF_TWIST; k++) y[k] += B[SF_TWIST * i + k] * x[i];
}

/* Of a block on the diagonal, the lower triangle alone is there. */
static void multiply_diagonal(const double *B, const double *x, double *y) {
    for (int i = 0; i < SF_TWIST; i++)
        for (int k = 0; k < SF_TWIST; k++) y[i] += B[i < k ? SF_TWIST * k + i : SF_TWIST * i + k] * x[k];
}

static void product_task(void *pointer, size_t row, int thread) {
    product *p = pointer;
    const sf_bundle_equations *eq = p->eq;
    double *y = p->y + SF_TWIST * row;
    (void)thread;
    memset(y, 0, SF_TWIST * sizeof *y);
    for (size_t k = eq->begin[row]; k + 1 < eq->begin[row + 1]; k++)
        multiply(eq->blocks + 36 * k, p->x + SF_TWIST * eq->column[k], y);
    multiply_diagonal(eq->blocks + 36 * (eq->begin[row + 1] - 1), p->x + SF_TWIST * row, y);
    for (size_t k = eq->upper_begin[row]; k < eq->upper_begin[row + 1]; k++)
        multiply_turned(eq->blocks + 36 * (size_t)eq->upper[k], p->x + SF_TWIST * (size_t)eq->upper_row[k],
                        y);
    for (size_t m = 0; m < eq->lens_columns; m++)
        for (size_t k = 0; k < SF_TWIST; k++)
            y[k] += eq->border[(row * eq->lens_columns + m) * SF_TWIST + k] * p->x[SF_TWIST * eq->rows + m];
}

static void apply(sf_context *ctx, const sf_bundle_equations *eq, const double *x, double *y) {
    product p = {eq, x, y};
    size_t lens = eq->lens_columns, views = SF_TWIST * eq->rows;
    sf_pool_run(ctx->pool, eq->rows, product_task, &p);
    for (size_t m = 0; m < lens; m++) {
        double sum = 0;
        for (size_t row = 0; row < eq->rows; row++)
            for (size_t k = 0; k < SF_TWIST; k++)
                sum += eq->border[(row * lens + m) * SF_TWIST + k] * x[SF_TWIST * row + k];
        for (size_t l = 0; l < lens; l++)
            sum += eq->corner[m < l ? l * lens + m : m * lens + l] * x[views + l];
        y[views + m] = sum;
    }
}

/* The factors of the blocks on the diagonal, and of the corner. */
static int precondition(const sf_bundle_equations *eq, double *factors) {
    size_t lens = eq->lens_columns;
    for (size_t row = 0; row < eq->rows; row++) {
        memcpy(factors + 36 * row, eq->blocks + 36 * (eq->begin[row + 1] - 1), 36 * sizeof *factors);
        if (!sf_cholesky(SF_TWIST, factors + 36 * row)) return 0;
    }
    memcpy(factors + 36 * eq->rows, eq->corner, lens * lens * sizeof *factors);
    return !lens || sf_cholesky((int)lens, factors + 36 * eq->rows);
}

static void divide(const sf_bundle_equations *eq, const double *factors, const double *r, double *z) {
    memcpy(z, r, size_of(eq) * sizeof *z);
    for (size_t row = 0; row < eq->rows; row++)
        sf_cholesky_solve(SF_TWIST, factors + 36 * row, z + SF_TWIST * row);
    if (eq->lens_columns)
        sf_cholesky_solve((int)eq->lens_columns, factors + 36 * eq->rows, z + SF_TWIST * eq->rows);
}

static double dot(const double *a, const double *b, size_t n) {
    double sum = 0;
    for (size_t i = 0; i < n; i++) sum += a[i] * b[i];
    return sum;
}

static int solve_iteratively(sf_context *ctx, sf_bundle_equations *eq) {
    enum { MOST = 200 };
    size_t n = size_of(eq);
    double *x = eq->vectors, *r = x + n, *z = r + n, *d = z + n, *Ad = d + n, *factors = Ad + n;
    if (!precondition(eq, factors)) return 0;
    memset(x, 0, n * sizeof *x);
    for (size_t i = 0; i < n; i++) r[i] = -eq->g[i];
    divide(eq, factors, r, z);
    memcpy(d, z, n * sizeof *d);
    double rz = dot(r, z, n), first = rz;
    for (int k = 0; k < MOST && rz > 1e-8 * first; k++) {
        apply(ctx, eq, d, Ad);
        double curvature = dot(d, Ad, n);
        if (!(curvature > 0)) break;
        double step = rz / curvature;
        for (size_t i = 0; i < n; i++) x[i] += step * d[i], r[i] -= step * Ad[i];
        divide(eq, factors, r, z);
        double next = dot(r, z, n);
        for (size_t i = 0; i < n; i++) d[i] = z[i] + next / rz * d[i];
        rz = next;
    }
    memcpy(eq->g, x, n * sizeof *x);
    return 1;
}

int sf_bundle_equations_solve(sf_context *ctx, sf_bundle_equations *eq) {
    return eq->dense ? solve_dense(ctx, eq) : solve_iteratively(ctx, eq);
}
