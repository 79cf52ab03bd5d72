/* row_growth.c - rows 8 and 10: what growth does to the quality, and what pictures that nothing explains do
 * to growth. */
#include <math.h>
#include <stdlib.h>

#include "fit/fitter.h"
#include "fits.h"

/* ---- row 8
 * -------------------------------------------------------------------------------------------------
 */

enum { EVERY = 100, LOOK = 10, GROWTH_STEPS = 700, RESET_AT = 500 };

/* As published: every opacity down to 0.01. */
static void reset_opacities(sf_fitter *f) {
    float *logit = f->model->params.field[SF_FIELD_logit_opacity], low = logf(0.01f / 0.99f);
    for (size_t i = 0; i < f->model->count; i++) logit[i] = fminf(logit[i], low);
}

/* The held-out PSNR at steps[i]: after each LOOK-th step, and the step before. */
typedef struct course {
    size_t count;
    double steps[STAB_LOOKS], psnr[STAB_LOOKS];
} course;

static course follow(sf_context *ctx, sf_scene *scene, const sf_fit_options *options, int reset) {
    course c = {0};
    sf_fitter *fitter;
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, options, &fitter));
    for (int64_t step = 1; step <= options->steps; step++) {
        assert_ok(ctx, sf_fitter_step(fitter));
        if (reset && step == RESET_AT) reset_opacities(fitter);
        if (step % LOOK && (step + 1) % EVERY) continue;
        assert_true(c.count < STAB_LOOKS);
        c.steps[c.count] = (double)step;
        c.psnr[c.count++] = test_held_out(ctx, scene, fitter).psnr;
    }
    sf_fitter_destroy(&fitter);
    return c;
}

typedef struct dip {
    double fall, steps; /* dB under the look before; steps until it is reached for good */
} dip;

/* After the look `at`, which follows a change, until `end` steps. */
static dip dip_at(const course *c, size_t at, double end) {
    double before = c->psnr[at - 1], least = c->psnr[at], below = 0;
    size_t i = at;
    for (; i < c->count && c->steps[i] < end; i++) {
        least = fmin(least, c->psnr[i]);
        if (c->psnr[i] < before) below = c->steps[i] + LOOK - c->steps[at];
    }
    return (dip){fmax(before - least, 0), c->psnr[i - 1] < before ? INFINITY : below};
}

static void through_growth(stab_run *run, const char *name, sf_context *ctx, sf_scene *scene,
                           const sf_fit_options *options, double most) {
    course ours = follow(ctx, scene, options, 0), textbook = follow(ctx, scene, options, 1);
    dip worst = {0}, reset = {0};
    for (size_t i = 1; i < ours.count; i++) {
        if ((int64_t)ours.steps[i] % EVERY || ours.steps[i] > 0.5 * (double)options->steps) continue;
        dip d = dip_at(&ours, i, ours.steps[i] + EVERY);
        worst = (dip){fmax(worst.fall, d.fall), fmax(worst.steps, d.steps)};
    }
    for (size_t i = 1; i < textbook.count; i++)
        if ((int64_t)textbook.steps[i] == RESET_AT) reset = dip_at(&textbook, i, INFINITY);
    stab_chart_begin(run, name, (stab_axis){"steps (1)", 0}, (stab_axis){"held-out PSNR (dB)", 0});
    stab_series_begin(run, STAB_OURS, "growth alone, every %d steps", EVERY);
    for (size_t i = 0; i < ours.count; i++) stab_point(run, ours.steps[i], ours.psnr[i]);
    stab_series_begin(run, STAB_TEXTBOOK, "textbook: and a reset of opacities after %d", RESET_AT);
    for (size_t i = 0; i < textbook.count; i++) stab_point(run, textbook.steps[i], textbook.psnr[i]);
    stab_at_most(run, worst.fall, most, "dB", "%s: largest fall at a growth", name);
    stab_textbook(run, reset.fall);
    stab_at_most(run, worst.steps, EVERY, "steps", "%s: most steps to recover", name);
    stab_textbook(run, reset.steps);
}

static void growths(stab_run *run) {
    sf_context *ctx = test_context();
    sf_scene *studio = stab_load(ctx, "sim:studio?width=120&height=90&frames=24", 4, 1);
    sf_fit_options options = stab_fit_options(GROWTH_STEPS, 6000);
    options.validate = 0, options.densify_every = EVERY;
    through_growth(run, "studio", ctx, studio, &options, 0.1);
    options.max_gaussians = 20000; /* most of them are new ones */
    through_growth(run, "studio, crowded", ctx, studio, &options, 0.5);
    sf_scene_destroy(&studio);
    sf_context_destroy(&ctx);
}

const stab_row stab_row_8 = {
    .id = "8",
    .failure = "An opacity reset: the quality falls by several dB, and is long in coming back",
    .cure =
        "Opacities are never reset; what is faint goes; growth leaves the picture nearly as it was, and new "
        "Gaussians begin with a part of their parents' squares in Adam: with none they would leap.",
    .run = growths,
};

/* ---- row 10
 * ------------------------------------------------------------------------------------------------
 */

enum { SIDE = 64, NOISE_VIEWS = 16, CAP = 2000 };

static sf_scene *noise_scene(sf_context *ctx) {
    static uint8_t rgb[3 * SIDE * SIDE];
    sf_rng rng;
    sf_scene *scene;
    sf_rng_seed(&rng, 7);
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    for (int v = 0; v < NOISE_VIEWS; v++) {
        sf_camera camera = test_camera_around(v, NOISE_VIEWS, SIDE, SIDE);
        for (size_t i = 0; i < sizeof rgb; i++) rgb[i] = (uint8_t)sf_rng_below(&rng, 256);
        sf_pixels pixels = {.rgb = rgb, .stride = 3 * (size_t)SIDE};
        assert_ok(ctx, sf_scene_add_view(scene, NULL, &camera, &pixels,
                                         v % 8 ? SF_SPLIT_TRAIN : SF_SPLIT_TEST, NULL));
    }
    return scene;
}

static void noise(stab_run *run, sf_context *ctx) {
    static const char *const names[] = {"what pays, up to the cap", "to the cap"};
    sf_scene *scene = noise_scene(ctx);
    stab_chart_begin(run, "Gaussians in a fit of noise", (stab_axis){"steps (1)", 0},
                     (stab_axis){"Gaussians (1)", 0});
    for (int size = SF_SIZE_AUTO; size <= SF_SIZE_CAP; size++) {
        sf_fit_options options = stab_fit_options(1000, CAP);
        options.size = size, options.init_random = 500, options.densify_per_step = 1e6,
        options.densify_every = 20;
        stab_fit fit = stab_fit_scene(ctx, scene, &options, 50, NULL);
        stab_series_begin(run, STAB_OURS, "%s", names[size]);
        for (size_t i = 0; i < fit.looks; i++) stab_point(run, fit.steps[i], fit.gaussians[i]);
        stab_at_most(run, (double)fit.most, CAP, "", "noise, %s: most Gaussians after any step", names[size]);
        stab_at_most(run, (double)fit.progress.skipped_values, 0, "", "noise, %s: values not finite",
                     names[size]);
    }
    stab_bound_line(run, CAP, "max_gaussians");
    sf_scene_destroy(&scene);
}

/* The scene in another unit of length. */
static void rescale(sf_scene *scene, double by) {
    for (size_t i = 0; i < scene->view_count; i++)
        for (int k = 0; k < 3; k++) scene->views[i]->camera.t_cw[k] *= by;
    for (size_t i = 0; i < 3 * scene->point_count; i++)
        scene->points[i] = (float)((double)scene->points[i] * by);
}

static void units(stab_run *run, sf_context *ctx) {
    static const double scales[] = {1, 1e-3, 1e3};
    enum { SCALES = sizeof scales / sizeof *scales, SEEDS = 3 };
    double mean[SCALES] = {0};
    for (size_t i = 0; i < SCALES; i++) {
        sf_scene *scene = stab_load(ctx, "sim:studio?width=80&height=60&frames=24", 4, 1);
        rescale(scene, scales[i]);
        for (int seed = 1; seed <= SEEDS; seed++) {
            sf_fit_options options = stab_fit_options(500, 2000);
            options.seed = seed;
            mean[i] += stab_fit_scene(ctx, scene, &options, 0, NULL).quality.psnr / SEEDS;
        }
        sf_scene_destroy(&scene);
    }
    stab_chart_begin(run, "The studio in other units of length", (stab_axis){"size of the scene (1)", 1},
                     (stab_axis){"held-out PSNR (dB)", 0});
    stab_series_begin(run, STAB_OURS, "mean of %d seeds", SEEDS);
    for (size_t i = 0; i < SCALES; i++) stab_point(run, scales[i], mean[i]);
    for (size_t i = 1; i < SCALES; i++)
        stab_at_most(run, fabs(mean[i] - mean[0]), 0.1, "dB", "studio times %g: held-out PSNR apart",
                     scales[i]);
}

static void explosions(stab_run *run) {
    sf_context *ctx = test_context();
    noise(run, ctx);
    units(run, ctx);
    sf_context_destroy(&ctx);
}

const stab_row stab_row_10 = {
    .id = "10",
    .failure = "Densification explodes: pictures of noise, the scene's unit",
    .cure = "A hard cap after every step; every length has a local unit (L1 to L4).",
    .run = explosions,
};
