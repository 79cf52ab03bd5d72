/* reconstruct.c - cameras from photos: features, matches, the geometry of pairs, the map (README.md). */
#include <stdio.h>
#include <string.h>

#include "../base/clock.h"
#include "mask_folder.h"
#include "pairs.h"
#include "photo_cameras.h"
#include "reasons.h"
#include "reconstruction.h"
#include "repetition.h"
#include "verify.h"
#include "view_graph.h"

sf_sfm_options sf_sfm_options_default(void) {
    return (sf_sfm_options){.side = 1600, .features = 2048, .all_pairs = 200, .error = 4};
}

/* What the stages need beside the reconstruction. */
typedef struct run {
    sf_context *ctx;
    const sf_sfm_options *options;
    sf_reconstruction *r;
    sf_features *features;     /* [photos]: those of the list */
    sf_photo_pair *pairs;      /* [pair_count] */
    sf_matches *matches;       /* [pair_count], of features */
    sf_matched_pair *verified; /* [pair_count]; without matches where there is no geometry */
    size_t pair_count;
    sf_matched_pair
        *in_order; /* [in_order_count]: those of the verified whose photos follow one another by name */
    size_t in_order_count;
    int64_t began; /* sf_clock_ns of the stage */
} run;

static sf_status check_options(sf_context *ctx, const sf_sfm_options *o) {
    if (o->side < 64 || o->side > SF_FEATURES_SIDE)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "side: %d is not in 64..%d", o->side, SF_FEATURES_SIDE);
    if (o->features < 100 || o->features > 1000000)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "features: %d is not in 100..1000000", o->features);
    if (o->all_pairs < 0 || o->all_pairs > 1000000)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "all_pairs: %d is not in 0..1000000", o->all_pairs);
    if (o->sequence < 0 || o->sequence > 1000000)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "sequence: %d is not in 0..1000000", o->sequence);
    if (o->memory < 0) return sf_fail(ctx, SF_ERR_ARGUMENT, "memory: %lld is below 0", (long long)o->memory);
    if (!(o->error > 0 && o->error < 1e4))
        return sf_fail(ctx, SF_ERR_ARGUMENT, "error: %g px is not above 0", o->error);
    if (!(o->focal >= 0 && o->focal < 1e6))
        return sf_fail(ctx, SF_ERR_ARGUMENT, "focal: %g px is not 0 or more", o->focal);
    if (o->lens && !(o->lens->fx > 0 && o->lens->fy > 0))
        return sf_fail(ctx, SF_ERR_ARGUMENT, "lens: fx, fy: %g, %g px are not above 0", o->lens->fx,
                       o->lens->fy);
    return SF_OK;
}

static int tell(const run *work, sf_sfm_stage stage, size_t done, size_t all) {
    return work->options->progress && work->options->progress(work->options->user, stage, done, all);
}

static void end_stage(run *work, sf_sfm_stage stage) {
    int64_t now = sf_clock_ns();
    work->r->seconds[stage] = 1e-9 * (double)(now - work->began);
    work->began = now;
}

static int features_done(void *user, size_t photos) {
    const run *work = user;
    return tell(work, SF_SFM_FEATURES, photos, work->r->list.count);
}

static int photo_placed(void *user, size_t placed, size_t photos) {
    return tell(user, SF_SFM_MAPPING, placed, photos);
}

static sf_status make_pictures(sf_reconstruction *r) {
    r->pictures = sf_calloc(r->ctx, r->list.count + 1, sizeof *r->pictures);
    if (!r->pictures) return SF_ERR_MEMORY;
    for (size_t i = 0; i < r->list.count; i++) {
        const sf_features *f = &r->list.photos[i].features;
        double *keypoints = sf_alloc(r->ctx, f->count + 1, 2 * sizeof *keypoints);
        if (!keypoints) return SF_ERR_MEMORY;
        for (size_t k = 0; k < f->count; k++)
            sf_photo_turn(r, i, (double)f->points[k].x, (double)f->points[k].y, keypoints + 2 * k);
        r->pictures[i] = (sf_map_picture){.keypoints = keypoints,
                                          .count = f->count,
                                          .camera = r->camera_of[i],
                                          .is_left_out = *r->list.photos[i].fault != 0};
    }
    return SF_OK;
}

/* Nothing to tell, but a moment to cancel in. */
static int photos_compared(void *user, size_t photos) {
    (void)photos;
    return tell(user, SF_SFM_MATCHES, 0, 0);
}

static sf_status choose_pairs(run *work) {
    sf_pair_options options = sf_pair_options_default();
    size_t n = work->r->list.count;
    options.all = (size_t)work->options->all_pairs;
    options.sequence = (size_t)work->options->sequence;
    options.done = photos_compared, options.user = work;
    work->features = sf_alloc(work->ctx, n + 1, sizeof *work->features);
    if (!work->features) return SF_ERR_MEMORY;
    for (size_t i = 0; i < n; i++) work->features[i] = work->r->list.photos[i].features;
    sf_status status =
        sf_pairs_choose(work->ctx, work->features, n, &options, &work->pairs, &work->pair_count);
    if (status) return status;
    work->matches = sf_calloc(work->ctx, work->pair_count + 1, sizeof *work->matches);
    work->verified = sf_calloc(work->ctx, work->pair_count + 1, sizeof *work->verified);
    work->in_order = sf_calloc(work->ctx, n + 1, sizeof *work->in_order);
    return work->matches && work->verified && work->in_order ? SF_OK : SF_ERR_MEMORY;
}

/* So many pairs at a time, of which those with too few matches are left without any. */
static sf_status match_pairs(run *work) {
    enum { CHUNK = 256 };
    sf_match_options options = sf_match_options_default();
    size_t least = sf_verify_options_default().least_count;
    for (size_t first = 0; first < work->pair_count; first += CHUNK) {
        size_t left = work->pair_count - first, count = left < CHUNK ? left : CHUNK;
        sf_matches *matches = work->matches + first;
        sf_status status =
            sf_match_all(work->ctx, work->features, work->pairs + first, count, &options, matches);
        if (status) return status;
        for (size_t i = 0; i < count; i++)
            if (matches[i].count < least) sf_matches_free(work->ctx, &matches[i]);
        if (tell(work, SF_SFM_MATCHES, first + count, work->pair_count)) return SF_ERR_CANCELLED;
    }
    return SF_OK;
}

/* Before pairs that contradict stronger ones are dropped: where things look the same, pairs of photos far
 * apart may be the stronger ones. */
static void keep_in_order(run *work) {
    for (size_t i = 0; i < work->pair_count; i++)
        if (work->verified[i].count && work->verified[i].second == work->verified[i].first + 1)
            work->in_order[work->in_order_count++] = work->verified[i];
}

static sf_status verify_pairs(run *work, size_t *verified) {
    sf_reconstruction *r = work->r;
    sf_verify_options options = sf_verify_options_default();
    options.error_px = work->options->error;
    for (size_t i = 0; i < work->pair_count; i++)
        work->verified[i] =
            (sf_matched_pair){.first = work->pairs[i].first,
                              .second = work->pairs[i].second,
                              .matches = work->matches[i].count ? &work->matches[i].items->a : NULL,
                              .count = work->matches[i].count};
    sf_status status = sf_verify_pairs(r->ctx, &options, r->pictures, r->cameras, r->camera_count,
                                       work->verified, work->pair_count);
    size_t dropped;
    if (!status) keep_in_order(work);
    if (!status)
        status = sf_view_graph_filter(r->ctx, r->list.count, work->verified, work->pair_count, &dropped);
    *verified = 0;
    for (size_t i = 0; i < work->pair_count; i++)
        if (work->verified[i].count) work->verified[(*verified)++] = work->verified[i];
    work->pair_count = *verified;
    return status;
}

static sf_status map_photos(run *work) {
    sf_reconstruction *r = work->r;
    sf_map_input input = {.cameras = r->cameras,
                          .camera_count = r->camera_count,
                          .pictures = r->pictures,
                          .picture_count = r->list.count,
                          .pairs = work->verified,
                          .pair_count = work->pair_count};
    sf_map_options options = sf_map_options_default();
    options.error_px = work->options->error;
    const sf_order order = {work->in_order, work->in_order_count, work->options->sequence > 0};
    sf_status status = sf_map_photos(r->ctx, &input, &order, &options, photo_placed, work, &r->map);
    return status == SF_ERR_EMPTY && sf_photos_why_none(r, work->verified, work->pair_count) ? SF_ERR_EMPTY
                                                                                             : status;
}

static void free_run(run *work, size_t pairs) {
    for (size_t i = 0; work->matches && i < pairs; i++) sf_matches_free(work->ctx, &work->matches[i]);
    sf_free(work->ctx, work->matches);
    sf_free(work->ctx, work->features);
    sf_free(work->ctx, work->pairs);
    sf_free(work->ctx, work->verified);
    sf_free(work->ctx, work->in_order);
}

/* Puts the folder before what a stage says of its photos. */
static sf_status named(sf_context *ctx, const char *folder, sf_status status) {
    char why[512];
    if (status != SF_ERR_EMPTY) return status;
    snprintf(why, sizeof why, "%s", sf_last_error(ctx));
    return sf_fail(ctx, status, "%s: %s", folder, why);
}

static sf_status run_stages(run *work, const char *folder) {
    sf_reconstruction *r = work->r;
    sf_features_options features = sf_features_options_default();
    features.most = (size_t)work->options->features;
    sf_status status = sf_photos_list(r->ctx, folder, &r->list);
    if (!status && r->list.count < 2)
        status = sf_fail(r->ctx, SF_ERR_EMPTY,
                         "%s: one photo alone shows no depth: add more of the same place", folder);
    if (!status && !work->options->no_masks)
        status = sf_photo_masks_find(r->ctx, folder, work->options->masks, &r->list);
    if (!status)
        status = sf_photos_check_memory(r->ctx, folder, work->options->side, &features,
                                        (uint64_t)work->options->memory, &r->list);
    if (!status)
        status = sf_photos_find_features(r->ctx, folder, work->options->side, &features, features_done, work,
                                         &r->list);
    end_stage(work, SF_SFM_FEATURES);
    if (!status) status = named(r->ctx, folder, sf_photo_cameras(r, folder, work->options));
    if (!status) status = make_pictures(r);
    if (!status) status = choose_pairs(work);
    size_t pairs = work->pair_count, verified = 0;
    if (!status) status = match_pairs(work);
    end_stage(work, SF_SFM_MATCHES);
    if (!status) status = verify_pairs(work, &verified);
    end_stage(work, SF_SFM_GEOMETRY);
    if (!status && tell(work, SF_SFM_GEOMETRY, verified, pairs)) status = SF_ERR_CANCELLED;
    if (!status) status = named(r->ctx, folder, map_photos(work));
    end_stage(work, SF_SFM_MAPPING);
    free_run(work, pairs);
    return status;
}

sf_status sf_sfm_run(sf_context *ctx, const char *folder, const sf_sfm_options *options,
                     sf_reconstruction **reconstruction) {
    sf_sfm_options o = options ? *options : sf_sfm_options_default();
    *reconstruction = NULL;
    sf_status status = check_options(ctx, &o);
    if (status) return status;
    sf_reconstruction *r = sf_calloc(ctx, 1, sizeof *r);
    if (!r) return SF_ERR_MEMORY;
    r->ctx = ctx;
    run work = {.ctx = ctx, .options = &o, .r = r, .began = sf_clock_ns()};
    status = run_stages(&work, folder);
    if (status)
        sf_reconstruction_destroy(&r);
    else
        *reconstruction = r;
    return status;
}

void sf_reconstruction_destroy(sf_reconstruction **reconstruction) {
    sf_reconstruction *r = *reconstruction;
    if (!r) return;
    sf_map_destroy(&r->map);
    for (size_t i = 0; r->pictures && i < r->list.count; i++)
        sf_free(r->ctx, (void *)(uintptr_t)r->pictures[i].keypoints);
    sf_free(r->ctx, r->pictures);
    sf_free(r->ctx, r->cameras);
    sf_free(r->ctx, r->camera_of);
    sf_free(r->ctx, r->is_turned);
    sf_photos_free(r->ctx, &r->list);
    sf_free(r->ctx, r);
    *reconstruction = NULL;
}
