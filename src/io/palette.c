/* palette.c - see codebook.h: vectors that stand for others. */
#include "codebook.h"

#include <string.h>

enum { ROUNDS = 4 };

/* Vectors order[first .. first + count) that one centroid stands for; error: of all, squared. */
typedef struct cell {
    size_t first, count;
    double error;
} cell;

typedef struct palette {
    const float *vectors;
    size_t dims;
    uint32_t *order, *scratch;
    double *sums; /* [4][dims] */
    cell *heap;   /* the greatest error first */
    size_t cells;
} palette;

static const float *vector(const palette *p, size_t at) { return p->vectors + p->dims * p->order[at]; }

static void find_mean(const palette *p, size_t first, size_t count, double *mean) {
    memset(mean, 0, p->dims * sizeof *mean);
    for (size_t i = first; i < first + count; i++)
        for (size_t d = 0; d < p->dims; d++) mean[d] += (double)vector(p, i)[d];
    for (size_t d = 0; d < p->dims; d++) mean[d] /= (double)count;
}

/* The squared error of the cell, and the dimension that has most of it. */
static double find_error(const palette *p, const cell *c, const double *mean, double *of, size_t *widest) {
    double error = 0;
    memset(of, 0, p->dims * sizeof *of);
    for (size_t i = c->first; i < c->first + c->count; i++)
        for (size_t d = 0; d < p->dims; d++) {
            double off = (double)vector(p, i)[d] - mean[d];
            of[d] += off * off;
        }
    *widest = 0;
    for (size_t d = 0; d < p->dims; d++) {
        error += of[d];
        if (of[d] > of[*widest]) *widest = d;
    }
    return error;
}

static int goes_before(const cell *a, const cell *b) {
    return a->error != b->error ? a->error > b->error : a->first < b->first;
}

static void swap(cell *a, cell *b) {
    cell c = *a;
    *a = *b;
    *b = c;
}

static void put_cell(palette *p, size_t first, size_t count) {
    cell c = {first, count, 0};
    size_t widest;
    find_mean(p, first, count, p->sums);
    c.error = find_error(p, &c, p->sums, p->sums + p->dims, &widest);
    size_t at = p->cells++;
    p->heap[at] = c;
    for (; at && goes_before(&p->heap[at], &p->heap[(at - 1) / 2]); at = (at - 1) / 2)
        swap(&p->heap[at], &p->heap[(at - 1) / 2]);
}

static cell take_cell(palette *p) {
    cell c = p->heap[0];
    p->heap[0] = p->heap[--p->cells];
    for (size_t at = 0;;) {
        size_t child = 2 * at + 1;
        if (child >= p->cells) return c;
        if (child + 1 < p->cells && goes_before(&p->heap[child + 1], &p->heap[child])) child++;
        if (!goes_before(&p->heap[child], &p->heap[at])) return c;
        swap(&p->heap[at], &p->heap[child]);
        at = child;
    }
}

/* Which of two means is nearer: the sign of the distance from the plane between them. */
static int is_second(const palette *p, const float *v, const double *means) {
    double nearer = 0;
    for (size_t d = 0; d < p->dims; d++) {
        double a = (double)v[d] - means[d], b = (double)v[d] - means[p->dims + d];
        nearer += a * a - b * b;
    }
    return nearer > 0;
}

typedef struct divide {
    const double *means; /* [2][dims]; NULL: by one dimension */
    size_t dimension;
    double at;
} divide;

/* Those of the second part behind those of the first, each in its order; returns how many are in the first.
 */
static size_t part(palette *p, const cell *c, const divide *by) {
    size_t first = 0, second = 0;
    for (size_t i = c->first; i < c->first + c->count; i++) {
        const float *v = vector(p, i);
        int behind = by->means ? is_second(p, v, by->means) : (double)v[by->dimension] > by->at;
        if (behind)
            p->scratch[second++] = p->order[i];
        else
            p->order[c->first + first++] = p->order[i];
    }
    memcpy(p->order + c->first + first, p->scratch, second * sizeof *p->scratch);
    return first;
}

/* 0: all of the cell's vectors are alike. */
static size_t split(palette *p, const cell *c) {
    double *mean = p->sums, *of = p->sums + p->dims, *means = p->sums + 2 * p->dims;
    size_t widest;
    find_mean(p, c->first, c->count, mean);
    find_error(p, c, mean, of, &widest);
    size_t first = part(p, c, &(divide){.dimension = widest, .at = mean[widest]});
    for (int round = 0; round < ROUNDS && first && first < c->count; round++) {
        find_mean(p, c->first, first, means);
        find_mean(p, c->first + first, c->count - first, means + p->dims);
        size_t now = part(p, c, &(divide){.means = means});
        if (now == first) break;
        first = now;
    }
    return first < c->count ? first : 0;
}

static void divide_all(palette *p, size_t n, size_t most) {
    put_cell(p, 0, n);
    while (p->cells < most && p->heap[0].error > 0) {
        cell c = take_cell(p);
        size_t first = split(p, &c);
        if (first) {
            put_cell(p, c.first, first);
            put_cell(p, c.first + first, c.count - first);
        } else {
            put_cell(p, c.first, c.count); /* all alike, and so are those of the others, which err less */
            return;
        }
    }
}

static void take_result(const palette *p, float *centroids, uint32_t *labels) {
    for (size_t k = 0; k < p->cells; k++) {
        const cell *c = &p->heap[k];
        find_mean(p, c->first, c->count, p->sums);
        for (size_t d = 0; d < p->dims; d++) centroids[k * p->dims + d] = (float)p->sums[d];
        for (size_t i = c->first; i < c->first + c->count; i++) labels[p->order[i]] = (uint32_t)k;
    }
}

sf_status sf_palette_make(sf_context *ctx, const sf_vectors *vectors, size_t most, float *centroids,
                          uint32_t *labels, size_t *made) {
    size_t n = vectors->n, dims = vectors->dims;
    palette p = {.vectors = vectors->values,
                 .dims = dims,
                 .order = sf_alloc(ctx, n, sizeof *p.order),
                 .scratch = sf_alloc(ctx, n, sizeof *p.scratch),
                 .sums = sf_alloc(ctx, 4 * dims, sizeof *p.sums),
                 .heap = sf_alloc(ctx, most + 1, sizeof *p.heap)};
    sf_status status = p.order && p.scratch && p.sums && p.heap ? SF_OK : SF_ERR_MEMORY;
    if (!status) {
        for (size_t i = 0; i < n; i++) p.order[i] = (uint32_t)i;
        divide_all(&p, n, most);
        take_result(&p, centroids, labels);
        *made = p.cells;
    }
    sf_free(ctx, p.order);
    sf_free(ctx, p.scratch);
    sf_free(ctx, p.sums);
    sf_free(ctx, p.heap);
    return status;
}
