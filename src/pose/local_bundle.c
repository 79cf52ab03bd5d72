/* local_bundle.c - bundle adjustment of the newest keyframe, its neighbours and their landmarks (README,
 * P.9). */
#include <math.h>
#include <string.h>

#include "../base/linear.h"
#include "landmark_map.h"
#include "landmarks.h"

enum {
    ROUNDS = 8,
    LEAST_OBSERVATIONS = 3 /* in keyframes, for a landmark's place to be known */
};

#define PARALLAX 0.02 /* rad, for a landmark's place to be known */

/* A bundle, and the landmarks that it was gathered from. */
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

static const sf_landmark_observation *observation_at(const sf_landmarks *l, const gathering *g, size_t i) {
    return &l->observations[g->order[i]];
}

/* Covisibility: how many landmarks of the newest keyframe each of the others sees. */
static void count_shared(const sf_landmarks *l, gathering *g, size_t newest) {
    for (size_t m = 0; m < l->count; m++) {
        int by_newest = 0;
        for (size_t i = g->first[m]; i < g->first[m + 1]; i++)
            by_newest |= observation_at(l, g, i)->keyframe == newest;
        for (size_t i = g->first[m]; by_newest && i < g->first[m + 1]; i++)
            g->shared[observation_at(l, g, i)->keyframe]++;
    }
}

/* Free variables: the newest keyframe, its most covisible ones, then the most recent, so that a loop closure
 * also corrects the drift in between. */
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
static sf_bundle_point point_of(const sf_landmarks *l, const sf_landmark *m) {
    sf_bundle_point p = {.at = {m->at[0], m->at[1], m->at[2]}};
    double center[3];
    if (m->state == SF_LANDMARK_KNOWN) return p;
    sf_rigid_center(&l->keyframes[m->keyframe].view.pose, center);
    for (int k = 0; k < 3; k++) p.ray[k] = m->at[k] - center[k];
    double length = sqrt(sf_dot3(p.ray, p.ray));
    for (int k = 0; k < 3; k++) p.ray[k] /= length;
    p.ray_information = 1 / pow(SF_GUESSED_DEPTH * length, 2);
    return p;
}

/* Whether a landmark belongs into the bundle: a free keyframe sees it, and another one. */
static int belongs(const sf_landmarks *l, const gathering *g, size_t m) {
    int seen = 0;
    for (size_t i = g->first[m]; i < g->first[m + 1]; i++)
        seen |= g->is_free[observation_at(l, g, i)->keyframe];
    return seen && g->first[m + 1] - g->first[m] > 1 && l->all[m].state != SF_LANDMARK_EMPTY;
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
            const sf_landmark_observation *s = observation_at(l, g, i);
            g->observations[b->observation_count++] =
                (sf_bundle_observation){(uint32_t)s->keyframe, point, s->u, s->v};
        }
    }
}

/* Takes over a landmark's place, and marks its outliers. */
static void accept_point(sf_landmarks *l, const gathering *g, size_t point, double most) {
    sf_landmark *m = &l->all[g->landmark_of[point]];
    const size_t *first = &g->first[g->landmark_of[point]];
    double widest = 1, p[3];
    int good = 0;
    memcpy(m->at, g->bundle.points[point].at, sizeof m->at);
    for (size_t i = first[0]; i < first[1]; i++) {
        sf_landmark_observation *s = &l->observations[g->order[i]];
        const sf_bundle_view *view = &l->keyframes[s->keyframe].view;
        if (!(sf_bundle_distance(view, m->at, s->u, s->v) <= most)) {
            s->landmark = SIZE_MAX;
            continue;
        }
        good++;
        widest = fmin(widest, sf_landmark_cosine(l, m, &view->pose));
    }
    sf_rigid_apply(&l->keyframes[m->keyframe].view.pose, m->at, p);
    if (!(p[2] > 0) || good < 2) {
        m->state = SF_LANDMARK_EMPTY;
    } else if (m->state == SF_LANDMARK_NEW) {
        m->inverse = 1 / p[2];
        if (good >= LEAST_OBSERVATIONS && widest < cos(PARALLAX))
            m->state = SF_LANDMARK_KNOWN, m->off_u = m->off_v = 0;
    }
}

/* Takes over the poses and places of the bundle. */
static void accept(sf_landmarks *l, const gathering *g, double spread) {
    size_t kept = 0;
    for (size_t k = 0; k < l->keyframe_count; k++) l->keyframes[k].view.pose = g->bundle.views[k].pose;
    for (size_t p = 0; p < g->bundle.point_count; p++) accept_point(l, g, p, sf_match_gate(spread));
    for (size_t i = 0; i < l->observation_count; i++)
        if (l->observations[i].landmark != SIZE_MAX) l->observations[kept++] = l->observations[i];
    l->observation_count = kept;
    sf_landmarks_drop_stale(l);
    for (size_t i = 0; i < l->count; i++) /* where their keyframes are by now */
        if (l->all[i].state == SF_LANDMARK_NEW)
            sf_landmark_place(l, &l->all[i], l->all[i].inverse, l->all[i].at);
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
        status = sf_bundle_adjust(l->ctx, &g.bundle, ROUNDS, &spread);
        if (!status) accept(l, &g, spread);
    }
    free_gathering(l, &g);
    return status;
}

/* Focal length */

/* What a bundle of all keyframes may change of it at most: beyond, something else is wrong. */
#define ZOOM_MOST 0.25
/* How well it was known before, as a part of it: this holds the focal length where a short way tells little.
 * First maps know it to 2 %. Observations of one track err alike, so that sixteen should count as one: the
 * same as taking a quarter of the 2 %. */
#define ZOOM_SIGMA 0.005

static void zoom_by(sf_landmarks *l, double zoom) {
    for (size_t k = 0; k <= l->keyframe_count; k++) {
        sf_lens *lens = k < l->keyframe_count ? &l->keyframes[k].view.lens : &l->view.lens;
        lens->fx *= zoom, lens->fy *= zoom;
    }
    for (size_t i = 0; i < l->count; i++) l->all[i].ray[0] /= zoom, l->all[i].ray[1] /= zoom;
}

sf_status sf_landmarks_calibrate(sf_landmarks *l, double *zoom) {
    enum { CALIBRATION_ROUNDS = 20 };
    gathering g = {0};
    double spread;
    *zoom = 1;
    if (l->keyframe_count < 3) return SF_OK;
    sf_bundle_camera camera = {.lens = l->keyframes[0].view.lens, .focal = 1};
    const double before = camera.lens.fx;
    camera.prior[0] = before, camera.information[0] = pow(ZOOM_SIGMA * before, -2);
    sf_status status = make_gathering(l, &g) ? SF_OK : SF_ERR_MEMORY;
    if (!status) {
        sort_observations(l, &g);
        memset(g.is_free, 1, l->keyframe_count);
        gather(l, &g);
        for (size_t k = 0; k < l->keyframe_count; k++) g.bundle.views[k].camera = 0;
        g.bundle.cameras = &camera, g.bundle.camera_count = 1;
        status = sf_bundle_adjust(l->ctx, &g.bundle, CALIBRATION_ROUNDS, &spread);
    }
    if (!status && fabs(log(camera.lens.fx / before)) < ZOOM_MOST) {
        *zoom = camera.lens.fx / before;
        zoom_by(l, *zoom);
        accept(l, &g, spread);
    }
    free_gathering(l, &g);
    return status;
}
