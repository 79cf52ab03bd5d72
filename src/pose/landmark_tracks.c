/* landmark_tracks.c - landmarks matched in a picture, and the pose that agrees with them (README, P.8). */
#include <math.h>
#include <stdlib.h>

#include "../base/linear.h"
#include "../base/pool.h"
#include "landmark_map.h"
#include "landmarks.h"

enum {
    PER_CELL = 2,    /* landmarks that are followed */
    LEAST_USED = 12, /* for a pose */
    ROUNDS = 12,     /* of Gauss and Newton, for a pose */
    GIVEN_UP = 3,    /* misses one after another, of one whose place is not known */
    JUDGED = 24      /* searches for one, until it may be given up */
};

#define ALIKE       0.65 /* correlation */
#define ALIKE_NEW   0.75
#define LOOKS_ALIKE 0.6  /* cosine between the rays, at least */
#define NEAR_MISS   2.0  /* px, from the line that a new one must lie on */
#define SEEN_SIGMA  0.5  /* px, of an observation where its pose may be off too */
#define LEARNED     0.02 /* least standard deviation of an inverse depth, in parts of it */
#define CORRELATED  4.0  /* landmarks that tell as much as one */
#define STILL       1e-6 /* rad: a step that turns by less is the last */
#define FOUND_LEAST 0.2  /* of the searches for one */

/* 1. Matches */

/* Displacements here to those in the first picture. */
static int map_back(const sf_landmarks *l, const sf_landmark *m, const double here[2], double back[4]) {
    const sf_bundle_view *first = &l->keyframes[m->keyframe].view;
    const double reach = 4;
    double p[3], forth[4];
    sf_rigid_apply(&first->pose, m->at, p);
    for (int i = 0; i < 2; i++) {
        double q[3] = {p[0], p[1], p[2]}, at[3], there[2];
        q[i] += reach * p[2] / (i ? first->lens.fy : first->lens.fx);
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
static int expect(const sf_landmarks *l, size_t i, sf_landmark_match *to) {
    const sf_landmark *m = &l->all[i];
    const double margin = SF_PATCH_REACH + 2;
    double p[3], here[2];
    if (m->state == SF_LANDMARK_EMPTY) return 0;
    sf_rigid_apply(&l->view.pose, m->at, p);
    if (!sf_bundle_pixel(&l->view, p, here)) return 0;
    *to = (sf_landmark_match){.landmark = i, .state = m->state, .observations = m->observations};
    if (!(sf_landmark_cosine(l, m, &l->view.pose) > LOOKS_ALIKE) || !map_back(l, m, here, to->back)) return 0;
    to->u = here[0] + m->off_u, to->v = here[1] + m->off_v;
    return to->u > margin && to->v > margin && to->u < l->width - margin && to->v < l->height - margin;
}

static int better_first(const void *a, const void *b) {
    const sf_landmark_match *x = a, *y = b;
    if (x->state != y->state) return x->state > y->state ? -1 : 1;
    if (x->observations != y->observations) return x->observations > y->observations ? -1 : 1;
    return (x->landmark > y->landmark) - (x->landmark < y->landmark);
}

/* The best of each cell. */
static sf_status choose(sf_landmarks *l) {
    int size = sf_landmarks_cell(l), across = l->width / size + 1, down = l->height / size + 1;
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
    sf_landmark_match *at = &l->matches[i];
    const sf_landmark *m = &l->all[at->landmark];
    if (at->found) return;
    double u = at->u, v = at->v;
    double like = sf_patch_find(&l->pyramid, &m->patch, at->back, l->coarsest, &u, &v);
    if (!(like > (m->state == SF_LANDMARK_NEW ? ALIKE_NEW : ALIKE))) return;
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
        sf_landmark_match *at = &l->matches[i], now;
        if (at->found && !at->misled) continue;
        if (expect(l, at->landmark, &now))
            *at = now;
        else
            at->found = 0, at->misled = 1;
    }
    find_matches(l, 1);
}

/* 2. The pose */

static double distance_of(const sf_landmarks *l, const sf_landmark_match *at) {
    return sf_bundle_distance(&l->view, l->all[at->landmark].at, at->u, at->v);
}

static double measure_spread(sf_landmarks *l) {
    size_t count = 0;
    for (size_t i = 0; i < l->match_count; i++) {
        double d = sf_match_is_used(l, &l->matches[i]) ? distance_of(l, &l->matches[i]) : INFINITY;
        if (isfinite(d)) l->distances[count++] = d;
    }
    return fmax(sf_spread(l->distances, count), SF_LEAST_SPREAD);
}

static void add_match(const sf_landmarks *l, const sf_landmark_match *at, double c2, double A[36],
                      double g[6]) {
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
        count += sf_match_is_used(l, &l->matches[i]) && distance_of(l, &l->matches[i]) <= within;
    return count;
}

/* A step of Gauss and Newton, with Cauchy's weights; 0: there is none. */
static int find_step(sf_landmarks *l, const sf_track_prior *prior, sf_followed *f, double g[SF_TWIST]) {
    double A[36] = {0}, off[SF_TWIST] = {0}, c2, scale;
    f->spread = measure_spread(l);
    c2 = pow(SF_CAUCHY * f->spread, 2), scale = 1 / (f->spread * f->spread * CORRELATED);
    for (size_t i = 0; i < l->match_count; i++)
        if (sf_match_is_used(l, &l->matches[i])) add_match(l, &l->matches[i], c2, A, g);
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
    f->used = count_telling(l, sf_match_gate(f->spread));
}

static void note_misled(sf_landmarks *l, double spread) {
    double most = sf_match_gate(spread);
    for (size_t i = 0; i < l->match_count; i++)
        if (sf_match_is_used(l, &l->matches[i]))
            l->matches[i].misled = !(distance_of(l, &l->matches[i]) <= most);
}

sf_status sf_landmarks_follow(sf_landmarks *l, const sf_rigid *guess, const sf_track_prior *prior,
                              sf_followed *f) {
    *f = (sf_followed){.pose = *guess};
    l->view.pose = *guess;
    sf_status status = plan_matches(l);
    if (status) return status;
    for (size_t i = 0; i < l->match_count; i++)
        f->expected += l->all[l->matches[i].landmark].state == SF_LANDMARK_KNOWN;
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

/* 3. Depths and misses */

/* A new landmark's inverse depth, by Kalman's filter; 0: it lies off the line that it must lie on. */
static int learn_depth(const sf_landmarks *l, sf_landmark *m, const sf_landmark_match *at) {
    double here[2], there[2], p[3], e[2], far[3], step = 0.01 * m->inverse;
    sf_landmark_place(l, m, m->inverse, m->at);
    sf_rigid_apply(&l->view.pose, m->at, p);
    sf_landmark_place(l, m, m->inverse + step, far);
    if (!sf_bundle_pixel(&l->view, p, here)) return 0;
    sf_rigid_apply(&l->view.pose, far, p);
    if (!sf_bundle_pixel(&l->view, p, there)) return 0;
    for (int k = 0; k < 2; k++) e[k] = (there[k] - here[k]) / step;
    const double r[2] = {at->u - here[0], at->v - here[1]};
    double ee = e[0] * e[0] + e[1] * e[1], along = ee > 0 ? (e[0] * r[0] + e[1] * r[1]) / ee : 0;
    if (!(hypot(r[0] - along * e[0], r[1] - along * e[1]) < NEAR_MISS)) return 0;
    double told = m->variance * ee, part = told / (told + SEEN_SIGMA * SEEN_SIGMA);
    m->inverse = fmin(fmax(m->inverse + part * along, 0.2 * m->inverse), 5 * m->inverse);
    m->variance = fmax((1 - part) * m->variance, pow(LEARNED * m->inverse, 2));
    sf_landmark_place(l, m, m->inverse, m->at);
    sf_rigid_apply(&l->view.pose, m->at, p);
    if (!sf_bundle_pixel(&l->view, p, here)) return 0;
    m->off_u = at->u - here[0], m->off_v = at->v - here[1];
    return 1;
}

static void count_search(sf_landmark *m, int found) {
    m->searches++, m->finds += found;
    m->misses = found ? 0 : m->misses + 1;
    if (m->state == SF_LANDMARK_NEW && m->misses >= GIVEN_UP) m->state = SF_LANDMARK_EMPTY;
    if (m->searches < JUDGED) return;
    if (m->finds < FOUND_LEAST * m->searches) m->state = SF_LANDMARK_EMPTY;
    m->searches /= 2, m->finds /= 2;
}

void sf_landmarks_settle(sf_landmarks *l, const sf_rigid *pose) {
    l->view.pose = *pose;
    double most = sf_match_gate(measure_spread(l));
    for (size_t i = 0; i < l->match_count; i++) {
        sf_landmark_match *at = &l->matches[i];
        sf_landmark *m = &l->all[at->landmark];
        if (at->found && m->state == SF_LANDMARK_KNOWN) at->misled = !(distance_of(l, at) <= most);
        if (at->found && m->state == SF_LANDMARK_NEW) at->misled = !learn_depth(l, m, at);
        at->found &= !at->misled;
        count_search(m, at->found);
    }
}
