/* verify.c - see verify.h. */
#include "verify.h"

#include <math.h>
#include <stdatomic.h>
#include <string.h>

#include "../base/pool.h"
#include "../pose/lens.h"
#include "focal.h"
#include "two_view.h"

/* Range of focal lengths that are looked for, in guesses. */
#define LEAST_FOCAL 0.3
#define MOST_FOCAL  4.0
/* How well the vote of all pairs knows a focal length, as a part of it. */
#define FOCAL_SIGMA 0.3

sf_status sf_verify_match(sf_context *ctx, const sf_photo_list *list, sf_verified *v) {
    size_t n = list->count, at = 0;
    *v = (sf_verified){.count = n * (n - 1) / 2};
    v->pairs = sf_alloc(ctx, v->count + 1, sizeof *v->pairs);
    v->matches = sf_calloc(ctx, v->count + 1, sizeof *v->matches);
    sf_features *features = sf_alloc(ctx, n + 1, sizeof *features);
    sf_status status = v->pairs && v->matches && features ? SF_OK : SF_ERR_MEMORY;
    if (!status) {
        for (size_t i = 0; i < n; i++) features[i] = list->photos[i].features;
        for (uint32_t i = 0; i < n; i++)
            for (uint32_t j = i + 1; j < n; j++) v->pairs[at++] = (sf_photo_pair){i, j};
        sf_match_options options = sf_match_options_default();
        status = sf_match_all(ctx, features, v->pairs, v->count, &options, v->matches);
    }
    sf_free(ctx, features);
    if (status) sf_verified_free(ctx, v);
    return status;
}

/* One pass over the pairs. */
typedef struct verify_job {
    sf_context *ctx;
    const sf_photo_list *list;
    const uint32_t *camera_of;
    const sf_map_camera *cameras;
    double error;
    int known; /* through the lenses */
    sf_verified *v;
    sf_two_view *geometry; /* [pairs] */
    size_t *counts;        /* [pairs]: matches that agree, moved to the front */
    atomic_int out_of_memory;
} verify_job;

/* The coordinates of a feature: a ray, or px from the picture's middle over the guessed focal length. */
static int coordinates(const verify_job *job, uint32_t photo, uint32_t feature, double to[2]) {
    const sf_map_camera *camera = &job->cameras[job->camera_of[photo]];
    const sf_keypoint *point = &job->list->photos[photo].features.points[feature];
    double pixel[2] = {(double)point->x, (double)point->y};
    if (job->known) return sf_lens_ray(&camera->lens, pixel, to);
    to[0] = (pixel[0] - camera->lens.cx) / camera->lens.fx;
    to[1] = (pixel[1] - camera->lens.cy) / camera->lens.fx;
    return 1;
}

/* Moves the matches with a flag to the front. */
static size_t keep_marked(sf_match *matches, size_t count, const uint8_t *marked) {
    size_t kept = 0;
    for (size_t i = 0; i < count; i++) {
        if (!marked[i]) continue;
        sf_match keep = matches[i];
        matches[i] = matches[kept];
        matches[kept++] = keep;
    }
    return kept;
}

static void verify_task(void *job_pointer, size_t task, int thread) {
    verify_job *job = job_pointer;
    const sf_photo_pair *pair = &job->v->pairs[task];
    sf_match *matches = job->v->matches[task].items;
    size_t count = job->known ? job->counts[task] : job->v->matches[task].count, n = 0;
    sf_two_view_options options = sf_two_view_options_default();
    (void)thread;
    job->counts[task] = 0;
    if (count < options.least_count) return;
    double *a = sf_alloc(job->ctx, count, (4 + SF_TWO_VIEW_SCRATCH) * sizeof *a), *b = a + 2 * count;
    uint8_t *inliers = sf_alloc(job->ctx, count, 1);
    if (!a || !inliers) {
        atomic_store(&job->out_of_memory, 1);
    } else {
        for (; n < count; n++)
            if (!coordinates(job, pair->first, matches[n].a, a + 2 * n) ||
                !coordinates(job, pair->second, matches[n].b, b + 2 * n))
                a[2 * n] = a[2 * n + 1] = b[2 * n] = b[2 * n + 1] = 0;
        const sf_lens *first = &job->cameras[job->camera_of[pair->first]].lens,
                      *second = &job->cameras[job->camera_of[pair->second]].lens;
        options.known = job->known;
        options.threshold = job->error / fmin(first->fx, second->fx);
        sf_two_view_find(&options, a, b, count, b + 2 * count, inliers, &job->geometry[task]);
        if (job->geometry[task].kind != SF_PAIR_NONE)
            job->counts[task] = keep_marked(matches, count, inliers);
    }
    sf_free(job->ctx, inliers);
    sf_free(job->ctx, a);
}

/* The focal length of a camera from the pairs that it took alone. */
static sf_status vote(const verify_job *job, uint32_t camera, sf_map_camera *to) {
    size_t n = 0;
    double contrast;
    sf_focal_pair *pairs = sf_alloc(job->ctx, job->v->count + 1, sizeof *pairs);
    if (!pairs) return SF_ERR_MEMORY;
    for (size_t i = 0; i < job->v->count; i++) {
        const sf_photo_pair *pair = &job->v->pairs[i];
        if (!job->counts[i] || job->geometry[i].kind != SF_PAIR_GENERAL) continue;
        if (job->camera_of[pair->first] != camera || job->camera_of[pair->second] != camera) continue;
        memcpy(pairs[n].F, job->geometry[i].F, sizeof pairs[n].F);
        pairs[n++].weight = (double)job->counts[i];
    }
    double factor = sf_focal_vote(pairs, n, LEAST_FOCAL, MOST_FOCAL, 1, &contrast);
    to->lens.fx *= factor, to->lens.fy *= factor;
    sf_free(job->ctx, pairs);
    return SF_OK;
}

static sf_status run_pass(verify_job *job) {
    sf_pool_run(job->ctx->pool, job->v->count, verify_task, job);
    return atomic_load(&job->out_of_memory) ? SF_ERR_MEMORY : SF_OK;
}

static sf_status list_agreed(const verify_job *job) {
    sf_verified *v = job->v;
    v->agreed = sf_alloc(job->ctx, v->count + 1, sizeof *v->agreed);
    if (!v->agreed) return SF_ERR_MEMORY;
    for (size_t i = 0; i < v->count; i++) {
        if (!job->counts[i]) continue;
        v->agreed[v->agreed_count++] = (sf_verified_pair){.first = v->pairs[i].first,
                                                       .second = v->pairs[i].second,
                                                       .matches = &v->matches[i].items->a,
                                                       .count = job->counts[i],
                                                       .geometry = job->geometry[i]};
    }
    return SF_OK;
}

sf_status sf_verify_geometry(sf_context *ctx, const sf_photo_list *list, const uint32_t *camera_of,
                             double error, sf_map_camera *cameras, size_t camera_count, sf_verified *v) {
    verify_job job = {
        .ctx = ctx, .list = list, .camera_of = camera_of, .cameras = cameras, .error = error, .v = v};
    job.geometry = sf_calloc(ctx, v->count + 1, sizeof *job.geometry);
    job.counts = sf_calloc(ctx, v->count + 1, sizeof *job.counts);
    sf_status status = job.geometry && job.counts ? run_pass(&job) : SF_ERR_MEMORY;
    for (uint32_t c = 0; c < camera_count && !status; c++)
        if (!cameras[c].is_fixed && !(cameras[c].focal_prior > 0)) status = vote(&job, c, &cameras[c]);
    job.known = 1;
    if (!status) status = run_pass(&job);
    if (!status) status = list_agreed(&job);
    sf_free(ctx, job.counts);
    sf_free(ctx, job.geometry);
    return status;
}

void sf_verified_free(sf_context *ctx, sf_verified *v) {
    for (size_t i = 0; v->matches && i < v->count; i++) sf_matches_free(ctx, &v->matches[i]);
    sf_free(ctx, v->matches);
    sf_free(ctx, v->pairs);
    sf_free(ctx, v->agreed);
    *v = (sf_verified){0};
}
