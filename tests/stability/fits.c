/* fits.c - what experiments share that are whole fits. */
#include "fits.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

sf_fit_options stab_fit_options(int64_t steps, int64_t max_gaussians) {
    sf_fit_options options = sf_fit_options_default();
    options.steps = steps;
    options.max_gaussians = max_gaussians;
    options.size = SF_SIZE_CAP;
    return options;
}

typedef struct watch {
    sf_context *ctx;
    sf_scene *scene;
    sf_fitter *fitter;
    stab_fit *fit;
    int64_t every;
} watch;

static void look(watch *w, const sf_fit_progress *p) {
    stab_fit *fit = w->fit;
    assert_true(fit->looks < STAB_LOOKS);
    fit->quality = test_held_out(w->ctx, w->scene, w->fitter);
    fit->steps[fit->looks] = (double)p->step;
    fit->psnr[fit->looks] = fit->quality.psnr;
    fit->gaussians[fit->looks++] = (double)p->gaussians;
    fit->best = fmax(fit->best, fit->quality.psnr);
}

static void after_step(void *user, const sf_fit_progress *p) {
    watch *w = user;
    if (p->gaussians > w->fit->most) w->fit->most = p->gaussians;
    if (w->every && p->step % w->every == 0) look(w, p);
}

stab_fit stab_fit_scene(sf_context *ctx, sf_scene *scene, const sf_fit_options *options, int64_t every,
                        sf_fitter **fitter) {
    stab_fit fit = {0};
    watch w = {.ctx = ctx, .scene = scene, .fit = &fit, .every = every};
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, options, &w.fitter));
    assert_ok(ctx, sf_fitter_run(w.fitter, after_step, &w));
    sf_fitter_get_progress(w.fitter, &fit.progress);
    if (!fit.looks || fit.steps[fit.looks - 1] < (double)fit.progress.step) look(&w, &fit.progress);
    if (fitter)
        *fitter = w.fitter;
    else
        sf_fitter_destroy(&w.fitter);
    return fit;
}

void stab_draw_fit(stab_run *run, stab_line line, const stab_fit *fit, const char *name) {
    stab_series_begin(run, line, "%s", name);
    for (size_t i = 0; i < fit->looks; i++) stab_point(run, fit->steps[i], fit->psnr[i]);
}

sf_scene *stab_load(sf_context *ctx, const char *path, int hold_out, int downscale) {
    sf_scene *scene;
    sf_load_options load = sf_load_options_default();
    load.hold_out = hold_out, load.downscale = downscale;
    assert_ok(ctx, sf_scene_load(ctx, path, &load, &scene));
    return scene;
}

static uint8_t as_byte(float linear) {
    double v = fmin(fmax((double)linear, 0), 1);
    v = v <= 0.0031308 ? 12.92 * v : 1.055 * pow(v, 1 / 2.4) - 0.055;
    return (uint8_t)floor(255 * v + 0.5);
}

void stab_draw_studio(sf_context *ctx, const sf_sim *sim, const sf_camera *camera, uint8_t *rgb) {
    size_t values = 3 * (size_t)camera->width * (size_t)camera->height;
    float *linear = malloc(values * sizeof *linear);
    assert_non_null(linear);
    sf_studio_draw(&sim->studio, ctx->pool, camera, linear, NULL);
    for (size_t i = 0; i < values; i++) rgb[i] = as_byte(linear[i]);
    free(linear);
}

sf_scene *stab_load_real(sf_context *ctx, const char *name, int hold_out, int downscale) {
    char path[1024];
    const char *data = getenv("SPLATFIT_DATA");
    if (!data || !*data) return NULL;
    snprintf(path, sizeof path, "%s/%s", data, name);
    return stab_load(ctx, path, hold_out, downscale);
}
