/* sim_source.c - the simulated camera (src/sim) as a source of frames: it keeps their pace, and is unplugged.
 */
#include "sim_source.h"

#include <math.h>
#include <stdio.h>

#include "../base/clock.h"
#include "../sim/frames.h"
#include "pace.h"

typedef struct sim_source {
    sf_context *ctx;
    sf_sim_frames frames;
    sf_pace pace;
    uint8_t *buffer[SF_SOURCE_MAX_LEASES];
    int taken[SF_SOURCE_MAX_LEASES];
} sim_source;

static sf_status sim_lock(void *self, int locked) {
    sim_source *s = self;
    sf_sim_lock_exposure(&s->frames, locked);
    return SF_OK;
}

static void sim_close(void *self) {
    sim_source *s = self;
    sf_sim_frames_free(&s->frames);
    for (int i = 0; i < SF_SOURCE_MAX_LEASES; i++) sf_free(s->ctx, s->buffer[i]);
    sf_free(s->ctx, s);
}

static int is_corridor(const sim_source *s) { return s->frames.sim.walks && !s->frames.sim.has_board; }

static void sim_describe(const void *self, sf_source_info *info) {
    const sim_source *s = self;
    info->width = s->frames.sim.width;
    info->height = s->frames.sim.height;
    info->format = SF_PIXEL_RGB24;
    info->frames_per_second = s->frames.sim.fps;
    info->frames = s->pace.frames;
    info->has_poses = 1;
    info->live = s->frames.sim.fps > 0;
    info->can_lock_exposure = s->frames.sim.auto_exposure;
    snprintf(info->name, sizeof info->name, "simulated %s%s, %dx%d", is_corridor(s) ? "corridor" : "studio",
             s->frames.sim.has_board ? " with a board" : "", (int)s->frames.sim.width,
             (int)s->frames.sim.height);
}

static const char *scheme_name(const sim_source *s) {
    return s->frames.sim.has_board ? "sim:studio-board" : is_corridor(s) ? "sim:corridor" : "sim:studio";
}

/* Frames that are due while the camera is unplugged are lost, also those that nobody had taken by then. It
 * is waited for at most *timeout_ms, of which what is left comes back. Where frames are not in real time, the
 * time that is waited passes for them. */
static sf_status wait_for_plug(sim_source *s, int *timeout_ms, sf_source_counts *counts) {
    sf_sim_span *away = &s->frames.sim.unplug;
    double period = sf_sim_period(&s->frames.sim), next = (double)s->pace.next * period, now = next;
    int live = s->pace.fps > 0;
    if (away->from < 0 || !s->pace.next) return SF_OK;
    if (live) now = fmax(now, (double)(sf_clock_ns() - s->pace.start_ns) * 1e-9);
    if (now < away->from) return SF_OK;
    if (live) now = (double)(sf_clock_ns() - s->pace.start_ns) * 1e-9;
    double until = fmin(now + fmax(*timeout_ms * 1e-3, live ? 0 : period), fmax(away->to, now));
    if (live) sf_pace_sleep_until(s->pace.start_ns + (int64_t)(until * 1e9));
    for (; (double)s->pace.next * period < fmin(until, away->to); s->pace.next++) counts->dropped++;
    if (until < away->to)
        return sf_fail(s->ctx, SF_ERR_TIMEOUT, "%s: unplugged: no frame within %d ms", scheme_name(s),
                       *timeout_ms);
    *timeout_ms -= (int)fmin((until - now) * 1e3, *timeout_ms);
    *away = (sf_sim_span){-1, -1};
    counts->reopened++;
    return SF_OK;
}

static sf_status sim_next(void *self, int timeout_ms, int newest, sf_frame *frame, sf_source_counts *counts) {
    sim_source *s = self;
    sf_pace_frame due;
    sf_status status = wait_for_plug(s, &timeout_ms, counts);
    if (status == SF_OK)
        status = sf_pace_next(&s->pace, s->ctx, scheme_name(s), timeout_ms, newest, counts, &due);
    if (status != SF_OK) return status;
    uint64_t number = due.number;
    int64_t time_ns = due.time_ns;
    int slot = s->taken[0] ? 1 : 0;
    sf_sim_moment m = sf_sim_moment_of(&s->frames, number);
    if (s->frames.sim.walks && s->pace.fps == 0)
        time_ns = (int64_t)((double)number * sf_sim_period(&s->frames.sim) * 1e9 + 0.5);
    frame->plane[0] = s->buffer[slot];
    frame->stride[0] = 3 * (size_t)s->frames.sim.width;
    frame->width = s->frames.sim.width;
    frame->height = s->frames.sim.height;
    frame->format = SF_PIXEL_RGB24;
    frame->sequence = number;
    frame->time_ns = time_ns - (int64_t)(m.early * 1e9);
    frame->has_camera = 1;
    frame->lease = &s->taken[slot];
    sf_sim_take(&s->frames, &m, s->buffer[slot], frame);
    s->taken[slot] = 1;
    return SF_OK;
}

static void sim_release(void *self, sf_frame *frame) {
    (void)self;
    *(int *)frame->lease = 0;
}

static sf_status take_memory(sim_source *s) {
    size_t pixels = (size_t)s->frames.sim.width * (size_t)s->frames.sim.height;
    for (int i = 0; i < SF_SOURCE_MAX_LEASES; i++)
        if (!(s->buffer[i] = sf_alloc(s->ctx, pixels, 3))) return SF_ERR_MEMORY;
    return SF_OK;
}

sf_status sf_sim_open(sf_context *ctx, const char *name, sf_source *source) {
    static const sf_source_ops ops = {sim_close, sim_describe, sim_next, sim_release, sim_lock};
    sim_source *s = sf_calloc(ctx, 1, sizeof *s);
    if (!s) return SF_ERR_MEMORY;
    s->ctx = ctx;
    sf_status status = sf_sim_frames_init(ctx, name, &s->frames);
    if (status == SF_OK) status = take_memory(s);
    if (status != SF_OK) {
        sim_close(s);
        return status;
    }
    const sf_sim *sim = &s->frames.sim;
    s->pace = (sf_pace){.fps = sim->fps, .frames = sim->loop ? 0 : sf_sim_frame_count(sim)};
    source->ops = &ops;
    source->self = s;
    return SF_OK;
}
