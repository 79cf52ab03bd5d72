/* landmarks.c - see landmarks.h. */
#include "landmarks.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../base/linear.h"
#include "../base/pool.h"
#include "bundle.h"
#include "patch.h"

enum {
    CELLS = 20,      /* along the longer side of the picture, for landmarks to be spread over */
    PER_CELL = 2,    /* that are followed */
    NEW_MOST = 150,  /* in a keyframe */
    NEAREST = 3,     /* whose depths a new one takes over */
    LEAST_USED = 12, /* for a pose */
    ROUNDS = 12,     /* of Gauss and Newton, for a pose */
    BUNDLE_ROUNDS = 8,
    LEAST_OBSERVATIONS = 3, /* in keyframes, for a landmark's place to be known */
    GIVEN_UP = 3,           /* misses one after another, of one whose place is not known */
    JUDGED = 24             /* searches for one, until it may be given up */
};

#define CORNER      3e-4f /* cornerness of a landmark at least */
#define APART       0.5   /* of a cell, from all others */
#define ALIKE       0.65  /* correlation */
#define ALIKE_NEW   0.75
#define LOOKS_ALIKE 0.6  /* cosine between the rays, at least */
#define NEAR_MISS   2.0  /* px, from the line that a new one must lie on */
#define SEEN_SIGMA  0.5  /* px, of a observation where its pose may be off too */
#define GUESSED     0.5  /* standard deviation of an inverse depth that was guessed, in parts of it */
#define LEARNED     0.02 /* the least that is believed of one */
#define PARALLAX    0.02 /* rad, for a landmark's place to be known */
#define WIDEST      1.5  /* px: what is farther off is no observation, */
#define WIDTHS      3.0  /* or by so many standard deviations */
#define CORRELATED  4.0  /* landmarks that tell as much as one */
#define STILL       1e-6 /* rad: a step that turns by less is the last */
#define FOUND_LEAST 0.2  /* of the searches for one */

typedef enum landmark_state { EMPTY, NEW, KNOWN } landmark_state;

typedef struct landmark {
    landmark_state state;
    sf_patch patch;
    size_t keyframe;          /* index, that it was first seen in */
    double ray[3];            /* there: (x, y, 1) of that camera */
    double at[3];             /* world */
    double inverse, variance; /* of NEW: inverse z in that camera */
    double off_u, off_v;      /* of NEW: where it was seen from where it was expected */
    int misses, searches, finds;
    uint32_t observations; /* in keyframes */
} landmark;

/* A landmark searched for in the picture. */
typedef struct match {
    size_t landmark;
    landmark_state state;  /* its, and */
    uint32_t observations; /* when the search was planned */
    double back[4];        /* displacements in the picture to those in its patch */
    double u, v;
    int found, misled; /* misled: it agrees with no pose that the others do */
} match;

typedef struct observation {
    size_t keyframe, landmark;
    double u, v;
} observation;

typedef struct keyframe {
    uint32_t id;
    sf_bundle_view view;
} keyframe;

struct sf_landmarks {
    sf_context *ctx;
    landmark *all;
    size_t count, capacity;
    keyframe *keyframes;
    size_t keyframe_count, keyframe_capacity;
    observation *observations; /* in keyframes */
    size_t observation_count, observation_capacity;

    /* of the picture */
    sf_bundle_view view;
    int width, height;
    sf_pyramid pyramid;
    float *cornerness; /* [height][width], of the last keyframe */
    size_t cornerness_capacity;
    match *matches;
    size_t match_count, match_capacity;
    int coarsest;      /* of the search in progress */
    double *distances; /* [matches] */
    size_t distance_capacity;
};

sf_status sf_landmarks_create(sf_context *ctx, sf_landmarks **landmarks) {
    *landmarks = sf_calloc(ctx, 1, sizeof **landmarks);
    if (!*landmarks) return SF_ERR_MEMORY;
    (*landmarks)->ctx = ctx;
    return SF_OK;
}

void sf_landmarks_destroy(sf_landmarks **landmarks) {
    sf_landmarks *l = *landmarks;
    if (!l) return;
    void *const blocks[] = {l->all, l->keyframes, l->observations, l->matches, l->cornerness, l->distances};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) sf_free(l->ctx, blocks[i]);
    sf_pyramid_free(l->ctx, &l->pyramid);
    sf_free(l->ctx, l);
    *landmarks = NULL;
}

void sf_landmarks_clear(sf_landmarks *l) {
    l->count = l->keyframe_count = l->observation_count = l->match_count = 0;
}

sf_status sf_landmarks_take(sf_landmarks *l, const sf_camera *c, float *const rgb[3], size_t stride) {
    l->view = (sf_bundle_view){.fx = c->fx, .fy = c->fy, .cx = c->cx, .cy = c->cy, .is_free = 1};
    l->width = c->width, l->height = c->height;
    l->match_count = 0;
    return sf_pyramid_make(l->ctx, c, rgb, stride, &l->pyramid);
}

/* 1. Geometry */

static double cosine(const double a[3], const double b[3]) {
    return sf_dot3(a, b) / fmax(sqrt(sf_dot3(a, a) * sf_dot3(b, b)), 1e-300);
}

static void center_of(const sf_rigid *pose, double center[3]) {
    sf_rigid_apply_back(pose, (const double[3]){0, 0, 0}, center);
}

/* The point of a new landmark at an inverse depth. */
static void place(const sf_landmarks *l, const landmark *m, double inverse, double at[3]) {
    double p[3];
    for (int k = 0; k < 3; k++) p[k] = m->ray[k] / inverse;
    sf_rigid_apply_back(&l->keyframes[m->keyframe].view.pose, p, at);
}

/* The cosine between the rays to a landmark from its first keyframe and from another camera. */
static double between_rays(const sf_landmarks *l, const landmark *m, const sf_rigid *pose) {
    double a[3], b[3];
    center_of(&l->keyframes[m->keyframe].view.pose, a);
    center_of(pose, b);
    for (int k = 0; k < 3; k++) a[k] = m->at[k] - a[k], b[k] = m->at[k] - b[k];
    return cosine(a, b);
}

/* 2. Matches */

/* Displacements here to those in the first picture. */
static int map_back(const sf_landmarks *l, const landmark *m, const double here[2], double back[4]) {
    const sf_bundle_view *first = &l->keyframes[m->keyframe].view;
    const double reach = 4;
    double p[3], forth[4];
    sf_rigid_apply(&first->pose, m->at, p);
    for (int i = 0; i < 2; i++) {
        double q[3] = {p[0], p[1], p[2]}, at[3], there[2];
        q[i] += reach * p[2] / (i ? first->fy : first->fx);
        sf_rigid_apply_back(&first->pose, q, at);
        sf_rigid_apply(&l->view.pose, at, q);
        if (!sf_bundle_pixel(&l->view, q, there)) return 0;
        forth[i] = (there[0] - here[0]) / reach, forth[2 + i] = (there[1] - here[1]) / reach;
    }
    double det = forth[0] * forth[3] - forth[1] * forth[2];
    if (!(det > 0.2 && det < 5)) return 0;
    back[0] = forth[3] / det, back[1] = -forth[1] / det, back[2] = -forth[2] / det, back[3] = forth[0] / det;
    return 1;
}

/* Whether the picture should show a landmark, from where it is thought to be taken. */
static int expect(const sf_landmarks *l, size_t i, match *to) {
    const landmark *m = &l->all[i];
    const double margin = SF_PATCH_REACH + 2;
    double p[3], here[2];
    if (m->state == EMPTY) return 0;
    sf_rigid_apply(&l->view.pose, m->at, p);
    if (!sf_bundle_pixel(&l->view, p, here)) return 0;
    *to = (match){.landmark = i, .state = m->state, .observations = m->observations};
    if (!(between_rays(l, m, &l->view.pose) > LOOKS_ALIKE) || !map_back(l, m, here, to->back)) return 0;
    to->u = here[0] + m->off_u, to->v = here[1] + m->off_v;
    return to->u > margin && to->v > margin && to->u < l->width - margin && to->v < l->height - margin;
}

static int cell_size(const sf_landmarks *l) {
    int side = l->width > l->height ? l->width : l->height;
    return side / CELLS > 8 ? side / CELLS : 8;
}

static int better_first(const void *a, const void *b) {
    const match *x = a, *y = b;
    if (x->state != y->state) return x->state > y->state ? -1 : 1;
    if (x->observations != y->observations) return x->observations > y->observations ? -1 : 1;
    return (x->landmark > y->landmark) - (x->landmark < y->landmark);
}

/* The best of each cell. */
static sf_status choose(sf_landmarks *l) {
    int size = cell_size(l), across = l->width / size + 1, down = l->height / size + 1;
    uint8_t *cells = sf_calloc(l->ctx, (size_t)across * (size_t)down, 1);
    if (!cells) return SF_ERR_MEMORY;
    if (l->match_count) qsort(l->matches, l->match_count, sizeof *l->matches, better_first);
    size_t kept = 0;
    for (size_t i = 0; i < l->match_count; i++) {
        uint8_t *cell = &cells[(int)l->matches[i].v / size * across + (int)l->matches[i].u / size];
        if (*cell < PER_CELL) ++*cell, l->matches[kept++] = l->matches[i];
    }
    l->match_count = kept;
    sf_free(l->ctx, cells);
    return SF_OK;
}

static sf_status plan_matches(sf_landmarks *l) {
    sf_status status = sf_grow(l->ctx, &l->matches, &l->match_capacity, 0, l->count, sizeof *l->matches);
    if (!status) status = sf_grow(l->ctx, &l->distances, &l->distance_capacity, 0, l->count, sizeof(double));
    if (status) return status;
    l->match_count = 0;
    for (size_t i = 0; i < l->count; i++)
        if (expect(l, i, &l->matches[l->match_count])) l->match_count++;
    return choose(l);
}

static void match_task(void *landmarks, size_t i, int thread) {
    (void)thread;
    sf_landmarks *l = landmarks;
    match *at = &l->matches[i];
    const landmark *m = &l->all[at->landmark];
    if (at->found) return;
    double u = at->u, v = at->v;
    double like = sf_patch_find(&l->pyramid, &m->patch, at->back, l->coarsest, &u, &v);
    if (!(like > (m->state == NEW ? ALIKE_NEW : ALIKE))) return;
    at->u = u, at->v = v;
    at->found = 1;
}

static void find_matches(sf_landmarks *l, int coarsest) {
    l->coarsest = coarsest;
    sf_pool_run(l->ctx->pool, l->match_count, match_task, l);
}

/* Those that were not found, from where the pose says by now. */
static void search_again(sf_landmarks *l) {
    for (size_t i = 0; i < l->match_count; i++) {
        match *at = &l->matches[i], now;
        if (at->found && !at->misled) continue;
        if (expect(l, at->landmark, &now))
            *at = now;
        else
            at->found = 0, at->misled = 1;
    }
    find_matches(l, 1);
}

/* 3. The pose */

static int tells(const sf_landmarks *l, const match *at) {
    return at->found && !at->misled && l->all[at->landmark].state == KNOWN;
}

static double distance_of(const sf_landmarks *l, const match *at) {
    return sf_bundle_distance(&l->view, l->all[at->landmark].at, at->u, at->v);
}

static double measure_spread(sf_landmarks *l) {
    size_t count = 0;
    for (size_t i = 0; i < l->match_count; i++) {
        double d = tells(l, &l->matches[i]) ? distance_of(l, &l->matches[i]) : INFINITY;
        if (isfinite(d)) l->distances[count++] = d;
    }
    return fmax(sf_spread(l->distances, count), SF_LEAST_SPREAD);
}

/* Px: how far off a observation may be. */
static double farthest(double spread) { return fmin(fmax(WIDTHS * spread, WIDEST), 2 * WIDEST); }

static void add_match(const sf_landmarks *l, const match *at, double c2, double A[36], double g[6]) {
    double p[3], pixel[2], J[2 * SF_TWIST];
    sf_rigid_apply(&l->view.pose, l->all[at->landmark].at, p);
    if (!sf_bundle_pixel(&l->view, p, pixel)) return;
    sf_bundle_derive(&l->view, p, J, NULL);
    const double r[2] = {pixel[0] - at->u, pixel[1] - at->v}, w = c2 / (c2 + r[0] * r[0] + r[1] * r[1]);
    for (int i = 0; i < SF_TWIST; i++) {
        g[i] += w * (J[i] * r[0] + J[SF_TWIST + i] * r[1]);
        for (int k = 0; k < SF_TWIST; k++)
            A[SF_TWIST * i + k] += w * (J[i] * J[k] + J[SF_TWIST + i] * J[SF_TWIST + k]);
    }
}

static size_t count_telling(const sf_landmarks *l, double within) {
    size_t count = 0;
    for (size_t i = 0; i < l->match_count; i++)
        count += tells(l, &l->matches[i]) && distance_of(l, &l->matches[i]) <= within;
    return count;
}

/* A step of Gauss and Newton, with Cauchy's weights; 0: there is none. */
static int find_step(sf_landmarks *l, const sf_track_prior *prior, sf_followed *f, double g[SF_TWIST]) {
    double A[36] = {0}, off[SF_TWIST] = {0}, c2, scale;
    f->spread = measure_spread(l);
    c2 = pow(SF_CAUCHY * f->spread, 2), scale = 1 / (f->spread * f->spread * CORRELATED);
    for (size_t i = 0; i < l->match_count; i++)
        if (tells(l, &l->matches[i])) add_match(l, &l->matches[i], c2, A, g);
    for (int k = 0; k < 36; k++) f->information[k] = A[k] *= scale;
    for (int k = 0; k < SF_TWIST; k++) g[k] *= scale;
    if (prior) sf_rigid_twist(&prior->pose, &l->view.pose, off);
    for (int k = 0; prior && k < 36; k++) {
        A[k] += prior->information[k];
        g[k / SF_TWIST] += prior->information[k] * off[k % SF_TWIST];
    }
    if (!sf_cholesky(SF_TWIST, A)) return 0;
    sf_cholesky_solve(SF_TWIST, A, g);
    for (int k = 0; k < SF_TWIST; k++) g[k] = -g[k];
    return 1;
}

static void find_pose(sf_landmarks *l, const sf_track_prior *prior, sf_followed *f) {
    for (int round = 0; round < ROUNDS; round++) {
        double step[SF_TWIST] = {0};
        if (!find_step(l, prior, f, step)) break;
        sf_rigid_move(&l->view.pose, step);
        if (sqrt(sf_dot3(step + 3, step + 3)) < STILL) break;
    }
    f->pose = l->view.pose;
    f->used = count_telling(l, farthest(f->spread));
}

static void note_misled(sf_landmarks *l, double spread) {
    double most = farthest(spread);
    for (size_t i = 0; i < l->match_count; i++)
        if (tells(l, &l->matches[i])) l->matches[i].misled = !(distance_of(l, &l->matches[i]) <= most);
}

sf_status sf_landmarks_follow(sf_landmarks *l, const sf_rigid *guess, const sf_track_prior *prior,
                              sf_followed *f) {
    *f = (sf_followed){.pose = *guess};
    l->view.pose = *guess;
    sf_status status = plan_matches(l);
    if (status) return status;
    for (size_t i = 0; i < l->match_count; i++) f->expected += l->all[l->matches[i].landmark].state == KNOWN;
    find_matches(l, SF_PYRAMID_LEVELS - 1);
    if (count_telling(l, INFINITY) < LEAST_USED) return SF_OK;
    find_pose(l, prior, f);
    if (f->used < LEAST_USED) {
        *f = (sf_followed){.pose = *guess, .expected = f->expected};
        return SF_OK;
    }
    note_misled(l, f->spread);
    search_again(l);
    find_pose(l, prior, f);
    return SF_OK;
}

/* 4. What was seen */

/* A new landmark's inverse depth, by Kalman's filter; 0: it lies off the line that it must lie on. */
static int learn_depth(const sf_landmarks *l, landmark *m, const match *at) {
    double here[2], there[2], p[3], e[2], far[3], step = 0.01 * m->inverse;
    place(l, m, m->inverse, m->at);
    sf_rigid_apply(&l->view.pose, m->at, p);
    place(l, m, m->inverse + step, far);
    if (!sf_bundle_pixel(&l->view, p, here)) return 0;
    sf_rigid_apply(&l->view.pose, far, p);
    if (!sf_bundle_pixel(&l->view, p, there)) return 0;
    for (int k = 0; k < 2; k++) e[k] = (there[k] - here[k]) / step;
    const double r[2] = {at->u - here[0], at->v - here[1]};
    double ee = e[0] * e[0] + e[1] * e[1], along = ee > 0 ? (e[0] * r[0] + e[1] * r[1]) / ee : 0;
    if (!(hypot(r[0] - along * e[0], r[1] - along * e[1]) < NEAR_MISS)) return 0;
    double noise = SEEN_SIGMA * SEEN_SIGMA / fmax(ee, 1e-12), part = m->variance / (m->variance + noise);
    m->inverse = fmin(fmax(m->inverse + part * along, 0.2 * m->inverse), 5 * m->inverse);
    m->variance = fmax((1 - part) * m->variance, pow(LEARNED * m->inverse, 2));
    place(l, m, m->inverse, m->at);
    sf_rigid_apply(&l->view.pose, m->at, p);
    if (!sf_bundle_pixel(&l->view, p, here)) return 0;
    m->off_u = at->u - here[0], m->off_v = at->v - here[1];
    return 1;
}

static void count_search(landmark *m, int found) {
    m->searches++, m->finds += found;
    m->misses = found ? 0 : m->misses + 1;
    if (m->state == NEW && m->misses >= GIVEN_UP) m->state = EMPTY;
    if (m->searches < JUDGED) return;
    if (m->finds < FOUND_LEAST * m->searches) m->state = EMPTY;
    m->searches /= 2, m->finds /= 2;
}

void sf_landmarks_settle(sf_landmarks *l, const sf_rigid *pose) {
    l->view.pose = *pose;
    double most = farthest(measure_spread(l));
    for (size_t i = 0; i < l->match_count; i++) {
        match *at = &l->matches[i];
        landmark *m = &l->all[at->landmark];
        if (at->found && m->state == KNOWN) at->misled = !(distance_of(l, at) <= most);
        if (at->found && m->state == NEW) at->misled = !learn_depth(l, m, at);
        at->found &= !at->misled;
        count_search(m, at->found);
    }
}

/* 5. Keyframes */

/* Those of landmarks that are no more. */
static void drop_observations(sf_landmarks *l) {
    size_t kept = 0;
    for (size_t i = 0; i < l->count; i++) l->all[i].observations = 0;
    for (size_t i = 0; i < l->observation_count; i++) {
        const observation *s = &l->observations[i];
        if (l->all[s->landmark].state == EMPTY) continue;
        l->all[s->landmark].observations++;
        l->observations[kept++] = *s;
    }
    l->observation_count = kept;
}

static sf_status note_observation(sf_landmarks *l, size_t landmark_index, double u, double v) {
    sf_status status = sf_grow(l->ctx, &l->observations, &l->observation_capacity, l->observation_count,
                               l->observation_count + 1, sizeof *l->observations);
    if (status) return status;
    l->observations[l->observation_count++] = (observation){l->keyframe_count - 1, landmark_index, u, v};
    l->all[landmark_index].observations++;
    return SF_OK;
}

/* The depth here of the known ones that are seen nearest to a pixel. */
static double depth_near(const sf_landmarks *l, double u, double v, double otherwise) {
    double nearest[NEAREST], depth[NEAREST], sum = 0;
    int n = 0;
    for (size_t i = 0; i < l->match_count; i++) {
        const match *at = &l->matches[i];
        double p[3], d = hypot(at->u - u, at->v - v);
        if (!tells(l, at) || (n == NEAREST && d >= nearest[n - 1])) continue;
        sf_rigid_apply(&l->view.pose, l->all[at->landmark].at, p);
        int k = n < NEAREST ? n++ : n - 1;
        for (; k && nearest[k - 1] > d; k--) nearest[k] = nearest[k - 1], depth[k] = depth[k - 1];
        nearest[k] = d, depth[k] = p[2];
    }
    for (int k = 0; k < n; k++) sum += 1 / depth[k] / n;
    return sum > 0 ? 1 / sum : otherwise;
}

static sf_status take_up(sf_landmarks *l, int x, int y, double distance) {
    double u = x + 0.5, v = y + 0.5, depth = depth_near(l, u, v, distance);
    size_t i = 0;
    while (i < l->count && l->all[i].state != EMPTY) i++;
    sf_status status = sf_grow(l->ctx, &l->all, &l->capacity, l->count, i + 1, sizeof *l->all);
    if (status) return status;
    landmark *m = &l->all[i];
    *m = (landmark){.keyframe = l->keyframe_count - 1, .inverse = 1 / depth};
    m->ray[0] = (u - l->view.cx) / l->view.fx, m->ray[1] = (v - l->view.cy) / l->view.fy, m->ray[2] = 1;
    m->variance = pow(GUESSED * m->inverse, 2);
    if (i == l->count) l->count++;
    if (!sf_patch_cut(&l->pyramid, u, v, &m->patch)) return SF_OK;
    m->state = NEW;
    place(l, m, m->inverse, m->at);
    return note_observation(l, i, u, v);
}

/* The best corner of a cell that is far from all others. */
typedef struct corner {
    float cornerness;
    int x, y;
} corner;

static int is_apart(const sf_landmarks *l, int x, int y, double apart) {
    for (size_t i = 0; i < l->match_count; i++) {
        double u = l->matches[i].u - x, v = l->matches[i].v - y;
        if (l->matches[i].found && u * u + v * v < apart * apart) return 0;
    }
    return 1;
}

static void cornerness_task(void *landmarks, size_t y, int thread) {
    sf_landmarks *l = landmarks;
    (void)thread;
    sf_cornerness(&l->pyramid, (int)y, l->cornerness + y * (size_t)l->width);
}

static corner best_corner(const sf_landmarks *l, int left, int top, int size, const float *weight) {
    corner best = {CORNER, -1, -1};
    for (int y = top; y < top + size && y < l->height; y++)
        for (int x = left; x < left + size && x < l->width; x++) {
            size_t at = (size_t)y * (size_t)l->width + (size_t)x;
            float c = l->cornerness[at];
            if (weight && weight[at] < 1) continue;
            if (c > best.cornerness && is_apart(l, x, y, APART * size)) best = (corner){c, x, y};
        }
    return best;
}

static int by_cornerness(const void *a, const void *b) {
    const corner *x = a, *y = b;
    return (x->cornerness < y->cornerness) - (x->cornerness > y->cornerness);
}

static sf_status find_new(sf_landmarks *l, double distance, const float *weight) {
    int size = cell_size(l);
    size_t cells = (size_t)(l->width / size + 1) * (size_t)(l->height / size + 1), n = 0;
    corner *corners = sf_alloc(l->ctx, cells, sizeof *corners);
    sf_status status = corners ? SF_OK : SF_ERR_MEMORY;
    if (!status)
        status = sf_grow(l->ctx, &l->cornerness, &l->cornerness_capacity, 0,
                         (size_t)l->width * (size_t)l->height, sizeof *l->cornerness);
    if (!status) sf_pool_run(l->ctx->pool, (size_t)l->height, cornerness_task, l);
    for (int y = 0; !status && y < l->height; y += size)
        for (int x = 0; x < l->width; x += size) {
            corners[n] = best_corner(l, x, y, size, weight);
            n += corners[n].x >= 0;
        }
    if (n) qsort(corners, n, sizeof *corners, by_cornerness);
    for (size_t i = 0; !status && i < n && i < NEW_MOST; i++)
        status = take_up(l, corners[i].x, corners[i].y, distance);
    sf_free(l->ctx, corners);
    return status;
}

sf_status sf_landmarks_keep(sf_landmarks *l, uint32_t id, const sf_rigid *pose, const sf_track_prior *known,
                            double distance, const float *weight) {
    sf_status status = sf_grow(l->ctx, &l->keyframes, &l->keyframe_capacity, l->keyframe_count,
                               l->keyframe_count + 1, sizeof *l->keyframes);
    if (status) return status;
    drop_observations(l);
    keyframe *k = &l->keyframes[l->keyframe_count++];
    *k = (keyframe){.id = id, .view = l->view};
    k->view.pose = l->view.pose = *pose;
    if (known) k->view.is_known = 1, k->view.prior = *known;
    for (size_t i = 0; !status && i < l->match_count; i++)
        if (l->matches[i].found && l->all[l->matches[i].landmark].state != EMPTY)
            status = note_observation(l, l->matches[i].landmark, l->matches[i].u, l->matches[i].v);
    if (!status) status = find_new(l, distance, weight);
    if (status) sf_landmarks_drop(l, id);
    return status;
}

static size_t index_of(const sf_landmarks *l, uint32_t id) {
    size_t i = 0;
    while (i < l->keyframe_count && l->keyframes[i].id != id) i++;
    return i;
}

void sf_landmarks_drop(sf_landmarks *l, uint32_t id) {
    size_t at = index_of(l, id), kept = 0;
    if (at == l->keyframe_count) return;
    l->keyframe_count--;
    memmove(l->keyframes + at, l->keyframes + at + 1, (l->keyframe_count - at) * sizeof *l->keyframes);
    for (size_t i = 0; i < l->count; i++) {
        if (l->all[i].keyframe == at) l->all[i].state = EMPTY;
        l->all[i].keyframe -= l->all[i].keyframe > at;
    }
    for (size_t i = 0; i < l->observation_count; i++) {
        observation s = l->observations[i];
        if (s.keyframe == at) continue;
        s.keyframe -= s.keyframe > at;
        l->observations[kept++] = s;
    }
    l->observation_count = kept;
    drop_observations(l);
}

int sf_landmarks_pose(const sf_landmarks *l, uint32_t id, sf_rigid *pose) {
    size_t at = index_of(l, id);
    if (at == l->keyframe_count) return 0;
    *pose = l->keyframes[at].view.pose;
    return 1;
}

/* 6. The bundle */

/* What goes into a bundle, and where it came from. */
typedef struct gathering {
    sf_bundle bundle;
    sf_bundle_observation *observations;
    size_t *order;         /* [observations]: those of l, by landmark; */
    size_t *first;         /* [landmarks + 1]: each one's first there */
    uint32_t *shared;      /* [keyframes]: landmarks of the newest that it sees */
    uint8_t *is_free;      /* [keyframes] */
    uint32_t *landmark_of; /* [points] */
} gathering;

static int make_gathering(sf_landmarks *l, gathering *g) {
    sf_context *ctx = l->ctx;
    g->observations = sf_alloc(ctx, l->observation_count + 1, sizeof *g->observations);
    g->order = sf_alloc(ctx, l->observation_count + 1, sizeof *g->order);
    g->first = sf_calloc(ctx, l->count + 2, sizeof *g->first);
    g->shared = sf_calloc(ctx, l->keyframe_count + 1, sizeof *g->shared);
    g->is_free = sf_calloc(ctx, l->keyframe_count + 1, 1);
    g->landmark_of = sf_alloc(ctx, l->count + 1, sizeof *g->landmark_of);
    g->bundle.views = sf_alloc(ctx, l->keyframe_count + 1, sizeof *g->bundle.views);
    g->bundle.points = sf_alloc(ctx, l->count + 1, sizeof *g->bundle.points);
    return g->observations && g->order && g->first && g->shared && g->is_free && g->landmark_of &&
           g->bundle.views && g->bundle.points;
}

static void free_gathering(sf_landmarks *l, gathering *g) {
    void *const blocks[] = {g->observations, g->order,       g->first,        g->shared,
                            g->is_free,      g->landmark_of, g->bundle.views, g->bundle.points};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) sf_free(l->ctx, blocks[i]);
}

/* Observations in the order of their landmarks. */
static void sort_observations(const sf_landmarks *l, gathering *g) {
    for (size_t i = 0; i < l->observation_count; i++) g->first[l->observations[i].landmark + 2]++;
    for (size_t i = 2; i < l->count + 2; i++) g->first[i] += g->first[i - 1];
    for (size_t i = 0; i < l->observation_count; i++)
        g->order[g->first[l->observations[i].landmark + 1]++] = i;
}

static const observation *observation_at(const sf_landmarks *l, const gathering *g, size_t i) {
    return &l->observations[g->order[i]];
}

/* How many landmarks of the newest keyframe each of the others sees. */
static void count_shared(const sf_landmarks *l, gathering *g, size_t newest) {
    for (size_t m = 0; m < l->count; m++) {
        int by_newest = 0;
        for (size_t i = g->first[m]; i < g->first[m + 1]; i++)
            by_newest |= observation_at(l, g, i)->keyframe == newest;
        for (size_t i = g->first[m]; by_newest && i < g->first[m + 1]; i++)
            g->shared[observation_at(l, g, i)->keyframe]++;
    }
}

/* The newest keyframe, those that see most of what it sees, and then the newest others: what drifted since a
 * place was seen before follows when it is seen again. */
static void choose_free(const sf_landmarks *l, gathering *g, size_t most) {
    size_t newest = l->keyframe_count - 1, n = 1;
    count_shared(l, g, newest);
    g->is_free[newest] = 1;
    for (; n < most / 2; n++) {
        size_t best = newest;
        for (size_t k = 0; k < newest; k++)
            if (!g->is_free[k] && g->shared[k] && (best == newest || g->shared[k] >= g->shared[best]))
                best = k;
        if (best == newest) break;
        g->is_free[best] = 1;
    }
    for (size_t k = newest; k-- && n < most;)
        if (!g->is_free[k]) g->is_free[k] = 1, n++;
}

/* One whose place is not known yet is held along the ray that it was first seen on. */
static sf_bundle_point point_of(const sf_landmarks *l, const landmark *m) {
    sf_bundle_point p = {.at = {m->at[0], m->at[1], m->at[2]}};
    double center[3];
    if (m->state == KNOWN) return p;
    center_of(&l->keyframes[m->keyframe].view.pose, center);
    for (int k = 0; k < 3; k++) p.ray[k] = m->at[k] - center[k];
    double length = sqrt(sf_dot3(p.ray, p.ray));
    for (int k = 0; k < 3; k++) p.ray[k] /= length;
    p.ray_information = 1 / pow(GUESSED * length, 2);
    return p;
}

/* Whether a landmark belongs into the bundle: a free keyframe sees it, and another one. */
static int belongs(const sf_landmarks *l, const gathering *g, size_t m) {
    int seen = 0;
    for (size_t i = g->first[m]; i < g->first[m + 1]; i++)
        seen |= g->is_free[observation_at(l, g, i)->keyframe];
    return seen && g->first[m + 1] - g->first[m] > 1 && l->all[m].state != EMPTY;
}

static void gather(const sf_landmarks *l, gathering *g) {
    sf_bundle *b = &g->bundle;
    b->view_count = l->keyframe_count;
    b->observations = g->observations;
    for (size_t k = 0; k < l->keyframe_count; k++) {
        b->views[k] = l->keyframes[k].view;
        b->views[k].is_free = g->is_free[k];
    }
    for (size_t m = 0; m < l->count; m++) {
        if (!belongs(l, g, m)) continue;
        uint32_t point = (uint32_t)b->point_count++;
        b->points[point] = point_of(l, &l->all[m]);
        g->landmark_of[point] = (uint32_t)m;
        for (size_t i = g->first[m]; i < g->first[m + 1]; i++) {
            const observation *s = observation_at(l, g, i);
            g->observations[b->observation_count++] =
                (sf_bundle_observation){(uint32_t)s->keyframe, point, s->u, s->v};
        }
    }
}

/* A landmark's place as it came out, and which of its observations were wrong. */
static void accept_point(sf_landmarks *l, const gathering *g, size_t point, double most) {
    landmark *m = &l->all[g->landmark_of[point]];
    const size_t *first = &g->first[g->landmark_of[point]];
    double widest = 1, p[3];
    int good = 0;
    memcpy(m->at, g->bundle.points[point].at, sizeof m->at);
    for (size_t i = first[0]; i < first[1]; i++) {
        observation *s = &l->observations[g->order[i]];
        const sf_bundle_view *view = &l->keyframes[s->keyframe].view;
        if (!(sf_bundle_distance(view, m->at, s->u, s->v) <= most)) {
            s->landmark = SIZE_MAX;
            continue;
        }
        good++;
        widest = fmin(widest, between_rays(l, m, &view->pose));
    }
    sf_rigid_apply(&l->keyframes[m->keyframe].view.pose, m->at, p);
    if (!(p[2] > 0) || good < 2) {
        m->state = EMPTY;
    } else if (m->state == NEW) {
        m->inverse = 1 / p[2];
        if (good >= LEAST_OBSERVATIONS && widest < cos(PARALLAX)) m->state = KNOWN, m->off_u = m->off_v = 0;
    }
}

/* What came out. */
static void accept(sf_landmarks *l, const gathering *g, double spread) {
    size_t kept = 0;
    for (size_t k = 0; k < l->keyframe_count; k++) l->keyframes[k].view.pose = g->bundle.views[k].pose;
    for (size_t p = 0; p < g->bundle.point_count; p++) accept_point(l, g, p, farthest(spread));
    for (size_t i = 0; i < l->observation_count; i++)
        if (l->observations[i].landmark != SIZE_MAX) l->observations[kept++] = l->observations[i];
    l->observation_count = kept;
    drop_observations(l);
    for (size_t i = 0; i < l->count; i++) /* where their keyframes are by now */
        if (l->all[i].state == NEW) place(l, &l->all[i], l->all[i].inverse, l->all[i].at);
}

sf_status sf_landmarks_adjust(sf_landmarks *l, size_t most) {
    gathering g = {0};
    double spread;
    if (l->keyframe_count < 2) return SF_OK;
    int ready = make_gathering(l, &g);
    sf_status status = ready ? SF_OK : SF_ERR_MEMORY;
    if (!status) {
        sort_observations(l, &g);
        choose_free(l, &g, most);
        gather(l, &g);
        status = sf_bundle_adjust(l->ctx, &g.bundle, BUNDLE_ROUNDS, &spread);
        if (!status) accept(l, &g, spread);
    }
    free_gathering(l, &g);
    return status;
}
