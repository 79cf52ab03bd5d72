/* intake.c - a thread that takes frames as they come and keeps the newest as a picture. */
#include "intake.h"

#include <math.h>
#include <pthread.h>
#include <string.h>
#include <time.h>

#include "../base/clock.h"
#include "../io/optics.h"

enum {
    WAIT_MS = 100, /* for a frame: so soon is the end noticed */
    PICTURES = 3   /* one is taken in, one waits, one is looked at */
};

#define REST          700.0              /* ms, over the rate of pictures that are wanted */
#define GUESSED_WIDTH 1.0471975511965976 /* rad, of a picture whose lens nobody knows */

struct sf_intake {
    sf_context *ctx; /* the caller's, for memory and messages */
    sf_context *own; /* one thread: the pool is the fit's */
    sf_source *source;
    sf_lens lens;
    int downscale, live, rest_ms;
    sf_remap *remap;
    float *planes; /* of a frame, before it is remapped */
    size_t plane_capacity;
    sf_camera pinhole;
    pthread_t thread;

    pthread_mutex_t lock; /* guards all below */
    pthread_cond_t changed;
    sf_picture pictures[PICTURES];
    size_t capacity[PICTURES]; /* floats */
    int filled, taken;         /* indices; -1: none */
    int ending;
    sf_status status; /* why no more come */
    char error[1024];
    sf_source_counts counts;
    uint64_t passed_over, came;
    double heard;                     /* s of the clock, of the newest frame */
    int timeouts;                     /* since */
    int lock_wanted, exposure_locked; /* -1: the source cannot be told */
};

static struct timespec after_ms(int ms) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    int64_t ns = t.tv_nsec + (int64_t)ms * 1000000;
    t.tv_sec += (time_t)(ns / 1000000000);
    t.tv_nsec = (long)(ns % 1000000000);
    return t;
}

/* 1. From a frame to a picture: on the thread */

/* The frame's own intrinsics, else a guess. */
static void find_lens(sf_intake *in, const sf_frame *frame) {
    if (in->lens.fx > 0) return;
    if (frame->has_camera) {
        const sf_camera *c = &frame->camera;
        in->lens = (sf_lens){.fx = c->fx, .fy = c->fy, .cx = c->cx, .cy = c->cy};
        return;
    }
    double f = frame->width / 2.0 / tan(GUESSED_WIDTH / 2);
    in->lens = (sf_lens){.fx = f, .fy = f, .cx = frame->width / 2.0, .cy = frame->height / 2.0};
    sf_log(in->ctx, SF_LOG_WARNING,
           "no lens is known: taken as %.0f px of focal length; splatfit calibrate measures it", f);
}

static sf_status prepare(sf_intake *in, const sf_frame *frame) {
    if (in->remap) return SF_OK;
    find_lens(in, frame);
    sf_status status =
        sf_remap_create(in->own, &in->lens, frame->width, frame->height, in->downscale, &in->remap);
    if (!status) sf_remap_camera(in->remap, &in->pinhole);
    return status;
}

/* A slot that nobody holds; those that wait may be overwritten only by what is newer, as a whole. */
static int free_slot(const sf_intake *in) {
    for (int i = 0; i < PICTURES; i++)
        if (i != in->filled && i != in->taken) return i;
    return 0; /* never: there are three */
}

static sf_status make_room(sf_intake *in, int slot, int with_weight) {
    sf_picture *p = &in->pictures[slot];
    size_t pixels = (size_t)in->pinhole.width * (size_t)in->pinhole.height;
    float *block = p->rgb[0];
    sf_status status = sf_grow(in->own, &block, &in->capacity[slot], 0, 4 * pixels, sizeof *block);
    if (status) return status;
    for (size_t c = 0; c < 3; c++) p->rgb[c] = block + c * pixels;
    p->weight = with_weight ? block + 3 * pixels : NULL;
    return SF_OK;
}

static sf_status develop(sf_intake *in, const sf_frame *frame, int slot) {
    size_t pixels = (size_t)frame->width * (size_t)frame->height, width = (size_t)frame->width;
    sf_picture *p = &in->pictures[slot];
    sf_status status = prepare(in, frame);
    if (!status) status = make_room(in, slot, sf_lens_is_distorted(&in->lens));
    if (!status)
        status = sf_grow(in->own, &in->planes, &in->plane_capacity, 0, 3 * pixels, sizeof *in->planes);
    if (status) return status;
    float *const from[3] = {in->planes, in->planes + pixels, in->planes + 2 * pixels};
    int as_it_is = in->downscale == 1 && !sf_lens_is_distorted(&in->lens);
    status = sf_frame_convert(in->own, frame, as_it_is ? p->rgb : from, width);
    if (!status && !as_it_is)
        status = sf_remap_run(in->remap, from, width, p->rgb, (size_t)in->pinhole.width, p->weight);
    p->camera = in->pinhole;
    p->time_ns = frame->time_ns;
    p->light = frame->exposure_s * frame->gain;
    p->sequence = frame->sequence;
    p->has_truth = frame->has_camera;
    if (frame->has_camera) p->truth = sf_camera_downscaled(&frame->camera, in->downscale);
    return status;
}

/* A picture that nobody took yet need not be replaced at once: what comes meanwhile is the source's to skip,
 * which costs less than to take it in. */
static void rest(sf_intake *in) {
    struct timespec until = after_ms(in->rest_ms);
    pthread_mutex_lock(&in->lock);
    while (in->live && in->filled >= 0 && !in->ending)
        if (pthread_cond_timedwait(&in->changed, &in->lock, &until)) break;
    pthread_mutex_unlock(&in->lock);
}

/* On this thread, which the source belongs to. */
static void lock_exposure(sf_intake *in) {
    pthread_mutex_lock(&in->lock);
    int wanted = in->lock_wanted, is = in->exposure_locked;
    pthread_mutex_unlock(&in->lock);
    if (is < 0 || wanted == is) return;
    sf_status status = sf_source_lock_exposure(in->source, wanted);
    if (status) sf_log(in->ctx, SF_LOG_WARNING, "the exposure cannot be %s", wanted ? "locked" : "unlocked");
    pthread_mutex_lock(&in->lock);
    if (status)
        in->lock_wanted = is;
    else
        in->exposure_locked = wanted;
    pthread_mutex_unlock(&in->lock);
}

static double silent(const sf_intake *in) {
    if (!(in->heard > 0) || !in->timeouts) return 0;
    return in->live ? sf_clock() - in->heard : 1e-3 * WAIT_MS * in->timeouts;
}

/* It is said once each time. */
static sf_status count_timeout(sf_intake *in) {
    pthread_mutex_lock(&in->lock);
    double before = silent(in);
    in->timeouts++;
    int say = before < SF_INTAKE_SILENCE && silent(in) >= SF_INTAKE_SILENCE;
    pthread_mutex_unlock(&in->lock);
    if (say) sf_log(in->ctx, SF_LOG_WARNING, "no frame for %.0f s: is the camera there?", SF_INTAKE_SILENCE);
    return SF_OK;
}

static void hear(sf_intake *in) {
    pthread_mutex_lock(&in->lock);
    double was = silent(in);
    in->heard = sf_clock(), in->timeouts = 0;
    pthread_mutex_unlock(&in->lock);
    if (was >= SF_INTAKE_SILENCE) sf_log(in->ctx, SF_LOG_INFO, "frames come again");
}

/* A frame that cannot be decoded is passed over; a camera that has gone may come back. */
static sf_status take_in(sf_intake *in) {
    sf_frame frame;
    rest(in);
    lock_exposure(in);
    sf_status status = (in->live ? sf_source_newest : sf_source_next)(in->source, WAIT_MS, &frame);
    if (status == SF_ERR_TIMEOUT) return count_timeout(in);
    if (status) return status;
    hear(in);
    pthread_mutex_lock(&in->lock);
    while (!in->live && in->filled >= 0 && !in->ending) pthread_cond_wait(&in->changed, &in->lock);
    int slot = free_slot(in);
    pthread_mutex_unlock(&in->lock);
    status = develop(in, &frame, slot);
    sf_source_release(in->source, &frame);
    pthread_mutex_lock(&in->lock);
    sf_source_count(in->source, &in->counts);
    in->came++;
    if (!status) {
        in->passed_over += in->filled >= 0;
        in->filled = slot;
        pthread_cond_broadcast(&in->changed);
    }
    pthread_mutex_unlock(&in->lock);
    return status == SF_ERR_FORMAT ? SF_OK : status;
}

static void *run(void *intake) {
    sf_intake *in = intake;
    for (;;) {
        sf_status status = take_in(in);
        pthread_mutex_lock(&in->lock);
        int over = in->ending || status;
        if (status) {
            in->status = status;
            const char *text = sf_last_error(in->own);
            memcpy(in->error, text, strlen(text) + 1);
            pthread_cond_broadcast(&in->changed);
        }
        pthread_mutex_unlock(&in->lock);
        if (over) return NULL;
    }
}

/* 2. The other side */

static void free_all(sf_intake *in) {
    for (int i = 0; i < PICTURES; i++) sf_free(in->own, in->pictures[i].rgb[0]);
    sf_free(in->own, in->planes);
    sf_remap_destroy(&in->remap);
    sf_context_destroy(&in->own);
    pthread_cond_destroy(&in->changed);
    pthread_mutex_destroy(&in->lock);
    sf_free(in->ctx, in);
}

sf_status sf_intake_create(sf_context *ctx, sf_source *source, const sf_lens *lens, int downscale,
                           double rate, sf_intake **intake) {
    *intake = NULL;
    sf_intake *in = sf_calloc(ctx, 1, sizeof *in);
    if (!in) return SF_ERR_MEMORY;
    sf_context_options own = {.allocator = &ctx->allocator, .threads = 1};
    sf_status status = sf_context_create(&in->own, &own);
    if (status) {
        sf_free(ctx, in);
        return status;
    }
    sf_source_info info;
    sf_source_describe(source, &info);
    in->ctx = ctx, in->source = source, in->lens = *lens, in->downscale = downscale;
    in->rest_ms = (int)fmin(REST / rate, 1000);
    in->live = info.live || info.frames_per_second > 0;
    in->exposure_locked = info.can_lock_exposure ? 0 : -1;
    in->filled = in->taken = -1;
    pthread_mutex_init(&in->lock, NULL);
    pthread_condattr_t attributes;
    pthread_condattr_init(&attributes);
    pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
    pthread_cond_init(&in->changed, &attributes);
    pthread_condattr_destroy(&attributes);
    if (pthread_create(&in->thread, NULL, run, in)) {
        free_all(in);
        return sf_fail(ctx, SF_ERR_MEMORY, "no thread for the frames can be created");
    }
    *intake = in;
    return SF_OK;
}

void sf_intake_destroy(sf_intake **intake) {
    sf_intake *in = *intake;
    if (!in) return;
    pthread_mutex_lock(&in->lock);
    in->ending = 1;
    pthread_cond_broadcast(&in->changed);
    pthread_mutex_unlock(&in->lock);
    pthread_join(in->thread, NULL);
    free_all(in);
    *intake = NULL;
}

sf_status sf_intake_take(sf_intake *in, int timeout_ms, const sf_picture **picture) {
    struct timespec until = after_ms(timeout_ms);
    sf_status status = SF_OK;
    pthread_mutex_lock(&in->lock);
    while (in->filled < 0 && !in->status && !status)
        if (pthread_cond_timedwait(&in->changed, &in->lock, &until)) status = SF_ERR_TIMEOUT;
    if (in->filled >= 0) {
        in->taken = in->filled;
        in->filled = -1;
        *picture = &in->pictures[in->taken];
        pthread_cond_broadcast(&in->changed);
        status = SF_OK;
    } else if (in->status) {
        status = in->status == SF_ERR_END ? SF_ERR_END : sf_fail(in->ctx, in->status, "%s", in->error);
    }
    pthread_mutex_unlock(&in->lock);
    return status;
}

void sf_intake_lock(sf_intake *in, int locked) {
    pthread_mutex_lock(&in->lock);
    in->lock_wanted = locked != 0;
    pthread_mutex_unlock(&in->lock);
}

int sf_intake_locked(sf_intake *in) {
    pthread_mutex_lock(&in->lock);
    int locked = in->exposure_locked;
    pthread_mutex_unlock(&in->lock);
    return locked;
}

int sf_intake_waits(sf_intake *in) {
    pthread_mutex_lock(&in->lock);
    int waits = in->filled >= 0 || in->status;
    pthread_mutex_unlock(&in->lock);
    return waits;
}

double sf_intake_silent(sf_intake *in) {
    pthread_mutex_lock(&in->lock);
    double seconds = silent(in);
    pthread_mutex_unlock(&in->lock);
    return seconds;
}

void sf_intake_count(sf_intake *in, sf_source_counts *counts, uint64_t *passed_over, uint64_t *came) {
    pthread_mutex_lock(&in->lock);
    *counts = in->counts;
    *passed_over = in->passed_over;
    *came = in->came;
    pthread_mutex_unlock(&in->lock);
}
