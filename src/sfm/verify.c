/* verify.c - see verify.h. Pairs are tasks, each with its thread's scratch. */
#include "verify.h"

#include <math.h>
#include <string.h>

#include "../base/pool.h"
#include "focal.h"

/* Doubles of scratch a match: rays of both pictures, the search's, flags. */
enum { RAYS = 4, FLAGS = 1, SCRATCH = RAYS + SF_TWO_VIEW_SCRATCH + FLAGS };

/* Pairs of a camera's pictures that are asked for its focal length; and the share of them whose matches an
 * essential matrix of it must explain, for the others to be searched for that alone. */
enum { VOTERS_MOST = 800 };
#define TRUSTED 0.9

/* The search for a focal length: from and to, in longer sides of the picture; what is likely. */
#define FOCAL_LEAST 0.3
#define FOCAL_MOST  6
#define FOCAL_GUESS 1.2
/* A vote is vague where one for a focal length so many times as long costs hardly more: 0.03 to 0.06 for the
 * studio through a long lens (18 to 35 degrees), 0.15 and more through others, and for the fox. */
#define LONGER 1.6
#define VAGUE  0.1

typedef struct verifier {
    sf_context *ctx;
    const sf_verify_options *o;
    const sf_map_picture *pictures;
    sf_map_camera *cameras;
    size_t camera_count;
    sf_matched_pair *pairs;
    size_t pair_count, most; /* matches of a pair */
    double *scratch;         /* [threads][SCRATCH most] */
    uint8_t *is_later;       /* [pairs]: not asked for the focal length, and looked at when it is known */
    int with_lenses;         /* the stage: lenses are known, */
    int later, trusts;       /* for which pairs; those later ones are searched with lenses alone */
} verifier;

sf_verify_options sf_verify_options_default(void) {
    return (sf_verify_options){.error_px = 4, .least_count = 15, .seed = 1};
}

static int is_known(const sf_map_camera *camera) {
    return camera->is_fixed || (camera->focal_prior > 0 && !camera->is_doubtful);
}

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
    if (v->is_later[task] != v->later) return;
    int was_known = are_known(v, p) || (v->later && v->trusts);
    if (!v->with_lenses && was_known) return; /* in the second stage */
    if (!p->count || (v->with_lenses && !was_known && p->geometry.kind == SF_PAIR_NONE)) return;
    make_rays(v, p, 0, v->with_lenses, a);
    make_rays(v, p, 1, v->with_lenses, b);
    const sf_map_camera *first = &v->cameras[v->pictures[p->first].camera];
    const sf_map_camera *second = &v->cameras[v->pictures[p->second].camera];
    double unit = (sf_map_unit(first) + sf_map_unit(second)) / (first->lens.fx + second->lens.fx);
    o.known = v->with_lenses, o.threshold = v->o->error_px * unit, o.least_count = v->o->least_count;
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

/* Whether two pictures of a camera give a fundamental matrix, which votes for its focal length. */
static int is_voter(const verifier *v, size_t camera, const sf_matched_pair *p) {
    return p->geometry.kind == SF_PAIR_GENERAL && p->count && v->pictures[p->first].camera == camera &&
           v->pictures[p->second].camera == camera;
}

/* Matches that essential matrices of this focal length explain, in some of the camera's pairs. Half the
 * threshold: the whole one also takes what a wrong focal length has bent. */
static size_t count_explained(const verifier *v, size_t camera, size_t voters, double focal) {
    enum { PAIRS = 40 };
    sf_two_view_options o = sf_two_view_options_default();
    double *a = v->scratch, *b = a + 2 * v->most, *rest = b + 2 * v->most;
    uint8_t *inliers = (uint8_t *)(rest + SF_TWO_VIEW_SCRATCH * v->most);
    size_t seen = 0, explained = 0;
    sf_map_camera *c = &v->cameras[camera];
    const sf_lens kept = c->lens;
    c->lens.fx = c->lens.fy = focal;
    o.known = 1, o.threshold = v->o->error_px * sf_map_unit(c) / 2 / focal, o.seed = v->o->seed;
    for (size_t i = 0; i < v->pair_count; i++) {
        const sf_matched_pair *p = &v->pairs[i];
        sf_two_view found;
        if (!is_voter(v, camera, p) || seen++ % (voters / PAIRS + 1)) continue;
        make_rays(v, p, 0, 0, a);
        make_rays(v, p, 1, 0, b);
        sf_two_view_find(&o, a, b, p->count, rest, inliers, &found);
        explained += found.count;
    }
    c->lens = kept;
    return explained;
}

/* Whether pictures speak against the focal length that their files tell, as where they were cropped: they
 * clearly vote for another one, by which the matches are explained as well. What is seen from nearly one
 * side, or is nearly flat, votes for anything: but too short a focal length loses matches. */
static int is_overruled(const verifier *v, size_t camera, const sf_focal_pair *pairs, size_t count,
                        double factor) {
    const double near = 0.1, clearly = 0.05, as_well = 0.99, told = v->cameras[camera].lens.fx;
    if (fabs(log(factor)) < near ||
        sf_focal_cost(pairs, count, 1) < sf_focal_cost(pairs, count, factor) + clearly)
        return 0;
    return (double)count_explained(v, camera, count, factor * told) >=
           as_well * (double)count_explained(v, camera, count, told);
}

/* The focal length of a camera of which nothing is known, or only what its files tell. */
static void vote(const verifier *v, size_t camera, sf_focal_pair *pairs) {
    const double near = 0.05;
    sf_map_camera *c = &v->cameras[camera];
    double side = (c->width > c->height ? c->width : c->height) / c->lens.fx;
    size_t count = 0;
    for (size_t i = 0; i < v->pair_count; i++) {
        if (!is_voter(v, camera, &v->pairs[i])) continue;
        memcpy(pairs[count].F, v->pairs[i].geometry.F, sizeof pairs[count].F);
        pairs[count++].weight = (double)v->pairs[i].count;
    }
    double factor =
        sf_focal_vote(pairs, count, FOCAL_LEAST * side, FOCAL_MOST * side, FOCAL_GUESS * side, NULL);
    c->focal_voted = factor * c->lens.fx;
    if (c->is_doubtful && is_overruled(v, camera, pairs, count, factor))
        c->is_doubtful = 0, c->focal_prior = 0;
    else if (c->is_doubtful && fabs(log(factor)) > near)
        factor = 1;
    c->is_vague = !(c->focal_prior > 0) &&
                  sf_focal_cost(pairs, count, LONGER * factor) < sf_focal_cost(pairs, count, factor) + VAGUE;
    c->lens.fx *= factor, c->lens.fy *= factor;
}

/* Of a camera with many pairs some are asked for its focal length, evenly chosen. counts [cameras][2] */
static size_t choose_later(const verifier *v, size_t (*counts)[2]) {
    size_t later = 0;
    for (size_t i = 0; i < 2 * v->pair_count; i++) { /* first they are counted */
        const sf_matched_pair *p = &v->pairs[i % v->pair_count];
        uint32_t camera = v->pictures[p->first].camera;
        if (!p->count || are_known(v, p) || v->pictures[p->second].camera != camera) continue;
        size_t all = counts[camera][0];
        if (i < v->pair_count) {
            counts[camera][0]++;
        } else if (all > VOTERS_MOST) {
            size_t before = counts[camera][1]++ * VOTERS_MOST / all;
            later += v->is_later[i - v->pair_count] = counts[camera][1] * VOTERS_MOST / all == before;
        }
    }
    return later;
}

/* Whether the lenses explain nearly all pairs that fundamental matrices explain. */
static int are_trusted(const verifier *v) {
    size_t all = 0, explained = 0;
    for (size_t i = 0; i < v->pair_count; i++) {
        if (v->is_later[i] || !v->pairs[i].count) continue;
        all++;
        explained += v->pairs[i].geometry.has_pose != 0;
    }
    return (double)explained >= TRUSTED * (double)all;
}

static void run_stage(verifier *v, int with_lenses, int later) {
    v->with_lenses = with_lenses, v->later = later;
    sf_pool_run(v->ctx->pool, v->pair_count, verify_task, v);
}

static void verify(verifier *v, sf_focal_pair *votes, size_t (*counts)[2]) {
    size_t later = choose_later(v, counts);
    run_stage(v, 0, 0);
    for (size_t i = 0; i < v->camera_count; i++)
        if (!is_known(&v->cameras[i])) vote(v, i, votes);
    run_stage(v, 1, 0);
    if (!later) return;
    v->trusts = are_trusted(v);
    if (!v->trusts) run_stage(v, 0, 1);
    run_stage(v, 1, 1);
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
    size_t(*counts)[2] = sf_calloc(ctx, camera_count + 1, sizeof *counts);
    v.scratch = sf_alloc(ctx, threads * SCRATCH * v.most + 1, sizeof *v.scratch);
    v.is_later = sf_calloc(ctx, pair_count + 1, sizeof *v.is_later);
    int ready = votes && counts && v.scratch && v.is_later;
    for (size_t i = 0; ready && i < pair_count; i++) memset(&pairs[i].geometry, 0, sizeof pairs[i].geometry);
    if (ready) verify(&v, votes, counts);
    sf_free(ctx, votes);
    sf_free(ctx, counts);
    sf_free(ctx, v.is_later);
    sf_free(ctx, v.scratch);
    return ready ? SF_OK : SF_ERR_MEMORY;
}
