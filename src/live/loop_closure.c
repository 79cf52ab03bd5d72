/* loop_closure.c - whether the camera is back at an old place that nothing joins the way here with. */
#include "loop_closure.h"

#include <math.h>

#include "../pose/covisibility.h"
#include "localizer.h"
#include "place_recognition.h"

enum {
    LEAST_KEYFRAMES = 5,
    ASKED = 6, /* keyframes before a loss that are asked for the old place, the newest first: */
    SAY = 3,   /* of which so many must say the same */
    TRIES = 4, /* after the camera was found again, */
    EVERY = 3  /* frames apart */
};

/* Rad, parts of the distance to the scene: so far two keyframes may differ in what they say. */
#define AGREES 0.03

/* The picture's landmarks, from where it is by now: those of the old place are among them. */
static sf_status follow_again(sf_live *live) {
    sf_localizer *l = &live->localizer;
    sf_status status = sf_landmarks_follow(l->landmarks, &l->pose, NULL, &l->followed);
    if (status) return status;
    if (l->followed.used) sf_live_correct_pose(live, &l->pose, &l->followed.pose);
    sf_landmarks_settle(l->landmarks, &l->pose);
    return SF_OK;
}

/* Spreads the drift that links tell. */
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

/* 1. With a new keyframe */

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
    return sf_loop_gap(&expected, &link->pose, live->localizer.distance) < AGREES;
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

/* 2. After a loss */

/* Whether two keyframes' links say the same: the way between the two is the same in both maps. */
static int say_the_same(const sf_live *live, const sf_loop_link *a, const sf_loop_link *b) {
    sf_rigid way, expected;
    sf_rigid_invert(&live->keyframes.list[a->keyframe].pose, &way);
    sf_rigid_compose(&live->keyframes.list[b->keyframe].pose, &way, &way);
    sf_rigid_compose(&way, &a->pose, &expected);
    return sf_loop_gap(&expected, &b->pose, live->localizer.distance) < AGREES;
}

/* Of the links, those that say the same as most others: to the front. Returns how many. */
static size_t agree(const sf_live *live, sf_loop_link *links, size_t count) {
    size_t best = 0, most = 0, kept = 0;
    for (size_t i = 0; i < count; i++) {
        size_t n = 0;
        for (size_t j = 0; j < count; j++) n += say_the_same(live, &links[i], &links[j]);
        if (n > most) most = n, best = i;
    }
    const sf_loop_link chosen = links[best];
    for (size_t j = 0; j < count; j++)
        if (say_the_same(live, &chosen, &links[j])) links[kept++] = links[j];
    return kept;
}

/* What keyframes say, from index `last` backwards. *drifted: how many of them are off. */
static sf_status ask(sf_live *live, size_t last, sf_loop_link links[ASKED], size_t *count, size_t *drifted) {
    sf_status status = SF_OK;
    *count = *drifted = 0;
    for (size_t i = 0; !status && i < ASKED && i < last; i++) {
        sf_loop_found found;
        status = sf_live_find_link(live, last - i, &links[*count], &found);
        *drifted += !status && found == SF_LOOP_DRIFTED;
        *count += !status && found != SF_LOOP_NONE;
    }
    return status;
}

/* Those that came after the loss are where the old place says, and stay there. */
static size_t hold(const sf_live *live, size_t after, size_t old, sf_loop_link *links) {
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

/* *joined: whether the last keyframes before a loss are joined with an old place by now. */
static sf_status join(sf_live *live, size_t after, int *joined) {
    size_t all = live->keyframes.count, count, drifted;
    sf_loop_link *links = sf_alloc(live->ctx, ASKED + all - after + 1, sizeof *links);
    if (!links) return SF_ERR_MEMORY;
    sf_status status = ask(live, after - 1, links, &count, &drifted);
    if (!status) count = agree(live, links, count);
    *joined = !status && count >= SAY;
    if (*joined && 2 * drifted > count) {
        const sf_loop_back back = {links[count - 1].keyframe, after - links[count - 1].keyframe};
        count += hold(live, after, links[0].old, links + count);
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
