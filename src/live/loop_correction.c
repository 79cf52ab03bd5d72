/* loop_correction.c - the drift of a loop, spread over its keyframes by a pose graph. */
#include <math.h>
#include <string.h>

#include "../pose/covisibility.h"
#include "keyframes.h"
#include "loop_closure.h"

enum {
    ROUNDS = 20,
    LEAST = 15,  /* landmarks that two keyframes share, for what is between them to be known */
    MOST = 50,   /* of which no more count */
    NEAR = 10,   /* keyframes: within so many, what is between them follows from those one after another */
    LINK = 20000 /* that a link counts for: it is as accurate as a keyframe, and drift is far more */
};

/* Rad, parts of the distance: what a shared landmark tells; a pixel, about. */
#define TOLD 0.002
/* In those: the logarithm of the scale. */
#define TOLD_SCALE 3.0
/* The part of a landmark that is between two keyframes one after another where the camera was lost. */
#define FAINT 0.01

typedef struct building {
    sf_live *live;
    sf_graph_pose *poses; /* [count + 1], the picture last */
    sf_graph_edge *edges;
    size_t count, edge_count; /* count: of keyframes */
    int with_scale;
} building;

static void join(building *b, size_t later, size_t sooner, const sf_similar *way, double landmarks) {
    double distance = fmax(b->live->localizer.distance, 1e-9), weight = landmarks / (TOLD * TOLD);
    b->edges[b->edge_count++] = (sf_graph_edge){.a = (uint32_t)later,
                                                .b = (uint32_t)sooner,
                                                .way = *way,
                                                .turn = weight,
                                                .move = weight / (distance * distance),
                                                .scale = weight / (TOLD_SCALE * TOLD_SCALE)};
}

/* As their poses are now. */
static void join_as_they_are(building *b, size_t later, size_t sooner, double landmarks) {
    sf_similar way;
    sf_similar_invert(&b->poses[sooner].at, &way);
    sf_similar_compose(&b->poses[later].at, &way, &way);
    join(b, later, sooner, &way, landmarks);
}

static void add_link(building *b, const sf_loop_link *link) {
    sf_similar way, old;
    const sf_similar pose = {1, link->pose};
    sf_similar_invert(&b->poses[link->old].at, &old);
    sf_similar_compose(&pose, &old, &way);
    way.scale *= link->scale;
    for (int k = 0; k < 3; k++) way.rigid.t[k] *= link->scale;
    join(b, link->keyframe, link->old, &way, LINK);
    if (!link->is_scaled) b->edges[b->edge_count - 1].scale = 1;
}

static void add_poses(building *b) {
    const sf_keyframes *keyframes = &b->live->keyframes;
    for (size_t i = 0; i <= b->count; i++) {
        sf_graph_pose *pose = &b->poses[i];
        const sf_rigid *at = i < b->count ? &keyframes->list[i].pose : &b->live->localizer.pose;
        *pose = (sf_graph_pose){.at = {1, *at}, .is_fixed = i == 0};
        if (i < b->count)
            pose->is_known =
                sf_landmarks_prior(b->live->localizer.landmarks, keyframes->list[i].id, &pose->prior);
    }
    const sf_fix *fix = &b->live->localizer.fix;
    b->with_scale = !fix->from;
    b->poses[b->count].is_known = fix->from != SF_POSE_NONE;
    b->poses[b->count].prior = fix->prior;
}

/* Whether the camera was followed from the keyframe before to this one, or to the picture. */
static int is_followed(const sf_live *live, size_t at) {
    const sf_keyframes *all = &live->keyframes;
    return all->list[at - 1].found_again ==
           (at < all->count ? all->list[at].found_again : live->localizer.found_again);
}

static size_t count_edges(const uint32_t *shared, size_t count) {
    size_t edges = count;
    for (size_t i = 0; i <= count; i++)
        for (size_t j = 0; j < i; j++) edges += shared[i * (count + 1) + j] >= LEAST;
    return edges;
}

static sf_status build(building *b, const sf_loop_link *links, size_t link_count) {
    sf_live *live = b->live;
    size_t side = b->count + 1;
    uint32_t *ids = sf_alloc(live->ctx, side, sizeof *ids);
    uint32_t *shared = sf_alloc(live->ctx, side * side, sizeof *shared);
    b->poses = sf_alloc(live->ctx, side, sizeof *b->poses);
    sf_status status = ids && shared && b->poses ? SF_OK : SF_ERR_MEMORY;
    for (size_t i = 0; !status && i < b->count; i++) ids[i] = live->keyframes.list[i].id;
    if (!status) status = sf_landmarks_count_shared(live->localizer.landmarks, ids, b->count, shared);
    if (!status) {
        b->edges = sf_alloc(live->ctx, count_edges(shared, b->count) + link_count + 1, sizeof *b->edges);
        status = b->edges ? SF_OK : SF_ERR_MEMORY;
    }
    if (!status) {
        add_poses(b);
        for (size_t i = 1; i <= b->count; i++) {
            for (size_t j = 0; j + NEAR < i; j++)
                if (shared[i * side + j] >= LEAST)
                    join_as_they_are(b, i, j, fmin(shared[i * side + j], MOST));
            double followed = fmin(fmax(shared[i * side + i - 1], LEAST), MOST);
            join_as_they_are(b, i, i - 1, is_followed(live, i) ? followed : FAINT);
        }
        for (size_t i = 0; i < link_count; i++) add_link(b, &links[i]);
    }
    sf_free(live->ctx, ids);
    sf_free(live->ctx, shared);
    return status;
}

/* A pose of the graph in the world's unit. */
static sf_rigid pose_of(const sf_similar *at) {
    sf_rigid pose = at->rigid;
    for (int k = 0; k < 3; k++) pose.t[k] /= at->scale;
    return pose;
}

static void tell(const building *b, const sf_rigid *before) {
    double most_turn = 0, most_move = 0;
    for (size_t i = 0; i <= b->count; i++) {
        double angle, apart;
        const sf_rigid now = pose_of(&b->poses[i].at);
        sf_rigid_gap(&before[i], &now, &angle, &apart);
        most_turn = fmax(most_turn, angle), most_move = fmax(most_move, apart);
    }
    sf_log(b->live->ctx, SF_LOG_INFO,
           "a loop is closed: keyframes are corrected by up to %.2f degrees and %.3g, the scale by %.2f %%",
           most_turn * 57.29577951308232, most_move, 100 * fabs(1 / b->poses[b->count].at.scale - 1));
}

static sf_status correct(building *b, const sf_loop_back *back, sf_rigid *moved, double *scale) {
    sf_context *ctx = b->live->ctx;
    sf_rigid *before = sf_alloc(ctx, b->count + 1, sizeof *before);
    sf_rigid *to = sf_alloc(ctx, b->count + 1, sizeof *to);
    double *scales = sf_alloc(ctx, b->count + 1, sizeof *scales);
    const sf_pose_graph graph = {b->poses, b->count + 1, b->edges, b->edge_count, b->with_scale};
    sf_status status = before && to && scales ? SF_OK : SF_ERR_MEMORY;
    for (size_t i = 0; !status && i <= b->count; i++) before[i] = b->poses[i].at.rigid;
    if (!status) status = sf_pose_graph_adjust(ctx, &graph, ROUNDS, NULL);
    if (!status) {
        tell(b, before);
        for (size_t i = 0; i <= b->count; i++)
            to[i] = pose_of(&b->poses[i].at), scales[i] = 1 / b->poses[i].at.scale;
        *moved = to[b->count], *scale = scales[b->count];
        status = sf_live_move_keyframes(b->live, to, scales, back->first, back->count);
    }
    sf_free(ctx, before);
    sf_free(ctx, to);
    sf_free(ctx, scales);
    return status;
}

sf_status sf_live_correct_loop(sf_live *live, const sf_loop_link *links, size_t count,
                               const sf_loop_back *back, sf_rigid *moved, double *scale) {
    building b = {.live = live, .count = live->keyframes.count};
    *moved = live->localizer.pose, *scale = 1;
    sf_status status = build(&b, links, count);
    if (!status) status = correct(&b, back, moved, scale);
    sf_free(live->ctx, b.poses);
    sf_free(live->ctx, b.edges);
    return status == SF_ERR_EMPTY ? SF_OK : status;
}
