/* live_walk_fixture.c - see the header. */
#include "live_walk_fixture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/linear.h"
#include "sim/baked.h"
#include "sim/sensor.h"

void live_walk_open(const char *name, int frames, int steps_per_frame, live_walk *w) {
    *w = (live_walk){.ctx = test_context_threads(2), .source_ctx = test_context_threads(1), .frames = frames};
    sf_live_options o = sf_live_options_default();
    sf_live_frame frame = {.number = 0};
    assert_ok(w->source_ctx, sf_source_open(w->source_ctx, name, &w->source));
    o.own_poses = 1;
    o.steps_per_frame = steps_per_frame;
    o.fit.steps = (int64_t)(frames + 1) * steps_per_frame;
    o.fit.max_gaussians = 15000;
    assert_ok(w->ctx, sf_live_create(w->ctx, w->source, &o, &w->live));
    while (frame.number < (uint64_t)frames) {
        assert_ok(w->ctx, sf_live_step(w->live));
        sf_live_get_frame(w->live, &frame);
    }
    w->live->options.own_poses = 0;
    assert_ok(w->ctx, sf_sim_frames_init(w->ctx, name, &w->sim));
    size_t pixels = (size_t)w->sim.sim.width * (size_t)w->sim.sim.height;
    w->linear = malloc(3 * pixels * sizeof *w->linear), w->depth = malloc(pixels * sizeof *w->depth);
    w->planes = malloc(3 * pixels * sizeof *w->planes), w->data = malloc(3 * pixels);
    assert_true(w->linear && w->depth && w->planes && w->data);
}

void live_walk_close(live_walk *w) {
    void *const blocks[] = {w->linear, w->depth, w->planes, w->data};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) free(blocks[i]);
    sf_sim_frames_free(&w->sim);
    sf_live_destroy(&w->live);
    sf_source_close(&w->source);
    sf_context_destroy(&w->source_ctx);
    sf_context_destroy(&w->ctx);
}

/* Turned about the vertical through a place. */
static void swing(sf_camera *c, const double about[3], double angle) {
    const double phi[3] = {0, 0, angle};
    double center[3], off[3], Q[9], moved[3], R[9];
    sf_camera_center(c, center);
    sf_rotation_exp(phi, Q);
    for (int k = 0; k < 3; k++) off[k] = center[k] - about[k];
    sf_mat3_vec(Q, off, moved);
    for (int k = 0; k < 3; k++) moved[k] += about[k];
    for (int k = 0; k < 9; k++) R[k] = sf_dot3(c->R_cw + k / 3 * 3, Q + k % 3 * 3);
    memcpy(c->R_cw, R, sizeof R);
    for (int k = 0; k < 3; k++) c->t_cw[k] = -sf_dot3(R + 3 * k, moved);
}

sf_camera live_walk_camera(const live_walk *w, double frame, double swung, double turned) {
    sf_camera c;
    double at[3];
    double unit = w->sim.sim.has_board ? w->sim.sim.board.unit_m : 1;
    sf_sim_studio_camera(&w->sim.sim, frame, &c);
    sf_camera_center(&c, at);
    swing(&c, at, turned);
    for (int k = 0; k < 3; k++) at[k] += w->live->localizer.distance / unit * c.R_cw[6 + k];
    swing(&c, at, swung);
    return c;
}

static void take(live_walk *w, const sf_camera *studio, uint64_t seed) {
    size_t pixels = (size_t)studio->width * (size_t)studio->height;
    const sf_exposure e = {.curve = &w->sim.curve,
                           .linear = w->linear,
                           .width = studio->width,
                           .height = studio->height,
                           .time = 1,
                           .gain = 1,
                           .noise = 1,
                           .seed = seed};
    sf_baked_draw(w->sim.baked, studio, w->linear, w->depth);
    sf_sensor_expose(w->ctx->pool, &e, w->data);
    w->picture = (sf_picture){.camera = *studio, .has_truth = 1};
    w->picture.time_ns = w->live->localizer.pose_ns + 100000000;
    sf_sim_to_world(&w->sim.sim, studio, &w->picture.truth);
    for (size_t k = 0; k < 3; k++) w->picture.rgb[k] = w->planes + k * pixels;
    for (size_t i = 0; i < 3 * pixels; i++)
        w->planes[i % 3 * pixels + i / 3] = (float)w->data[i] * (1 / 255.0f);
    w->live->input.picture = &w->picture;
}

int live_walk_find(live_walk *w, const sf_camera *studio, int tries) {
    for (int i = 1; i <= tries; i++) {
        sf_localizer *l = &w->live->localizer;
        take(w, studio, (uint64_t)i);
        l->state = SF_LIVE_LOST;
        l->poses = 0, l->misses = 2 + i, l->doubts = 6;
        assert_ok(w->ctx, sf_live_localize(w->live));
        if (w->live->input.frame.from == SF_POSE_TRACK) return i;
    }
    return 0;
}

static double angle_between(const double a[9], const double b[9]) {
    double trace = 0;
    for (int k = 0; k < 9; k++) trace += a[k] * b[k];
    return acos(fmin(fmax((trace - 1) / 2, -1), 1));
}

void live_walk_error(const live_walk *w, double *angle, double *apart) {
    const sf_camera *a = &w->live->input.frame.camera, *b = &w->live->input.frame.truth;
    double here[3], there[3], moved = 0;
    sf_camera_center(a, here), sf_camera_center(b, there);
    for (int k = 0; k < 3; k++) moved += pow(here[k] - there[k], 2);
    *angle = angle_between(a->R_cw, b->R_cw);
    *apart = sqrt(moved) / w->live->localizer.distance;
}

double live_walk_nearest(const live_walk *w) {
    double least = INFINITY;
    for (size_t i = 0; i < w->live->keyframes.count; i++)
        least = fmin(least, angle_between(w->picture.truth.R_cw, w->live->keyframes.list[i].pose.R));
    return least;
}
