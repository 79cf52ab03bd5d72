/* row_size.c - rows S1 and S2: as many Gaussians as a scene needs, by how much there is in it. */
#include <math.h>

#include "base/rng.h"
#include "blobs.h"
#include "fits.h"
#include "render/workspace.h"

/* Fitted as whoever knows nothing of the scene would. */
static stab_fit fit_unknown(sf_context *ctx, sf_scene *scene, int64_t steps, int background) {
    sf_fit_options options = sf_fit_options_default();
    options.steps = steps;
    options.init = SF_INIT_RANDOM;
    options.init_random = 1000;
    options.background = background;
    return stab_fit_scene(ctx, scene, &options, 0, NULL);
}

/* ---- row S1 -----------------------------------------------------------------------------------------------
 */

static void count_blobs(stab_run *run) {
    static const size_t counts[] = {1, 2, 5, 10, 20, 50, 100, 200, 500};
    enum { COUNTS = sizeof counts / sizeof *counts, STEPS = 6000 };
    double found[COUNTS], least = INFINITY, worst = 0, few = 0;
    sf_context *ctx = test_context_threads(0);
    for (size_t i = 0; i < COUNTS; i++) {
        sf_scene *scene = test_blob_scene(ctx, counts[i], 0);
        stab_fit fit = fit_unknown(ctx, scene, STEPS, SF_BACKGROUND_BLACK);
        double off = fabs((found[i] = (double)fit.progress.gaussians) - (double)counts[i]);
        if (counts[i] <= 5)
            few = fmax(few, off);
        else
            worst = fmax(worst, 100 * off / (double)counts[i]);
        least = fmin(least, fit.quality.psnr);
        sf_scene_destroy(&scene);
    }
    stab_at_most(run, few, 1, "", "1 to 5 blobs: Gaussians too many or too few");
    stab_at_most(run, worst, 20, "%", "10 to 500 blobs: Gaussians too many or too few");
    stab_at_least(run, least, 40, "dB", "1 to 500 blobs: held-out PSNR");
    stab_chart_begin(run, "Blobs that stand apart, from 1,000 random first points",
                     (stab_axis){"blobs (1)", 1}, (stab_axis){"Gaussians (1)", 1});
    stab_series_begin(run, STAB_OURS, "chosen");
    for (size_t i = 0; i < COUNTS; i++) stab_point(run, (double)counts[i], found[i]);
    stab_series_begin(run, STAB_TEXTBOOK, "as many as there are");
    for (size_t i = 0; i < COUNTS; i++) stab_point(run, (double)counts[i], (double)counts[i]);
    sf_context_destroy(&ctx);
}

const stab_row stab_row_S1 = {
    .id = "S1",
    .failure = "More Gaussians than the scene has",
    .cure = "Each pays for itself, and pairs that one can stand for become one.",
    .run = count_blobs,
};

/* ---- row S2 -----------------------------------------------------------------------------------------------
 */

enum { SIDE = 128, VIEWS = 20, HELD_OUT = 5, WAVES = 8, SAMPLES = 3 };

/* A plane's texture: per channel so many waves, in cycles a world unit, between half the bandwidth and all of
 * it. */
typedef struct texture {
    double wave[SF_CHANNELS][WAVES][2], phase[SF_CHANNELS][WAVES];
} texture;

static texture texture_of(double bandwidth) {
    const double around = 6.283185307179586;
    texture t;
    sf_rng rng;
    sf_rng_seed(&rng, 11);
    for (int ch = 0; ch < SF_CHANNELS; ch++)
        for (int k = 0; k < WAVES; k++) {
            double turn = around * sf_rng_uniform(&rng), f = bandwidth * (0.5 + 0.5 * sf_rng_uniform(&rng));
            t.wave[ch][k][0] = around * f * cos(turn), t.wave[ch][k][1] = around * f * sin(turn);
            t.phase[ch][k] = around * sf_rng_uniform(&rng);
        }
    return t;
}

static double texture_at(const texture *t, int ch, const double at[2]) {
    double sum = 0;
    for (int k = 0; k < WAVES; k++)
        sum += sin(t->wave[ch][k][0] * at[0] + t->wave[ch][k][1] * at[1] + t->phase[ch][k]);
    return fmin(fmax(0.5 + 0.2 * sum / sqrt(WAVES / 2.0), 0), 1);
}

/* Looks at the plane z = 0 from 2.5 above it, at most 25 degrees from upright, so that nothing but the plane
 * is seen. */
static sf_camera camera_above(int view, int views, double twist) {
    double tilt = 0.44 * sqrt((view + 0.5) / views), turn = 2.39996323 * view + twist;
    const double ahead[3] = {-sin(tilt) * cos(turn), -sin(tilt) * sin(turn), -cos(tilt)};
    const double right[3] = {-sin(turn), cos(turn), 0};
    sf_camera camera = {.width = SIDE,
                        .height = SIDE,
                        .fx = 1.2 * SIDE,
                        .fy = 1.2 * SIDE,
                        .cx = SIDE / 2.0,
                        .cy = SIDE / 2.0,
                        .t_cw = {0, 0, 2.5}};
    test_turn_camera(&camera, right, ahead);
    return camera;
}

/* The mean over a pixel of what its rays meet on the plane. */
static void draw_plane(const sf_camera *c, const texture *t, uint8_t *rgb) {
    double center[3];
    sf_camera_center(c, center);
    for (int i = 0; i < SIDE * SIDE; i++) {
        double sum[SF_CHANNELS] = {0};
        for (int s = 0; s < SAMPLES * SAMPLES; s++) {
            double x = (i % SIDE + (s % SAMPLES + 0.5) / SAMPLES - c->cx) / c->fx, to[3];
            double y = ((double)(i / SIDE) + ((double)(s / SAMPLES) + 0.5) / SAMPLES - c->cy) / c->fy;
            for (int k = 0; k < 3; k++) to[k] = c->R_cw[k] * x + c->R_cw[3 + k] * y + c->R_cw[6 + k];
            double far = -center[2] / to[2], at[2] = {center[0] + far * to[0], center[1] + far * to[1]};
            for (int ch = 0; ch < SF_CHANNELS; ch++) sum[ch] += texture_at(t, ch, at);
        }
        for (int ch = 0; ch < SF_CHANNELS; ch++)
            rgb[SF_CHANNELS * i + ch] = (uint8_t)lrint(255 * sum[ch] / (SAMPLES * SAMPLES));
    }
}

static sf_scene *plane(sf_context *ctx, double bandwidth) {
    static uint8_t rgb[SF_CHANNELS * SIDE * SIDE];
    texture t = texture_of(bandwidth);
    sf_scene *scene;
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    for (int v = 0; v < VIEWS + HELD_OUT; v++) {
        int held_out = v >= VIEWS;
        sf_camera camera = held_out ? camera_above(v - VIEWS, HELD_OUT, 1) : camera_above(v, VIEWS, 0);
        sf_pixels pixels = {.rgb = rgb, .stride = SF_CHANNELS * (size_t)SIDE};
        assert_ok(ctx, (sf_status)sf_camera_check(&camera));
        draw_plane(&camera, &t, rgb);
        assert_ok(ctx, sf_scene_add_view(scene, NULL, &camera, &pixels,
                                         held_out ? SF_SPLIT_TEST : SF_SPLIT_TRAIN, NULL));
    }
    return scene;
}

static void textured_plane(stab_run *run) {
    static const double bandwidths[] = {1, 2, 4, 8}; /* cycles a world unit; 61 px */
    enum { COUNTS = sizeof bandwidths / sizeof *bandwidths, STEPS = 3000 };
    double found[COUNTS], growth = INFINITY, least = INFINITY;
    sf_context *ctx = test_context_threads(0);
    for (size_t i = 0; i < COUNTS; i++) {
        sf_scene *scene = plane(ctx, bandwidths[i]);
        stab_fit fit = fit_unknown(ctx, scene, STEPS, SF_BACKGROUND_AUTO);
        found[i] = (double)fit.progress.gaussians;
        if (i) growth = fmin(growth, found[i] / found[i - 1]);
        least = fmin(least, fit.quality.psnr);
        stab_shown(run, fit.quality.psnr, "dB", "%g cycles a unit: %zu Gaussians; held-out PSNR",
                   bandwidths[i], fit.progress.gaussians);
        sf_scene_destroy(&scene);
    }
    stab_at_least(run, growth, 1.5, "", "twice the bandwidth: so many times the Gaussians, at least");
    stab_at_least(run, least, 30, "dB", "all: held-out PSNR");
    stab_chart_begin(run, "A plane with a texture", (stab_axis){"bandwidth (cycles a world unit)", 1},
                     (stab_axis){"Gaussians (1)", 1});
    stab_series_begin(run, STAB_OURS, "chosen");
    for (size_t i = 0; i < COUNTS; i++) stab_point(run, bandwidths[i], found[i]);
    sf_context_destroy(&ctx);
}

const stab_row stab_row_S2 = {
    .id = "S2",
    .failure = "The same number of Gaussians, whatever there is to see",
    .cure = "Growth goes on while it takes away from the error, and each pays for itself.",
    .run = textured_plane,
};
