/* loop_link.c - the pose of the present frame, or of a keyframe, in the map of an old place that it shares
 * few landmarks with. */
#include "loop_closure.h"

#include <math.h>
#include <string.h>

#include "../base/statistics.h"
#include "../fit/online.h"
#include "../pose/covisibility.h"
#include "place_recognition.h"
#include "relocalization.h"

enum {
    JOINED = 15,      /* landmarks that two keyframes share: tracking has joined them */
    RECENT = 5,       /* keyframes before and after, which are never candidates */
    LEAST_SHARED = 4, /* of the few features, for a place to be looked at */
    ALIKE = 5,        /* keyframes that the picture is compared with in full */
    DRAWINGS = 2,     /* of the model, for depths */
    LEAST_AGREE = 40, /* features, for a loop */
    SEEN_MOST = 300,  /* landmarks that scales are compared at */
    LEAST_SCALES = 10 /* of them */
};

/* A smaller difference of the two poses is no drift: rad, and parts of the distance to the scene. */
#define SAME 0.01
/* The most that tracking drifts by: a part of the length of the way; rad. */
#define DRIFT 0.1
#define TURN  0.35
/* Rad: features match between views up to this angle apart. */
#define ASIDE 0.8
/* Transmittance up to which a drawn pixel has a depth. */
#define SOLID 0.5f
/* Of the factors of depths: the most that the median is off from 1, and that they scatter about it. */
#define SCATTER 0.15

double sf_loop_gap(const sf_rigid *a, const sf_rigid *b, double distance) {
    double angle, apart;
    sf_rigid_gap(a, b, &angle, &apart);
    return fmax(angle, apart / fmax(distance, 1e-9));
}

/* 1. Candidates: old keyframes that look alike */

/* The length of the way from one keyframe to another, or to the present frame, world units. */
static double way_between(const sf_live *live, size_t from, size_t to) {
    double sum = 0;
    for (size_t i = from + 1; i <= to && i < live->keyframes.count; i++) {
        const double *a = live->keyframes.list[i - 1].center, *b = live->keyframes.list[i].center;
        sum += sqrt(pow(a[0] - b[0], 2) + pow(a[1] - b[1], 2) + pow(a[2] - b[2], 2));
    }
    return sum;
}

const sf_rigid *sf_loop_tracked_pose(const sf_live *live, size_t which) {
    return which < live->keyframes.count ? &live->keyframes.list[which].pose : &live->localizer.pose;
}

/* Whether tracking may have drifted so far, since a keyframe, that a pose (of `which`, or of a keyframe that
 * shows the same from up to `angle` and `apart` aside) is where it is: two places may look alike. */
static int may_be_here(const sf_live *live, size_t which, const sf_rigid *pose, size_t since, double angle,
                       double apart) {
    double turned, moved, way = way_between(live, since < which ? since : 0, which);
    sf_rigid_gap(sf_loop_tracked_pose(live, which), pose, &turned, &moved);
    return turned < TURN + angle && moved < DRIFT * way + apart;
}

/* Whether a keyframe is of the way to `which`, shortly before or after it, without a loss between. */
static int is_recent(const sf_live *live, size_t which, size_t keyframe) {
    size_t apart = which > keyframe ? which - keyframe : keyframe - which;
    if (which == live->keyframes.count) return apart <= RECENT;
    return apart <= RECENT &&
           live->keyframes.list[keyframe].found_again == live->keyframes.list[which].found_again;
}

/* Flags of the keyframes that landmarks join with `which`, of those of the way, and of those elsewhere. */
static sf_status find_joined(const sf_live *live, size_t which, uint8_t *joined) {
    size_t count = live->keyframes.count;
    uint32_t *ids = sf_alloc(live->ctx, count + 1, sizeof *ids);
    uint32_t *shared = sf_alloc(live->ctx, (count + 1) * (count + 1), sizeof *shared);
    sf_status status = ids && shared ? SF_OK : SF_ERR_MEMORY;
    for (size_t i = 0; !status && i < count; i++) ids[i] = live->keyframes.list[i].id;
    if (!status) status = sf_landmarks_count_shared(live->localizer.landmarks, ids, count, shared);
    for (size_t i = 0; !status && i < count; i++)
        joined[i] =
            shared[which * (count + 1) + i] >= JOINED || is_recent(live, which, i) ||
            !may_be_here(live, which, &live->keyframes.list[i].pose, i, ASIDE, live->localizer.distance);
    sf_free(live->ctx, ids);
    sf_free(live->ctx, shared);
    return status;
}

static sf_status choose(sf_live *live, size_t which, const sf_place *of, size_t chosen[ALIKE],
                        size_t *count) {
    size_t all = live->keyframes.count;
    uint8_t *joined = sf_alloc(live->ctx, all + 1, 1);
    sf_place_score *scores = sf_alloc(live->ctx, all + 1, sizeof *scores);
    sf_status status = joined && scores ? find_joined(live, which, joined) : SF_ERR_MEMORY;
    *count = 0;
    if (!status) status = sf_live_score_places(live, of, joined, scores);
    for (size_t i = 0; !status && i < all && *count < ALIKE; i++)
        if (scores[i].shared >= LEAST_SHARED) chosen[(*count)++] = scores[i].keyframe;
    sf_free(live->ctx, joined);
    sf_free(live->ctx, scores);
    return status;
}

/* 2. The pose in their map */

/* The drift of scale: the median ratio of the depths of the landmarks, which tracking has, to those of the
 * model drawn at the pose in the old map. */
static sf_status compare_scales(sf_live *live, sf_loop_link *link) {
    double(*at)[3] = sf_alloc(live->ctx, SEEN_MOST, sizeof *at), factors[SEEN_MOST];
    double(*pixels)[2] = sf_alloc(live->ctx, SEEN_MOST, sizeof *pixels);
    sf_camera camera = live->input.frame.camera;
    const sf_workspace *ws;
    size_t n = 0, seen = 0, which = link->keyframe;
    const sf_landmarks *landmarks = live->localizer.landmarks;
    memcpy(camera.R_cw, link->pose.R, sizeof camera.R_cw),
        memcpy(camera.t_cw, link->pose.t, sizeof camera.t_cw);
    sf_status status = at && pixels ? sf_online_draw(live->fitter, &camera, &ws) : SF_ERR_MEMORY;
    if (!status && which < live->keyframes.count)
        seen = sf_landmarks_seen_by(landmarks, live->keyframes.list[which].id, at, pixels, SEEN_MOST);
    else if (!status)
        seen = sf_landmarks_seen(landmarks, at, pixels, SEEN_MOST);
    for (size_t i = 0; i < seen; i++) {
        double p[3];
        size_t x = (size_t)pixels[i][0], y = (size_t)pixels[i][1], place = y * ws->stride + x;
        if (x >= (size_t)camera.width || y >= (size_t)camera.height || !(ws->transmittance[place] < SOLID))
            continue;
        double z = ldexp((double)(ws->depth[place] / (1 - ws->transmittance[place])), ws->unit);
        sf_rigid_apply(sf_loop_tracked_pose(live, which), at[i], p);
        if (z > 0 && p[2] > 0) factors[n++] = log(p[2] / z);
    }
    sf_free(live->ctx, at);
    sf_free(live->ctx, pixels);
    link->scale = 1, link->is_scaled = 0;
    if (status || n < LEAST_SCALES) return status;
    double middle = sf_median(factors, n);
    for (size_t i = 0; i < n; i++) factors[i] = fabs(factors[i] - middle);
    link->is_scaled = sf_median(factors, n) < SCATTER && fabs(middle) < SCATTER;
    if (link->is_scaled) link->scale = exp(middle);
    return SF_OK;
}

sf_status sf_live_find_link(sf_live *live, size_t which, sf_loop_link *link, sf_loop_found *found) {
    const sf_place *of =
        which < live->keyframes.count ? &live->keyframes.list[which].place : &live->input.place;
    size_t chosen[ALIKE], count = 0;
    sf_place_pose place = {0};
    *found = SF_LOOP_NONE;
    sf_status status = choose(live, which, of, chosen, &count);
    if (!status && count) status = sf_live_find_place(live, of, chosen, count, DRAWINGS, &place);
    if (status || !place.found || place.agree < LEAST_AGREE) return status;
    *link = (sf_loop_link){.keyframe = which, .old = chosen[0], .pose = place.pose, .scale = 1};
    *found = SF_LOOP_SAME;
    if (sf_loop_gap(sf_loop_tracked_pose(live, which), &place.pose, live->localizer.distance) < SAME)
        return SF_OK;
    *found = may_be_here(live, which, &place.pose, link->old, 0, 0) ? SF_LOOP_DRIFTED : SF_LOOP_NONE;
    return *found ? compare_scales(live, link) : SF_OK;
}
