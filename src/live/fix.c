/* fix.c - the pose of a frame as it is known before the model is drawn. */
#include "fix.h"

#include <math.h>
#include <string.h>

#include "../base/linear.h"

enum {
    LEAST_CORNERS = 8, /* of a board: two tags */
    BOARD_EVERY = 4    /* frames, where poses do not hang on the board */
};

/* Without the model: a board's pose. */
#define AMBIGUOUS 0.7
#define BOARD_RMS 1.5 /* px */
/* A pose from outside that is known so well (rad) is held. */
#define FIXED 0.004
/* Standard deviation of the frames' own poses: rad, parts of the distance. */
#define OWN 1e-4
/* The same of poses from a caller who does not tell it, and of a first map from pictures. */
#define OUTSIDE   0.01
#define FIRST_MAP 0.01
/* A board's covariance knows of the corners' scatter alone, not of the lens or the sheet, nor of what is
 * wrong of many pictures alike: a recording's poses were off by a degree for a second. */
#define BOARD_DOUBT 16.0

static void make_grey(const sf_picture *p, uint8_t *grey) {
    size_t pixels = (size_t)p->camera.width * (size_t)p->camera.height;
    for (size_t i = 0; i < pixels; i++)
        grey[i] = (uint8_t)(255 * fminf(fmaxf(sf_picture_grey(p, i), 0), 1) + 0.5f);
}

/* information = (doubt covariance)^-1. 0: there is none. */
static int invert_covariance(const double covariance[36], double doubt, double information[36]) {
    double L[36];
    for (int k = 0; k < 36; k++) L[k] = doubt * covariance[k];
    if (!sf_cholesky(6, L)) return 0;
    sf_cholesky_invert(6, L, information);
    return 1;
}

static sf_status fix_by_board(sf_live *live, sf_fix *fix) {
    const sf_picture *p = live->input.picture;
    const sf_camera *c = &p->camera;
    sf_lens lens = {.fx = c->fx, .fy = c->fy, .cx = c->cx, .cy = c->cy};
    sf_pose pose;
    make_grey(p, live->input.bytes);
    sf_status status =
        sf_detector_find(live->localizer.detector, live->input.bytes, (size_t)c->width, c->width, c->height,
                         &live->input.frame.corners, &live->input.frame.corner_count);
    if (status || live->input.frame.corner_count < LEAST_CORNERS) return status;
    status =
        sf_board_pose(live->ctx, &lens, live->input.frame.corners, live->input.frame.corner_count, &pose);
    if (status) return status == SF_ERR_EMPTY ? SF_OK : status;
    if (pose.ambiguity > AMBIGUOUS || pose.rms > BOARD_RMS || pose.used < LEAST_CORNERS) return SF_OK;
    memcpy(fix->prior.pose.R, pose.R_cb, sizeof pose.R_cb);
    memcpy(fix->prior.pose.t, pose.t_cb, sizeof pose.t_cb);
    if (invert_covariance(pose.covariance, BOARD_DOUBT, fix->prior.information)) fix->from = SF_POSE_BOARD;
    if (fix->from && !(live->localizer.distance > 0))
        live->localizer.distance = sqrt(sf_dot3(pose.t_cb, pose.t_cb)); /* until something is drawn */
    return SF_OK;
}

void sf_fix_tell_accuracy(sf_fix *fix, double distance) {
    double far = distance > 0 ? distance : 1, *information = fix->prior.information;
    if (!(fix->deviation > 0)) return;
    for (int k = 0; k < 36; k++) information[k] = 0;
    for (int k = 0; k < 6; k++) information[7 * k] = pow(fix->deviation * (k < 3 ? far : 1), -2);
}

static void fix_by_frame(const sf_live *live, sf_fix *fix) {
    const sf_picture *p = live->input.picture;
    if (!live->options.own_poses || !p->has_truth) return;
    memcpy(fix->prior.pose.R, p->truth.R_cw, sizeof p->truth.R_cw);
    memcpy(fix->prior.pose.t, p->truth.t_cw, sizeof p->truth.t_cw);
    fix->deviation = OWN;
    fix->from = SF_POSE_OUTSIDE;
}

static sf_status fix_by_caller(sf_live *live, sf_fix *fix) {
    sf_track_prior *prior = &fix->prior;
    int known = 0;
    if (!live->options.pose) return SF_OK;
    sf_status status = live->options.pose(live->options.pose_user, live->input.picture->time_ns,
                                          prior->pose.R, prior->pose.t, prior->information);
    if (status) return status == SF_ERR_EMPTY ? SF_OK : status;
    for (int k = 0; k < 36; k++) known |= prior->information[k] != 0;
    if (!known) fix->deviation = OUTSIDE;
    if (!sf_pose_is_finite(&prior->pose)) return SF_OK;
    fix->from = SF_POSE_OUTSIDE;
    live->input.has_outside = 1, live->input.outside = prior->pose;
    return SF_OK;
}

void sf_pose_shift(double R[9], double t[3], const double origin[3]) {
    for (int k = 0; k < 3; k++) t[k] += sf_dot3(R + 3 * k, origin);
}

void sf_fix_by_first_map(const sf_live *live, sf_fix *fix) {
    fix->prior.pose = *live->input.first_pose;
    fix->deviation = live->keyframes.count ? FIRST_MAP : OWN;
    fix->from = SF_POSE_PICTURES;
    sf_fix_tell_accuracy(fix, live->localizer.distance);
}

sf_status sf_fix_find(sf_live *live, sf_fix *fix) {
    *fix = (sf_fix){0};
    live->input.has_outside = 0;
    fix_by_frame(live, fix);
    sf_status status = fix->from ? SF_OK : fix_by_caller(live, fix);
    if (status) return status;
    if (fix->from) sf_pose_shift(fix->prior.pose.R, fix->prior.pose.t, live->scene->origin);
    sf_fix_tell_accuracy(fix, live->localizer.distance);
    live->input.frame.corners = NULL, live->input.frame.corner_count = 0;
    /* In a world of its own, a board tells where that lies: some frames are enough. */
    int look = !live->localizer.has_own_world || live->localizer.looked_at % BOARD_EVERY == 0;
    if (live->localizer.detector && look) {
        sf_fix board = {0};
        status = fix_by_board(live, &board);
        if (status) return status;
        if (board.from && !fix->from) *fix = board;
    }
    return SF_OK;
}

int sf_fix_is_held(const sf_fix *fix) {
    double L[36], covariance[36];
    if (!fix->from) return 0;
    memcpy(L, fix->prior.information, sizeof L);
    if (!sf_cholesky(6, L)) return 0;
    sf_cholesky_invert(6, L, covariance);
    return covariance[21] + covariance[28] + covariance[35] < FIXED * FIXED;
}
