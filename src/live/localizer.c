/* localizer.c - the pose of a frame: from a board or from outside, from landmarks and from the model. */
#include "localizer.h"

#include <math.h>
#include <string.h>

#include "../base/clock.h"
#include "../base/linear.h"
#include "../fit/online.h"
#include "../scene/neighbours.h"
#include "fix.h"
#include "place_recognition.h"
#include "relocalization.h"

enum {
    FOUND_AFTER = 6, /* good poses one after another, until a lost camera counts as found again */
    FIRST_POSES = 6  /* that a distance is guessed from */
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
/* What a hand does to a steady motion in a tenth of a second: turns by this (rad), moves by this part of the
 * distance. */
#define UNSTEADY 0.04
/* The most that a first guess of the distance is, in distances between the cameras. */
#define FAR 12
/* From frame to frame it does no more than this. */
#define JUMP_TURN 0.35
#define JUMP_MOVE 0.3
/* For so long (s) after it was lost, a camera is looked for within these: rad, parts of the distance. */
#define ANYWHERE   1.0
#define REACH_TURN 1.2
#define REACH_MOVE 1.2

/* 1. By the model */

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
    return track->agreement >= least && track->seen >= SEEN && sf_pose_is_finite(&track->pose) &&
           isfinite(track->covariance[0]);
}

/* What no hand does. */
static int jumps(const sf_localizer *l, const sf_rigid *from, const sf_rigid *to) {
    double angle, apart;
    sf_rigid_gap(from, to, &angle, &apart);
    return angle > JUMP_TURN || (l->distance > 0 && apart > JUMP_MOVE * l->distance);
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

/* How far from a steady motion a hand may be. */
static void tell_spread(sf_track_prior *steady, double spread, double distance) {
    double apart = spread * fmax(distance, 1e-9);
    for (int k = 0; k < 6; k++) steady->information[7 * k] = 1 / pow(k < 3 ? apart : spread, 2);
}

static sf_status track_on(sf_live *live, const sf_fix *fix, sf_track *track, int *good) {
    double spread;
    sf_track_prior steady = {.pose = predict(live, &spread)}, both;
    const sf_track_prior *prior = fix->from ? &fix->prior : live->localizer.poses > 1 ? &steady : NULL;
    const sf_rigid *guess = fix->from ? &fix->prior.pose : &steady.pose;
    tell_spread(&steady, spread, live->localizer.distance);
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

/* Before there is a model, in a map that began from pictures: the pose that landmarks alone tell. */
static sf_status follow_alone(sf_live *live, sf_rigid *pose, int *good) {
    sf_localizer *l = &live->localizer;
    double spread;
    sf_track_prior steady = {.pose = predict(live, &spread)}, both;
    *good = 0;
    if (live->fitter || !l->has_own_world || !l->poses || live->quality.blank) return SF_OK;
    tell_spread(&steady, spread, l->distance);
    sf_status status = sf_landmarks_follow(l->landmarks, &steady.pose, &steady, &l->followed);
    if (status || !add_followed(l, &steady, &both)) return status;
    *pose = both.pose;
    *good = !jumps(l, &steady.pose, pose);
    return SF_OK;
}

/* A camera that was lost a moment ago is not far away: other places may look like the one it is at. After a
 * while it may have been carried anywhere. */
static int is_within_reach(const sf_live *live, const sf_rigid *pose) {
    const sf_localizer *l = &live->localizer;
    double since = 1e-9 * (double)(live->input.picture->time_ns - l->pose_ns), angle, apart;
    sf_rigid_gap(&l->pose, pose, &angle, &apart);
    return since > ANYWHERE || (angle < REACH_TURN && apart < REACH_MOVE * l->distance);
}

/* From what the picture shares with keyframes. */
static sf_status find_again(sf_live *live, sf_track *track, int *good) {
    sf_place_pose place;
    sf_status status = sf_live_relocalize(live, &place);
    if (status || !place.found || !is_within_reach(live, &place.pose)) return status;
    status = track_from(live, &place.pose, NULL, SF_GUESS_NEAR, track);
    if (status || !is_good(live, track) || jumps(&live->localizer, &place.pose, &track->pose)) return status;
    status = sf_live_confirm_place(live, &track->pose, good);
    live->localizer.found_again += *good != 0;
    return status;
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
    for (size_t i = 0; i < sizeof poses / sizeof *poses; i++) sf_pose_shift(poses[i]->R, poses[i]->t, origin);
    sf_pose_shift(frame->R_cw, frame->t_cw, origin);
    sf_pose_shift(truth->R_cw, truth->t_cw, origin);
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
    if (!live->fitter) sf_fix_tell_accuracy(&live->localizer.fix, live->localizer.distance);
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
    sf_rigid alone;
    int good = 0, follows = 0;
    sf_status status = SF_OK;
    live->localizer.fixed = sf_fix_is_held(fix);
    live->localizer.followed = (sf_followed){0};
    if (fix->from) live->localizer.doubts = 0;
    if (live->fitter && !live->quality.blank) {
        if (fix->from || live->localizer.poses) status = track_on(live, fix, &track, &good);
        if (!status && !good && !fix->from && live->localizer.misses)
            status = find_again(live, &track, &good);
        if (status) return status;
        live->input.frame.agreement = track.agreement;
    }
    if (!fix->from) status = follow_alone(live, &alone, &follows);
    if (status) return status;
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
    } else if (follows) {
        note_pose(live, &alone, SF_POSE_TRACK);
    } else {
        note_miss(live);
    }
    live->localizer.sure &= !live->localizer.doubts;
    sf_note_trouble(live->ctx, &live->quality);
    return live->input.frame.from == SF_POSE_NONE ? SF_OK : note_landmarks(&live->localizer);
}

/* Why there is no first map yet: once, when it is another reason. */
static void tell_verdict(sf_live *live, sf_first_map_verdict before) {
    static const char *const words[] = {
        [SF_FIRST_MAP_FEW] = "the start waits: the pictures show too little that can be recognised",
        [SF_FIRST_MAP_STILL] = "the start waits: the camera has not moved sideways, or only turned",
        [SF_FIRST_MAP_FLAT] =
            "the start waits: all that is seen is flat; look at something with depth, or show a board",
        [SF_FIRST_MAP_MOVING] = "the start waits: something large moves in the pictures",
        [SF_FIRST_MAP_DOUBTFUL] =
            "the start waits: a first map is there, but not accurate enough yet; move on"};
    sf_first_map_verdict now = live->start.map.verdict;
    if (now != before && now != SF_FIRST_MAP_FOUND) sf_log(live->ctx, SF_LOG_INFO, "%s", words[now]);
}

/* Without a board and poses from outside: frames are collected until they give a first map. A board that is
 * seen, or a pose that comes, is the better start. */
static sf_status collect(sf_live *live) {
    const sf_picture *p = live->input.picture;
    const sf_camera *c = &p->camera;
    sf_lens lens = {.fx = c->fx, .fy = c->fy, .cx = c->cx, .cy = c->cy};
    int found;
    if (live->fitter || live->localizer.has_own_world || !live->options.from_pictures) return SF_OK;
    if (live->input.frame.from != SF_POSE_NONE) sf_start_clear(&live->start);
    if (live->input.frame.from != SF_POSE_NONE || live->quality.blank || live->quality.blurred) return SF_OK;
    sf_first_map_verdict before = live->start.map.verdict;
    sf_status status =
        sf_start_take(&live->start, p, live->input.frame.number, p->is_lens_guessed ? NULL : &lens, &found);
    if (!status) tell_verdict(live, before);
    live->localizer.state = live->start.count ? SF_LIVE_STARTING : SF_LIVE_WAITING;
    if (status || !found) return status;
    const sf_first_map *map = &live->start.map;
    if (p->is_lens_guessed) status = sf_found_lens_set(&live->lens, &map->lens, c->width, c->height);
    live->localizer.has_own_world = live->localizer.has_origin = 1;
    live->localizer.misses = 0;
    live->localizer.distance = live->options.scale > 0 ? live->options.scale : 1;
    sf_log(
        live->ctx, SF_LOG_INFO,
        "the first map: %zu of %zu frames, %zu points seen %.1f degrees wide, %.2f px, focal length %.1f px",
        map->placed, live->start.count, map->points, map->angle * 57.29577951308232, map->error,
        map->lens.fx);
    return status;
}

/* A map that began from pictures, where a board is seen or a pose comes from outside. */
static void note_world(sf_live *live, const sf_fix *seen) {
    const sf_live_frame *f = &live->input.frame;
    if (!live->localizer.has_own_world || !seen->from || f->from == SF_POSE_NONE || !live->localizer.sure)
        return;
    if (sf_world_note(&live->world, &f->camera, &seen->prior.pose, live->localizer.distance))
        sf_log(live->ctx, SF_LOG_INFO, "the world of %s: 1 unit of the map is %.4g there",
               seen->from == SF_POSE_BOARD ? "the board" : "poses from outside",
               live->world.similarity.scale);
}

sf_status sf_live_localize(sf_live *live) {
    const sf_picture *p = live->input.picture;
    int again = live->input.first_pose != NULL; /* it was counted when it came */
    sf_place_free(live->ctx, &live->input.place);
    live->input.has_place = 0;
    live->input.frame = (sf_live_frame){.number = again ? live->input.number : live->localizer.looked_at + 1,
                                        .time_ns = p->time_ns,
                                        .camera = p->camera,
                                        .has_truth = p->has_truth && !live->options.own_poses,
                                        .truth = p->truth,
                                        .rgb = {p->rgb[0], p->rgb[1], p->rgb[2]}};
    sf_pose_shift(live->input.frame.truth.R_cw, live->input.frame.truth.t_cw, live->scene->origin);
    sf_fix seen = {0}, *fix = &live->localizer.fix;
    sf_status status = SF_OK;
    *fix = seen;
    if (again)
        sf_fix_by_first_map(live, fix);
    else
        status = sf_fix_find(live, &seen);
    /* A pose that a guessed lens gives a board would be wrong: the pictures tell the lens first. */
    if (!live->localizer.has_own_world && !(live->options.from_pictures && p->is_lens_guessed)) *fix = seen;
    if (!status)
        status = sf_tracker_take(live->localizer.tracker, &p->camera, p->rgb, (size_t)p->camera.width);
    if (!status)
        status = sf_landmarks_take(live->localizer.landmarks, &p->camera, p->rgb, (size_t)p->camera.width);
    live->quality.blank = sf_picture_contrast(p) < BLANK ? live->quality.blank + 1 : 0;
    live->quality.sharpness = sf_picture_sharpness(p);
    if (!status) status = look(live, &live->localizer.fix);
    live->localizer.looked_at += !again;
    if (!status && !again) note_world(live, &seen);
    return status || again ? status : collect(live);
}

void sf_live_forget_pose(sf_live *live) {
    live->localizer.state = SF_LIVE_WAITING;
    live->localizer.poses = live->localizer.misses = live->localizer.doubts = 0;
    live->localizer.usual_agreement = live->quality.usual_detail = live->quality.usual_sharpness = 0;
    live->localizer.distance = 0;
    live->localizer.has_own_world = live->localizer.has_origin = 0;
    live->world = (sf_world){0};
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
