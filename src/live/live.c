/* live.c - the loop of a live fit: a frame that is due, else a step. */
#include "live.h"

#include <math.h>
#include <string.h>

#include "../base/clock.h"
#include "../fit/online.h"
#include "../io/cameras_json.h"
#include "guidance.h"
#include "loop_closure.h"
#include "place_recognition.h"
#include "throttling.h"

enum {
    IDLE_MS = 20,
    FIRST_MS = 100,
    MISSES_MOST = 30 /* of a first map from pictures, until it is given up, where no fit began with it */
};

#define TRACK_MEMORY  0.1 /* part of a frame in the mean time of a look */
#define FIT_SHARE     0.5 /* of the time of a look: so long the fit goes on before the next one, at least */
#define PLANNED       300 /* s, of a run without an end */
#define PLANNED_STEPS 10000

/* Thermal throttling is checked every CHECK_EVERY seconds. `duty`, the part of its time that the fit works,
 * is multiplied by COOLER while the processor is throttled, to no less than LEAST_DUTY, and by WARMER
 * otherwise. */
#define CHECK_EVERY 2.0
#define COOLER      0.7
#define WARMER      1.15
#define LEAST_DUTY  0.1

sf_live_options sf_live_options_default(void) {
    sf_live_options o = {.fit = sf_fit_options_default(),
                         .from_pictures = 1,
                         .downscale = 1,
                         .track_rate = 12,
                         .keyframes_most = 300,
                         .hold_out = 8,
                         .keyframe_gap = 0.07,
                         .thermal = "/sys"};
    o.fit.steps = 0;
    o.fit.validate = 0;
    o.fit.size = SF_SIZE_CAP;
    o.fit.max_gaussians = 40000;
    o.fit.exposure = 1;
    o.fit.refine_start = 0;
    o.fit.lr_pose = 2e-4;
    o.fit.init = SF_INIT_SWEEP;
    o.fit.init_random = 1000;
    o.fit.pyramid_levels = 1;  /* what comes late has no time to begin coarsely, */
    o.fit.pyramid_end = 0.001; /* and the model is looked at from the start */
    o.fit.densify_every = 20;  /* many new Gaussians at once are seen, and tracked against */
    o.fit.blur = 0;            /* such frames are no keyframes */
    o.fit.max_scale = 0.2;     /* what is split close to a keyframe would be seen */
    o.fit.densify_end = 0.9;
    o.fit.cool_down = 0.9;
    o.fit.ema_steps = 30;     /* who looks, tracks or saves on the way sees no single step */
    o.fit.huber_delta = 1e-9; /* L1: what moves, and what tracking is off by, is not to be fitted first */
    return o;
}

static sf_status check(sf_context *ctx, const sf_live_options *o) {
    if (!(o->track_rate >= 0.1 && o->track_rate <= 1000))
        return sf_fail(ctx, SF_ERR_ARGUMENT, "track_rate: %g is not in 0.1..1000", o->track_rate);
    if (o->downscale < 1 || o->downscale > 16)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "downscale: %d is not in 1..16", o->downscale);
    if (o->keyframes_most < 8 || o->keyframes_most > 100000)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "keyframes_most: %lld is not in 8..100000",
                       (long long)o->keyframes_most);
    if (o->hold_out < 0 || o->hold_out == 1)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "hold_out: %d is neither 0 nor above 1", o->hold_out);
    if (o->steps_per_frame < 0)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "steps_per_frame: %d is below 0", o->steps_per_frame);
    if (!(o->keyframe_gap >= 0.001 && o->keyframe_gap <= 1))
        return sf_fail(ctx, SF_ERR_ARGUMENT, "keyframe_gap: %g is not in 0.001..1", o->keyframe_gap);
    if (o->scale != 0 && !(o->scale >= 1e-9 && o->scale <= 1e9))
        return sf_fail(ctx, SF_ERR_ARGUMENT, "scale: %g is neither 0 nor in 1e-9..1e9", o->scale);
    if (o->find_lens && o->lens.fx > 0) return sf_fail(ctx, SF_ERR_ARGUMENT, "find_lens: there is a lens");
    if (!o->board && !o->pose && !o->own_poses && !o->from_pictures)
        return sf_fail(ctx, SF_ERR_ARGUMENT,
                       "poses: neither a start from pictures nor a board nor poses from outside are given");
    return SF_OK;
}

/* A run without an end is planned as one of a usual length, and stays short of its end. */
static void plan(sf_live *live, const sf_source *source) {
    sf_fit_options *fit = &live->options.fit;
    int per_frame = live->options.steps_per_frame;
    sf_source_info info;
    sf_source_describe(source, &info);
    if (per_frame > 0) {
        fit->time_limit = 0;
        if (!fit->steps) fit->steps = info.frames ? (int64_t)info.frames * per_frame : 0;
        fit->open_end = !fit->steps;
        if (!fit->steps) fit->steps = PLANNED_STEPS;
        live->options.track_rate = INFINITY;
    } else if (!(fit->time_limit > 0)) {
        fit->time_limit = PLANNED, fit->open_end = 1;
    }
}

sf_status sf_live_create(sf_context *ctx, sf_source *source, const sf_live_options *options, sf_live **out) {
    *out = NULL;
    sf_status status = check(ctx, options);
    if (status) return status;
    sf_live *live = sf_calloc(ctx, 1, sizeof *live);
    if (!live) return SF_ERR_MEMORY;
    live->ctx = ctx;
    live->options = *options;
    live->start.ctx = live->lens.ctx = ctx;
    live->pace.duty = 1;
    live->evaluation = (sf_evaluation){.ctx = ctx, .exposes = live->options.fit.exposure};
    sf_guidance_init(&live->guidance, ctx);
    plan(live, source);
    atomic_init(&live->cancelled, 0);
    status = sf_online_check(ctx, &live->options.fit);
    if (!status) status = sf_scene_create(ctx, &live->scene);
    if (!status) status = sf_tracker_create(ctx, &live->localizer.tracker);
    if (!status) status = sf_landmarks_create(ctx, &live->localizer.landmarks);
    if (!status) status = sf_renderer_create(ctx, &live->evaluation.renderer);
    if (!status) status = sf_spawner_create(ctx, &live->spawning.spawner);
    if (!status && options->board)
        status = sf_detector_create(ctx, options->board, 1, &live->localizer.detector);
    if (!status)
        status = sf_frame_grabber_create(ctx, source, &options->lens, options->find_lens, options->downscale,
                                         options->track_rate, &live->grabber);
    *out = live;
    if (status) sf_live_destroy(out);
    return status;
}

void sf_live_destroy(sf_live **live_pointer) {
    sf_live *live = *live_pointer;
    if (!live) return;
    sf_frame_grabber_destroy(&live->grabber);
    sf_spawner_destroy(&live->spawning.spawner);
    sf_fitter_destroy(&live->fitter);
    sf_detector_destroy(&live->localizer.detector);
    sf_tracker_destroy(&live->localizer.tracker);
    sf_landmarks_destroy(&live->localizer.landmarks);
    sf_renderer_destroy(&live->evaluation.renderer);
    sf_scene_destroy(&live->scene);
    sf_start_free(&live->start);
    sf_found_lens_free(&live->lens);
    sf_places_free(live->ctx, &live->keyframes);
    sf_place_free(live->ctx, &live->input.place);
    sf_guidance_free(&live->guidance);
    sf_free(live->ctx, live->keyframes.list);
    sf_free(live->ctx, live->input.bytes);
    sf_free(live->ctx, live);
    *live_pointer = NULL;
}

void sf_live_cancel(sf_live *live) { atomic_store(&live->cancelled, 1); }
void sf_live_pause(sf_live *live, int paused) { live->paused = paused; }
void sf_live_lock_exposure(sf_live *live, int locked) { sf_frame_grabber_lock(live->grabber, locked); }

void sf_live_reset(sf_live *live) {
    sf_spawned_points points;
    sf_spawner_wait(live->spawning.spawner);
    if (sf_spawner_take(live->spawning.spawner, &points))
        sf_spawned_points_free(live->spawning.spawner, &points);
    sf_fitter_destroy(&live->fitter);
    for (size_t i = 0; i < live->keyframes.count; i++)
        (void)sf_scene_remove_view(live->scene, live->keyframes.list[i].id);
    sf_landmarks_clear(live->localizer.landmarks);
    sf_places_free(live->ctx, &live->keyframes);
    live->keyframes.count = 0;
    live->keyframes.made = 0;
    live->loop = (sf_loop){.is_seen = 0};
    live->spawning.spawned = 0;
    sf_start_clear(&live->start);
    sf_found_lens_forget(&live->lens);
    sf_guidance_clear(&live->guidance);
    sf_live_forget_pose(live);
}

/* Room for the picture's bytes: colours, and a mask or grey. */
static sf_status note_frame(sf_live *live) {
    const sf_camera *c = &live->input.picture->camera;
    double now = sf_clock();
    if (!(live->pace.first_frame > 0)) live->pace.first_frame = now;
    live->pace.next_frame = fmax(live->pace.next_frame + 1 / live->options.track_rate, now);
    return sf_grow(live->ctx, &live->input.bytes, &live->input.byte_capacity, 0,
                   4 * (size_t)c->width * (size_t)c->height, 1);
}

/* The frame's pose; and whether it becomes a keyframe. */
static sf_status handle_frame(sf_live *live, int *taken) {
    *taken = 0;
    sf_status status = sf_live_localize(live);
    if (!status && !live->paused) status = sf_live_join_lost(live);
    if (!status && !live->paused) status = sf_live_offer_keyframe(live, taken);
    return status;
}

/* A frame of the first map again, now with its pose; after the last one the fit begins. */
static sf_status handle_again(sf_live *live) {
    const sf_picture *picture;
    sf_rigid pose;
    int taken;
    sf_status status = sf_start_next(&live->start, &picture, &live->input.number, &pose);
    if (status || !picture) return status ? status : sf_live_begin(live);
    for (int k = 0; k < 3; k++) pose.t[k] *= live->localizer.distance;
    status = sf_found_lens_correct(&live->lens, picture, &live->input.picture);
    live->input.first_pose = &pose;
    if (!status) status = handle_frame(live, &taken);
    live->input.first_pose = NULL;
    return status;
}

static sf_status look_at_frame(sf_live *live) {
    double began = sf_clock();
    int taken = 0;
    sf_status status = note_frame(live);
    if (!status) status = handle_frame(live, &taken);
    if (!status && !live->fitter && taken) status = sf_live_begin(live);
    if (!status && live->localizer.has_own_world && !live->fitter && live->localizer.misses > MISSES_MOST)
        sf_live_reset(live);
    if (!status && taken) status = sf_live_ask_for_points(live);
    if (!status) sf_live_advise(live);
    live->pace.steps_due = live->options.steps_per_frame;
    double ended = sf_clock(), took = ended - began;
    /* Where a look takes longer than from one frame to the next, the fit would have no time at all. */
    if (live->fitter && !live->paused)
        live->pace.next_frame = fmax(live->pace.next_frame, ended + FIT_SHARE * took);
    live->pace.track_seconds +=
        (live->localizer.looked_at > 1 ? TRACK_MEMORY : 1) * (took - live->pace.track_seconds);
    return status;
}

static sf_status take_frame(sf_live *live, int timeout_ms, int *looked) {
    const sf_picture *picture;
    sf_status status = sf_frame_grabber_take(live->grabber, timeout_ms, &picture);
    *looked = !status;
    if (!status) status = sf_found_lens_correct(&live->lens, picture, &live->input.picture);
    if (status == SF_ERR_END) live->source_ended = 1;
    if (status == SF_ERR_TIMEOUT || status == SF_ERR_END) return SF_OK;
    return status ? status : look_at_frame(live);
}

/* What is repeated to the byte does not depend on the weather. */
static void check_throttling(sf_live *live, double now) {
    char what[128] = "";
    if (!live->options.thermal || live->options.steps_per_frame > 0 || now < live->pace.next_check) return;
    int hot = sf_is_throttled(live->options.thermal, what, sizeof what), worked_fully = live->pace.duty >= 1;
    live->pace.next_check = now + CHECK_EVERY;
    live->pace.duty = hot ? fmax(live->pace.duty * COOLER, LEAST_DUTY) : fmin(live->pace.duty * WARMER, 1);
    if (hot && worked_fully)
        sf_log(live->ctx, SF_LOG_WARNING, "hot: %s: the fit rests for a part of the time", what);
    if (!worked_fully && live->pace.duty >= 1)
        sf_log(live->ctx, SF_LOG_INFO, "cool again: the fit rests no more");
}

static sf_status step_fit(sf_live *live) {
    double began = sf_clock();
    check_throttling(live, began);
    sf_status status = sf_live_take_points(live);
    if (!status) status = sf_live_ask_for_points(live); /* for one that came while the thread was busy */
    if (!status) status = sf_evaluate_next(&live->evaluation, &live->keyframes, live->scene, live->fitter);
    if (!status) status = sf_live_look_around(live);
    if (!status) status = sf_fitter_step(live->fitter);
    if (!status) sf_tell_fit(&live->keyframes, live->fitter);
    double now = sf_clock();
    live->pace.rest_until = now + (now - began) * (1 / live->pace.duty - 1);
    return status;
}

/* Whether it is a frame's turn, if there is one. */
static int frame_is_due(sf_live *live, int fits) {
    if (live->source_ended) return 0;
    if (live->options.steps_per_frame > 0) return !fits || live->pace.steps_due <= 0;
    return sf_clock() >= live->pace.next_frame && (!fits || sf_frame_grabber_waits(live->grabber));
}

static int is_over(const sf_live *live) {
    if (live->source_ended && (!live->fitter || live->options.fit.open_end)) return 1;
    return live->pace.first_frame > 0 && live->options.fit.time_limit > 0 && !live->options.fit.open_end &&
           sf_clock() - live->pace.first_frame >= live->options.fit.time_limit;
}

/* How long a frame is waited for while nothing is fitted. */
static int idle_ms(const sf_live *live) {
    if (!(live->pace.first_frame > 0)) return FIRST_MS;
    double rest = live->fitter && !live->paused ? 1e3 * (live->pace.rest_until - sf_clock()) : IDLE_MS;
    return (int)fmin(fmax(rest, 1), IDLE_MS);
}

static sf_status advance(sf_live *live) {
    int looked = 0, fits = live->fitter && !live->paused && sf_clock() >= live->pace.rest_until;
    if (atomic_load(&live->cancelled)) return SF_ERR_CANCELLED;
    if (is_over(live)) return SF_ERR_END;
    if (sf_start_is_ready(&live->start)) return handle_again(live);
    int due = frame_is_due(live, fits);
    if (due) {
        sf_status status = take_frame(live, fits ? IDLE_MS : idle_ms(live), &looked);
        int must = live->options.steps_per_frame > 0 && !live->source_ended;
        if (status || looked || must) return status;
    }
    if (!fits) {
        if (!due) sf_sleep(1e-3 * idle_ms(live)); /* paused or resting, and no frame is due */
        return SF_OK;
    }
    live->pace.steps_due--;
    return step_fit(live);
}

/* What was held out is looked at a last time, all of it: figures of one model. */
static sf_status finish(sf_live *live) {
    sf_status status = SF_OK;
    if (live->fitter && !live->finished)
        status = sf_evaluate_all(&live->evaluation, &live->keyframes, live->scene, live->fitter);
    live->finished = !status;
    return status ? status : SF_ERR_END;
}

sf_status sf_live_step(sf_live *live) {
    sf_status status = advance(live);
    return status == SF_ERR_END ? finish(live) : status;
}

static void count_quality(const sf_live *live, sf_live_progress *p) {
    double sum = 0, corrected = 0, n = 0;
    for (size_t i = 0; i < live->keyframes.count; i++) {
        const sf_keyframe *k = &live->keyframes.list[i];
        p->held_out += k->held_out != 0;
        if (!k->held_out || isnan(k->psnr)) continue;
        sum += k->psnr, corrected += k->psnr_corrected, n++;
    }
    p->held_out_psnr = n > 0 ? sum / n : NAN;
    p->held_out_psnr_corrected = n > 0 ? corrected / n : NAN;
    p->first_psnr = live->keyframes.count ? live->keyframes.list[0].psnr_corrected : NAN;
}

static sf_live_trouble trouble_of(const sf_live *live) {
    int ended = live->source_ended || sf_frame_grabber_waits(live->grabber);
    return !ended && sf_frame_grabber_silent(live->grabber) >= SF_FRAME_SILENCE ? SF_LIVE_SILENT
                                                                                : live->quality.trouble;
}

void sf_live_get_progress(const sf_live *live, sf_live_progress *p) {
    double now = sf_clock();
    uint64_t came;
    *p = (sf_live_progress){.state = live->localizer.state,
                            .trouble = trouble_of(live),
                            .advice = live->guidance.adviser.shown,
                            .paused = live->paused,
                            .own_world = live->localizer.has_own_world,
                            .focal_length = live->input.picture ? live->input.picture->camera.fx : 0,
                            .exposure_locked = sf_frame_grabber_locked(live->grabber),
                            .seconds = live->pace.first_frame > 0 ? now - live->pace.first_frame : 0,
                            .tracked = live->localizer.tracked,
                            .looked_at = live->localizer.looked_at,
                            .lost = live->localizer.lost,
                            .track_rate = sf_tick_rate(&live->localizer.poses_found, now),
                            .track_ms = 1e3 * live->pace.track_seconds,
                            .duty = live->pace.duty,
                            .keyframes = live->keyframes.count,
                            .spawned = live->spawning.spawned,
                            .has_fit = live->fitter != NULL};
    sf_frame_grabber_count(live->grabber, &p->frames, &p->passed_over, &came);
    p->frame_rate = p->seconds > 0 ? (double)came / p->seconds : 0;
    count_quality(live, p);
    if (live->fitter) sf_fitter_get_progress(live->fitter, &p->fit);
}

void sf_live_get_frame(const sf_live *live, sf_live_frame *frame) { *frame = live->input.frame; }

sf_status sf_live_snapshot(const sf_live *live, sf_model **model) {
    *model = NULL;
    if (!live->fitter) return sf_fail(live->ctx, SF_ERR_EMPTY, "live: there is no model yet");
    return sf_fitter_snapshot(live->fitter, model);
}

sf_status sf_live_render(sf_live *live, const sf_camera *camera, const sf_image_out *out) {
    if (!live->fitter) return sf_fail(live->ctx, SF_ERR_EMPTY, "live: there is no model yet");
    return sf_fitter_render(live->fitter, camera, out);
}

sf_status sf_live_get_world(const sf_live *live, sf_similarity *to_world) {
    if (!live->world.is_known) return sf_fail(live->ctx, SF_ERR_EMPTY, "live: no other world is known");
    *to_world = live->world.similarity;
    return SF_OK;
}

size_t sf_live_get_keyframes(const sf_live *live, size_t first, size_t capacity,
                             sf_live_keyframe *keyframes) {
    size_t count = 0;
    for (size_t i = first; i < live->keyframes.count && count < capacity; i++) {
        const sf_keyframe *k = &live->keyframes.list[i];
        sf_live_keyframe *to = &keyframes[count++];
        *to = (sf_live_keyframe){.time_ns = k->time_ns,
                                 .held_out = k->held_out,
                                 .camera = live->input.frame.camera,
                                 .has_truth = k->has_truth};
        memcpy(to->camera.R_cw, k->pose.R, sizeof k->pose.R);
        memcpy(to->camera.t_cw, k->pose.t, sizeof k->pose.t);
        to->truth = to->camera;
        memcpy(to->truth.R_cw, k->truth.R, sizeof k->truth.R);
        memcpy(to->truth.t_cw, k->truth.t, sizeof k->truth.t);
        if (live->fitter) sf_online_refine_camera(live->fitter, k->id, &to->camera);
    }
    return count;
}

sf_scene *sf_live_scene(sf_live *live) { return live->scene; }

/* A keyframe's camera as the fit refined it, in the world that is known. */
static void save_camera(void *user, uint32_t id, sf_camera *camera) {
    sf_live *live = user;
    if (live->fitter) sf_online_refine_camera(live->fitter, id, camera);
    if (live->world.is_known) sf_camera_transform(camera, &live->world.similarity);
}

sf_status sf_live_save_cameras(sf_live *live, const char *path, int world) {
    return sf_save_cameras(live->scene, save_camera, live, path, world);
}
