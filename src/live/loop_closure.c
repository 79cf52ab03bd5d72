/* loop_closure.c - closes loops: finds that the camera is back at a place that it left long ago, and corrects
 * the drift since. */
#include "loop_closure.h"

#include <math.h>

#include "../pose/covisibility.h"
#include "localizer.h"
#include "place_recognition.h"

enum {
    LEAST_KEYFRAMES = 5,
    COMPARED = 6,    /* the last keyframes before a loss that are compared with old ones, the newest first */
    LEAST_AGREE = 3, /* of their links must agree */
    TRIES = 4,       /* comparisons after the camera was found again, */
    EVERY = 3        /* frames apart */
};

/* Two links agree up to this difference: rad, and parts of the distance to the scene. */
#define AGREES 0.03

/* Tracks the landmarks again from the corrected pose, from which those of the old place are visible too. */
static sf_status follow_again(sf_live *live) {
    sf_localizer *l = &live->localizer;
    sf_status status = sf_landmarks_follow(l->landmarks, &l->pose, NULL, &l->followed);
    if (status) return status;
    if (l->followed.used) sf_live_correct_pose(live, &l->pose, &l->followed.pose);
    sf_landmarks_settle(l->landmarks, &l->pose);
    return SF_OK;
}

/* Spreads the drift that the links show over the keyframes, and corrects the pose of the frame. */
static sf_status correct(sf_live *live, const sf_loop_link *links, size_t count, const sf_loop_back *back) {
    const sf_rigid tracked = live->localizer.pose;
    sf_rigid pose;
    double scale;
    sf_status status = sf_live_correct_loop(live, links, count, back, &pose, &scale);
    if (status) return status;
    sf_live_correct_pose(live, &tracked, &pose);
    live->localizer.distance *= scale;
    return follow_again(live);
}

/* 1. Loops found with a new keyframe */

static size_t index_of(const sf_keyframes *keyframes, uint32_t id) {
    size_t i = 0;
    while (i < keyframes->count && keyframes->list[i].id != id) i++;
    return i;
}

/* Whether two links agree: the relative pose of their keyframes is the same by tracking and by the old map.
 */
static int links_agree(const sf_live *live, const sf_loop_link *a, const sf_loop_link *b) {
    sf_rigid way, expected;
    sf_rigid_invert(sf_loop_tracked_pose(live, a->keyframe), &way);
    sf_rigid_compose(sf_loop_tracked_pose(live, b->keyframe), &way, &way);
    sf_rigid_compose(&way, &a->pose, &expected);
    return sf_loop_gap(&expected, &b->pose, live->localizer.distance) < AGREES;
}

/* Whether the keyframe before has a link that agrees. *before: that link. */
static int is_confirmed(const sf_live *live, const sf_loop_link *link, sf_loop_link *before) {
    const sf_loop *loop = &live->loop;
    size_t last = live->keyframes.count - 1;
    *before = (sf_loop_link){.keyframe = last,
                             .old = index_of(&live->keyframes, loop->old),
                             .pose = loop->pose,
                             .scale = loop->scale,
                             .is_scaled = loop->is_scaled};
    if (!loop->is_seen || loop->made + 1 != live->keyframes.made || before->old > last) return 0;
    return links_agree(live, before, link);
}

static void remember(sf_live *live, const sf_loop_link *link) {
    live->loop = (sf_loop){.is_seen = 1,
                           .made = live->keyframes.made,
                           .old = live->keyframes.list[link->old].id,
                           .pose = link->pose,
                           .scale = link->scale,
                           .is_scaled = link->is_scaled,
                           .checked = live->loop.checked};
}

sf_status sf_live_close_loop(sf_live *live) {
    sf_loop_link links[2];
    sf_loop_found found = SF_LOOP_NONE;
    if (!live->fitter || live->keyframes.count <= LEAST_KEYFRAMES) return SF_OK;
    sf_status status = sf_live_find_link(live, live->keyframes.count, &links[1], &found);
    if (status || found != SF_LOOP_DRIFTED) return status;
    if (!is_confirmed(live, &links[1], &links[0])) {
        remember(live, &links[1]);
        return SF_OK;
    }
    live->loop.is_seen = 0;
    const sf_loop_back back = {live->keyframes.count - 2, 2};
    return correct(live, links, 2, &back);
}

/* 2. Loops found after the camera was lost */

/* Moves the largest set of links that agree with one of them to the front; returns how many they are. */
static size_t keep_agreeing(const sf_live *live, sf_loop_link *links, size_t count) {
    size_t best = 0, most = 0, kept = 0;
    if (!count) return 0;
    for (size_t i = 0; i < count; i++) {
        size_t n = 0;
        for (size_t j = 0; j < count; j++) n += links_agree(live, &links[i], &links[j]);
        if (n > most) most = n, best = i;
    }
    const sf_loop_link chosen = links[best];
    for (size_t j = 0; j < count; j++)
        if (links_agree(live, &chosen, &links[j])) links[kept++] = links[j];
    return kept;
}

/* Links of the keyframes with old places, from index `last` backwards. *drifted: how many show drift. */
static sf_status find_links(sf_live *live, size_t last, sf_loop_link links[COMPARED], size_t *count,
                            size_t *drifted) {
    sf_status status = SF_OK;
    *count = *drifted = 0;
    for (size_t i = 0; !status && i < COMPARED && i < last; i++) {
        sf_loop_found found;
        status = sf_live_find_link(live, last - i, &links[*count], &found);
        *drifted += !status && found == SF_LOOP_DRIFTED;
        *count += !status && found != SF_LOOP_NONE;
    }
    return status;
}

/* Links that hold the keyframes made after the loss, and the frame, where they are: their poses are of the
 * old map. */
static size_t hold_newer(const sf_live *live, size_t after, size_t old, sf_loop_link *links) {
    size_t count = 0, all = live->keyframes.count;
    int again = live->localizer.state == SF_LIVE_TRACKING;
    for (size_t i = after; i < all + (size_t)again; i++)
        links[count++] = (sf_loop_link){.keyframe = i,
                                        .old = old,
                                        .pose = i < all ? live->keyframes.list[i].pose : live->localizer.pose,
                                        .scale = 1,
                                        .is_scaled = 1};
    return count;
}

/* Corrects the drift where links of the last keyframes before a loss, which end at index `after`, agree.
 * *joined: they do, with or without drift. */
static sf_status join(sf_live *live, size_t after, int *joined) {
    size_t all = live->keyframes.count, count, drifted;
    sf_loop_link *links = sf_alloc(live->ctx, COMPARED + all - after + 1, sizeof *links);
    if (!links) return SF_ERR_MEMORY;
    sf_status status = find_links(live, after - 1, links, &count, &drifted);
    if (!status) count = keep_agreeing(live, links, count);
    *joined = !status && count >= LEAST_AGREE;
    if (*joined && 2 * drifted > count) {
        const sf_loop_back back = {links[count - 1].keyframe, after - links[count - 1].keyframe};
        count += hold_newer(live, after, links[0].old, links + count);
        live->loop.is_seen = 0;
        status = correct(live, links, count, &back);
        live->keyframes.forced = 1;
    }
    sf_free(live->ctx, links);
    return status;
}

sf_status sf_live_join_lost(sf_live *live) {
    sf_localizer *l = &live->localizer;
    sf_loop_checked *checked = &live->loop.checked;
    size_t after = live->keyframes.count;
    int joined = 0;
    if (!live->fitter || after <= LEAST_KEYFRAMES) return SF_OK;
    if (checked->lost != l->lost) {
        *checked = (sf_loop_checked){.lost = l->lost, .tries = TRIES, .found_again = l->found_again};
    } else if (l->found_again == checked->found_again || !l->sure || !checked->tries ||
               l->looked_at < checked->next) {
        return SF_OK;
    }
    while (after > 1 && live->keyframes.list[after - 1].found_again > checked->found_again) after--;
    if (after <= LEAST_KEYFRAMES) return SF_OK;
    checked->tries -= l->found_again != checked->found_again;
    checked->next = l->looked_at + EVERY;
    sf_status status = join(live, after, &joined);
    if (joined) live->loop.checked.tries = 0;
    return status;
}
