/* sim.c - a simulated camera that is carried around a simulated scene. */
#include "sim.h"

#include <stdio.h>
#include <string.h>

#include "../base/pool.h"
#include "../base/rng.h"
#include "pace.h"

static const double pi = 3.141592653589793;

/* 1. The name */

sf_status sf_sim_init(sf_context *ctx, const char *name, sf_sim *sim) {
    enum { WIDTH, HEIGHT, FRAMES, SEED, FOV, FPS, LOOP, OPTIONS };
    sf_source_option options[OPTIONS] = {
        [WIDTH] = {.name = "width", .value = 320, .least = 16, .most = 4096, .whole = 1},
        [HEIGHT] = {.name = "height", .value = 240, .least = 16, .most = 4096, .whole = 1},
        [FRAMES] = {.name = "frames", .value = 60, .least = 1, .most = 10000, .whole = 1},
        [SEED] = {.name = "seed", .value = 1, .most = 0x1p53, .whole = 1},
        [FOV] = {.name = "fov", .value = 50, .least = 10, .most = 120},
        [FPS] = {.name = "fps", .most = 1000},
        [LOOP] = {.name = "loop", .most = 1, .whole = 1},
    };
    size_t length = strcspn(name, "?");
    if (length != strlen("sim:studio") || memcmp(name, "sim:studio", length) != 0)
        return sf_fail(ctx, SF_ERR_ARGUMENT, "%s: unknown simulated scene; known: sim:studio", name);
    sf_status status = sf_source_parse_options(ctx, name, options, OPTIONS);
    if (status != SF_OK) return status;
    sim->width = (int32_t)options[WIDTH].value;
    sim->height = (int32_t)options[HEIGHT].value;
    sim->frames = (uint64_t)options[FRAMES].value;
    sim->seed = (uint64_t)options[SEED].value;
    sim->fov = options[FOV].value;
    sim->fps = options[FPS].value;
    sim->loop = options[LOOP].value != 0;
    sf_rng rng;
    sf_rng_seed(&rng, sim->seed);
    for (int i = 0; i < 6; i++) sim->phase[i] = 2 * pi * sf_rng_uniform(&rng);
    sf_studio_init(&sim->studio);
    return SF_OK;
}

/* 2. The path */

/* One of six wobbles of size 1 that close with the loop. */
static double sway(const sf_sim *sim, int which, double turn) {
    return sin((3 + which) * turn + sim->phase[which]);
}

/* Looks from `from` to `at` with the horizon turned by `roll` radians. */
static void aim(sf_camera *camera, sf_vec3 from, sf_vec3 at, double roll) {
    sf_vec3 forward = vunit(vsub(at, from)), right = vunit(vcross(forward, vec3(0, 0, 1)));
    sf_vec3 down = vcross(forward, right);
    sf_vec3 rows[3] = {vat(vscale(right, cos(roll)), sin(roll), down),
                       vat(vscale(down, cos(roll)), -sin(roll), right), forward};
    for (int i = 0; i < 3; i++) {
        camera->R_cw[3 * i] = rows[i].x;
        camera->R_cw[3 * i + 1] = rows[i].y;
        camera->R_cw[3 * i + 2] = rows[i].z;
        camera->t_cw[i] = -vdot(rows[i], from);
    }
}

void sf_sim_camera(const sf_sim *sim, uint64_t frame, sf_camera *camera) {
    const double degree = pi / 180;
    double turn = 2 * pi * (double)frame / (double)sim->frames;
    double azimuth = 100 * degree * sin(turn) + 0.02 * sway(sim, 0, turn);
    double elevation = (25 - 12 * cos(turn)) * degree + 0.02 * sway(sim, 1, turn);
    double radius = 4.3 + 0.08 * sway(sim, 2, turn);
    sf_vec3 middle = {0.03 * sway(sim, 3, turn), 0.03 * sway(sim, 4, turn), 0.78};
    sf_vec3 offset = {sin(azimuth) * cos(elevation), -cos(azimuth) * cos(elevation), sin(elevation)};
    double focal = sim->width / 2.0 / tan(sim->fov / 2 * degree);
    *camera = (sf_camera){.width = sim->width,
                          .height = sim->height,
                          .fx = focal,
                          .fy = focal,
                          .cx = sim->width / 2.0,
                          .cy = sim->height / 2.0};
    aim(camera, vat(middle, radius, offset), middle, 0.015 * sway(sim, 5, turn));
}

/* 3. The sensor */

static uint8_t srgb8(float linear) {
    double v = fmin(fmax((double)linear, 0), 1);
    v = v <= 0.0031308 ? 12.92 * v : 1.055 * pow(v, 1 / 2.4) - 0.055;
    return (uint8_t)(255 * v + 0.5);
}

typedef struct exposure {
    const float *linear;
    uint8_t *data;
    size_t stride;
} exposure;

static void expose_row(void *arg, size_t row, int thread) {
    const exposure *e = arg;
    (void)thread;
    for (size_t i = row * e->stride; i < (row + 1) * e->stride; i++) e->data[i] = srgb8(e->linear[i]);
}

/* 4. The source */

typedef struct sim_source {
    sf_context *ctx;
    sf_sim sim;
    sf_pace pace;
    float *linear; /* [height][width][3] */
    uint8_t *frames[SF_SOURCE_MAX_LEASES];
    int taken[SF_SOURCE_MAX_LEASES];
} sim_source;

static void sim_close(void *self) {
    sim_source *s = self;
    for (int i = 0; i < SF_SOURCE_MAX_LEASES; i++) sf_free(s->ctx, s->frames[i]);
    sf_free(s->ctx, s->linear);
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
    snprintf(info->name, sizeof info->name, "simulated studio, %dx%d", (int)s->sim.width, (int)s->sim.height);
}

static sf_status sim_next(void *self, int timeout_ms, int newest, sf_frame *frame, sf_source_counts *counts) {
    sim_source *s = self;
    uint64_t number;
    int64_t time_ns;
    sf_status status =
        sf_pace_next(&s->pace, s->ctx, "sim:studio", timeout_ms, newest, counts, &number, &time_ns);
    if (status != SF_OK) return status;
    int slot = s->taken[0] ? 1 : 0;
    frame->plane[0] = s->frames[slot];
    frame->stride[0] = 3 * (size_t)s->sim.width;
    frame->width = s->sim.width;
    frame->height = s->sim.height;
    frame->format = SF_PIXEL_RGB24;
    frame->sequence = number;
    frame->time_ns = time_ns;
    frame->has_camera = 1;
    frame->lease = &s->taken[slot];
    sf_sim_camera(&s->sim, number % s->sim.frames, &frame->camera);
    sf_studio_draw(&s->sim.studio, s->ctx->pool, &frame->camera, s->linear, NULL);
    exposure e = {s->linear, s->frames[slot], frame->stride[0]};
    sf_pool_run(s->ctx->pool, (size_t)s->sim.height, expose_row, &e);
    s->taken[slot] = 1;
    return SF_OK;
}

static void sim_release(void *self, sf_frame *frame) {
    (void)self;
    *(int *)frame->lease = 0;
}

sf_status sf_sim_open(sf_context *ctx, const char *name, sf_source *source) {
    static const sf_source_ops ops = {sim_close, sim_describe, sim_next, sim_release};
    sim_source *s = sf_calloc(ctx, 1, sizeof *s);
    if (!s) return SF_ERR_MEMORY;
    s->ctx = ctx;
    sf_status status = sf_sim_init(ctx, name, &s->sim);
    s->pace = (sf_pace){.fps = s->sim.fps, .frames = s->sim.loop ? 0 : s->sim.frames};
    size_t size = status == SF_OK ? 3 * (size_t)s->sim.width * (size_t)s->sim.height : 0;
    for (int i = 0; i < SF_SOURCE_MAX_LEASES && status == SF_OK; i++)
        if (!(s->frames[i] = sf_alloc(ctx, size, 1))) status = SF_ERR_MEMORY;
    if (status == SF_OK && !(s->linear = sf_alloc(ctx, size, sizeof *s->linear))) status = SF_ERR_MEMORY;
    if (status != SF_OK) {
        sim_close(s);
        return status;
    }
    source->ops = &ops;
    source->self = s;
    return SF_OK;
}
