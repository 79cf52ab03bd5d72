/* two_view.c - see two_view.h. */
#include "two_view.h"

#include <math.h>
#include <string.h>

#include "../base/linear.h"
#include "../base/statistics.h"
#include "epipolar.h"
#include "essential.h"
#include "pair_models.h"
#include "plane.h"
#include "relative_pose.h"
#include "triangulate.h"

sf_two_view_options sf_two_view_options_default(void) {
    return (sf_two_view_options){.threshold = 0.003,
                                 .least_count = 15,
                                 .plane_share = 0.8,
                                 .turn_share = 0.9,
                                 .most_samples = 1000,
                                 .seed = 1};
}

typedef struct finder {
    const sf_two_view_options *o;
    sf_pairs p;
    double *scratch; /* [2 count] */
    double *angles;  /* [count] */
    uint8_t *flags;  /* [2 count] */
    sf_two_view *to;
} finder;

static sf_ransac_options options_of(const finder *f) {
    return (sf_ransac_options){.threshold = f->o->threshold,
                               .confidence = 0.9999,
                               .least = 20,
                               .most = f->o->most_samples,
                               .least_count = f->o->least_count,
                               .seed = f->o->seed};
}

/* 1. A camera that only turned */

static size_t mark_rotation(const finder *f, const double R[9], uint8_t *inliers) {
    double H[18];
    size_t count = 0;
    memcpy(H, R, 9 * sizeof *H);
    for (int i = 0; i < 9; i++) H[9 + i] = R[3 * (i % 3) + i / 3];
    for (size_t i = 0; i < f->p.count; i++) {
        double error = sf_homography_error(H, f->p.a + 2 * i, f->p.b + 2 * i);
        inliers[i] = error <= f->o->threshold * f->o->threshold;
        count += inliers[i];
    }
    return count;
}

/* From the homography's inliers on, to its own. */
static size_t find_rotation(const finder *f, double R[9], uint8_t *inliers) {
    enum { ROUNDS = 4 };
    size_t count = 0;
    for (int round = 0; round < ROUNDS; round++) {
        if (!sf_rotation_between(f->p.a, f->p.b, inliers, f->p.count, R)) return 0;
        count = mark_rotation(f, R, inliers);
    }
    return count;
}

/* 2. The pose of a pair that is general, or a plane */

static size_t mark_epipolar(const finder *f, const double E[9], uint8_t *inliers, double *cost) {
    double most = f->o->threshold * f->o->threshold;
    size_t count = 0;
    *cost = 0;
    for (size_t i = 0; i < f->p.count; i++) {
        double error = sf_sampson(E, f->p.a + 2 * i, f->p.b + 2 * i);
        inliers[i] = error <= most;
        count += inliers[i];
        *cost += fmin(error / most, 1);
    }
    return count;
}

/* Refines a pose over the given inliers; takes it if more of the pairs are in front of both cameras than of
 * the best one so far, or about as many at less cost. */
typedef struct candidate {
    sf_rigid T;
    size_t in_front;
    double cost;
} candidate;

static void try_pose(const finder *f, const sf_rigid *T, const uint8_t *inliers, candidate *best) {
    candidate c = {.T = *T};
    double E[9], length = sqrt(sf_dot3(T->t, T->t));
    uint8_t *marks = f->flags;
    if (!(length > 0)) return;
    for (int k = 0; k < 3; k++) c.T.t[k] /= length;
    /* Of a plane's poses, refining does not bring before the cameras what is behind them. */
    if (2 * sf_count_in_front(&c.T, f->p.a, f->p.b, inliers, f->p.count) < best->in_front) return;
    for (size_t i = 0; i < f->p.count; i++) f->scratch[i] = inliers[i];
    sf_relative_pose_refine(f->p.a, f->p.b, f->scratch, f->p.count, 10, &c.T);
    sf_essential_of_pose(&c.T, E);
    mark_epipolar(f, E, marks, &c.cost);
    c.in_front = sf_count_in_front(&c.T, f->p.a, f->p.b, marks, f->p.count);
    double margin = 0.02 * (double)best->in_front, more = (double)c.in_front - (double)best->in_front;
    if (best->in_front && (more < -margin || (more <= margin && !(c.cost < best->cost)))) return;
    *best = c;
}

/* inliers: of the essential matrix; on return, of the pose that was found. */
static void find_pose(const finder *f, const double E[9], int is_plane, uint8_t *inliers) {
    sf_two_view *to = f->to;
    candidate best = {.in_front = 0};
    sf_rigid poses[4];
    double cost;
    size_t kept = 0;
    if (to->general_count && sf_essential_pose(E, f->p.a, f->p.b, inliers, f->p.count, &poses[0]))
        try_pose(f, &poses[0], inliers, &best);
    int count = is_plane ? sf_homography_poses(to->H, poses, NULL) : 0;
    for (int k = 0; k < count; k++) try_pose(f, &poses[k], inliers, &best);
    if (!best.in_front) return;
    to->has_pose = 1;
    to->T = best.T;
    sf_essential_of_pose(&to->T, to->F);
    for (int i = 0; i < 9; i++) to->F[i] *= sqrt(0.5);
    to->general_count = mark_epipolar(f, to->F, inliers, &cost);
    for (size_t i = 0; i < f->p.count; i++)
        if (inliers[i]) f->angles[kept++] = sf_pair_angle(&to->T, f->p.a + 2 * i, f->p.b + 2 * i);
    to->angle = sf_median(f->angles, kept);
}

/* 3. Which of them */

static void decide(const finder *f, const double E[9], const uint8_t *by_plane, uint8_t *inliers) {
    sf_two_view *to = f->to;
    size_t more = to->general_count > to->plane_count ? to->general_count : to->plane_count;
    int is_plane =
        to->plane_count && (double)to->plane_count >= f->o->plane_share * (double)to->general_count;
    double R[9];
    if (is_plane && f->o->known) {
        uint8_t *turned = f->flags + f->p.count;
        memcpy(turned, by_plane, f->p.count);
        to->rotation_count = find_rotation(f, R, turned);
        if ((double)to->rotation_count >= f->o->turn_share * (double)more) {
            to->kind = SF_PAIR_ROTATION, to->count = to->rotation_count, to->has_pose = 1;
            memcpy(to->T.R, R, sizeof R);
            memcpy(inliers, turned, f->p.count);
            return;
        }
    }
    to->kind = !is_plane ? SF_PAIR_GENERAL : f->o->known ? SF_PAIR_PLANE : SF_PAIR_PLANE_OR_ROTATION;
    if (is_plane && to->plane_count >= to->general_count) memcpy(inliers, by_plane, f->p.count);
    if (f->o->known) find_pose(f, E, is_plane, inliers);
    to->count = is_plane && !to->has_pose ? more : to->general_count;
    if (f->o->known && !to->has_pose) to->kind = SF_PAIR_NONE, to->count = 0;
}

void sf_two_view_find(const sf_two_view_options *o, const double *a, const double *b, size_t count,
                      double *scratch, uint8_t *inliers, sf_two_view *to) {
    finder f = {.o = o, .p = {a, b, count}, .scratch = scratch, .angles = scratch + 2 * count, .to = to};
    sf_ransac_options r = options_of(&f);
    sf_ransac_result general, plane;
    f.flags = (uint8_t *)(scratch + 3 * count);
    uint8_t *by_plane = f.flags + 2 * count;
    const sf_ransac_problem epipolar = o->known ? sf_essential_problem(&f.p) : sf_fundamental_problem(&f.p);
    const sf_ransac_problem flat = sf_homography_problem(&f.p);
    memset(to, 0, sizeof *to);
    sf_ransac(&epipolar, &r, scratch, inliers, &general);
    size_t enough =
        (size_t)(o->plane_share * (double)general.count); /* fewer make no plane: not looked for */
    if (enough > r.least_count) r.least_count = enough;
    sf_ransac(&flat, &r, scratch, by_plane, &plane);
    to->general_count = general.count, to->plane_count = plane.count;
    if (general.count) memcpy(to->F, general.model, sizeof to->F);
    if (plane.count) memcpy(to->H, plane.model, sizeof to->H);
    if (general.count || plane.count) decide(&f, general.model, by_plane, inliers);
}
