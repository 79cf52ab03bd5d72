/* refine.c - refinement of poses and focal lengths. */
#include "refine.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../base/linear.h"
#include "../base/statistics.h"
#include "../render/shard.h"
#include "adam.h"
#include "follow.h"

static const double pi = 3.141592653589793;

/* Step sizes of poses, in rates. */
#define FIRST_SIZE 0.01
#define GROWTH     1.5
#define FALL       0.5

/* 1. The gauge: two fixed poses */

static double distance_between(const sf_camera *a, const sf_camera *b) {
    double p[3], q[3], sum = 0;
    sf_camera_center(a, p);
    sf_camera_center(b, q);
    for (int k = 0; k < 3; k++) sum += (p[k] - q[k]) * (p[k] - q[k]);
    return sqrt(sum);
}

/* The view whose camera is farthest from that of `from`; NULL: there is no other. */
static sf_view_state *farthest(const sf_view_states *views, const sf_view_state *from) {
    sf_view_state *best = NULL;
    double most = -1;
    for (size_t i = 0; i < views->count; i++) {
        sf_view_state *view = &views->states[i];
        double distance = view == from ? -1 : distance_between(&view->given, &from->given);
        if (distance > most) best = view, most = distance;
    }
    return best;
}

void sf_hold_two(sf_view_states *views) {
    sf_view_state *held[2] = {NULL, NULL};
    int count = 0;
    for (size_t i = 0; i < views->count && count < 2; i++)
        if (views->states[i].held) held[count++] = &views->states[i];
    if (!views->count || count == 2) return;
    if (!held[0]) held[0] = farthest(views, &views->states[0]);
    if (!held[0]) held[0] = &views->states[0]; /* the only one */
    held[0]->held = 1;
    held[1] = farthest(views, held[0]);
    if (held[1]) held[1]->held = 1;
}

/* 2. The cameras */

static void pose_in_use(const sf_view_state *view, sf_camera *camera) {
    memcpy(camera->R_cw, view->R_cw, sizeof view->R_cw);
    memcpy(camera->t_cw, view->t_cw, sizeof view->t_cw);
}

void sf_refine_camera(const sf_view_states *views, uint32_t id, sf_camera *camera) {
    const sf_view_state *view = sf_view_state_of(views, id);
    const sf_view_lens *lens = view ? &views->lenses[view->lens] : sf_view_lens_of(views, camera);
    if (view)
        pose_in_use(view, camera);
    else
        sf_follow_neighbours(views, camera);
    if (lens) {
        camera->fx *= exp(lens->log_focal[0]);
        camera->fy *= exp(lens->log_focal[1]);
    }
}

void sf_begin_at_neighbours(sf_view_states *views, const uint32_t *ids, size_t count) {
    for (size_t i = 0; i < count; i++) {
        sf_view_state *view = sf_view_state_of(views, ids[i]);
        if (!view || view->depth > 0 || view->held) continue;
        sf_camera start = view->given;
        sf_follow_neighbours(views, &start);
        memcpy(view->R_cw, start.R_cw, sizeof view->R_cw);
        memcpy(view->t_cw, start.t_cw, sizeof view->t_cw);
    }
}

void sf_note_depth(sf_view_state *view, const sf_workspace *ws, double otherwise) {
    if (view->depth > 0) return;
    const sf_splat *splats;
    const uint8_t *states;
    double sum[2] = {0}; /* harmonic mean: very distant Gaussians hardly count */
    size_t count = sf_shard_own(ws, &splats, &states);
    for (size_t i = 0; i < count; i++)
        if (states[i] == SF_SEEN) sum[0] += 1 / (double)splats[i].depth, sum[1]++;
    sf_shard_sum(ws, sum, 2);
    view->depth = sum[1] > 0 ? ldexp(sum[1] / sum[0], ws->unit) : otherwise;
}

/* 3. The steps */

/* p_c' = E (p_c - pivot) + pivot + rho */
static void move(sf_view_state *view, const double rho[3], const double phi[3]) {
    const double pivot[3] = {0, 0, view->depth};
    double E[9], R[9], arm[3], turned[3];
    sf_rotation_exp(phi, E);
    sf_mat3_mul(E, view->R_cw, R);
    for (int k = 0; k < 3; k++) arm[k] = view->t_cw[k] - pivot[k];
    sf_mat3_vec(E, arm, turned);
    memcpy(view->R_cw, R, sizeof R);
    for (int k = 0; k < 3; k++) view->t_cw[k] = turned[k] + pivot[k] + rho[k];
}

static void measure(sf_view_state *view) {
    sf_camera now;
    double trace = 0;
    pose_in_use(view, &now);
    for (int k = 0; k < 9; k++) trace += now.R_cw[k] * view->given.R_cw[k];
    /* |R - R'|^2 = 6 - 2 trace = 8 sin^2(angle / 2) */
    view->turned_deg = 2 * asin(fmin(sqrt(fmax(6 - 2 * trace, 0) / 8), 1)) * 180 / pi;
    view->moved_depths = view->depth > 0 ? distance_between(&now, &view->given) / view->depth : 0;
}

/* Resilient propagation (Riedmiller and Braun 1993): each value has a step size of its own, which grows while
 * the gradient keeps its sign, and falls when it changes. The pose of a view that is right already, whose
 * gradients are noise, comes to rest, and one that is off is as fast as `rate` allows. Adam would move both
 * by about the rate: gradients of the first are small, but so are its moments. 0: a gradient is not finite.
 */
static int next_step(sf_view_state *view, const double gradient[6], double rate, double step[6]) {
    for (int k = 0; k < 6; k++)
        if (!isfinite(gradient[k])) return 0;
    if (!view->pose.steps++)
        for (int k = 0; k < 6; k++) view->pose.size[k] = FIRST_SIZE;
    for (int k = 0; k < 6; k++) {
        double *last = &view->pose.last[k], *size = &view->pose.size[k], kept = *last * gradient[k];
        *size = fmin(kept > 0 ? *size * GROWTH : kept < 0 ? *size * FALL : *size, 1);
        *last = kept < 0 ? 0 : gradient[k]; /* a change of sign counts once */
        step[k] = kept < 0 || gradient[k] == 0 ? 0 : copysign(rate * *size, gradient[k]);
    }
    return 1;
}

/* The camera turns about a pivot at the depth of what it sees. A turn about its own centre moves the picture
 * like a translation, and steps that scale each value by itself would let both work against each other.
 * With the pivot c on the optical axis, rho = rho' - phi x c, so dL/dphi' = dL/dphi - c x dL/drho; with rho'
 * in depths both are angles. */
void sf_refine_pose(sf_view_state *view, const double *gradient, double rate) {
    if (view->held) return;
    double depth = view->depth, step[6], rho[3], phi[3];
    const double turned[6] = {depth * gradient[0],
                              depth * gradient[1],
                              depth * gradient[2],
                              gradient[3] + depth * gradient[1],
                              gradient[4] - depth * gradient[0],
                              gradient[5]};
    if (!next_step(view, turned, rate, step)) return;
    for (int k = 0; k < 3; k++) {
        rho[k] = -depth * step[k];
        phi[k] = -step[3 + k];
    }
    move(view, rho, phi);
    measure(view);
}

void sf_refine_focal(const sf_view_states *views, const sf_view_state *view, const double *gradient,
                     const sf_fit_options *options, double rate) {
    sf_view_lens *lens = &views->lenses[view->lens];
    double step[2];
    sf_small_moments moments = {lens->focal.m, lens->focal.v};
    sf_adam_small(options, rate, ++lens->focal.steps, 2, gradient, moments, step);
    for (int k = 0; k < 2; k++) lens->log_focal[k] -= step[k];
}

/* 4. The gauge: the mean correction */

/* Correction of a view: the rotation in its own frame, and the displacement of the centre in the world. */
static void correction(const sf_view_state *view, double out[6]) {
    sf_camera now;
    double given[9], E[9], from[3], to[3];
    pose_in_use(view, &now);
    for (int k = 0; k < 9; k++) given[k] = view->given.R_cw[k % 3 * 3 + k / 3];
    sf_mat3_mul(now.R_cw, given, E);
    out[0] = (E[7] - E[5]) / 2, out[1] = (E[2] - E[6]) / 2, out[2] = (E[3] - E[1]) / 2;
    sf_camera_center(&view->given, from);
    sf_camera_center(&now, to);
    for (int k = 0; k < 3; k++) out[3 + k] = to[k] - from[k];
}

/* The part of a mean beyond chance: m - 4 e^2 / m if |m| is above twice its standard error e, else 0. */
static double beyond_chance(double mean, double error2) { return sf_shrunk_mean(mean, 4 * error2); }

/* Common part of all corrections. Errors of given poses are independent; what all corrections have in common
 * is drift of the model. */
typedef struct shared_part {
    double turn[3], shift[3]; /* mean rotation in the camera frames, mean displacement of the centres */
    double scaling, from[3];  /* scale change of the distances from the mean centre `from` */
} shared_part;

static void find_shared(const sf_view_states *views, shared_part *shared) {
    double mean[6] = {0}, square[6] = {0}, n = (double)views->count, c[6], center[3], along = 0, far = 0,
           left = 0;
    *shared = (shared_part){0};
    for (size_t i = 0; i < views->count; i++) {
        correction(&views->states[i], c);
        sf_camera_center(&views->states[i].given, center);
        for (int k = 0; k < 6; k++) mean[k] += c[k] / n, square[k] += c[k] * c[k] / n;
        for (int k = 0; k < 3; k++) shared->from[k] += center[k] / n;
    }
    for (int k = 0; k < 3; k++) {
        shared->turn[k] = beyond_chance(mean[k], (square[k] - mean[k] * mean[k]) / (n - 1));
        shared->shift[k] = beyond_chance(mean[3 + k], (square[3 + k] - mean[3 + k] * mean[3 + k]) / (n - 1));
    }
    for (size_t i = 0; i < views->count; i++) {
        correction(&views->states[i], c);
        sf_camera_center(&views->states[i].given, center);
        for (int k = 0; k < 3; k++) {
            double arm = center[k] - shared->from[k], moved = c[3 + k] - mean[3 + k];
            along += moved * arm, far += arm * arm, left += moved * moved;
        }
    }
    if (!(far > 0)) return;
    double scaling = along / far;
    shared->scaling = beyond_chance(scaling, (left / far - scaling * scaling) / (3 * n - 4));
}

void sf_hold_mean(sf_view_states *views) {
    double back[9], R[9], o[3];
    shared_part shared;
    if (views->count < 2) return;
    for (size_t i = 0; i < views->count; i++)
        if (views->states[i].held) return;
    find_shared(views, &shared);
    const double turn[3] = {-shared.turn[0], -shared.turn[1], -shared.turn[2]};
    sf_rotation_exp(turn, back);
    for (size_t i = 0; i < views->count; i++) {
        sf_view_state *view = &views->states[i];
        sf_camera now;
        pose_in_use(view, &now);
        sf_camera_center(&now, o);
        for (int k = 0; k < 3; k++) o[k] = shared.shift[k] - o[k] + shared.scaling * (o[k] - shared.from[k]);
        sf_mat3_mul(back, now.R_cw, R);
        memcpy(view->R_cw, R, sizeof R);
        sf_mat3_vec(R, o, view->t_cw);
        measure(view);
    }
}

/* 5. Statistics */

void sf_refinement(const sf_view_states *views, double *degrees, double *depths, double *focal) {
    double *values = views->scratch;
    for (size_t i = 0; i < views->count; i++) values[i] = views->states[i].turned_deg;
    *degrees = sf_median(values, views->count);
    for (size_t i = 0; i < views->count; i++) values[i] = views->states[i].moved_depths;
    *depths = sf_median(values, views->count);
    for (size_t i = 0; i < views->count; i++) {
        const double *log_focal = views->lenses[views->states[i].lens].log_focal;
        values[i] = expm1((log_focal[0] + log_focal[1]) / 2);
    }
    *focal = sf_median(values, views->count);
}
