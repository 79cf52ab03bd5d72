/* localizer.c - the pose of a frame: from a board or from outside, from landmarks and from the model. */
#include "localizer.h"

#include <math.h>
#include <string.h>

#include "../base/clock.h"
#include "../base/linear.h"
#include "../fit/online.h"
#include "../scene/neighbours.h"
#include "place_recognition.h"

enum {
    LEAST_CORNERS = 8, /* of a board: two tags */
    TURNS = 8,         /* a lost pose is searched for from the best keyframe, and in turn the next TURNS */
    FOUND_AFTER = 6,   /* good poses one after another, until a lost camera counts as found again */
    FIRST_POSES = 6    /* that a distance is guessed from */
};

/* A pose is trusted from here on. */
#define AGREES 0.55
#define SEEN   0.12
/* Of the usual agreement: to be tracked on, and to be found again after it was lost. */
#define LIKE_BEFORE 0.75
#define FOUND       0.9
/* Of the landmarks that should be seen, for what they say to be believed. */
#define FOLLOWED 0.4
/* Part of a frame in what is usual. */
#define USUAL_MEMORY 0.05
/* Standard deviation of the greys of a picture that shows nothing: the noise is averaged out. */
#define BLANK 0.012
/* Without the model: a board's pose. */
#define AMBIGUOUS 0.7
#define BOARD_RMS 1.5 /* px */
/* A pose from outside that is known so well (rad) is held. */
#define FIXED 0.004
/* Standard deviation of the frames' own poses: rad, parts of the distance. */
#define OWN 1e-4
/* The same of poses from a caller who does not tell it. */
#define OUTSIDE 0.01
/* A board's covariance knows of the corners' scatter alone, not of the lens or the sheet, nor of what is
 * wrong of many pictures alike: a recording's poses were off by a degree for a second. */
#define BOARD_DOUBT 16.0
/* What a hand does to a steady motion in a tenth of a second: turns by this (rad), moves by this part of the
 * distance. */
#define UNSTEADY 0.04
/* The most that a first guess of the distance is, in distances between the cameras. */
#define FAR 12
/* From frame to frame it does no more than this. */
#define JUMP_TURN 0.35
#define JUMP_MOVE 0.3

static int is_finite(const sf_rigid *pose) {
    for (int k = 0; k < 9; k++)
        if (!isfinite(pose->R[k])) return 0;
    return isfinite(pose->t[0]) && isfinite(pose->t[1]) && isfinite(pose->t[2]);
}

/* 1. From outside the model */

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

/* Of a pose with a standard deviation in rad and parts of the distance. While the distance is not known,
 * nothing is there that the position could be weighed against. */
static void tell_accuracy(sf_fix *fix, double distance) {
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
    if (is_finite(&prior->pose)) fix->from = SF_POSE_OUTSIDE;
    return SF_OK;
}

/* A pose relative to another origin. */
static void shift(double R[9], double t[3], const double origin[3]) {
    for (int k = 0; k < 3; k++) t[k] += sf_dot3(R + 3 * k, origin);
}

static sf_status find_fix(sf_live *live, sf_fix *fix) {
    *fix = (sf_fix){0};
    fix_by_frame(live, fix);
    sf_status status = fix->from ? SF_OK : fix_by_caller(live, fix);
    if (status) return status;
    if (fix->from) shift(fix->prior.pose.R, fix->prior.pose.t, live->scene->origin);
    tell_accuracy(fix, live->localizer.distance);
    live->input.frame.corners = NULL, live->input.frame.corner_count = 0;
    if (live->localizer.detector) {
        sf_fix board = {0};
        status = fix_by_board(live, &board);
        if (status) return status;
        if (board.from && !fix->from) *fix = board;
    }
    return SF_OK;
}

/* 2. By the model */

/* Where a steady motion leads; `spread`: how far from there a hand may be, rad. */
static sf_rigid predict(const sf_live *live, double *spread) {
    double since = 1e-9 * (double)(live->input.picture->time_ns - live->localizer.pose_ns);
    double before = 1e-9 * (double)(live->localizer.pose_ns - live->localizer.pose_before_ns);
    sf_rigid pose = live->localizer.pose;
    *spread = UNSTEADY * fmax(since / 0.1, 0.5);
    if (live->localizer.poses < 2 || !(before > 0) || !(since < 3 * before + 0.1)) return pose;
    double twist[6];
    sf_rigid_twist(&live->localizer.pose_before, &live->localizer.pose, twist);
    for (int k = 0; k < 6; k++) twist[k] *= since / before;
    sf_rigid_move(&pose, twist);
    return pose;
}

/* Blurred pictures agree less: while they last the camera is tracked on as before, and has to be found again
 * when they are over. */
static int is_good(const sf_live *live, const sf_track *track) {
    int finds = live->localizer.doubts && (!live->quality.blurred || live->localizer.state == SF_LIVE_LOST);
    double least = fmax(AGREES, (finds ? FOUND : LIKE_BEFORE) * live->localizer.usual_agreement);
    return track->agreement >= least && track->seen >= SEEN && is_finite(&track->pose) &&
           isfinite(track->covariance[0]);
}

/* What no hand does. */
static int jumps(const sf_localizer *l, const sf_rigid *from, const sf_rigid *to) {
    double twist[6], here[3], there[3], moved = 0;
    sf_rigid a, b;
    sf_rigid_twist(from, to, twist);
    sf_rigid_invert(from, &a), sf_rigid_invert(to, &b);
    memcpy(here, a.t, sizeof here), memcpy(there, b.t, sizeof there);
    for (int k = 0; k < 3; k++) moved += pow(here[k] - there[k], 2);
    double turned = sqrt(sf_dot3(twist + 3, twist + 3));
    return turned > JUMP_TURN || (l->distance > 0 && sqrt(moved) > JUMP_MOVE * l->distance);
}

static sf_status track_from(sf_live *live, const sf_rigid *guess, const sf_track_prior *prior,
                            sf_track_guess how, sf_track *track) {
    sf_render_options options;
    const sf_model *model = sf_online_model(live->fitter, &options);
    return sf_track_picture(live->localizer.tracker, model, &options, guess, prior, how, track);
}

/* What landmarks and `prior` (NULL: nothing) say together; 0: landmarks tell nothing. */
static int add_followed(const sf_localizer *l, const sf_track_prior *prior, sf_track_prior *both) {
    const sf_followed *f = &l->followed;
    if (!(f->used > FOLLOWED * (double)f->expected)) return 0;
    both->pose = f->pose;
    for (int k = 0; k < 36; k++)
        both->information[k] = f->information[k] + (prior ? prior->information[k] : 0);
    return 1;
}

static sf_status track_on(sf_live *live, const sf_fix *fix, sf_track *track, int *good) {
    double spread;
    sf_track_prior steady = {.pose = predict(live, &spread)}, both;
    const sf_track_prior *prior = fix->from ? &fix->prior : live->localizer.poses > 1 ? &steady : NULL;
    const sf_rigid *guess = fix->from ? &fix->prior.pose : &steady.pose;
    double apart = spread * fmax(live->localizer.distance, 1e-9);
    for (int k = 0; k < 6; k++) steady.information[7 * k] = 1 / pow(k < 3 ? apart : spread, 2);
    sf_status status =
        sf_landmarks_follow(live->localizer.landmarks, guess, prior, &live->localizer.followed);
    if (status) return status;
    int close = add_followed(&live->localizer, prior, &both);
    if (close) prior = &both, guess = &both.pose;
    status = track_from(live, guess, prior, close ? SF_GUESS_CLOSE : SF_GUESS_NEAR, track);
    *good = !status && is_good(live, track) && (fix->from || !jumps(&live->localizer, guess, &track->pose));
    return status;
}

/* What is known of a pose, and landmarks: before there is a model. */
static sf_status join_landmarks(sf_live *live, const sf_track_prior *known, sf_rigid *pose) {
    sf_track_prior both;
    *pose = known->pose;
    if (live->fitter || live->quality.blank) return SF_OK;
    sf_status status =
        sf_landmarks_follow(live->localizer.landmarks, &known->pose, known, &live->localizer.followed);
    if (!status && add_followed(&live->localizer, known, &both)) *pose = both.pose;
    return status;
}

/* From the keyframes that look most like the picture. */
static sf_status find_again(sf_live *live, sf_track *track, int *good) {
    for (int turn = 0; turn < 2 && !*good; turn++) {
        const sf_keyframe *like = sf_recognize_place(&live->keyframes, live->input.thumbnail,
                                                     turn ? 1 + live->localizer.misses % TURNS : 0);
        if (!like) continue;
        sf_status status = track_from(live, &like->pose, NULL, SF_GUESS_FAR, track);
        if (status) return status;
        *good = is_good(live, track) && !jumps(&live->localizer, &like->pose, &track->pose);
    }
    return SF_OK;
}

/* Before anything is drawn, what cameras look at is where their axes meet, or far off, compared with how far
 * they are apart. */
static void guess_distance(sf_localizer *l, const sf_camera *camera) {
    const sf_camera *cameras[SF_FIRST_CAMERAS] = {0};
    double focus[3], span = 0;
    size_t n = l->first_count;
    if (l->distance > 0 || n == SF_FIRST_CAMERAS) return;
    l->first_cameras[n++] = *camera;
    l->first_count = n;
    for (size_t i = 0; i < n; i++) {
        double a[3], b[3], apart = 0;
        cameras[i] = &l->first_cameras[i];
        sf_camera_center(cameras[0], a);
        sf_camera_center(cameras[i], b);
        for (int k = 0; k < 3; k++) apart += pow(a[k] - b[k], 2);
        span = fmax(span, sqrt(apart));
    }
    sf_focus_point(cameras, n, focus);
    double far = FAR * span, distance = sf_look_distance(cameras[0], focus, far);
    int in_front = isfinite(distance) && distance > 0.3 * span && distance < far;
    if (in_front && n >= FIRST_POSES) l->distance = distance;
    if (n == SF_FIRST_CAMERAS && !(l->distance > 0)) l->distance = far;
    if (n == SF_FIRST_CAMERAS && !(span > 0)) l->first_count = 0, l->distance = 0;
}

/* Poses from outside may lie far from 0 (UTM, ECEF). As soon as the distance is known, before there is a
 * keyframe, an origin near them is chosen, and what is known of poses moves there. */
static void choose_origin(sf_live *live) {
    sf_localizer *l = &live->localizer;
    sf_camera *frame = &live->input.frame.camera, *truth = &live->input.frame.truth;
    double at[3], origin[3];
    if (l->has_origin || !(l->distance > 0)) return;
    l->has_origin = 1;
    sf_camera_center(frame, at);
    if (l->fix.from != SF_POSE_OUTSIDE || !sf_choose_origin(at, l->distance, origin)) return;
    sf_rigid *const poses[] = {&l->pose, &l->pose_before, &l->fix.prior.pose};
    for (size_t i = 0; i < sizeof poses / sizeof *poses; i++) shift(poses[i]->R, poses[i]->t, origin);
    shift(frame->R_cw, frame->t_cw, origin);
    shift(truth->R_cw, truth->t_cw, origin);
    memcpy(live->scene->origin, origin, sizeof origin);
    sf_log(live->ctx, SF_LOG_INFO,
           "poses from outside are far from 0: they are taken relative to the origin %.17g %.17g %.17g",
           origin[0], origin[1], origin[2]);
}

static void note_pose(sf_live *live, const sf_rigid *pose, sf_pose_from from) {
    sf_camera *c = &live->input.frame.camera;
    int again = live->localizer.state == SF_LIVE_LOST || live->localizer.misses > 2;
    live->localizer.pose_before = live->localizer.pose,
    live->localizer.pose_before_ns = live->localizer.pose_ns;
    live->localizer.pose = *pose, live->localizer.pose_ns = live->input.picture->time_ns;
    live->localizer.poses = again ? 1 : live->localizer.poses < 2 ? live->localizer.poses + 1 : 2;
    live->localizer.misses = 0;
    if (live->localizer.doubts) live->localizer.doubts--;
    memcpy(c->R_cw, pose->R, sizeof pose->R);
    memcpy(c->t_cw, pose->t, sizeof pose->t);
    live->input.frame.from = from;
    if (!live->fitter) guess_distance(&live->localizer, c);
    if (!live->fitter) tell_accuracy(&live->localizer.fix, live->localizer.distance);
    choose_origin(live);
    live->localizer.tracked++;
    sf_tick(&live->localizer.poses_found, sf_clock());
    if (live->fitter) live->localizer.state = SF_LIVE_TRACKING;
}

static void note_miss(sf_live *live) {
    live->localizer.misses++;
    live->input.frame.from = SF_POSE_NONE;
    if (!live->fitter || live->localizer.state == SF_LIVE_LOST || live->localizer.misses < 3) return;
    live->localizer.state = SF_LIVE_LOST;
    live->localizer.lost++;
    live->localizer.poses = 0;
    live->localizer.doubts = FOUND_AFTER;
}

static void note_track(sf_localizer *l, const sf_track *track) {
    double usual = l->usual_agreement > 0 ? l->usual_agreement : track->agreement;
    l->usual_agreement = usual + USUAL_MEMORY * (track->agreement - usual);
}

/* Whether a pose from outside leaves the model nothing to say. */
static int is_fixed(const sf_fix *fix) {
    double L[36], covariance[36];
    if (!fix->from) return 0;
    memcpy(L, fix->prior.information, sizeof L);
    if (!sf_cholesky(6, L)) return 0;
    sf_cholesky_invert(6, L, covariance);
    return covariance[21] + covariance[28] + covariance[35] < FIXED * FIXED;
}

/* What the pose shows of landmarks. */
static sf_status note_landmarks(sf_localizer *l) {
    sf_status status = SF_OK;
    if (!l->sure) return SF_OK;
    if (!l->followed.used) status = sf_landmarks_follow(l->landmarks, &l->pose, NULL, &l->followed);
    if (!status) sf_landmarks_settle(l->landmarks, &l->pose);
    return status;
}

static sf_status look(sf_live *live, const sf_fix *fix) {
    sf_track track = {0};
    int good = 0;
    sf_status status = SF_OK;
    live->localizer.fixed = is_fixed(fix);
    live->localizer.followed = (sf_followed){0};
    if (fix->from) live->localizer.doubts = 0;
    if (live->fitter && !live->quality.blank) {
        if (fix->from || live->localizer.poses) status = track_on(live, fix, &track, &good);
        if (!status && !good && !fix->from && live->localizer.misses)
            status = find_again(live, &track, &good);
        if (status) return status;
        live->input.frame.agreement = track.agreement;
    }
    sf_judge_sharpness(&live->quality, (good || fix->from) && track.seen >= SEEN ? &track : NULL);
    if (live->quality.blurred >= SF_TROUBLE_FRAMES && !fix->from) live->localizer.doubts = FOUND_AFTER;
    live->localizer.sure = !live->localizer.doubts && !live->quality.blurred && !live->quality.blank;
    live->guidance.brightness = good ? track.gain + 2 * track.bias : NAN; /* at a grey of a half */
    if (good) {
        live->localizer.distance = track.depth;
        if (live->localizer.sure) note_track(&live->localizer, &track);
        note_pose(live, &track.pose, SF_POSE_TRACK);
    } else if (fix->from) {
        sf_rigid pose;
        status = join_landmarks(live, &fix->prior, &pose);
        if (status) return status;
        note_pose(live, &pose, fix->from);
    } else {
        note_miss(live);
    }
    live->localizer.sure &= !live->localizer.doubts;
    sf_note_trouble(live->ctx, &live->quality);
    return live->input.frame.from == SF_POSE_NONE ? SF_OK : note_landmarks(&live->localizer);
}

sf_status sf_live_localize(sf_live *live) {
    const sf_picture *p = live->input.picture;
    live->input.frame = (sf_live_frame){.number = live->localizer.looked_at + 1,
                                        .time_ns = p->time_ns,
                                        .camera = p->camera,
                                        .has_truth = p->has_truth && !live->options.own_poses,
                                        .truth = p->truth,
                                        .rgb = {p->rgb[0], p->rgb[1], p->rgb[2]}};
    shift(live->input.frame.truth.R_cw, live->input.frame.truth.t_cw, live->scene->origin);
    sf_status status = find_fix(live, &live->localizer.fix);
    if (!status)
        status = sf_tracker_take(live->localizer.tracker, &p->camera, p->rgb, (size_t)p->camera.width);
    if (!status)
        status = sf_landmarks_take(live->localizer.landmarks, &p->camera, p->rgb, (size_t)p->camera.width);
    live->quality.blank = sf_make_thumbnail(p, live->input.thumbnail) < BLANK ? live->quality.blank + 1 : 0;
    live->quality.sharpness = sf_picture_sharpness(p);
    if (!status) status = look(live, &live->localizer.fix);
    live->localizer.looked_at++;
    return status;
}

void sf_live_forget_pose(sf_live *live) {
    live->localizer.state = SF_LIVE_WAITING;
    live->localizer.poses = live->localizer.misses = live->localizer.doubts = 0;
    live->localizer.usual_agreement = live->quality.usual_detail = live->quality.usual_sharpness = 0;
    live->localizer.distance = 0;
    live->localizer.has_origin = 0;
    live->localizer.first_count = 0;
    memset(live->scene->origin, 0, sizeof live->scene->origin);
}

void sf_live_correct_pose(sf_live *live, const sf_rigid *from, const sf_rigid *to) {
    sf_rigid way, *const poses[2] = {&live->localizer.pose, &live->localizer.pose_before};
    sf_rigid_invert(from, &way);
    sf_rigid_compose(&way, to, &way);
    for (int i = 0; i < 2; i++) sf_rigid_compose(poses[i], &way, poses[i]);
    memcpy(live->input.frame.camera.R_cw, live->localizer.pose.R, sizeof live->localizer.pose.R);
    memcpy(live->input.frame.camera.t_cw, live->localizer.pose.t, sizeof live->localizer.pose.t);
}
