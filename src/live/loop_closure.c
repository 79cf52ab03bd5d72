/* loop_closure.c - whether the picture in hand shows an old place that nothing joins it with. */
#include "loop_closure.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../base/statistics.h"
#include "../fit/online.h"
#include "../pose/covisibility.h"
#include "localizer.h"
#include "place_recognition.h"
#include "relocalization.h"

enum {
    JOINED = 3,       /* landmarks that two share, and are joined by */
    RECENT = 5,       /* keyframes: of the way here, whatever they share */
    LEAST_SHARED = 6, /* of the few features, for a place to be looked at */
    ALIKE = 3,        /* keyframes that the picture is compared with in full */
    DRAWINGS = 2,     /* of the model, for depths */
    LEAST_AGREE = 25, /* features, for a loop */
    SEEN_MOST = 300,  /* landmarks that scales are compared at */
    LEAST_SCALES = 10 /* of them */
};

/* Rad, and parts of the distance to the scene: so far off the pose is to be worth while; so far two keyframes
 * may differ in what they say. */
#define SAME   0.01
#define AGREES 0.03
/* The most that tracking drifts by: parts of the way; rad. */
#define DRIFT 0.1
#define TURN  0.35
/* Rad: from so far aside the same is recognized. */
#define ASIDE 0.8
/* Transmittance up to which a drawn pixel has a depth. */
#define SOLID 0.5f
/* Of the factors of depths: the most that the median is off from 1, and that they scatter about it. */
#define SCATTER 0.15

/* How far apart two poses are: the greater of the turn, rad, and the move, in distances. */
static double gap_of(const sf_rigid *a, const sf_rigid *b, double distance) {
    double angle, apart;
    sf_rigid_gap(a, b, &angle, &apart);
    return fmax(angle, apart / fmax(distance, 1e-9));
}

/* 1. Keyframes that show the same */

/* The length of the way since a keyframe, world units. */
static double way_since(const sf_live *live, size_t from) {
    double sum = 0;
    for (size_t i = from + 1; i < live->keyframes.count; i++) {
        const double *a = live->keyframes.list[i - 1].center, *b = live->keyframes.list[i].center;
        sum += sqrt(pow(a[0] - b[0], 2) + pow(a[1] - b[1], 2) + pow(a[2] - b[2], 2));
    }
    return sum;
}

/* Whether tracking may have drifted so far, since a keyframe, that a pose (of the picture, or of a keyframe
 * that shows the same from up to `angle` and `apart` aside) is where the picture is: two places may look
 * alike. */
static int may_be_here(const sf_live *live, const sf_rigid *pose, size_t since, double angle, double apart) {
    double turned, moved;
    sf_rigid_gap(&live->localizer.pose, pose, &turned, &moved);
    return turned < TURN + angle && moved < DRIFT * way_since(live, since) + apart;
}

/* Flags of the keyframes that landmarks join with the picture, of the last ones, and of those elsewhere. */
static sf_status find_joined(const sf_live *live, uint8_t *joined) {
    size_t count = live->keyframes.count;
    uint32_t *ids = sf_alloc(live->ctx, count + 1, sizeof *ids);
    uint32_t *shared = sf_alloc(live->ctx, (count + 1) * (count + 1), sizeof *shared);
    sf_status status = ids && shared ? SF_OK : SF_ERR_MEMORY;
    for (size_t i = 0; !status && i < count; i++) ids[i] = live->keyframes.list[i].id;
    if (!status) status = sf_landmarks_count_shared(live->localizer.landmarks, ids, count, shared);
    for (size_t i = 0; !status && i < count; i++)
        joined[i] = shared[count * (count + 1) + i] >= JOINED || i + RECENT >= count ||
                    !may_be_here(live, &live->keyframes.list[i].pose, i, ASIDE, live->localizer.distance);
    sf_free(live->ctx, ids);
    sf_free(live->ctx, shared);
    return status;
}

static sf_status choose(sf_live *live, size_t chosen[ALIKE], size_t *count) {
    size_t all = live->keyframes.count;
    uint8_t *joined = sf_alloc(live->ctx, all + 1, 1);
    sf_place_score *scores = sf_alloc(live->ctx, all + 1, sizeof *scores);
    sf_status status = joined && scores ? find_joined(live, joined) : SF_ERR_MEMORY;
    *count = 0;
    if (!status) status = sf_live_score_places(live, joined, scores);
    for (size_t i = 0; !status && i < all && *count < ALIKE; i++)
        if (scores[i].shared >= LEAST_SHARED) chosen[(*count)++] = scores[i].keyframe;
    sf_free(live->ctx, joined);
    sf_free(live->ctx, scores);
    return status;
}

/* 2. What they say */

/* The picture's landmarks have depths in the map that came along, the model at the pose that the old map
 * gives has those of the old one. */
static sf_status compare_scales(sf_live *live, sf_loop_link *link) {
    double(*at)[3] = sf_alloc(live->ctx, SEEN_MOST, sizeof *at), factors[SEEN_MOST];
    double(*pixels)[2] = sf_alloc(live->ctx, SEEN_MOST, sizeof *pixels);
    sf_camera camera = live->input.frame.camera;
    const sf_workspace *ws;
    size_t n = 0, seen = 0;
    memcpy(camera.R_cw, link->pose.R, sizeof camera.R_cw),
        memcpy(camera.t_cw, link->pose.t, sizeof camera.t_cw);
    sf_status status = at && pixels ? sf_online_draw(live->fitter, &camera, &ws) : SF_ERR_MEMORY;
    if (!status) seen = sf_landmarks_seen(live->localizer.landmarks, at, pixels, SEEN_MOST);
    for (size_t i = 0; i < seen; i++) {
        double p[3];
        size_t x = (size_t)pixels[i][0], y = (size_t)pixels[i][1], place = y * ws->stride + x;
        if (x >= (size_t)camera.width || y >= (size_t)camera.height || !(ws->transmittance[place] < SOLID))
            continue;
        double z = ldexp((double)(ws->depth[place] / (1 - ws->transmittance[place])), ws->unit);
        sf_rigid_apply(&live->localizer.pose, at[i], p);
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

/* *found: whether there is such a place. */
static sf_status find_link(sf_live *live, sf_loop_link *link, int *found) {
    size_t chosen[ALIKE], count = 0;
    sf_place_pose place = {0};
    *found = 0;
    sf_status status = choose(live, chosen, &count);
    if (!status && count) status = sf_live_find_place(live, chosen, count, DRAWINGS, &place);
    if (status || !place.found || place.agree < LEAST_AGREE) return status;
    *link =
        (sf_loop_link){.keyframe = live->keyframes.count, .old = chosen[0], .pose = place.pose, .scale = 1};
    if (gap_of(&live->localizer.pose, &place.pose, live->localizer.distance) < SAME) return SF_OK;
    *found = may_be_here(live, &place.pose, link->old, 0, 0);
    return *found ? compare_scales(live, link) : SF_OK;
}

/* 3. Whether two keyframes say the same */

static size_t index_of(const sf_keyframes *keyframes, uint32_t id) {
    size_t i = 0;
    while (i < keyframes->count && keyframes->list[i].id != id) i++;
    return i;
}

/* The keyframe before saw it as well: the way between the two is the same in both maps. *before: its link. */
static int is_confirmed(const sf_live *live, const sf_loop_link *link, sf_loop_link *before) {
    const sf_loop *loop = &live->loop;
    size_t last = live->keyframes.count - 1;
    sf_rigid way, expected;
    *before = (sf_loop_link){.keyframe = last,
                             .old = index_of(&live->keyframes, loop->old),
                             .pose = loop->pose,
                             .scale = loop->scale,
                             .is_scaled = loop->is_scaled};
    if (!loop->is_seen || loop->made + 1 != live->keyframes.made || before->old > last) return 0;
    sf_rigid_invert(&live->keyframes.list[last].pose, &way);
    sf_rigid_compose(&live->localizer.pose, &way, &way);
    sf_rigid_compose(&way, &loop->pose, &expected);
    return gap_of(&expected, &link->pose, live->localizer.distance) < AGREES;
}

static void remember(sf_live *live, const sf_loop_link *link) {
    live->loop = (sf_loop){.is_seen = 1,
                           .made = live->keyframes.made,
                           .old = live->keyframes.list[link->old].id,
                           .pose = link->pose,
                           .scale = link->scale,
                           .is_scaled = link->is_scaled};
}

/* The picture's landmarks, from where it is by now: those of the old place are among them. */
static sf_status follow_again(sf_live *live) {
    sf_localizer *l = &live->localizer;
    sf_status status = sf_landmarks_follow(l->landmarks, &l->pose, NULL, &l->followed);
    if (status) return status;
    if (l->followed.used) sf_live_correct_pose(live, &l->pose, &l->followed.pose);
    sf_landmarks_settle(l->landmarks, &l->pose);
    return SF_OK;
}

sf_status sf_live_close_loop(sf_live *live) {
    sf_loop_link links[2];
    sf_rigid pose;
    double scale;
    int found = 0;
    if (!live->fitter || live->keyframes.count <= RECENT) return SF_OK;
    sf_status status = find_link(live, &links[1], &found);
    if (status || !found) return status;
    if (!is_confirmed(live, &links[1], &links[0])) {
        remember(live, &links[1]);
        return SF_OK;
    }
    live->loop = (sf_loop){.is_seen = 0};
    const sf_rigid tracked = live->localizer.pose;
    status = sf_live_correct_loop(live, links, 2, &pose, &scale);
    if (status) return status;
    sf_live_correct_pose(live, &tracked, &pose);
    live->localizer.distance *= scale;
    return follow_again(live);
}
