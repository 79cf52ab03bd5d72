/* board_pose.c - the pose of a board in one picture (README, P.6). */
#include <math.h>
#include <string.h>

#include "../base/context.h"
#include "../base/linear.h"
#include "../io/undistort.h"
#include "edge_bias.h"

enum { LEAST_CORNERS = 4, ROUNDS = 3, EDGE_BIAS_ROUNDS = 2 };

/* Corners further off than REJECT spreads, and than REJECT_PX, do not belong to the pose. */
static const double LEAST_SPREAD = 0.1, REJECT = 4.5, REJECT_PX = 0.5;

/* What is known of a pose while it is looked for. */
typedef struct search {
    const sf_lens *lens;
    sf_corner_list list;
    double distances[SF_CORNERS_MOST];
    uint8_t rejected[SF_CORNERS_MOST];
    sf_board_corner corners[SF_CORNERS_MOST]; /* as they would be without the edge bias */
    sf_edge_bias edge_bias;
} search;

static double spread_about(search *s, const sf_rigid *T) {
    sf_view_distances(s->lens, T, &s->list, s->distances);
    return fmax(sf_spread(s->distances, s->list.count), LEAST_SPREAD);
}

static size_t reject(search *s, const sf_rigid *T, double spread) {
    size_t rejected = 0;
    sf_view_distances(s->lens, T, &s->list, s->distances);
    for (size_t i = 0; i < s->list.count; i++)
        rejected += s->rejected[i] = s->distances[i] > fmax(REJECT * spread, REJECT_PX);
    return rejected;
}

/* Robustly, then with all weights 1 over the corners that belong to it. Returns how many do not. */
static size_t fit(search *s, sf_rigid *T) {
    s->list.rejected = NULL;
    for (int round = 0; round < ROUNDS; round++)
        sf_view_refine(s->lens, &s->list, SF_CAUCHY * spread_about(s, T), T);
    size_t rejected = reject(s, T, spread_about(s, T));
    s->list.rejected = s->rejected;
    if (s->list.count - rejected >= LEAST_CORNERS) sf_view_refine(s->lens, &s->list, 0, T);
    return rejected;
}

/* The board turned about its middle so that its axis is mirrored at the line of sight: the other pose that a
 * small board may have. */
static void mirror(const search *s, const sf_rigid *T, sf_rigid *other) {
    double middle[3] = {0}, sight[3], axis[3] = {T->R[2], T->R[5], T->R[8]}, turn[3], Q[9], moved[3];
    for (size_t i = 0; i < s->list.count; i++)
        for (int k = 0; k < 2; k++) middle[k] += s->list.corners[i].board[k] / (double)s->list.count;
    sf_mat3_vec(T->R, middle, moved);
    for (int i = 0; i < 3; i++) sight[i] = moved[i] + T->t[i];
    sf_cross3(axis, sight, turn);
    double sine = sqrt(sf_dot3(turn, turn)), angle = atan2(sine, sf_dot3(axis, sight));
    for (int i = 0; i < 3; i++) turn[i] *= sine > 0 ? 2 * angle / sine : 0;
    sf_rotation_exp(turn, Q);
    sf_mat3_mul(Q, T->R, other->R);
    sf_mat3_vec(other->R, middle, moved);
    for (int i = 0; i < 3; i++) other->t[i] = sight[i] - moved[i];
}

static double rms_of(const search *s, const sf_rigid *T) {
    sf_view_sums sums;
    sf_view_sum(s->lens, T, &s->list, 0, SF_VIEW_COST, &sums);
    return sums.count ? sqrt(sums.squares / (double)sums.count) : INFINITY;
}

static int same_pose(const sf_rigid *a, const sf_rigid *b) {
    double squares = 0;
    for (int i = 0; i < 9; i++) squares += pow(a->R[i] - b->R[i], 2);
    return squares < 1e-6;
}

/* Takes the better of the two poses; returns the ambiguity. */
static double choose(search *s, sf_rigid *T, size_t *rejected) {
    sf_rigid other;
    mirror(s, T, &other);
    sf_corner_list all = s->list;
    all.rejected = NULL;
    double scale = SF_CAUCHY * spread_about(s, T);
    double cost = sf_view_refine(s->lens, &all, scale, &other);
    sf_view_sums mine;
    sf_view_sum(s->lens, T, &all, scale, SF_VIEW_COST, &mine);
    if (!isfinite(cost) || same_pose(T, &other)) return 0;
    if (cost < mine.cost) {
        sf_rigid swap = *T;
        *T = other;
        other = swap;
        *rejected = fit(s, T);
    }
    sf_view_refine(s->lens, &s->list, 0, &other);
    double worse = rms_of(s, &other), better = rms_of(s, T);
    return same_pose(T, &other) || !isfinite(worse) ? 0 : worse > 0 ? fmin(better / worse, 1) : 1;
}

static int covariance(const search *s, const sf_rigid *T, double out[SF_TWIST * SF_TWIST]) {
    sf_view_sums sums;
    sf_view_sum(s->lens, T, &s->list, 0, SF_VIEW_TWIST, &sums);
    double freedom = 2 * (double)sums.count - SF_TWIST;
    double variance = fmax(sums.squares / freedom, LEAST_SPREAD * LEAST_SPREAD);
    if (!sf_cholesky(SF_TWIST, sums.twist)) return 0;
    sf_cholesky_invert(SF_TWIST, sums.twist, out);
    const double *twist = s->edge_bias.twist;
    for (int i = 0; i < SF_TWIST * SF_TWIST; i++)
        out[i] = variance * out[i] + s->edge_bias.variance * twist[i / SF_TWIST] * twist[i % SF_TWIST];
    return 1;
}

/* 0 if no pose explains the corners. */
static int find_pose(search *s, sf_pose *pose) {
    sf_rigid T;
    if (!sf_view_first_pose(s->lens, &s->list, &T)) return 0;
    pose->rejected = fit(s, &T);
    for (int round = 0; round < EDGE_BIAS_ROUNDS; round++)
        if (sf_estimate_edge_bias(s->lens, &T, &s->list, s->corners, &s->edge_bias))
            pose->rejected = fit(s, &T);
    pose->ambiguity = choose(s, &T, &pose->rejected);
    pose->used = s->list.count - pose->rejected;
    pose->rms = rms_of(s, &T);
    memcpy(pose->R_cb, T.R, sizeof T.R);
    memcpy(pose->t_cb, T.t, sizeof T.t);
    return pose->used >= LEAST_CORNERS && isfinite(pose->rms) && covariance(s, &T, pose->covariance);
}

sf_status sf_board_pose(sf_context *ctx, const sf_lens *lens, const sf_board_corner *corners, size_t count,
                        sf_pose *pose) {
    memset(pose, 0, sizeof *pose);
    if (!sf_lens_is_valid(lens)) return sf_fail(ctx, SF_ERR_ARGUMENT, "pose: the lens is not valid");
    if (count < LEAST_CORNERS || count > SF_CORNERS_MOST)
        return sf_fail(ctx, SF_ERR_EMPTY, "pose: corners: %zu is not in %d..%d", count, LEAST_CORNERS,
                       SF_CORNERS_MOST);
    search *s = sf_calloc(ctx, 1, sizeof *s);
    if (!s) return SF_ERR_MEMORY;
    s->lens = lens;
    memcpy(s->corners, corners, count * sizeof *corners);
    s->list = (sf_corner_list){s->corners, NULL, count};
    int found = find_pose(s, pose);
    sf_free(ctx, s);
    if (found) return SF_OK;
    memset(pose, 0, sizeof *pose);
    return sf_fail(ctx, SF_ERR_EMPTY, "pose: no pose explains the %zu corners", count);
}
