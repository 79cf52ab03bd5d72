/* nearest.c - distances to the nearest points, by a balanced k-d tree kept in one array. */
#include "first.h"

#include <math.h>

#include "../base/pool.h"

enum { NEIGHBOURS = 3, LEAF = 8, CHUNK = 512 };

/* A node is a range of `order`; where it is longer than a leaf, its middle element splits it along
 * axis[middle]. */
typedef struct tree {
    const float *points;
    uint32_t *order;
    uint8_t *axis;
    size_t n;
    float *distances;
} tree;

static float coordinate(const tree *t, size_t k, int axis) {
    return t->points[3 * (size_t)t->order[k] + (size_t)axis];
}

static void swap(tree *t, size_t a, size_t b) {
    uint32_t keep = t->order[a];
    t->order[a] = t->order[b];
    t->order[b] = keep;
}

/* Puts the element of rank `middle` of [begin, end) in its place, smaller ones before it. Parts in three, so
 * that many equal points do not make it quadratic. */
static void select_middle(tree *t, size_t begin, size_t end, size_t middle, int axis) {
    for (;;) {
        float pivot = coordinate(t, begin + (end - begin) / 2, axis);
        size_t low = begin, at = begin, high = end;
        while (at < high) {
            float x = coordinate(t, at, axis);
            if (x < pivot)
                swap(t, low++, at++);
            else if (x > pivot)
                swap(t, at, --high);
            else
                at++;
        }
        if (middle < low)
            end = low;
        else if (middle >= high)
            begin = high;
        else
            return;
    }
}

static int widest_axis(const tree *t, size_t begin, size_t end) {
    float best = -1;
    int widest = 0;
    for (int axis = 0; axis < 3; axis++) {
        float low = coordinate(t, begin, axis), high = low;
        for (size_t k = begin; k < end; k++) {
            float x = coordinate(t, k, axis);
            low = x < low ? x : low;
            high = x > high ? x : high;
        }
        if (high - low > best) best = high - low, widest = axis;
    }
    return widest;
}

static void build(tree *t, size_t begin, size_t end) {
    while (end - begin > LEAF) {
        size_t middle = begin + (end - begin) / 2;
        int axis = widest_axis(t, begin, end);
        select_middle(t, begin, end, middle, axis);
        t->axis[middle] = (uint8_t)axis;
        build(t, begin, middle); /* the depth is log2 n: each half is half as long */
        begin = middle + 1;
    }
}

/* The nearest so far, squared, ascending. */
typedef struct query {
    const float *point;
    uint32_t self;
    float nearest[NEIGHBOURS];
} query;

static void consider(const tree *t, size_t k, query *q) {
    if (t->order[k] == q->self) return;
    const float *p = t->points + 3 * (size_t)t->order[k];
    float x = p[0] - q->point[0], y = p[1] - q->point[1], z = p[2] - q->point[2], d = x * x + y * y + z * z;
    for (int i = 0; i < NEIGHBOURS; i++)
        if (d < q->nearest[i]) {
            float keep = q->nearest[i];
            q->nearest[i] = d;
            d = keep;
        }
}

static void visit(const tree *t, size_t begin, size_t end, query *q) {
    if (end - begin <= LEAF) {
        for (size_t k = begin; k < end; k++) consider(t, k, q);
        return;
    }
    size_t middle = begin + (end - begin) / 2;
    float across = q->point[t->axis[middle]] - coordinate(t, middle, t->axis[middle]);
    int left_first = across < 0;
    visit(t, left_first ? begin : middle + 1, left_first ? middle : end, q);
    consider(t, middle, q);
    if (across * across < q->nearest[NEIGHBOURS - 1]) /* what is as far does not come nearer */
        visit(t, left_first ? middle + 1 : begin, left_first ? end : middle, q);
}

static void query_task(void *tree_pointer, size_t task, int thread) {
    (void)thread;
    tree *t = tree_pointer;
    for (size_t k = task * CHUNK; k < (task + 1) * CHUNK && k < t->n; k++) {
        query q = {t->points + 3 * (size_t)t->order[k], t->order[k], {INFINITY, INFINITY, INFINITY}};
        visit(t, 0, t->n, &q);
        float sum = 0;
        int found = 0;
        for (; found < NEIGHBOURS && q.nearest[found] < INFINITY; found++) sum += sqrtf(q.nearest[found]);
        t->distances[q.self] = found ? sum / (float)found : 0;
    }
}

sf_status sf_nearest_distances(sf_context *ctx, const float *points, size_t n, float *distances) {
    tree t = {points, sf_alloc(ctx, n, sizeof(uint32_t)), sf_alloc(ctx, n, 1), n, distances};
    sf_status status = t.order && t.axis ? SF_OK : SF_ERR_MEMORY;
    if (!status) {
        for (size_t k = 0; k < n; k++) t.order[k] = (uint32_t)k;
        build(&t, 0, n);
        sf_pool_run(ctx->pool, (n + CHUNK - 1) / CHUNK, query_task, &t);
    }
    sf_free(ctx, t.order);
    sf_free(ctx, t.axis);
    return status;
}
