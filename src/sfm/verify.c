/* verify.c - see verify.h. Pairs are tasks, each with its thread's scratch. */
#include "verify.h"

#include <math.h>
#include <string.h>

#include "../base/pool.h"
#include "focal.h"

/* Doubles of scratch a match: rays of both pictures, the search's, flags. */
enum { RAYS = 4, FLAGS = 1, SCRATCH = RAYS + SF_TWO_VIEW_SCRATCH + FLAGS };

/* The search for a focal length: from and to, in parts of the guess. */
#define FOCAL_LEAST 0.25
#define FOCAL_MOST  5

typedef struct verifier {
    sf_context *ctx;
    const sf_verify_options *o;
    const sf_map_picture *pictures;
    sf_map_camera *cameras;
    size_t camera_count;
    sf_matched_pair *pairs;
    size_t pair_count, most; /* matches of a pair */
    double *scratch;         /* [threads][SCRATCH most] */
    int with_lenses;         /* the stage: lenses are known */
} verifier;

sf_verify_options sf_verify_options_default(void) {
    return (sf_verify_options){.error_px = 4, .least_count = 15, .seed = 1};
}

static int is_known(const sf_map_camera *camera) { return camera->is_fixed || camera->focal_prior > 0; }

/* Whether both lenses of a pair were known before. */
static int are_known(const verifier *v, const sf_matched_pair *p) {
    return is_known(&v->cameras[v->pictures[p->first].camera]) &&
           is_known(&v->cameras[v->pictures[p->second].camera]);
}

/* Rays through the lens; of a pixel that has none, and in the first stage of all, those of a pinhole. */
static void make_rays(const verifier *v, const sf_matched_pair *p, int side, int with_lens, double *rays) {
    const sf_map_picture *picture = &v->pictures[side ? p->second : p->first];
    const sf_lens *lens = &v->cameras[picture->camera].lens;
    for (size_t k = 0; k < p->count; k++) {
        const double *pixel = picture->keypoints + 2 * (size_t)p->matches[2 * k + (size_t)side];
        if (with_lens && sf_lens_ray(lens, pixel, rays + 2 * k)) continue;
        rays[2 * k] = (pixel[0] - lens->cx) / lens->fx;
        rays[2 * k + 1] = (pixel[1] - lens->cy) / lens->fy;
    }
}

/* The inliers come first, all else in its order. */
static void keep_inliers(sf_matched_pair *p, const uint8_t *inliers) {
    size_t kept = 0;
    for (size_t k = 0; k < p->count; k++) {
        if (!inliers[k]) continue;
        uint32_t first = p->matches[2 * k], second = p->matches[2 * k + 1];
        p->matches[2 * k] = p->matches[2 * kept], p->matches[2 * k + 1] = p->matches[2 * kept + 1];
        p->matches[2 * kept] = first, p->matches[2 * kept++ + 1] = second;
    }
    p->count = kept;
}

static void verify_task(void *pointer, size_t task, int thread) {
    const verifier *v = pointer;
    sf_matched_pair *p = &v->pairs[task];
    sf_two_view_options o = sf_two_view_options_default();
    sf_two_view found;
    double *a = v->scratch + (size_t)thread * SCRATCH * v->most, *b = a + 2 * v->most,
           *rest = b + 2 * v->most;
    uint8_t *inliers = (uint8_t *)(rest + SF_TWO_VIEW_SCRATCH * v->most);
    int was_known = are_known(v, p);
    if (!v->with_lenses && was_known) return; /* in the second stage */
    if (!p->count || (v->with_lenses && !was_known && p->geometry.kind == SF_PAIR_NONE)) return;
    make_rays(v, p, 0, v->with_lenses, a);
    make_rays(v, p, 1, v->with_lenses, b);
    double focal = (v->cameras[v->pictures[p->first].camera].lens.fx +
                    v->cameras[v->pictures[p->second].camera].lens.fx) /
                   2;
    o.known = v->with_lenses, o.threshold = v->o->error_px / focal, o.least_count = v->o->least_count;
    o.seed = v->o->seed + task;
    sf_two_view_find(&o, a, b, p->count, rest, inliers, &found);
    /* A focal length that is wrong loses matches that the fundamental matrix has confirmed: they stay,
     * without a pose. */
    if (v->with_lenses && !was_known && 2 * found.count < p->count) {
        p->geometry.has_pose = 0;
        return;
    }
    p->geometry = found;
    if (found.kind == SF_PAIR_NONE)
        p->count = 0;
    else
        keep_inliers(p, inliers);
}

/* The focal length of a camera of which nothing is known. */
static void vote(const verifier *v, size_t camera, sf_focal_pair *pairs) {
    sf_map_camera *c = &v->cameras[camera];
    size_t count = 0;
    for (size_t i = 0; i < v->pair_count; i++) {
        const sf_matched_pair *p = &v->pairs[i];
        if (p->geometry.kind != SF_PAIR_GENERAL || !p->count) continue;
        if (v->pictures[p->first].camera != camera || v->pictures[p->second].camera != camera) continue;
        memcpy(pairs[count].F, p->geometry.F, sizeof p->geometry.F);
        pairs[count++].weight = (double)p->count;
    }
    double factor = sf_focal_vote(pairs, count, FOCAL_LEAST, FOCAL_MOST, 1, NULL);
    c->lens.fx *= factor, c->lens.fy *= factor;
}

static void verify(verifier *v, sf_focal_pair *votes) {
    sf_pool_run(v->ctx->pool, v->pair_count, verify_task, v);
    for (size_t i = 0; i < v->camera_count; i++)
        if (!is_known(&v->cameras[i])) vote(v, i, votes);
    v->with_lenses = 1;
    sf_pool_run(v->ctx->pool, v->pair_count, verify_task, v);
}

sf_status sf_verify_pairs(sf_context *ctx, const sf_verify_options *options, const sf_map_picture *pictures,
                          sf_map_camera *cameras, size_t camera_count, sf_matched_pair *pairs,
                          size_t pair_count) {
    verifier v = {.ctx = ctx,
                  .o = options,
                  .pictures = pictures,
                  .cameras = cameras,
                  .camera_count = camera_count,
                  .pairs = pairs,
                  .pair_count = pair_count};
    for (size_t i = 0; i < pair_count; i++)
        if (pairs[i].count > v.most) v.most = pairs[i].count;
    size_t threads = (size_t)sf_pool_threads(ctx->pool);
    sf_focal_pair *votes = sf_alloc(ctx, pair_count + 1, sizeof *votes);
    v.scratch = sf_alloc(ctx, threads * SCRATCH * v.most + 1, sizeof *v.scratch);
    int ready = votes && v.scratch;
    for (size_t i = 0; ready && i < pair_count; i++) memset(&pairs[i].geometry, 0, sizeof pairs[i].geometry);
    if (ready) verify(&v, votes);
    sf_free(ctx, votes);
    sf_free(ctx, v.scratch);
    return ready ? SF_OK : SF_ERR_MEMORY;
}
