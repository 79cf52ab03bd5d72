/* nearest.c - nearest neighbours, by a balanced k-d tree in one array. */
#include "nearest.h"

#include <math.h>

#include "../base/pool.h"

enum { LEAF = 8, CHUNK = 512 };

/* A node is a range of `order`; where it is longer than a leaf, its middle element splits it along
 * axis[middle]. */
typedef struct tree {
    const float *points;
    uint32_t *order;
    uint8_t *axis;
    size_t n;
    int wanted;
    sf_nearest *nearest;
} tree;

static float coordinate(const tree *t, size_t k, int axis) {
    return t->points[3 * (size_t)t->order[k] + (size_t)axis];
}

static void swap(tree *t, size_t a, size_t b) {
    uint32_t keep = t->order[a];
    t->order[a] = t->order[b];
    t->order[b] = keep;
}

/* Puts the element of rank `middle` of [begin, end) in its place, smaller ones before it. Three-way
 * partition: many equal points do not make it quadratic. */
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

/* The nearest so far, ascending, with squared distances. */
typedef struct query {
    const float *point;
    uint32_t self;
    int wanted;
    sf_nearest *nearest;
} query;

static void consider(const tree *t, size_t k, query *q) {
    if (t->order[k] == q->self) return;
    const float *p = t->points + 3 * (size_t)t->order[k];
    float x = p[0] - q->point[0], y = p[1] - q->point[1], z = p[2] - q->point[2];
    sf_nearest one = {t->order[k], x * x + y * y + z * z};
    for (int i = 0; i < q->wanted; i++)
        if (one.distance < q->nearest[i].distance) {
            sf_nearest keep = q->nearest[i];
            q->nearest[i] = one;
            one = keep;
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
    if (across * across < q->nearest[q->wanted - 1].distance) /* points at an equal distance change nothing */
        visit(t, left_first ? middle + 1 : begin, left_first ? end : middle, q);
}

static void query_task(void *tree_pointer, size_t task, int thread) {
    (void)thread;
    tree *t = tree_pointer;
    for (size_t k = task * CHUNK; k < (task + 1) * CHUNK && k < t->n; k++) {
        uint32_t self = t->order[k];
        query q = {t->points + 3 * (size_t)self, self, t->wanted, t->nearest + (size_t)t->wanted * self};
        for (int i = 0; i < q.wanted; i++) q.nearest[i] = (sf_nearest){self, INFINITY};
        visit(t, 0, t->n, &q);
        for (int i = 0; i < q.wanted; i++) q.nearest[i].distance = sqrtf(q.nearest[i].distance);
    }
}

sf_status sf_find_nearest(sf_context *ctx, const float *points, size_t n, int wanted, sf_nearest *nearest) {
    tree t = {points, sf_alloc(ctx, n, sizeof(uint32_t)), sf_alloc(ctx, n, 1), n, wanted, nearest};
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

sf_status sf_nearest_distances(sf_context *ctx, const float *points, size_t n, float *distances) {
    enum { NEIGHBOURS = 3 };
    sf_nearest *nearest = sf_alloc(ctx, n, NEIGHBOURS * sizeof *nearest);
    sf_status status = nearest ? sf_find_nearest(ctx, points, n, NEIGHBOURS, nearest) : SF_ERR_MEMORY;
    for (size_t i = 0; i < n && !status; i++) {
        const sf_nearest *of = nearest + NEIGHBOURS * i;
        int found = 0;
        float sum = 0;
        for (; found < NEIGHBOURS && of[found].distance < INFINITY; found++) sum += of[found].distance;
        distances[i] = found ? sum / (float)found : 0;
    }
    sf_free(ctx, nearest);
    return status;
}
