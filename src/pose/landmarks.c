/* landmarks.c - keyframes that observe the landmarks of the map, and new landmarks. */
#include "landmarks.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../base/linear.h"
#include "../base/pool.h"
#include "../base/statistics.h"
#include "landmark_map.h"

enum {
    NEW_MOST = 150, /* in a sf_landmark_keyframe */
    NEAREST = 3     /* landmarks of known depth, from which a new one takes its depth */
};

#define CORNER 3e-4f /* cornerness of a landmark at least */
#define APART  0.5   /* of a cell, from all others */

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
    l->view = (sf_bundle_view){.lens = {.fx = c->fx, .fy = c->fy, .cx = c->cx, .cy = c->cy}, .is_free = 1};
    l->width = c->width, l->height = c->height;
    l->match_count = 0;
    return sf_pyramid_make(l->ctx, c, rgb, stride, &l->pyramid);
}

/* Keyframes */

static sf_status note_observation(sf_landmarks *l, size_t landmark_index, double u, double v) {
    sf_status status = sf_grow(l->ctx, &l->observations, &l->observation_capacity, l->observation_count,
                               l->observation_count + 1, sizeof *l->observations);
    if (status) return status;
    l->observations[l->observation_count++] =
        (sf_landmark_observation){l->keyframe_count - 1, landmark_index, u, v};
    l->all[landmark_index].observations++;
    return SF_OK;
}

/* The depth here of the known ones that are seen nearest to a pixel. */
static double depth_near(const sf_landmarks *l, double u, double v, double otherwise) {
    double nearest[NEAREST], depth[NEAREST], sum = 0;
    int n = 0;
    for (size_t i = 0; i < l->match_count; i++) {
        const sf_landmark_match *at = &l->matches[i];
        double p[3], d = hypot(at->u - u, at->v - v);
        if (!sf_match_is_used(l, at) || (n == NEAREST && d >= nearest[n - 1])) continue;
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
    while (i < l->count && l->all[i].state != SF_LANDMARK_EMPTY) i++;
    sf_status status = sf_grow(l->ctx, &l->all, &l->capacity, l->count, i + 1, sizeof *l->all);
    if (status) return status;
    sf_landmark *m = &l->all[i];
    *m = (sf_landmark){.keyframe = l->keyframe_count - 1, .inverse = 1 / depth};
    m->ray[0] = (u - l->view.lens.cx) / l->view.lens.fx, m->ray[1] = (v - l->view.lens.cy) / l->view.lens.fy,
    m->ray[2] = 1;
    m->variance = pow(SF_GUESSED_DEPTH * m->inverse, 2);
    if (i == l->count) l->count++;
    if (!sf_patch_cut(&l->pyramid, u, v, &m->patch)) return SF_OK;
    m->state = SF_LANDMARK_NEW;
    sf_landmark_place(l, m, m->inverse, m->at);
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
    int size = sf_landmarks_cell(l);
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
    sf_landmarks_drop_stale(l);
    sf_landmark_keyframe *k = &l->keyframes[l->keyframe_count++];
    *k = (sf_landmark_keyframe){.id = id, .view = l->view};
    k->view.pose = l->view.pose = *pose;
    if (known) k->view.is_known = 1, k->view.prior = *known;
    for (size_t i = 0; !status && i < l->match_count; i++)
        if (l->matches[i].found && l->all[l->matches[i].landmark].state != SF_LANDMARK_EMPTY)
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
        if (l->all[i].keyframe == at) l->all[i].state = SF_LANDMARK_EMPTY;
        l->all[i].keyframe -= l->all[i].keyframe > at;
    }
    for (size_t i = 0; i < l->observation_count; i++) {
        sf_landmark_observation s = l->observations[i];
        if (s.keyframe == at) continue;
        s.keyframe -= s.keyframe > at;
        l->observations[kept++] = s;
    }
    l->observation_count = kept;
    sf_landmarks_drop_stale(l);
}

int sf_landmarks_pose(const sf_landmarks *l, uint32_t id, sf_rigid *pose) {
    size_t at = index_of(l, id);
    if (at == l->keyframe_count) return 0;
    *pose = l->keyframes[at].view.pose;
    return 1;
}

sf_status sf_landmarks_depth(const sf_landmarks *l, uint32_t id, double *depth) {
    size_t at = index_of(l, id), n = 0;
    *depth = 0;
    if (at == l->keyframe_count) return SF_OK;
    double *depths = sf_alloc(l->ctx, l->observation_count + 1, sizeof *depths), p[3];
    if (!depths) return SF_ERR_MEMORY;
    for (size_t i = 0; i < l->observation_count; i++) {
        const sf_landmark_observation *s = &l->observations[i];
        if (s->keyframe != at || l->all[s->landmark].state != SF_LANDMARK_KNOWN) continue;
        sf_rigid_apply(&l->keyframes[at].view.pose, l->all[s->landmark].at, p);
        depths[n++] = p[2];
    }
    *depth = sf_median(depths, n);
    sf_free(l->ctx, depths);
    return SF_OK;
}
