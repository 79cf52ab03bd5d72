/* pose_check.c - see pose_check.h.
 *
 * Poses in another convention than the one that is wanted are poses as well: nothing but the pictures tells.
 * The geometry of a pair by its matches alone says which of them are right; those must be on the lines that
 * the poses say.
 */
#include "pose_check.h"

#include <string.h>

#include <splatfit/camera.h>

#include "../base/linear.h"
#include "../scene/gaussian_math.h"
#include "../sfm/epipolar.h"
#include "../sfm/match.h"
#include "../sfm/two_view.h"

enum {
    APART = 8,         /* keyframes */
    PAIRS = 5,         /* that decide */
    LEAST_MATCHES = 30 /* of a pair */
};

#define LEAST_ANGLE 0.05 /* rad: nearer points are on all lines */
#define FARTHEST    0.01 /* px / focal length, from a line */
/* The least share of right poses, and that of another reading that is named. */
#define RIGHT 0.5
#define NAMED 0.7

/* 1. What a pose would be if it had been meant otherwise */

/* The quaternion as it came, its w first. */
static void turn_quaternion(sf_rigid *pose) {
    double R[9], q[4], center[3] = {0, 0, 0}, t[3];
    sf_rigid_center(pose, center);
    for (int i = 0; i < 9; i++) R[i] = pose->R[3 * (i % 3) + i / 3];
    sf_rotation_to_quat(R, q); /* w, x, y, z */
    sf_unit_quat_rotation(q[1], q[2], q[3], q[0], R);
    for (int i = 0; i < 9; i++) pose->R[i] = R[3 * (i % 3) + i / 3];
    sf_mat3_vec(pose->R, center, t);
    for (int k = 0; k < 3; k++) pose->t[k] = -t[k];
}

static void read_otherwise(int reading, sf_rigid *pose) {
    static const double flip[9] = {1, 0, 0, 0, -1, 0, 0, 0, -1};
    sf_rigid from = *pose;
    if (reading == 1) sf_rigid_invert(&from, pose);
    if (reading == 2) {
        sf_mat3_mul(flip, from.R, pose->R);
        sf_mat3_vec(flip, from.t, pose->t);
    }
    if (reading == 3) turn_quaternion(pose);
}

static const char *const readings[SF_POSE_READINGS] = {NULL, "world to camera",
                                                       "y up and z back, as OpenGL has it", "qw qx qy qz"};

/* 2. A pair */

typedef struct pair {
    double *a, *b, *scratch; /* rays [count][2] */
    uint8_t *inliers;
} pair;

static int make_pair(sf_context *ctx, size_t count, pair *p) {
    *p = (pair){.a = sf_alloc(ctx, 2 * count + 1, sizeof *p->a),
                .b = sf_alloc(ctx, 2 * count + 1, sizeof *p->b),
                .scratch = sf_alloc(ctx, SF_TWO_VIEW_SCRATCH * count + 1, sizeof *p->scratch),
                .inliers = sf_alloc(ctx, count + 1, 1)};
    return p->a && p->b && p->scratch && p->inliers;
}

static void free_pair(sf_context *ctx, pair *p) {
    sf_free(ctx, p->a);
    sf_free(ctx, p->b);
    sf_free(ctx, p->scratch);
    sf_free(ctx, p->inliers);
}

static void ray_of(const sf_camera *c, const sf_keypoint *from, double ray[2]) {
    ray[0] = ((double)from->x - c->cx) / c->fx;
    ray[1] = ((double)from->y - c->cy) / c->fy;
}

/* E = [t]x R of the second camera from the first one, of norm 1. */
static void essential_of(const sf_rigid *first, const sf_rigid *second, double E[9]) {
    sf_rigid back, way;
    sf_rigid_invert(first, &back);
    sf_rigid_compose(second, &back, &way);
    const double *t = way.t;
    const double cross[9] = {0, -t[2], t[1], t[2], 0, -t[0], -t[1], t[0], 0};
    sf_mat3_mul(cross, way.R, E);
}

static size_t count_agreeing(const pair *p, size_t count, const double E[9]) {
    size_t agree = 0;
    for (size_t i = 0; i < count; i++)
        agree += p->inliers[i] && sf_sampson(E, p->a + 2 * i, p->b + 2 * i) < FARTHEST * FARTHEST;
    return agree;
}

static void compare(sf_live *live, const sf_keyframe *first, const sf_keyframe *second, const sf_matches *m,
                    pair *p) {
    sf_pose_check *check = &live->pose_check;
    sf_two_view_options options = sf_two_view_options_default();
    sf_two_view found;
    options.known = 1;
    for (size_t i = 0; i < m->count; i++) {
        ray_of(&live->input.picture->camera, &first->place.features.points[m->items[i].a], p->a + 2 * i);
        ray_of(&live->input.picture->camera, &second->place.features.points[m->items[i].b], p->b + 2 * i);
    }
    sf_two_view_find(&options, p->a, p->b, m->count, p->scratch, p->inliers, &found);
    if (found.kind != SF_PAIR_GENERAL || found.count < LEAST_MATCHES || !(found.angle >= LEAST_ANGLE)) return;
    check->pairs++;
    check->matches += found.count;
    for (int reading = 0; reading < SF_POSE_READINGS; reading++) {
        sf_rigid a = first->outside, b = second->outside;
        double E[9];
        read_otherwise(reading, &a);
        read_otherwise(reading, &b);
        essential_of(&a, &b, E);
        check->agree[reading] += count_agreeing(p, m->count, E);
    }
}

/* 3. All pairs */

static void tell(const sf_live *live) {
    static const char wanted[] =
        "wanted are camera to world, x right, y down, z ahead, lines of time x y z qx qy "
        "qz qw, and the times of the frames";
    const sf_pose_check *check = &live->pose_check;
    double all = (double)check->matches;
    int best = 1;
    if ((double)check->agree[0] >= RIGHT * all) return;
    for (int i = 2; i < SF_POSE_READINGS; i++)
        if (check->agree[i] > check->agree[best]) best = i;
    double here = 100 * (double)check->agree[0] / all, there = 100 * (double)check->agree[best] / all;
    if (there >= 100 * NAMED)
        sf_log(live->ctx, SF_LOG_WARNING,
               "poses: the pictures contradict them: %.0f %% of %zu matches between %d pairs of keyframes "
               "agree, "
               "but %.0f %% if they are %s; %s",
               here, check->matches, check->pairs, there, readings[best], wanted);
    else
        sf_log(live->ctx, SF_LOG_WARNING,
               "poses: the pictures contradict them: %.0f %% of %zu matches between %d pairs of keyframes "
               "agree; "
               "%s; or the lens is wrong",
               here, check->matches, check->pairs, wanted);
}

sf_status sf_live_check_poses(sf_live *live) {
    size_t count = live->keyframes.count;
    if (!live->options.pose || live->localizer.has_own_world || live->pose_check.pairs >= PAIRS) return SF_OK;
    if (count <= APART) return SF_OK;
    const sf_keyframe *first = &live->keyframes.list[count - 1 - APART], *second = first + APART;
    if (!first->has_outside || !second->has_outside) return SF_OK;
    sf_match_options options = sf_match_options_default();
    sf_matches matches = {0};
    pair p = {.a = NULL};
    sf_status status =
        sf_match_pair(live->ctx, &first->place.features, &second->place.features, &options, &matches);
    if (!status && matches.count >= LEAST_MATCHES) {
        status = make_pair(live->ctx, matches.count, &p) ? SF_OK : SF_ERR_MEMORY;
        if (!status) compare(live, first, second, &matches, &p);
        free_pair(live->ctx, &p);
        if (!status && live->pose_check.pairs == PAIRS) tell(live);
    }
    sf_matches_free(live->ctx, &matches);
    return status;
}
