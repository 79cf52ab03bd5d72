/* keyframes.c - which frames become keyframes, their poses, and the start of the fit. */
#include "keyframes.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../base/clock.h"
#include "../base/linear.h"
#include "../base/statistics.h"
#include "../fit/online.h"
#include "../pose/covisibility.h"
#include "../scene/neighbours.h"
#include "deformation.h"
#include "localizer.h"
#include "loop_closure.h"
#include "place_recognition.h"
#include "pose_check.h"

enum {
    FIRST_VIEWS = 5, /* keyframes that a fit begins with */
    FITTED = 8,      /* newer keyframes, after which one is fitted well enough for depths */
    RECENT = 6,      /* keyframes: the newest, none of which makes room for another */
    ADJUSTED = 60    /* keyframes whose poses are adjusted with each new one */
};

#define MOVED          2e-5 /* rad, parts of the distance: a pose that is another one */
#define FIRST_BASELINE 0.06 /* of the distance: so far apart are the first keyframes at least */
#define FIRST_GAP      0.2  /* of the gap between keyframes, where there are none yet */
#define FULL_GAP       60   /* keyframes from which on the gap is as told */
#define SHARP          0.7  /* of the usual sharpness: enough for a keyframe */
#define PATIENCE       0.7  /* s, for a sharper one */

/* 1. Which frames are kept */

/* How far a pose is from a keyframe: the greater of the move, in distances to what is seen, and the turn,
 * rad. */
static double gap_to(const sf_keyframe *k, const sf_rigid *pose, const double center[3], double distance) {
    double twist[6], apart = 0;
    sf_rigid_twist(&k->pose, pose, twist);
    for (int i = 0; i < 3; i++) apart += pow(k->center[i] - center[i], 2);
    return fmax(sqrt(apart) / fmax(distance, 1e-9), sqrt(sf_dot3(twist + 3, twist + 3)));
}

static double least_gap(const sf_live *live, const sf_rigid *pose, const double center[3], size_t but) {
    double least = INFINITY;
    for (size_t i = 0; i < live->keyframes.count; i++)
        if (i != but)
            least = fmin(least, gap_to(&live->keyframes.list[i], pose, center, live->localizer.distance));
    return least;
}

/* Of those that are trained on, but the first and the newest, the one that another stands in for best. */
static size_t most_redundant(const sf_live *live) {
    size_t found = 1;
    double least = INFINITY;
    for (size_t i = 1; i + RECENT < live->keyframes.count; i++) {
        const sf_keyframe *k = &live->keyframes.list[i];
        double gap = k->held_out ? INFINITY : least_gap(live, &k->pose, k->center, i);
        if (gap < least) least = gap, found = i;
    }
    return found;
}

static sf_status make_room(sf_live *live) {
    if (live->keyframes.count >= (size_t)live->options.keyframes_most) {
        size_t gone = most_redundant(live);
        sf_status status = sf_scene_remove_view(live->scene, live->keyframes.list[gone].id);
        if (status) return status;
        sf_landmarks_drop(live->localizer.landmarks, live->keyframes.list[gone].id);
        sf_place_free(live->ctx, &live->keyframes.list[gone].place);
        live->keyframes.count--;
        memmove(live->keyframes.list + gone, live->keyframes.list + gone + 1,
                (live->keyframes.count - gone) * sizeof *live->keyframes.list);
    }
    return sf_grow(live->ctx, &live->keyframes.list, &live->keyframes.capacity, live->keyframes.count,
                   live->keyframes.count + 1, sizeof *live->keyframes.list);
}

static sf_status add_view(sf_live *live, sf_split split, uint32_t *id) {
    const sf_picture *p = live->input.picture;
    size_t pixels = (size_t)p->camera.width * (size_t)p->camera.height;
    uint8_t *rgb = live->input.bytes, *mask = live->input.bytes + 3 * pixels;
    for (size_t i = 0; i < pixels; i++) {
        for (size_t c = 0; c < 3; c++)
            rgb[3 * i + c] = (uint8_t)(255 * fminf(fmaxf(p->rgb[c][i], 0), 1) + 0.5f);
        if (p->weight) mask[i] = (uint8_t)(255 * p->weight[i] + 0.5f);
    }
    sf_pixels given = {rgb, 3 * (size_t)p->camera.width, p->weight ? mask : NULL};
    return sf_scene_add_view(live->scene, NULL, &live->input.frame.camera, &given, split, id);
}

static sf_camera camera_at(const sf_live *live, const sf_rigid *pose) {
    sf_camera camera = live->input.frame.camera;
    memcpy(camera.R_cw, pose->R, sizeof pose->R), memcpy(camera.t_cw, pose->t, sizeof pose->t);
    return camera;
}

/* A keyframe's pose and focal length as they are known by now. */
static sf_status correct(sf_live *live, sf_keyframe *k, const sf_rigid *pose, double zoom) {
    sf_camera camera = camera_at(live, pose);
    camera.fx *= zoom, camera.fy *= zoom;
    k->pose = *pose;
    sf_camera_center(&camera, k->center);
    sf_status status = SF_OK;
    if (live->fitter) status = sf_online_set_camera(live->fitter, k->id, &camera);
    return status ? status : sf_scene_set_camera(live->scene, k->id, &camera);
}

static int has_moved(const sf_live *live, const sf_rigid *from, const sf_rigid *to) {
    double twist[6];
    sf_rigid_twist(from, to, twist);
    return sqrt(sf_dot3(twist + 3, twist + 3)) > MOVED ||
           sqrt(sf_dot3(twist, twist)) > MOVED * live->localizer.distance;
}

/* All that is known better by now follows. corrections[count]: of the keyframes but the newest, which nothing
 * was fitted to yet. */
static sf_status correct_all(sf_live *live, uint32_t newest, double zoom, sf_correction *corrections,
                             size_t *count) {
    const sf_landmarks *landmarks = live->localizer.landmarks;
    sf_status status = SF_OK;
    *count = 0;
    for (size_t i = 0; !status && i < live->keyframes.count; i++) {
        sf_keyframe *k = &live->keyframes.list[i];
        sf_correction *c = &corrections[*count];
        sf_rigid pose = k->pose;
        c->camera = camera_at(live, &k->pose);
        c->zoom = zoom;
        if ((sf_landmarks_pose(landmarks, k->id, &pose) && has_moved(live, &k->pose, &pose)) || zoom != 1) {
            if (k->id == newest) sf_live_correct_pose(live, &k->pose, &pose);
            status = correct(live, k, &pose, zoom);
        }
        c->to = k->pose, c->scale = 1;
        *count += k->id != newest;
    }
    return status;
}

/* The depths of a keyframe's features. */
static void scale_depths(sf_keyframe *k, double scale) {
    for (size_t f = 0; k->place.depths && f < k->place.features.count; f++)
        k->place.depths[f] *= (float)scale;
}

sf_status sf_live_move_keyframes(sf_live *live, const sf_rigid *to, const double *scales, size_t first_back,
                                 size_t backs) {
    size_t all = live->keyframes.count, count = 0;
    sf_correction *corrections = sf_alloc(live->ctx, all + 1, sizeof *corrections);
    sf_status status = corrections ? SF_OK : SF_ERR_MEMORY;
    for (size_t i = 0; !status && i < all; i++) {
        sf_keyframe *k = &live->keyframes.list[i];
        if (i < first_back || i >= first_back + backs)
            corrections[count++] = (sf_correction){camera_at(live, &k->pose), to[i], 1, scales[i]};
        scale_depths(k, scales[i]);
        sf_landmarks_move(live->localizer.landmarks, k->id, &to[i], scales[i]);
        status = correct(live, k, &to[i], 1);
    }
    if (!status && live->fitter) status = sf_deform_fit(live->ctx, live->fitter, corrections, count);
    sf_free(live->ctx, corrections);
    return status;
}

/* Whether a lens that was found is due to be adjusted: with half as many keyframes again. */
static int is_lens_due(const sf_live *live) {
    const size_t first = 12, last = 150, count = live->keyframes.count;
    return live->lens.is_found && count >= first && count <= last && 2 * count >= 3 * live->lens.checked_at;
}

/* Adjusts the focal length that all keyframes share. depths [keyframes]: then what they show is so many times
 * as far from them. */
static sf_status calibrate(sf_live *live, double *depths, double *zoom) {
    sf_landmarks *landmarks = live->localizer.landmarks;
    sf_status status = SF_OK;
    size_t count = live->keyframes.count;
    for (size_t i = 0; !status && i < count; i++)
        status = sf_landmarks_depth(landmarks, live->keyframes.list[i].id, &depths[i]);
    if (!status) status = sf_landmarks_calibrate(landmarks, zoom);
    for (size_t i = 0; !status && i < count; i++) {
        double now;
        status = sf_landmarks_depth(landmarks, live->keyframes.list[i].id, &now);
        depths[i] = now > 0 && depths[i] > 0 ? now / depths[i] : 1;
    }
    if (status) return status;
    sf_log(live->ctx, SF_LOG_INFO, "focal length %.1f px, by %zu keyframes", *zoom * live->lens.camera.fx,
           count);
    live->lens.checked_at = count;
    return SF_OK;
}

/* Pictures are known to be taken with another focal length, and what they show to be at another depth. */
static void zoom_by(sf_live *live, double zoom, double stretch) {
    sf_found_lens_zoom(&live->lens, zoom);
    live->input.frame.camera.fx *= zoom, live->input.frame.camera.fy *= zoom;
    live->localizer.distance *= stretch;
}

/* Moves poses, the lens, and the model with them, to where landmarks agree best. */
static sf_status follow_landmarks(sf_live *live, uint32_t newest, sf_correction *corrections,
                                  double *depths) {
    size_t count, keyframes = live->keyframes.count;
    double zoom = 1;
    sf_status status = sf_landmarks_adjust(live->localizer.landmarks, ADJUSTED);
    for (size_t i = 0; i < keyframes; i++) depths[i] = 1;
    if (!status && is_lens_due(live)) status = calibrate(live, depths, &zoom);
    if (!status) status = correct_all(live, newest, zoom, corrections, &count);
    for (size_t i = 0; !status && i < count; i++) corrections[i].scale = depths[i]; /* the newest is last */
    if (!status && live->fitter) status = sf_deform_fit(live->ctx, live->fitter, corrections, count);
    for (size_t i = 0; !status && i < keyframes; i++) scale_depths(&live->keyframes.list[i], depths[i]);
    if (!status && zoom != 1) zoom_by(live, zoom, sf_median(depths, keyframes));
    return status;
}

/* The newest keyframe joins the landmarks. */
static sf_status adjust(sf_live *live, uint32_t id) {
    const sf_fix *fix = &live->localizer.fix;
    /* Of a first map from pictures, one pose holds all: the others are what the pictures say. */
    int is_known = fix->from && (fix->from != SF_POSE_PICTURES || live->keyframes.count == 1);
    sf_status status =
        sf_landmarks_keep(live->localizer.landmarks, id, &live->localizer.pose, is_known ? &fix->prior : NULL,
                          live->localizer.distance, live->input.picture->weight);
    if (status) return status;
    sf_correction *corrections = sf_alloc(live->ctx, live->keyframes.count, sizeof *corrections);
    double *depths = sf_alloc(live->ctx, live->keyframes.count, sizeof *depths);
    status = corrections && depths ? follow_landmarks(live, id, corrections, depths) : SF_ERR_MEMORY;
    sf_free(live->ctx, corrections);
    sf_free(live->ctx, depths);
    return status;
}

/* Draws the depths of a keyframe once the fit has learned it, before Gaussians that drifted lie in front of
 * it. */
static sf_status draw_depths(sf_live *live) {
    size_t count = live->keyframes.count;
    int drawn;
    if (!live->fitter || count <= FITTED) return SF_OK;
    sf_keyframe *k = &live->keyframes.list[count - 1 - FITTED];
    return k->place.depths ? SF_OK : sf_live_draw_depths(live, k, &drawn);
}

static sf_status take_keyframe(sf_live *live) {
    int64_t every = live->options.hold_out;
    sf_status status = make_room(live);
    if (status) return status;
    sf_keyframe k = {.psnr = NAN, .psnr_corrected = NAN};
    k.held_out = every > 0 && live->keyframes.made % every == every / 2;
    status = sf_live_find_features(live);
    if (!status) status = sf_live_close_loop(live);
    k.pose = live->localizer.pose;
    sf_camera_center(&live->input.frame.camera, k.center);
    if (!status) status = add_view(live, k.held_out ? SF_SPLIT_TEST : SF_SPLIT_TRAIN, &k.id);
    if (status) return status;
    k.hold = live->localizer.fixed;
    k.found_again = live->localizer.found_again;
    k.light = live->input.picture->light;
    k.time_ns = live->input.frame.time_ns;
    k.has_truth = live->input.frame.has_truth;
    memcpy(k.truth.R, live->input.frame.truth.R_cw, sizeof k.truth.R);
    memcpy(k.truth.t, live->input.frame.truth.t_cw, sizeof k.truth.t);
    k.has_outside = live->input.has_outside;
    k.outside = live->input.outside;
    k.place = live->input.place;
    live->input.place = (sf_place){.depths = NULL};
    live->keyframes.list[live->keyframes.count++] = k;
    live->keyframes.made++;
    live->keyframes.wanted = live->keyframes.forced = 0;
    status = sf_live_check_poses(live);
    if (!status) status = adjust(live, k.id);
    return status ? status : draw_depths(live);
}

sf_status sf_live_offer_keyframe(sf_live *live, int *taken) {
    double now = 1e-9 * (double)live->input.picture->time_ns, gap = live->options.keyframe_gap, center[3];
    *taken = 0;
    if (live->input.frame.from == SF_POSE_NONE || !live->localizer.sure || !(live->localizer.distance > 0))
        return SF_OK;
    double grown =
        fmin(1, (double)live->keyframes.count / FULL_GAP); /* where there are few, one more costs little */
    gap *= FIRST_GAP + (1 - FIRST_GAP) * grown;
    sf_camera_center(&live->input.frame.camera, center);
    if (!live->keyframes.forced && least_gap(live, &live->localizer.pose, center, SIZE_MAX) < gap) {
        live->keyframes.wanted = 0;
        return SF_OK;
    }
    if (!live->keyframes.wanted) live->keyframes.wanted = 1, live->keyframes.wanted_since = now;
    if (live->quality.relative_sharpness < SHARP && now - live->keyframes.wanted_since < PATIENCE)
        return SF_OK;
    sf_status status = take_keyframe(live);
    *taken = !status;
    return status;
}

/* 2. The start */

/* The largest distance between two keyframes that are trained on, in distances to what they see. */
static double baseline(const sf_live *live, size_t *count) {
    double most = 0;
    *count = 0;
    for (size_t i = 0; i < live->keyframes.count; i++) {
        const sf_keyframe *a = &live->keyframes.list[i];
        *count += !a->held_out;
        for (size_t j = 0; j < i && !a->held_out; j++) {
            double apart = 0;
            for (int k = 0; k < 3; k++) apart += pow(a->center[k] - live->keyframes.list[j].center[k], 2);
            if (!live->keyframes.list[j].held_out) most = fmax(most, sqrt(apart));
        }
    }
    return most / fmax(live->localizer.distance, 1e-9);
}

sf_status sf_live_begin(sf_live *live) {
    size_t views;
    double apart = baseline(live, &views);
    live->localizer.state = SF_LIVE_STARTING;
    if (views < FIRST_VIEWS || apart < FIRST_BASELINE) return SF_OK;
    sf_fit_options o = live->options.fit;
    if (!(o.extent > 0)) o.extent = live->localizer.distance;
    if (o.time_limit > 0) o.time_limit = fmax(o.time_limit - (sf_clock() - live->pace.first_frame), 1);
    sf_status status = sf_fitter_create(live->ctx, live->scene, NULL, &o, &live->fitter);
    if (!status) live->localizer.state = SF_LIVE_TRACKING;
    for (size_t i = 0; i < live->keyframes.count && !status; i++)
        live->keyframes.list[i].searched = 1; /* as a whole */
    return status;
}
