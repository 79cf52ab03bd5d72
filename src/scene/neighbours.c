/* neighbours.c - the point that cameras look at, and the choice of views to match with. */
#include "neighbours.h"

#include <math.h>

#include "../base/statistics.h"

enum { LOCAL = 8 /* cameras that tell what one among them looks at */ };

/* Angles in radians between the rays of two cameras to one point: small ones do not determine its depth,
 * large ones change its look. */
#define BEST_ANGLE  0.16
#define LEAST_ANGLE 0.012
#define MOST_ANGLE  0.7
/* Greatest tangent of the angle between an optical axis and the point that the camera is said to look at. */
#define NEAR_AXIS 0.5
/* The least cosine between optical axes, and the least part of the picture that the other view sees. */
#define LEAST_COSINE  0.5
#define LEAST_OVERLAP 0.4

/* Squared distance of a point from a camera's optical axis. */
static double off_axis(const sf_camera *camera, const double point[3]) {
    const double *d = camera->R_cw + 6;
    double c[3], v[3], along = 0, square = 0;
    sf_camera_center(camera, c);
    for (int k = 0; k < 3; k++) v[k] = point[k] - c[k], along += v[k] * d[k];
    for (int k = 0; k < 3; k++) square += (v[k] - along * d[k]) * (v[k] - along * d[k]);
    return square;
}

/* The point with the least weighted sum of squared distances from the optical axes. An axis that is `soft` or
 * more away from `focus` weighs less, by its distance; soft 0: all weigh the same. */
static void solve_focus(const sf_camera *const *cameras, size_t n, double soft, double focus[3]) {
    double M[6] = {0}, b[3] = {0}; /* sum of w (I - d d^T), and that times the centres */
    for (size_t i = 0; i < n; i++) {
        const double *d = cameras[i]->R_cw + 6;
        double c[3], along, w = soft > 0 ? soft / fmax(sqrt(off_axis(cameras[i], focus)), soft) : 1;
        sf_camera_center(cameras[i], c);
        along = d[0] * c[0] + d[1] * c[1] + d[2] * c[2];
        M[0] += w * (1 - d[0] * d[0]), M[1] -= w * d[0] * d[1], M[2] -= w * d[0] * d[2];
        M[3] += w * (1 - d[1] * d[1]), M[4] -= w * d[1] * d[2], M[5] += w * (1 - d[2] * d[2]);
        for (int k = 0; k < 3; k++) b[k] += w * (c[k] - along * d[k]);
    }
    double m00 = M[3] * M[5] - M[4] * M[4], m01 = M[2] * M[4] - M[1] * M[5], m02 = M[1] * M[4] - M[2] * M[3];
    double m11 = M[0] * M[5] - M[2] * M[2], m12 = M[1] * M[2] - M[0] * M[4], m22 = M[0] * M[3] - M[1] * M[1];
    double det = M[0] * m00 + M[1] * m01 + M[2] * m02;
    focus[0] = (m00 * b[0] + m01 * b[1] + m02 * b[2]) / det; /* not finite for parallel axes */
    focus[1] = (m01 * b[0] + m11 * b[1] + m12 * b[2]) / det;
    focus[2] = (m02 * b[0] + m12 * b[1] + m22 * b[2]) / det;
}

/* Median distance of a point from the optical axes of up to FOCUS_AXES cameras. */
static double median_off_axis(const sf_camera *const *cameras, size_t n, const double focus[3]) {
    enum { FOCUS_AXES = 256 };
    double values[FOCUS_AXES];
    size_t count = n < FOCUS_AXES ? n : FOCUS_AXES;
    for (size_t k = 0; k < count; k++) values[k] = off_axis(cameras[k * n / count], focus);
    return sqrt(sf_median(values, count));
}

void sf_focus_point(const sf_camera *const *cameras, size_t n, double focus[3]) {
    enum { ROUNDS = 20 };
    solve_focus(cameras, n, 0, focus);
    for (int round = 0; round < ROUNDS && isfinite(focus[0]); round++) {
        double soft = 3 * median_off_axis(cameras, n, focus); /* Huber's weights: one far axis pulls little */
        if (!(soft > 0)) return;
        solve_focus(cameras, n, soft, focus);
    }
}

double sf_look_distance(const sf_camera *camera, const double focus[3], double extent) {
    const double *R = camera->R_cw + 6;
    double depth = R[0] * focus[0] + R[1] * focus[1] + R[2] * focus[2] + camera->t_cw[2];
    int plausible = depth > 0.05 * extent && (depth < 100 * extent || !(extent > 0));
    return isfinite(depth) && plausible ? depth : extent;
}

/* Whether a camera's axis passes near a point in front of it: within NEAR_AXIS of its depth. */
static int looks_at(const sf_camera *camera, const double point[3]) {
    const double *R = camera->R_cw + 6;
    double depth = R[0] * point[0] + R[1] * point[1] + R[2] * point[2] + camera->t_cw[2];
    return isfinite(depth) && depth > 0 && sqrt(off_axis(camera, point)) < NEAR_AXIS * depth;
}

static int share_focus(const sf_camera *const *cameras, size_t n, const double focus[3]) {
    size_t looking = 0;
    for (size_t i = 0; i < n; i++) looking += (size_t)looks_at(cameras[i], focus);
    return 2 * looking > n;
}

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static double distance_between(const double *a, const double *b) {
    double d[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
    return sqrt(dot(d, d));
}

/* Part of a grid of the camera's pixels, at a depth, that is in the other's picture. */
static double overlap(const sf_camera *camera, const sf_camera *other, double depth) {
    enum { SAMPLES = 5 };
    int inside = 0;
    for (int i = 0; i < SAMPLES * SAMPLES; i++) {
        double x = (i % SAMPLES + 0.5) / SAMPLES * camera->width, p[3], q[3];
        double y = (i / SAMPLES + 0.5) / SAMPLES * camera->height;
        double c[3] = {(x - camera->cx) / camera->fx * depth - camera->t_cw[0],
                       (y - camera->cy) / camera->fy * depth - camera->t_cw[1], depth - camera->t_cw[2]};
        for (int k = 0; k < 3; k++)
            p[k] = camera->R_cw[k] * c[0] + camera->R_cw[3 + k] * c[1] + camera->R_cw[6 + k] * c[2];
        for (int k = 0; k < 3; k++) q[k] = dot(other->R_cw + 3 * k, p) + other->t_cw[k];
        double u = other->fx * q[0] / q[2] + other->cx, v = other->fy * q[1] / q[2] + other->cy;
        inside += q[2] > 0 && u > 0 && u < other->width && v > 0 && v < other->height;
    }
    return (double)inside / (SAMPLES * SAMPLES);
}

/* Cost of camera b as a neighbour of a: 0 is best, INFINITY: unsuitable. */
static double unfitness(const sf_camera *a, const sf_camera *b, double distance) {
    double ca[3], cb[3], to_a[3], to_b[3];
    if (dot(a->R_cw + 6, b->R_cw + 6) < LEAST_COSINE) return INFINITY;
    sf_camera_center(a, ca);
    sf_camera_center(b, cb);
    for (int k = 0; k < 3; k++) {
        to_a[k] = -distance * a->R_cw[6 + k]; /* from the point that a looks at */
        to_b[k] = cb[k] - (ca[k] + distance * a->R_cw[6 + k]);
    }
    double length = sqrt(dot(to_b, to_b));
    double cosine = dot(to_a, to_b) / (distance * length), angle = acos(fmax(-1, fmin(1, cosine)));
    if (!(angle >= LEAST_ANGLE && angle <= MOST_ANGLE)) return INFINITY;
    double seen = overlap(a, b, distance);
    if (seen < LEAST_OVERLAP) return INFINITY;
    return fabs(log(angle / BEST_ANGLE)) + fabs(log(length / distance)) + (1 - seen);
}

/* Whether b is far enough from all chosen cameras, as seen from a. */
static int apart(const sf_camera *const *cameras, size_t a, size_t b, const size_t *chosen, size_t count) {
    double ca[3], cb[3], cc[3];
    sf_camera_center(cameras[a], ca);
    sf_camera_center(cameras[b], cb);
    for (size_t i = 0; i < count; i++) {
        sf_camera_center(cameras[chosen[i]], cc);
        if (distance_between(cb, cc) < 0.5 * distance_between(ca, cb)) return 0;
    }
    return 1;
}

static int is_chosen(const size_t *chosen, size_t count, size_t i) {
    while (count && chosen[count - 1] != i) count--;
    return count > 0;
}

/* The best candidate that is not chosen yet; n: all are chosen. */
static size_t fittest(const sf_camera *const *cameras, size_t n, size_t self, double distance,
                      const size_t *chosen, size_t count, int want_apart) {
    size_t best = n;
    double least = INFINITY;
    for (size_t i = 0; i < n; i++) {
        if (i == self || is_chosen(chosen, count, i)) continue;
        if (want_apart && !apart(cameras, self, i, chosen, count)) continue;
        double u = unfitness(cameras[self], cameras[i], distance);
        if (u < least) least = u, best = i;
    }
    return best;
}

size_t sf_choose_neighbours(const sf_camera *const *cameras, size_t n, size_t self, double distance,
                            size_t most, size_t *chosen) {
    size_t count = 0;
    for (int want_apart = 1; want_apart >= 0; want_apart--)
        while (count < most) {
            size_t i = fittest(cameras, n, self, distance, chosen, count, want_apart);
            if (i == n) break;
            chosen[count++] = i;
        }
    return count;
}

/* Sets near[0 ..] to the cameras nearest to `self`, itself first, and their distances; returns how many. */
static size_t nearest_cameras(const sf_camera *const *cameras, size_t n, size_t self,
                              const sf_camera *near[LOCAL], double distances[LOCAL]) {
    double own[3], other[3];
    size_t count = 0;
    sf_camera_center(cameras[self], own);
    for (size_t i = 0; i < n; i++) {
        sf_camera_center(cameras[i], other);
        double distance = i == self ? -1 : distance_between(own, other);
        size_t at = count < LOCAL ? count++ : LOCAL;
        while (at && distances[at - 1] > distance) {
            if (at < LOCAL) near[at] = near[at - 1], distances[at] = distances[at - 1];
            at--;
        }
        if (at < LOCAL) near[at] = cameras[i], distances[at] = distance;
    }
    return count;
}

/* The distance that a camera looks at, by the cameras nearest to it. */
static double local_distance(const sf_camera *const *cameras, size_t n, size_t self, double extent) {
    const sf_camera *near[LOCAL];
    double distances[LOCAL], focus[3];
    size_t count = nearest_cameras(cameras, n, self, near, distances);
    sf_focus_point(near, count, focus);
    if (looks_at(cameras[self], focus)) return sf_look_distance(cameras[self], focus, 0);
    size_t beside = count < 4 ? count : 4;
    double apart = beside > 1 ? sf_median(distances + 1, beside - 1) : 0;
    return apart > 0 ? apart / BEST_ANGLE : extent;
}

int sf_look_distances(const sf_camera *const *cameras, size_t n, double extent, double *distances) {
    double focus[3];
    sf_focus_point(cameras, n, focus);
    int shared = share_focus(cameras, n, focus);
    for (size_t i = 0; i < n; i++)
        distances[i] =
            shared ? sf_look_distance(cameras[i], focus, extent) : local_distance(cameras, n, i, extent);
    return shared;
}

int sf_camera_sees(const sf_camera *c, const double p[3], double *u, double *v, double *z) {
    double q[3];
    for (int k = 0; k < 3; k++)
        q[k] = c->R_cw[3 * k] * p[0] + c->R_cw[3 * k + 1] * p[1] + c->R_cw[3 * k + 2] * p[2] + c->t_cw[k];
    *u = c->fx * q[0] / q[2] + c->cx, *v = c->fy * q[1] / q[2] + c->cy, *z = q[2];
    return q[2] > 0 && *u >= 0 && *u < c->width && *v >= 0 && *v < c->height;
}
