/* frames.c - the frames of a simulated camera: drawn, exposed, put through the sensor. */
#include "frames.h"

#include <string.h>

#include "../base/rng.h"

static const double pi = 3.141592653589793;

enum { METER_WIDTH = 24, METER_HEIGHT = 18, FULL_TIME_MS = 10 };

/* 1. When and where a frame is taken */

/* A number for a frame, uniform in [0, 1). */
static double chance(const sf_sim_frames *f, uint64_t number, uint64_t purpose) {
    sf_rng rng;
    sf_rng_seed(&rng, f->sim.seed + (number + 1) * 0x9e3779b97f4a7c15u + purpose);
    return sf_rng_uniform(&rng);
}

/* Seconds that a frame is taken before it is due; less than the time between two. */
static double early(const sf_sim_frames *f, uint64_t number) {
    if (number == 0 || f->sim.jitter_s <= 0) return 0;
    return fmin(f->sim.jitter_s, 0.9 * sf_sim_period(&f->sim)) * chance(f, number, 1);
}

/* The place on the path, in frames, of `place` frames after the first, where the camera does not jump. */
static double on_path(const sf_sim *sim, double place) {
    double frames = (double)sim->frames, period = sf_sim_period(sim), seconds = place * period;
    if (sim->spin.from >= 0 && seconds > sim->spin.from)
        place -= (fmin(seconds, sim->spin.to) - sim->spin.from) / period;
    if (sf_span_holds(sim->away, seconds)) place += 0.5 * frames;
    if (sim->jump_s >= 0 && seconds >= sim->jump_s) place += 0.2 * frames;
    place = fmod(place, frames);
    return place < 0 ? place + frames : place;
}

sf_sim_moment sf_sim_moment_of(const sf_sim_frames *f, uint64_t number) {
    double period = sf_sim_period(&f->sim);
    sf_sim_moment m = {.number = number, .early = early(f, number)};
    m.seconds = (double)number * period - m.early;
    m.place = on_path(&f->sim, (double)number - m.early / period);
    return m;
}

/* The camera there; on the spot it turns to both sides. */
static void camera_at(const sf_sim_frames *f, double place, double seconds, sf_camera *camera) {
    const double most = 0.5, once_s = 6; /* rad */
    sf_sim_studio_camera(&f->sim, place, camera);
    if (!sf_span_holds(f->sim.spin, seconds)) return;
    double angle = most * sin(2 * pi * (seconds - f->sim.spin.from) / once_s), s = sin(angle), c = cos(angle);
    sf_camera from = *camera;
    for (int k = 0; k < 3; k++) {
        camera->R_cw[k] = c * from.R_cw[k] + s * from.R_cw[6 + k];
        camera->R_cw[6 + k] = c * from.R_cw[6 + k] - s * from.R_cw[k];
    }
    camera->t_cw[0] = c * from.t_cw[0] + s * from.t_cw[2];
    camera->t_cw[2] = c * from.t_cw[2] - s * from.t_cw[0];
}

/* 2. How it is exposed */

static void draw(const sf_sim_frames *f, const sf_camera *camera, float *linear, float *depth) {
    if (f->baked)
        sf_baked_draw(f->baked, camera, linear, depth);
    else
        sf_studio_draw(&f->sim.studio, f->ctx->pool, camera, linear, depth);
}

/* The light that a picture of the whole shows at a moment, as a sensor that saturates has it. */
static double metered(const sf_sim_frames *f, double place) {
    float picture[3 * METER_WIDTH * METER_HEIGHT];
    sf_camera camera;
    if (sf_span_holds(f->sim.black, place * sf_sim_period(&f->sim))) return 0;
    sf_sim_studio_camera(&f->sim, on_path(&f->sim, place), &camera);
    camera.fx *= (double)METER_WIDTH / camera.width;
    camera.fy *= (double)METER_HEIGHT / camera.height;
    camera.cx = METER_WIDTH / 2.0, camera.cy = METER_HEIGHT / 2.0;
    camera.width = METER_WIDTH, camera.height = METER_HEIGHT;
    draw(f, &camera, picture, NULL);
    double sum = 0;
    for (int i = 0; i < 3 * METER_WIDTH * METER_HEIGHT; i++) sum += fmin((double)picture[i], 1);
    return sum / (3 * METER_WIDTH * METER_HEIGHT);
}

/* What automatic exposure does along the whole path: it goes to a mean grey, late. Worked out ahead, so that
 * a frame does not depend on which ones were taken before it. */
static void meter(sf_sim_frames *f) {
    const double least = 0.6, most = 1.4, lag_s = 0.5;
    double light[SF_SIM_METER_TIMES], mean = 0, frames = (double)f->sim.frames / SF_SIM_METER_TIMES;
    double step = sf_sim_period(&f->sim) * frames;
    int count = 0;
    for (int i = 0; i < SF_SIM_METER_TIMES; i++) {
        light[i] = metered(f, i * frames);
        if (light[i] > 0) mean += light[i], count++;
    }
    mean /= count > 0 ? count : 1;
    double now = light[0] > 0 ? fmin(fmax(mean / light[0], least), most) : 1;
    for (int i = 0; i < SF_SIM_METER_TIMES; i++) {
        double wanted = light[i] > 0 ? fmin(fmax(mean / light[i], least), most) : most;
        f->bright[i] = (float)now;
        now += (wanted - now) * (1 - exp(-step / lag_s));
    }
}

static double brightness(const sf_sim_frames *f, const sf_sim_moment *m) {
    if (!f->sim.auto_exposure) return 1;
    if (f->locked) return f->locked_at;
    double turns = m->seconds / (sf_sim_period(&f->sim) * (double)f->sim.frames);
    double place = (turns - floor(turns)) * SF_SIM_METER_TIMES, t = place - floor(place);
    int i = (int)place % SF_SIM_METER_TIMES, next = (i + 1) % SF_SIM_METER_TIMES;
    return (double)f->bright[i] * (1 - t) + (double)f->bright[next] * t;
}

void sf_sim_lock_exposure(sf_sim_frames *f, int locked) {
    if (locked && !f->locked) f->locked_at = f->last_bright;
    f->locked = locked;
}

/* 3. What goes on before the lens */

/* A wall without a pattern, a little brighter on one side. */
static void draw_wall(const sf_sim_frames *f) {
    size_t width = (size_t)f->sim.width, pixels = width * (size_t)f->sim.height;
    for (size_t i = 0; i < pixels; i++) {
        float light = 0.4f + 0.04f * (float)(i % width) / (float)width;
        for (size_t c = 0; c < 3; c++) f->linear[3 * i + c] = light;
        if (f->depth) f->depth[i] = 1;
    }
}

/* A striped ball that swings through the picture and covers a part of it. */
static void draw_mover(const sf_sim_frames *f, double seconds) {
    int width = f->sim.width, height = f->sim.height;
    double radius = sqrt(f->sim.mover_part * width * height / pi), reach = fmax(width / 2.0 - radius, 0);
    double x = width / 2.0 + reach * sin(2 * pi * seconds / 5), y = height * (0.5 + 0.1 * cos(seconds));
    for (int j = 0; j < height; j++)
        for (int i = 0; i < width; i++) {
            double u = (i + 0.5 - x) / radius, v = (j + 0.5 - y) / radius, out = u * u + v * v;
            if (out >= 1) continue;
            size_t at = (size_t)j * (size_t)width + (size_t)i;
            double shade = 0.25 + 0.75 * sqrt(1 - out) * (0.75 - 0.25 * v);
            int dark = whole_below(5 * (u + 0.6 * v) + seconds) & 1;
            f->linear[3 * at] = (float)(shade * (dark ? 0.05 : 0.7));
            f->linear[3 * at + 1] = (float)(shade * (dark ? 0.12 : 0.55));
            f->linear[3 * at + 2] = (float)(shade * (dark ? 0.3 : 0.2));
            f->depth[at] = 1;
        }
}

/* The scene's motion before the camera while it is exposed for `time` seconds. */
static sf_motion motion_at(const sf_sim_frames *f, const sf_sim_moment *m, double time) {
    const double shake = 0.06; /* radians */
    double half = time / 2 / sf_sim_period(&f->sim);
    sf_camera from, to;
    camera_at(f, m->place - half, m->seconds - time / 2, &from);
    camera_at(f, m->place + half, m->seconds + time / 2, &to);
    sf_motion motion = sf_motion_between(&from, &to);
    if (sf_span_holds(f->sim.smear, m->seconds)) {
        double angle = 2 * pi * chance(f, m->number, 2);
        motion.turn[0] += shake * sin(angle);
        motion.turn[1] += shake * cos(angle);
    }
    return motion;
}

/* 4. A frame */

static const float *light_of(sf_sim_frames *f, const sf_camera *camera, const sf_sim_moment *m, double time) {
    const int usual = 5, heavy = 25; /* pictures that blur is the mean of */
    int smear = sf_span_holds(f->sim.smear, m->seconds);
    if (sf_span_holds(f->sim.black, m->seconds)) {
        memset(f->linear, 0, 3 * (size_t)f->sim.width * (size_t)f->sim.height * sizeof *f->linear);
        return f->linear;
    }
    if (sf_span_holds(f->sim.wall, m->seconds))
        draw_wall(f);
    else
        draw(f, camera, f->linear, f->depth);
    if (sf_span_holds(f->sim.mover, m->seconds)) draw_mover(f, m->seconds);
    if (!f->sim.blur && !smear) return f->linear;
    sf_motion motion = motion_at(f, m, time);
    sf_sensor_smear(f->ctx->pool, camera, &motion, smear ? heavy : usual, f->linear, f->depth, f->smeared);
    return f->smeared;
}

void sf_sim_take(sf_sim_frames *f, const sf_sim_moment *m, uint8_t *data, sf_frame *frame) {
    double bright = brightness(f, m), time = fmin(bright, 1), gain = fmax(bright, 1);
    double exposure_s = time * FULL_TIME_MS * 1e-3;
    sf_camera camera;
    f->last_bright = bright;
    camera_at(f, m->place, m->seconds, &camera);
    sf_sim_to_world(&f->sim, &camera, &frame->camera);
    sf_exposure e = {.curve = &f->curve,
                     .linear = light_of(f, &camera, m, exposure_s),
                     .width = camera.width,
                     .height = camera.height,
                     .time = time,
                     .gain = gain,
                     .noise = f->sim.noise,
                     .seed = f->sim.seed * 0x2545f4914f6cdd1du + m->number};
    sf_sensor_expose(f->ctx->pool, &e, data);
    frame->exposure_s = f->sim.sensor ? exposure_s : 0;
    frame->gain = f->sim.sensor ? gain : 0;
}

/* 5. Begin and end */

static int needs_depth(const sf_sim *sim) {
    return sim->blur || sim->smear.from >= 0 || sim->mover.from >= 0;
}

static sf_status take_memory(sf_sim_frames *f) {
    size_t pixels = (size_t)f->sim.width * (size_t)f->sim.height;
    if (!(f->linear = sf_alloc(f->ctx, pixels, 3 * sizeof *f->linear))) return SF_ERR_MEMORY;
    if (!needs_depth(&f->sim)) return SF_OK;
    f->depth = sf_alloc(f->ctx, pixels, sizeof *f->depth);
    f->smeared = sf_alloc(f->ctx, pixels, 3 * sizeof *f->smeared);
    return f->depth && f->smeared ? SF_OK : SF_ERR_MEMORY;
}

/* Textures as fine as the path needs them. */
static sf_status bake(sf_sim_frames *f) {
    enum { EYES = 60 };
    sf_vec3 eyes[EYES];
    sf_camera camera;
    for (int i = 0; i < EYES; i++) {
        double center[3];
        sf_sim_studio_camera(&f->sim, (double)f->sim.frames * i / EYES, &camera);
        sf_camera_center(&camera, center);
        eyes[i] = vec3(center[0], center[1], center[2]);
    }
    size_t pixels = (size_t)f->sim.width * (size_t)f->sim.height;
    if (pixels < METER_WIDTH * METER_HEIGHT) pixels = METER_WIDTH * METER_HEIGHT;
    return sf_baked_create(f->ctx, &f->sim.studio, eyes, EYES, camera.fx, pixels, &f->baked);
}

sf_status sf_sim_frames_init(sf_context *ctx, const char *name, sf_sim_frames *f) {
    memset(f, 0, sizeof *f);
    f->ctx = ctx;
    sf_status status = sf_sim_init(ctx, name, &f->sim);
    if (status == SF_OK) status = take_memory(f);
    if (status == SF_OK && !f->sim.exact) status = bake(f);
    if (status != SF_OK) {
        sf_sim_frames_free(f);
        return status;
    }
    sf_sensor_curve_init(&f->curve);
    f->last_bright = 1;
    if (f->sim.auto_exposure) meter(f);
    return SF_OK;
}

void sf_sim_frames_free(sf_sim_frames *f) {
    sf_baked_destroy(&f->baked);
    sf_free(f->ctx, f->linear);
    sf_free(f->ctx, f->smeared);
    sf_free(f->ctx, f->depth);
    f->linear = f->smeared = f->depth = NULL;
}
