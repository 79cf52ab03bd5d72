/* sim_source.c - the frames of a simulated camera: drawn, put through the sensor, with faults on demand. */
#include "sim.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../base/clock.h"
#include "../base/rng.h"
#include "baked.h"
#include "pace.h"

static const double pi = 3.141592653589793;

enum { METER_TIMES = 240, METER_WIDTH = 24, METER_HEIGHT = 18 };

typedef struct sim_source {
    sf_context *ctx;
    sf_sim sim;
    sf_pace pace;
    sf_sensor_curve curve;
    sf_baked *baked;                 /* NULL: drawn exactly */
    float *linear, *smeared, *depth; /* [height][width][3]; those that the sensor needs */
    uint8_t *frames[SF_SOURCE_MAX_LEASES];
    int taken[SF_SOURCE_MAX_LEASES];
    int locked; /* the exposure stays as it was in the last frame */
    double last_bright, locked_at;
    float bright[METER_TIMES]; /* the exposure along the frames, 1: as it is without control */
} sim_source;

/* 1. When and where a frame is taken */

/* A number for a frame, uniform in [0, 1). */
static double chance(const sim_source *s, uint64_t number, uint64_t purpose) {
    sf_rng rng;
    sf_rng_seed(&rng, s->sim.seed + (number + 1) * 0x9e3779b97f4a7c15u + purpose);
    return sf_rng_uniform(&rng);
}

/* Seconds that a frame is taken before it is due; less than the time between two. */
static double early(const sim_source *s, uint64_t number) {
    if (number == 0 || s->sim.jitter_s <= 0) return 0;
    return fmin(s->sim.jitter_s, 0.9 * sf_sim_period(&s->sim)) * chance(s, number, 1);
}

/* The place on the path, in frames, of `place` frames after the first, where the camera does not jump. */
static double on_path(const sf_sim *sim, double place) {
    double frames = (double)sim->frames;
    if (sim->jump_s >= 0 && place * sf_sim_period(sim) >= sim->jump_s) place += 0.2 * frames;
    place = fmod(place, frames);
    return place < 0 ? place + frames : place;
}

/* When a frame is taken. */
typedef struct moment {
    uint64_t number;
    double seconds, early; /* after frame 0 was due; before this one is */
    double place;          /* on the path, in frames */
} moment;

static moment moment_of(const sim_source *s, uint64_t number) {
    double period = sf_sim_period(&s->sim);
    moment m = {.number = number, .early = early(s, number)};
    m.seconds = (double)number * period - m.early;
    m.place = on_path(&s->sim, (double)number - m.early / period);
    return m;
}

/* 2. How it is exposed */

enum { FULL_TIME_MS = 10 };

static void draw(const sim_source *s, const sf_camera *camera, float *linear, float *depth) {
    if (s->baked)
        sf_baked_draw(s->baked, camera, linear, depth);
    else
        sf_studio_draw(&s->sim.studio, s->ctx->pool, camera, linear, depth);
}

/* The light that a picture of the whole shows at a moment, as a sensor that saturates has it. */
static double metered(const sim_source *s, double place) {
    float picture[3 * METER_WIDTH * METER_HEIGHT];
    sf_camera camera;
    if (sf_span_holds(s->sim.black, place * sf_sim_period(&s->sim))) return 0;
    sf_sim_studio_camera(&s->sim, on_path(&s->sim, place), &camera);
    camera.fx *= (double)METER_WIDTH / camera.width;
    camera.fy *= (double)METER_HEIGHT / camera.height;
    camera.cx = METER_WIDTH / 2.0, camera.cy = METER_HEIGHT / 2.0;
    camera.width = METER_WIDTH, camera.height = METER_HEIGHT;
    draw(s, &camera, picture, NULL);
    double sum = 0;
    for (int i = 0; i < 3 * METER_WIDTH * METER_HEIGHT; i++) sum += fmin((double)picture[i], 1);
    return sum / (3 * METER_WIDTH * METER_HEIGHT);
}

/* What automatic exposure does along the whole path: it goes to a mean grey, late. Worked out ahead, so that
 * a frame does not depend on which ones were taken before it. */
static void meter(sim_source *s) {
    const double least = 0.6, most = 1.4, lag_s = 0.5;
    double light[METER_TIMES], mean = 0, frames = (double)s->sim.frames / METER_TIMES;
    double step = sf_sim_period(&s->sim) * frames;
    int count = 0;
    for (int i = 0; i < METER_TIMES; i++) {
        light[i] = metered(s, i * frames);
        if (light[i] > 0) mean += light[i], count++;
    }
    mean /= count > 0 ? count : 1;
    double now = light[0] > 0 ? fmin(fmax(mean / light[0], least), most) : 1;
    for (int i = 0; i < METER_TIMES; i++) {
        double wanted = light[i] > 0 ? fmin(fmax(mean / light[i], least), most) : most;
        s->bright[i] = (float)now;
        now += (wanted - now) * (1 - exp(-step / lag_s));
    }
}

static double brightness(const sim_source *s, const moment *m) {
    if (!s->sim.auto_exposure) return 1;
    if (s->locked) return s->locked_at;
    double turns = m->seconds / (sf_sim_period(&s->sim) * (double)s->sim.frames);
    double place = (turns - floor(turns)) * METER_TIMES, t = place - floor(place);
    int i = (int)place % METER_TIMES, next = (i + 1) % METER_TIMES;
    return (double)s->bright[i] * (1 - t) + (double)s->bright[next] * t;
}

/* 3. What goes on before the lens */

/* A striped ball that swings through the picture and covers a tenth of it. */
static void draw_mover(const sim_source *s, double seconds) {
    int width = s->sim.width, height = s->sim.height;
    double radius = sqrt(0.1 * width * height / pi), reach = fmax(width / 2.0 - radius, 0);
    double x = width / 2.0 + reach * sin(2 * pi * seconds / 5), y = height * (0.5 + 0.1 * cos(seconds));
    for (int j = 0; j < height; j++)
        for (int i = 0; i < width; i++) {
            double u = (i + 0.5 - x) / radius, v = (j + 0.5 - y) / radius, out = u * u + v * v;
            if (out >= 1) continue;
            size_t at = (size_t)j * (size_t)width + (size_t)i;
            double shade = 0.25 + 0.75 * sqrt(1 - out) * (0.75 - 0.25 * v);
            int dark = whole_below(5 * (u + 0.6 * v) + seconds) & 1;
            s->linear[3 * at] = (float)(shade * (dark ? 0.05 : 0.7));
            s->linear[3 * at + 1] = (float)(shade * (dark ? 0.12 : 0.55));
            s->linear[3 * at + 2] = (float)(shade * (dark ? 0.3 : 0.2));
            s->depth[at] = 1;
        }
}

/* The scene's motion before the camera while it is exposed for `time` seconds. */
static sf_motion motion_at(const sim_source *s, const moment *m, double time) {
    const double shake = 0.06; /* radians */
    double half = time / 2 / sf_sim_period(&s->sim);
    sf_camera from, to;
    sf_sim_studio_camera(&s->sim, m->place - half, &from);
    sf_sim_studio_camera(&s->sim, m->place + half, &to);
    sf_motion motion = sf_motion_between(&from, &to);
    if (sf_span_holds(s->sim.smear, m->seconds)) {
        double angle = 2 * pi * chance(s, m->number, 2);
        motion.turn[0] += shake * sin(angle);
        motion.turn[1] += shake * cos(angle);
    }
    return motion;
}

/* 4. A frame */

static const float *light_of(sim_source *s, const sf_camera *camera, const moment *m, double time) {
    const int usual = 5, heavy = 25; /* pictures that blur is the mean of */
    int smear = sf_span_holds(s->sim.smear, m->seconds);
    if (sf_span_holds(s->sim.black, m->seconds)) {
        memset(s->linear, 0, 3 * (size_t)s->sim.width * (size_t)s->sim.height * sizeof *s->linear);
        return s->linear;
    }
    draw(s, camera, s->linear, s->depth);
    if (sf_span_holds(s->sim.mover, m->seconds)) draw_mover(s, m->seconds);
    if (!s->sim.blur && !smear) return s->linear;
    sf_motion motion = motion_at(s, m, time);
    sf_sensor_smear(s->ctx->pool, camera, &motion, smear ? heavy : usual, s->linear, s->depth, s->smeared);
    return s->smeared;
}

static void take_picture(sim_source *s, const moment *m, uint8_t *data, sf_frame *frame) {
    double bright = brightness(s, m), time = fmin(bright, 1), gain = fmax(bright, 1);
    double exposure_s = time * FULL_TIME_MS * 1e-3;
    sf_camera camera;
    s->last_bright = bright;
    sf_sim_studio_camera(&s->sim, m->place, &camera);
    sf_sim_to_world(&s->sim, &camera, &frame->camera);
    sf_exposure e = {.curve = &s->curve,
                     .linear = light_of(s, &camera, m, exposure_s),
                     .width = camera.width,
                     .height = camera.height,
                     .time = time,
                     .gain = gain,
                     .noise = s->sim.noise,
                     .seed = s->sim.seed * 0x2545f4914f6cdd1du + m->number};
    sf_sensor_expose(s->ctx->pool, &e, data);
    frame->exposure_s = s->sim.sensor ? exposure_s : 0;
    frame->gain = s->sim.sensor ? gain : 0;
}

/* 5. The source */

static sf_status sim_lock(void *self, int locked) {
    sim_source *s = self;
    if (locked && !s->locked) s->locked_at = s->last_bright;
    s->locked = locked;
    return SF_OK;
}

static void sim_close(void *self) {
    sim_source *s = self;
    sf_baked_destroy(&s->baked);
    for (int i = 0; i < SF_SOURCE_MAX_LEASES; i++) sf_free(s->ctx, s->frames[i]);
    sf_free(s->ctx, s->linear);
    sf_free(s->ctx, s->smeared);
    sf_free(s->ctx, s->depth);
    sf_free(s->ctx, s);
}

static void sim_describe(const void *self, sf_source_info *info) {
    const sim_source *s = self;
    info->width = s->sim.width;
    info->height = s->sim.height;
    info->format = SF_PIXEL_RGB24;
    info->frames_per_second = s->sim.fps;
    info->frames = s->pace.frames;
    info->has_poses = 1;
    info->live = s->sim.fps > 0;
    info->can_lock_exposure = s->sim.auto_exposure;
    snprintf(info->name, sizeof info->name, "simulated studio%s, %dx%d",
             s->sim.has_board ? " with a board" : "", (int)s->sim.width, (int)s->sim.height);
}

static const char *scheme_name(const sim_source *s) {
    return s->sim.has_board ? "sim:studio-board" : "sim:studio";
}

/* Frames that are due while the camera is unplugged are lost, also those that nobody had taken by then. It
 * is waited for at most *timeout_ms, of which what is left comes back. Where frames are not in real time, the
 * time that is waited passes for them. */
static sf_status wait_for_plug(sim_source *s, int *timeout_ms, sf_source_counts *counts) {
    sf_sim_span *away = &s->sim.unplug;
    double period = sf_sim_period(&s->sim), next = (double)s->pace.next * period, now = next;
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
    moment m = moment_of(s, number);
    if (s->sim.has_board && s->pace.fps == 0)
        time_ns = (int64_t)((double)number * sf_sim_period(&s->sim) * 1e9 + 0.5);
    frame->plane[0] = s->frames[slot];
    frame->stride[0] = 3 * (size_t)s->sim.width;
    frame->width = s->sim.width;
    frame->height = s->sim.height;
    frame->format = SF_PIXEL_RGB24;
    frame->sequence = number;
    frame->time_ns = time_ns - (int64_t)(m.early * 1e9);
    frame->has_camera = 1;
    frame->lease = &s->taken[slot];
    take_picture(s, &m, s->frames[slot], frame);
    s->taken[slot] = 1;
    return SF_OK;
}

static void sim_release(void *self, sf_frame *frame) {
    (void)self;
    *(int *)frame->lease = 0;
}

static int needs_depth(const sf_sim *sim) {
    return sim->blur || sim->smear.from >= 0 || sim->mover.from >= 0;
}

static sf_status take_memory(sim_source *s) {
    size_t pixels = (size_t)s->sim.width * (size_t)s->sim.height;
    for (int i = 0; i < SF_SOURCE_MAX_LEASES; i++)
        if (!(s->frames[i] = sf_alloc(s->ctx, pixels, 3))) return SF_ERR_MEMORY;
    if (!(s->linear = sf_alloc(s->ctx, pixels, 3 * sizeof *s->linear))) return SF_ERR_MEMORY;
    if (!needs_depth(&s->sim)) return SF_OK;
    s->depth = sf_alloc(s->ctx, pixels, sizeof *s->depth);
    s->smeared = sf_alloc(s->ctx, pixels, 3 * sizeof *s->smeared);
    return s->depth && s->smeared ? SF_OK : SF_ERR_MEMORY;
}

/* Textures as fine as the path needs them. */
static sf_status bake(sim_source *s) {
    enum { EYES = 60 };
    sf_vec3 eyes[EYES];
    sf_camera camera;
    for (int i = 0; i < EYES; i++) {
        double center[3];
        sf_sim_studio_camera(&s->sim, (double)s->sim.frames * i / EYES, &camera);
        sf_camera_center(&camera, center);
        eyes[i] = vec3(center[0], center[1], center[2]);
    }
    size_t pixels = (size_t)s->sim.width * (size_t)s->sim.height;
    if (pixels < METER_WIDTH * METER_HEIGHT) pixels = METER_WIDTH * METER_HEIGHT;
    return sf_baked_create(s->ctx, &s->sim.studio, eyes, EYES, camera.fx, pixels, &s->baked);
}

sf_status sf_sim_open(sf_context *ctx, const char *name, sf_source *source) {
    static const sf_source_ops ops = {sim_close, sim_describe, sim_next, sim_release, sim_lock};
    sim_source *s = sf_calloc(ctx, 1, sizeof *s);
    if (!s) return SF_ERR_MEMORY;
    s->ctx = ctx;
    sf_status status = sf_sim_init(ctx, name, &s->sim);
    s->pace = (sf_pace){.fps = s->sim.fps, .frames = s->sim.loop ? 0 : s->sim.frames};
    if (status == SF_OK) status = take_memory(s);
    if (status == SF_OK && !s->sim.exact) status = bake(s);
    if (status != SF_OK) {
        sim_close(s);
        return status;
    }
    sf_sensor_curve_init(&s->curve);
    s->last_bright = 1;
    if (s->sim.auto_exposure) meter(s);
    source->ops = &ops;
    source->self = s;
    return SF_OK;
}
