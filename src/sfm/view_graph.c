/* view_graph.c - see view_graph.h. A maximum spanning tree of the pairs gives first rotations; robust means
 * over all pairs then spread the errors that have added up along it. */
#include "view_graph.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../base/linear.h"

enum { SWEEPS = 60 }; /* of each scale */

#define DEGREE 0.017453292519943295
/* Matches of a plane count for less: its pose may be the wrong one of two. */
#define PLANE_WEIGHT 0.1
/* Scales of the robust mean: pairs that are off by more hardly count. */
#define FIRST_SCALE (40 * DEGREE)
#define LAST_SCALE  (15 * DEGREE)
/* A pair that is off by more contradicts the others; of a plane or a rotation, whose pose is less certain. */
#define MOST_OFF       (30 * DEGREE)
#define MOST_OFF_PLANE (90 * DEGREE)

typedef struct edge {
    uint32_t first, second;
    double weight, most_off;
    double R[9]; /* second from first */
    size_t pair;
} edge;

typedef struct graph {
    sf_context *ctx;
    size_t picture_count, edge_count;
    edge *edges;         /* [edges]: strongest first */
    size_t *from, *at;   /* [pictures + 2], [2 edges]: the edges of each picture */
    uint8_t *is_reached; /* [pictures]: by the walk over the tree */
    double (*R)[9];      /* [pictures]: world to camera */
    uint32_t *set;       /* [pictures]: of union and find; then the queue of a walk over the tree */
    uint8_t *in_tree;    /* [edges] */
} graph;

static int compare_edges(const void *a, const void *b) {
    const edge *x = a, *y = b;
    if (x->weight != y->weight) return x->weight < y->weight ? 1 : -1;
    return x->pair < y->pair ? -1 : x->pair > y->pair;
}

/* 1. The graph and its tree */

static void list_edges(graph *g, const sf_matched_pair *pairs, size_t pair_count) {
    for (size_t i = 0; i < pair_count; i++) {
        const sf_matched_pair *p = &pairs[i];
        if (!p->count || !p->geometry.has_pose || p->first == p->second) continue;
        int is_general = p->geometry.kind == SF_PAIR_GENERAL;
        edge *e = &g->edges[g->edge_count++];
        *e = (edge){.first = p->first,
                    .second = p->second,
                    .weight = (double)p->count * (is_general ? 1 : PLANE_WEIGHT),
                    .most_off = is_general ? MOST_OFF : MOST_OFF_PLANE,
                    .pair = i};
        memcpy(e->R, p->geometry.T.R, sizeof e->R);
    }
    qsort(g->edges, g->edge_count, sizeof *g->edges, compare_edges);
    /* from[i + 1] is where the next edge of picture i goes, and in the end where those of i + 1 begin */
    for (size_t i = 0; i < g->edge_count; i++)
        g->from[g->edges[i].first + 2]++, g->from[g->edges[i].second + 2]++;
    for (size_t i = 2; i < g->picture_count + 2; i++) g->from[i] += g->from[i - 1];
    for (size_t i = 0; i < g->edge_count; i++) {
        g->at[g->from[g->edges[i].first + 1]++] = i;
        g->at[g->from[g->edges[i].second + 1]++] = i;
    }
}

static uint32_t find_set(uint32_t *set, uint32_t i) {
    while (set[i] != i) i = set[i] = set[set[i]];
    return i;
}

static void choose_tree(graph *g) {
    for (size_t i = 0; i < g->picture_count; i++) g->set[i] = (uint32_t)i;
    for (size_t i = 0; i < g->edge_count; i++) {
        uint32_t a = find_set(g->set, g->edges[i].first), b = find_set(g->set, g->edges[i].second);
        g->in_tree[i] = a != b;
        g->set[a] = b;
    }
}

static void transpose(const double R[9], double to[9]) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) to[3 * i + j] = R[3 * j + i];
}

/* The rotation of edge e's other end, for the rotation of its end `at`. */
static void rotation_beyond(const edge *e, size_t at, const double from[9], double to[9]) {
    double back[9];
    if (e->first != at) transpose(e->R, back);
    sf_mat3_mul(e->first == at ? e->R : back, from, to);
}

static size_t other_end(const edge *e, size_t at) { return e->first == at ? e->second : e->first; }

/* Walks over the tree from each root. */
static void begin_rotations(graph *g) {
    uint32_t *queue = g->set;
    for (size_t root = 0; root < g->picture_count; root++) {
        if (g->is_reached[root]) continue;
        size_t head = 0, tail = 0;
        g->is_reached[root] = 1;
        memcpy(g->R[root], (const double[9]){1, 0, 0, 0, 1, 0, 0, 0, 1}, sizeof g->R[root]);
        queue[tail++] = (uint32_t)root;
        while (head < tail) {
            size_t at = queue[head++];
            for (size_t k = g->from[at]; k < g->from[at + 1]; k++) {
                const edge *e = &g->edges[g->at[k]];
                size_t next = other_end(e, at);
                if (!g->in_tree[g->at[k]] || g->is_reached[next]) continue;
                g->is_reached[next] = 1;
                rotation_beyond(e, at, g->R[at], g->R[next]);
                queue[tail++] = (uint32_t)next;
            }
        }
    }
}

/* 2. Robust means */

/* The turn, rad, that takes picture `at` to where edge e and its other end want it. */
static double turn_wanted(const graph *g, const edge *e, size_t at, double turn[3]) {
    double wanted[9], back[9], difference[9];
    size_t other = other_end(e, at);
    rotation_beyond(e, other, g->R[other], wanted);
    transpose(g->R[at], back);
    sf_mat3_mul(wanted, back, difference);
    sf_rotation_log(difference, turn);
    return sqrt(sf_dot3(turn, turn));
}

/* Geman and McClure's weights. Pictures are moved one after the other. */
static void sweep(graph *g, double scale) {
    for (size_t i = 0; i < g->picture_count; i++) {
        double sum[3] = {0}, weights = 0, turn[3], by[9], moved[9];
        for (size_t k = g->from[i]; k < g->from[i + 1]; k++) {
            const edge *e = &g->edges[g->at[k]];
            double off = turn_wanted(g, e, i, turn) / scale, near = 1 + off * off;
            double w = e->weight / (near * near);
            for (int axis = 0; axis < 3; axis++) sum[axis] += w * turn[axis];
            weights += w;
        }
        if (!(weights > 0)) continue;
        for (int axis = 0; axis < 3; axis++) turn[axis] = sum[axis] / weights;
        sf_rotation_exp(turn, by);
        sf_mat3_mul(by, g->R[i], moved);
        memcpy(g->R[i], moved, sizeof moved);
    }
}

/* 3. Contradictions */

static size_t drop(const graph *g, sf_matched_pair *pairs) {
    size_t dropped = 0;
    for (size_t i = 0; i < g->edge_count; i++) {
        const edge *e = &g->edges[i];
        double turn[3];
        if (g->in_tree[i] || turn_wanted(g, e, e->first, turn) < e->most_off) continue;
        pairs[e->pair].count = 0;
        dropped++;
    }
    return dropped;
}

sf_status sf_view_graph_filter(sf_context *ctx, size_t picture_count, sf_matched_pair *pairs,
                               size_t pair_count, size_t *dropped) {
    graph g = {.ctx = ctx, .picture_count = picture_count};
    size_t n = picture_count + 1;
    g.edges = sf_alloc(ctx, pair_count + 1, sizeof *g.edges);
    g.from = sf_calloc(ctx, picture_count + 2, sizeof *g.from);
    g.at = sf_alloc(ctx, 2 * pair_count + 1, sizeof *g.at);
    g.is_reached = sf_calloc(ctx, n, sizeof *g.is_reached);
    g.R = sf_alloc(ctx, n, sizeof *g.R);
    g.set = sf_alloc(ctx, n, sizeof *g.set);
    g.in_tree = sf_calloc(ctx, pair_count + 1, sizeof *g.in_tree);
    int ready = g.edges && g.from && g.at && g.is_reached && g.R && g.set && g.in_tree;
    *dropped = 0;
    if (ready) {
        list_edges(&g, pairs, pair_count);
        choose_tree(&g);
        begin_rotations(&g);
        for (int i = 0; i < 2 * SWEEPS; i++) sweep(&g, i < SWEEPS ? FIRST_SCALE : LAST_SCALE);
        *dropped = drop(&g, pairs);
    }
    void *const blocks[] = {g.edges, g.from, g.at, g.is_reached, g.R, g.set, g.in_tree};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) sf_free(ctx, blocks[i]);
    return ready ? SF_OK : SF_ERR_MEMORY;
}
