/* place_recognition.c - features of pictures, and the keyframes that look most like one. */
#include "place_recognition.h"

#include <math.h>
#include <stdlib.h>

#include "../base/pool.h"
#include "../fit/online.h"
#include "../sfm/pairs.h"

enum {
    REDRAWN = 200, /* steps of the fit, after which depths are drawn anew, */
    RECENT = 30    /* of these keyframes, the newest: what others show may be hidden by what drifted since */
};

#define SOLID 0.5f /* transmittance up to which a drawn pixel has a depth */
#define EDGE  0.1f /* depths of neighbours that differ by more are no surface */

/* 1. Features */

void sf_place_free(sf_context *ctx, sf_place *place) {
    sf_features_free(ctx, &place->features);
    sf_features_free(ctx, &place->few);
    sf_free(ctx, place->depths);
    *place = (sf_place){.depths = NULL};
}

void sf_places_free(sf_context *ctx, const sf_keyframes *keyframes) {
    for (size_t i = 0; i < keyframes->count; i++) sf_place_free(ctx, &keyframes->list[i].place);
}

/* In live->input.bytes: grey, and a mask. */
static sf_photo photo_of(const sf_live *live) {
    const sf_picture *p = live->input.picture;
    size_t width = (size_t)p->camera.width, pixels = width * (size_t)p->camera.height;
    uint8_t *grey = live->input.bytes, *mask = grey + pixels;
    for (size_t i = 0; i < pixels; i++) {
        grey[i] = (uint8_t)(255 * fminf(fmaxf(sf_picture_grey(p, i), 0), 1) + 0.5f);
        if (p->weight) mask[i] = p->weight[i] >= 1;
    }
    return (sf_photo){.pixels = grey,
                      .mask = p->weight ? mask : NULL,
                      .stride = width,
                      .width = p->camera.width,
                      .height = p->camera.height};
}

sf_status sf_live_find_features(sf_live *live) {
    sf_place *place = &live->input.place;
    sf_features_options options = sf_features_options_default();
    if (live->input.has_place) return SF_OK;
    options.most = SF_PLACE_FEATURES;
    const sf_photo photo = photo_of(live);
    sf_status status = sf_features_find(live->ctx, &photo, &options, &place->features);
    if (!status) status = sf_pairs_take_few(live->ctx, &place->features, SF_PLACE_FEW, &place->few);
    live->input.has_place = !status;
    return status;
}

/* 2. Which keyframes are like the picture */

typedef struct scoring {
    sf_live *live;
    const sf_place *place;
    const uint8_t *left_out;
    sf_place_score *scores;
    sf_status *statuses;
} scoring;

static void score_task(void *pointer, size_t at, int thread) {
    const scoring *s = pointer;
    sf_match_options options = sf_match_options_default();
    sf_matches matches = {0};
    (void)thread;
    s->scores[at] = (sf_place_score){.keyframe = at};
    if (s->left_out && s->left_out[at]) return;
    s->statuses[at] = sf_match_pair(s->live->ctx, &s->place->few, &s->live->keyframes.list[at].place.few,
                                    &options, &matches);
    s->scores[at].shared = matches.count;
    sf_matches_free(s->live->ctx, &matches);
}

static int most_alike_first(const void *a, const void *b) {
    const sf_place_score *x = a, *y = b;
    if (x->shared != y->shared) return x->shared > y->shared ? -1 : 1;
    return (x->keyframe < y->keyframe) - (x->keyframe > y->keyframe);
}

sf_status sf_live_score_places(sf_live *live, const sf_place *place, const uint8_t *left_out,
                               sf_place_score *scores) {
    size_t count = live->keyframes.count;
    scoring s = {live, place, left_out, scores, sf_calloc(live->ctx, count + 1, sizeof *s.statuses)};
    sf_status status = s.statuses ? SF_OK : SF_ERR_MEMORY;
    if (!status) sf_pool_run(live->ctx->pool, count, score_task, &s);
    for (size_t i = 0; i < count && !status; i++) status = s.statuses[i];
    if (!status && count) qsort(scores, count, sizeof *scores, most_alike_first);
    sf_free(live->ctx, s.statuses);
    return status;
}

/* 3. Depths */

static float depth_of(const sf_workspace *ws, size_t at) {
    float T = ws->transmittance[at];
    return T < SOLID ? ws->depth[at] / (1 - T) : 0;
}

/* 0: there is no surface. */
static float depth_at(const sf_workspace *ws, int x, int y) {
    if (x < 1 || y < 1 || x + 1 >= ws->eye.width || y + 1 >= ws->eye.height) return 0;
    size_t at = (size_t)y * ws->stride + (size_t)x;
    const size_t around[4] = {at - 1, at + 1, at - ws->stride, at + ws->stride};
    float z = depth_of(ws, at);
    for (int i = 0; i < 4; i++)
        if (!(fabsf(depth_of(ws, around[i]) - z) <= EDGE * z)) return 0;
    return z;
}

sf_status sf_live_draw_depths(sf_live *live, sf_keyframe *k, int *drawn) {
    sf_place *place = &k->place;
    sf_fit_progress progress;
    const sf_workspace *ws;
    sf_camera camera = live->input.frame.camera;
    *drawn = 0;
    sf_fitter_get_progress(live->fitter, &progress);
    size_t at = (size_t)(k - live->keyframes.list);
    int is_old = at + RECENT < live->keyframes.count;
    if (place->depths && (is_old || progress.step < place->drawn_at + REDRAWN)) return SF_OK;
    if (!place->depths)
        place->depths = sf_calloc(live->ctx, place->features.count + 1, sizeof *place->depths);
    if (!place->depths) return SF_ERR_MEMORY;
    for (int i = 0; i < 9; i++) camera.R_cw[i] = k->pose.R[i];
    for (int i = 0; i < 3; i++) camera.t_cw[i] = k->pose.t[i];
    sf_status status = sf_online_draw(live->fitter, &camera, &ws);
    if (status) return status;
    for (size_t i = 0; i < place->features.count; i++) {
        const sf_keypoint *point = &place->features.points[i];
        place->depths[i] = ldexpf(depth_at(ws, (int)point->x, (int)point->y), ws->unit);
    }
    place->drawn_at = progress.step;
    *drawn = 1;
    return SF_OK;
}
