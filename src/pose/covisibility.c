/* covisibility.c - see covisibility.h. */
#include "covisibility.h"

#include <string.h>

#include "landmark_map.h"

static size_t index_of(const sf_landmarks *l, uint32_t id) {
    size_t i = 0;
    while (i < l->keyframe_count && l->keyframes[i].id != id) i++;
    return i;
}

/* Who sees each landmark: lists of places in `ids`, the picture's last. */
typedef struct observation_lists {
    size_t *first; /* [landmarks + 1] */
    uint32_t *who; /* [observations] */
} observation_lists;

static void add_pairs(const observation_lists *s, size_t landmark, size_t side, uint32_t *shared) {
    for (size_t i = s->first[landmark]; i < s->first[landmark + 1]; i++)
        for (size_t j = s->first[landmark]; j < s->first[landmark + 1]; j++)
            if (i != j) shared[s->who[i] * side + s->who[j]]++;
}

/* place [keyframes]: in ids; UINT32_MAX: not there. */
static void list_observations(const sf_landmarks *l, const uint32_t *place, uint32_t picture,
                              const observation_lists *s) {
    memset(s->first, 0, (l->count + 2) * sizeof *s->first);
    for (size_t i = 0; i < l->observation_count; i++)
        s->first[l->observations[i].landmark + 2] += place[l->observations[i].keyframe] != UINT32_MAX;
    for (size_t i = 0; i < l->match_count; i++)
        s->first[l->matches[i].landmark + 2] += sf_match_is_used(l, &l->matches[i]) != 0;
    for (size_t i = 2; i < l->count + 2; i++) s->first[i] += s->first[i - 1];
    for (size_t i = 0; i < l->observation_count; i++) {
        uint32_t who = place[l->observations[i].keyframe];
        if (who != UINT32_MAX) s->who[s->first[l->observations[i].landmark + 1]++] = who;
    }
    for (size_t i = 0; i < l->match_count; i++)
        if (sf_match_is_used(l, &l->matches[i])) s->who[s->first[l->matches[i].landmark + 1]++] = picture;
}

sf_status sf_landmarks_count_shared(const sf_landmarks *l, const uint32_t *ids, size_t count,
                                    uint32_t *shared) {
    uint32_t *place = sf_alloc(l->ctx, l->keyframe_count + 1, sizeof *place);
    observation_lists s = {.first = sf_alloc(l->ctx, l->count + 2, sizeof *s.first),
                           .who = sf_alloc(l->ctx, l->observation_count + l->match_count + 1, sizeof *s.who)};
    int ready = place && s.first && s.who;
    if (ready) {
        for (size_t i = 0; i < l->keyframe_count; i++) place[i] = UINT32_MAX;
        for (size_t i = 0; i < count; i++) {
            size_t at = index_of(l, ids[i]);
            if (at < l->keyframe_count) place[at] = (uint32_t)i;
        }
        list_observations(l, place, (uint32_t)count, &s);
        memset(shared, 0, (count + 1) * (count + 1) * sizeof *shared);
        for (size_t m = 0; m < l->count; m++) add_pairs(&s, m, count + 1, shared);
    }
    void *const blocks[] = {place, s.first, s.who};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) sf_free(l->ctx, blocks[i]);
    return ready ? SF_OK : SF_ERR_MEMORY;
}

int sf_landmarks_prior(const sf_landmarks *l, uint32_t id, sf_track_prior *prior) {
    size_t at = index_of(l, id);
    if (at == l->keyframe_count || !l->keyframes[at].view.is_known) return 0;
    *prior = l->keyframes[at].view.prior;
    return 1;
}

size_t sf_landmarks_seen(const sf_landmarks *l, double (*at)[3], double (*pixels)[2], size_t most) {
    size_t count = 0;
    for (size_t i = 0; i < l->match_count && count < most; i++) {
        const sf_landmark_match *match = &l->matches[i];
        if (!sf_match_is_used(l, match)) continue;
        memcpy(at[count], l->all[match->landmark].at, sizeof at[count]);
        pixels[count][0] = match->u, pixels[count][1] = match->v;
        count++;
    }
    return count;
}

size_t sf_landmarks_seen_by(const sf_landmarks *l, uint32_t id, double (*at)[3], double (*pixels)[2],
                            size_t most) {
    size_t count = 0, keyframe = index_of(l, id);
    for (size_t i = 0; i < l->observation_count && count < most; i++) {
        const sf_landmark_observation *o = &l->observations[i];
        if (o->keyframe != keyframe || l->all[o->landmark].state != SF_LANDMARK_KNOWN) continue;
        memcpy(at[count], l->all[o->landmark].at, sizeof at[count]);
        pixels[count][0] = o->u, pixels[count][1] = o->v;
        count++;
    }
    return count;
}

void sf_landmarks_move(sf_landmarks *l, uint32_t id, const sf_rigid *to, double scale) {
    size_t at = index_of(l, id);
    if (at == l->keyframe_count) return;
    const sf_rigid from = l->keyframes[at].view.pose;
    l->keyframes[at].view.pose = *to;
    for (size_t i = 0; i < l->count; i++) {
        sf_landmark *m = &l->all[i];
        double p[3];
        if (m->keyframe != at || m->state == SF_LANDMARK_EMPTY) continue;
        sf_rigid_apply(&from, m->at, p);
        for (int k = 0; k < 3; k++) p[k] *= scale;
        sf_rigid_apply_back(to, p, m->at);
        m->inverse /= scale, m->variance /= scale * scale;
    }
}
