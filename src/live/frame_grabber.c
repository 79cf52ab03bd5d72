/* frame_grabber.c - a thread that takes frames as they come and keeps the newest as a picture. */
#include "frame_grabber.h"

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

struct sf_frame_grabber {
    sf_context *ctx; /* the caller's, for memory and messages */
    sf_context *own; /* one thread: the pool is the fit's */
    sf_source *source;
    sf_lens lens;
    int find_lens, is_lens_guessed;
    int downscale, live, rest_ms;
    sf_remap *remap;
    float *planes; /* of a frame, before it is remapped */
    size_t plane_capacity;
    sf_camera pinhole;
    int32_t width, height; /* px, of the first frame, and so of all that are taken */
    int other_sizes;       /* frames of another size */
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
static void find_lens(sf_frame_grabber *g, const sf_frame *frame) {
    if (g->lens.fx > 0) return;
    if (frame->has_camera && !g->find_lens) {
        const sf_camera *c = &frame->camera;
        g->lens = (sf_lens){.fx = c->fx, .fy = c->fy, .cx = c->cx, .cy = c->cy};
        return;
    }
    double f = frame->width / 2.0 / tan(GUESSED_WIDTH / 2);
    g->lens = (sf_lens){.fx = f, .fy = f, .cx = frame->width / 2.0, .cy = frame->height / 2.0};
    g->is_lens_guessed = 1;
}

/* One camera, one size: folders and pipes may bring others. It is said once. */
static sf_status check_size(sf_frame_grabber *g, const sf_frame *frame) {
    if (frame->width == g->width && frame->height == g->height) return SF_OK;
    if (!g->other_sizes++)
        sf_log(g->ctx, SF_LOG_WARNING,
               "frame %llu: %d x %d px after frames of %d x %d: it and others like it are passed over, since "
               "one camera has "
               "one size",
               (unsigned long long)frame->sequence, (int)frame->width, (int)frame->height, (int)g->width,
               (int)g->height);
    return SF_ERR_FORMAT;
}

static sf_status prepare(sf_frame_grabber *g, const sf_frame *frame) {
    if (g->remap) return check_size(g, frame);
    find_lens(g, frame);
    g->width = frame->width, g->height = frame->height;
    sf_status status =
        sf_remap_create(g->own, &g->lens, frame->width, frame->height, g->downscale, &g->remap);
    if (!status) sf_remap_camera(g->remap, &g->pinhole);
    return status;
}

/* A slot that nobody holds; those that wait may be overwritten only by what is newer, as a whole. */
static int free_slot(const sf_frame_grabber *g) {
    for (int i = 0; i < PICTURES; i++)
        if (i != g->filled && i != g->taken) return i;
    return 0; /* never: there are three */
}

static sf_status make_room(sf_frame_grabber *g, int slot, int with_weight) {
    sf_picture *p = &g->pictures[slot];
    size_t pixels = (size_t)g->pinhole.width * (size_t)g->pinhole.height;
    float *block = p->rgb[0];
    sf_status status = sf_grow(g->own, &block, &g->capacity[slot], 0, 4 * pixels, sizeof *block);
    if (status) return status;
    for (size_t c = 0; c < 3; c++) p->rgb[c] = block + c * pixels;
    p->weight = with_weight ? block + 3 * pixels : NULL;
    return SF_OK;
}

static sf_status develop(sf_frame_grabber *g, const sf_frame *frame, int slot) {
    size_t pixels = (size_t)frame->width * (size_t)frame->height, width = (size_t)frame->width;
    sf_picture *p = &g->pictures[slot];
    sf_status status = prepare(g, frame);
    if (!status) status = make_room(g, slot, sf_lens_is_distorted(&g->lens));
    if (!status) status = sf_grow(g->own, &g->planes, &g->plane_capacity, 0, 3 * pixels, sizeof *g->planes);
    if (status) return status;
    float *const from[3] = {g->planes, g->planes + pixels, g->planes + 2 * pixels};
    int as_it_is = g->downscale == 1 && !sf_lens_is_distorted(&g->lens);
    status = sf_frame_convert(g->own, frame, as_it_is ? p->rgb : from, width);
    if (!status && !as_it_is)
        status = sf_remap_run(g->remap, from, width, p->rgb, (size_t)g->pinhole.width, p->weight);
    p->camera = g->pinhole;
    p->time_ns = frame->time_ns;
    p->light = frame->exposure_s * frame->gain;
    p->sequence = frame->sequence;
    p->is_lens_guessed = g->is_lens_guessed;
    p->has_truth = frame->has_camera;
    if (frame->has_camera) p->truth = sf_camera_downscaled(&frame->camera, g->downscale);
    return status;
}

/* A picture that nobody took yet need not be replaced at once: what comes meanwhile is the source's to skip,
 * which costs less than to take it in. */
static void rest(sf_frame_grabber *g) {
    struct timespec until = after_ms(g->rest_ms);
    pthread_mutex_lock(&g->lock);
    while (g->live && g->filled >= 0 && !g->ending)
        if (pthread_cond_timedwait(&g->changed, &g->lock, &until)) break;
    pthread_mutex_unlock(&g->lock);
}

/* On this thread, which the source belongs to. */
static void lock_exposure(sf_frame_grabber *g) {
    pthread_mutex_lock(&g->lock);
    int wanted = g->lock_wanted, is = g->exposure_locked;
    pthread_mutex_unlock(&g->lock);
    if (is < 0 || wanted == is) return;
    sf_status status = sf_source_lock_exposure(g->source, wanted);
    if (status) sf_log(g->ctx, SF_LOG_WARNING, "the exposure cannot be %s", wanted ? "locked" : "unlocked");
    pthread_mutex_lock(&g->lock);
    if (status)
        g->lock_wanted = is;
    else
        g->exposure_locked = wanted;
    pthread_mutex_unlock(&g->lock);
}

static double silent(const sf_frame_grabber *g) {
    if (!(g->heard > 0) || !g->timeouts) return 0;
    return g->live ? sf_clock() - g->heard : 1e-3 * WAIT_MS * g->timeouts;
}

/* It is said once each time. */
static sf_status count_timeout(sf_frame_grabber *g) {
    pthread_mutex_lock(&g->lock);
    double before = silent(g);
    g->timeouts++;
    int say = before < SF_FRAME_SILENCE && silent(g) >= SF_FRAME_SILENCE;
    pthread_mutex_unlock(&g->lock);
    if (say) sf_log(g->ctx, SF_LOG_WARNING, "no frame for %.0f s: is the camera there?", SF_FRAME_SILENCE);
    return SF_OK;
}

static void hear(sf_frame_grabber *g) {
    pthread_mutex_lock(&g->lock);
    double was = silent(g);
    g->heard = sf_clock(), g->timeouts = 0;
    pthread_mutex_unlock(&g->lock);
    if (was >= SF_FRAME_SILENCE) sf_log(g->ctx, SF_LOG_INFO, "frames come again");
}

/* A frame that cannot be decoded is passed over; a camera that has gone may come back. */
static sf_status take_in(sf_frame_grabber *g) {
    sf_frame frame;
    rest(g);
    lock_exposure(g);
    sf_status status = (g->live ? sf_source_newest : sf_source_next)(g->source, WAIT_MS, &frame);
    if (status == SF_ERR_TIMEOUT) return count_timeout(g);
    if (status) return status;
    hear(g);
    pthread_mutex_lock(&g->lock);
    while (!g->live && g->filled >= 0 && !g->ending) pthread_cond_wait(&g->changed, &g->lock);
    int slot = free_slot(g);
    pthread_mutex_unlock(&g->lock);
    status = develop(g, &frame, slot);
    sf_source_release(g->source, &frame);
    pthread_mutex_lock(&g->lock);
    sf_source_count(g->source, &g->counts);
    g->came++;
    if (!status) {
        g->passed_over += g->filled >= 0;
        g->filled = slot;
        pthread_cond_broadcast(&g->changed);
    }
    pthread_mutex_unlock(&g->lock);
    return status == SF_ERR_FORMAT ? SF_OK : status;
}

static void *run(void *grabber) {
    sf_frame_grabber *g = grabber;
    for (;;) {
        sf_status status = take_in(g);
        pthread_mutex_lock(&g->lock);
        int over = g->ending || status;
        if (status) {
            g->status = status;
            const char *text = sf_last_error(g->own);
            memcpy(g->error, text, strlen(text) + 1);
            pthread_cond_broadcast(&g->changed);
        }
        pthread_mutex_unlock(&g->lock);
        if (over) return NULL;
    }
}

/* 2. The other side */

static void free_all(sf_frame_grabber *g) {
    for (int i = 0; i < PICTURES; i++) sf_free(g->own, g->pictures[i].rgb[0]);
    sf_free(g->own, g->planes);
    sf_remap_destroy(&g->remap);
    sf_context_destroy(&g->own);
    pthread_cond_destroy(&g->changed);
    pthread_mutex_destroy(&g->lock);
    sf_free(g->ctx, g);
}

sf_status sf_frame_grabber_create(sf_context *ctx, sf_source *source, const sf_lens *lens, int find_lens,
                                  int downscale, double rate, sf_frame_grabber **grabber) {
    *grabber = NULL;
    sf_frame_grabber *g = sf_calloc(ctx, 1, sizeof *g);
    if (!g) return SF_ERR_MEMORY;
    sf_context_options own = {.allocator = &ctx->allocator, .threads = 1};
    sf_status status = sf_context_create(&g->own, &own);
    if (status) {
        sf_free(ctx, g);
        return status;
    }
    sf_source_info info;
    sf_source_describe(source, &info);
    g->ctx = ctx, g->source = source, g->lens = *lens, g->find_lens = find_lens;
    g->downscale = downscale;
    g->rest_ms = (int)fmin(REST / rate, 1000);
    g->live = info.live || info.frames_per_second > 0;
    g->exposure_locked = info.can_lock_exposure ? 0 : -1;
    g->filled = g->taken = -1;
    pthread_mutex_init(&g->lock, NULL);
    pthread_condattr_t attributes;
    pthread_condattr_init(&attributes);
    pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
    pthread_cond_init(&g->changed, &attributes);
    pthread_condattr_destroy(&attributes);
    if (pthread_create(&g->thread, NULL, run, g)) {
        free_all(g);
        return sf_fail(ctx, SF_ERR_MEMORY, "no thread for the frames can be created");
    }
    *grabber = g;
    return SF_OK;
}

void sf_frame_grabber_destroy(sf_frame_grabber **grabber) {
    sf_frame_grabber *g = *grabber;
    if (!g) return;
    pthread_mutex_lock(&g->lock);
    g->ending = 1;
    pthread_cond_broadcast(&g->changed);
    pthread_mutex_unlock(&g->lock);
    pthread_join(g->thread, NULL);
    free_all(g);
    *grabber = NULL;
}

sf_status sf_frame_grabber_take(sf_frame_grabber *g, int timeout_ms, const sf_picture **picture) {
    struct timespec until = after_ms(timeout_ms);
    sf_status status = SF_OK;
    pthread_mutex_lock(&g->lock);
    while (g->filled < 0 && !g->status && !status)
        if (pthread_cond_timedwait(&g->changed, &g->lock, &until)) status = SF_ERR_TIMEOUT;
    if (g->filled >= 0) {
        g->taken = g->filled;
        g->filled = -1;
        *picture = &g->pictures[g->taken];
        pthread_cond_broadcast(&g->changed);
        status = SF_OK;
    } else if (g->status) {
        status = g->status == SF_ERR_END ? SF_ERR_END : sf_fail(g->ctx, g->status, "%s", g->error);
    }
    pthread_mutex_unlock(&g->lock);
    return status;
}

void sf_frame_grabber_lock(sf_frame_grabber *g, int locked) {
    pthread_mutex_lock(&g->lock);
    g->lock_wanted = locked != 0;
    pthread_mutex_unlock(&g->lock);
}

int sf_frame_grabber_locked(sf_frame_grabber *g) {
    pthread_mutex_lock(&g->lock);
    int locked = g->exposure_locked;
    pthread_mutex_unlock(&g->lock);
    return locked;
}

int sf_frame_grabber_waits(sf_frame_grabber *g) {
    pthread_mutex_lock(&g->lock);
    int waits = g->filled >= 0 || g->status;
    pthread_mutex_unlock(&g->lock);
    return waits;
}

double sf_frame_grabber_silent(sf_frame_grabber *g) {
    pthread_mutex_lock(&g->lock);
    double seconds = silent(g);
    pthread_mutex_unlock(&g->lock);
    return seconds;
}

void sf_frame_grabber_count(sf_frame_grabber *g, sf_source_counts *counts, uint64_t *passed_over,
                            uint64_t *came) {
    pthread_mutex_lock(&g->lock);
    *counts = g->counts;
    *passed_over = g->passed_over;
    *came = g->came;
    pthread_mutex_unlock(&g->lock);
}
