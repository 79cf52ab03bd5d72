/* cholesky.c - see cholesky.h. Column by column of tiles: the tile on the diagonal is factored, those below
 * it are divided by its factor, and their products are taken from all tiles to the right (Golub and Van Loan,
 * 4.2.7). A task is a row of tiles. */
#include "cholesky.h"

#include "linear.h"

enum { TILE = SF_CHOLESKY_TILE };

typedef struct work {
    size_t n, column; /* of tiles: the one that is eliminated */
    double *A;
    double *panel; /* [TILE][n]: the tiles below the diagonal of the column, transposed */
} work;

/* X L^T = A of a tile below the diagonal, for all its rows at once: row k of its transpose is done when those
 * above it are. */
static void divide_task(void *pointer, size_t task, int thread) {
    work *w = pointer;
    size_t n = w->n, first = (w->column + 1 + task) * TILE, at = w->column * TILE;
    const double *L = w->A + at * n + at;
    double *A = w->A + first * n + at, *panel = w->panel + first;
    (void)thread;
    for (size_t k = 0; k < TILE; k++) {
        double *restrict row = panel + k * n, scale = 1 / L[k * n + k];
        for (size_t i = 0; i < TILE; i++) row[i] = A[i * n + k];
        for (size_t l = 0; l < k; l++) {
            const double *restrict done = panel + l * n, factor = L[k * n + l];
            for (size_t i = 0; i < TILE; i++) row[i] -= factor * done[i];
        }
        for (size_t i = 0; i < TILE; i++) row[i] *= scale;
        for (size_t i = 0; i < TILE; i++) A[i * n + k] = row[i];
    }
}

/* A row of a tile less the products of a row of its own column of tiles with the panel. */
static void subtract_row(double *restrict A, const double *restrict own, const double *restrict panel,
                         size_t n) {
    for (size_t k = 0; k < TILE; k += 4) {
        const double *restrict p = panel + k * n, *restrict q = p + n, *restrict r = q + n,
                               *restrict s = r + n;
        double a = own[k], b = own[k + 1], c = own[k + 2], d = own[k + 3];
        for (size_t j = 0; j < TILE; j++) A[j] -= (a * p[j] + b * q[j]) + (c * r[j] + d * s[j]);
    }
}

static void subtract_task(void *pointer, size_t task, int thread) {
    work *w = pointer;
    size_t n = w->n, rows = n / TILE, i = rows - 1 - task; /* the longest first */
    (void)thread;
    for (size_t j = w->column + 1; j <= i; j++)
        for (size_t k = 0; k < TILE; k++) {
            double *row = w->A + (i * TILE + k) * n;
            subtract_row(row + j * TILE, row + w->column * TILE, w->panel + j * TILE, n);
        }
}

int sf_cholesky_tiled(struct sf_pool *pool, size_t n, double *A, double *panel) {
    work w = {n, 0, A, panel};
    for (; w.column < n / TILE; w.column++) {
        size_t below = n / TILE - 1 - w.column;
        if (!sf_cholesky_within(TILE, n, A + w.column * TILE * (n + 1))) return 0;
        if (!below) continue;
        sf_pool_run(pool, below, divide_task, &w);
        sf_pool_run(pool, below, subtract_task, &w);
    }
    return 1;
}
