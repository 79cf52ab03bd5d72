/* row_repeat.c - row 11: whether a fit is the same again. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fits.h"

enum { SEEDS = 5 };

static sf_scene *small_studio(sf_context *ctx) {
    return stab_load(ctx, "sim:studio?width=80&height=60&frames=24", 8, 1);
}

static uint8_t *bytes_of_fit(int threads, int64_t steps, size_t *size) {
    const char *path = test_path("model.ply");
    sf_context *ctx = test_context_threads(threads);
    sf_scene *scene = small_studio(ctx);
    sf_fit_options options = stab_fit_options(steps, 3000);
    sf_fitter *fitter;
    sf_model *model;
    stab_fit_scene(ctx, scene, &options, 0, &fitter);
    assert_ok(ctx, sf_fitter_snapshot(fitter, &model));
    assert_ok(ctx, sf_model_save(model, path));
    sf_model_destroy(&model);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
    return test_read(path, size);
}

/* Of two files of one size, or all of the larger. */
static double bytes_apart(const uint8_t *a, size_t a_size, const uint8_t *b, size_t b_size) {
    if (a_size != b_size) return (double)(a_size > b_size ? a_size : b_size);
    double apart = 0;
    for (size_t i = 0; i < a_size; i++) apart += a[i] != b[i];
    return apart;
}

static void by_threads(stab_run *run) {
    static const int threads[] = {1, 2, 3, 4, 8};
    size_t size, other;
    uint8_t *first = bytes_of_fit(threads[0], 200, &size);
    for (size_t i = 0; i < sizeof threads / sizeof *threads; i++) {
        uint8_t *again = bytes_of_fit(threads[i], 200, &other);
        stab_at_most(run, bytes_apart(first, size, again, other), 0, "bytes",
                     "200 steps again with %d threads: bytes of %zu that differ", threads[i], size);
        free(again);
    }
    free(first);
}

static void by_seed(stab_run *run, const char *name, sf_context *ctx, sf_scene *scene,
                    sf_fit_options options) {
    double least = INFINITY, most = 0;
    stab_series_begin(run, STAB_OURS, "%s", name);
    for (int seed = 1; seed <= SEEDS; seed++) {
        options.seed = seed;
        double psnr = stab_fit_scene(ctx, scene, &options, 0, NULL).quality.psnr;
        stab_point(run, seed, psnr);
        least = fmin(least, psnr), most = fmax(most, psnr);
        if (isnan(psnr)) most = INFINITY;
    }
    stab_at_most(run, most - least, 0.3, "dB", "%s: held-out PSNR of %d seeds, greatest less least", name,
                 SEEDS);
    stab_shown(run, least, "dB", "%s: the least of them", name);
}

static void repeated(stab_run *run) {
    by_threads(run);
    sf_context *ctx = test_context();
    sf_scene *studio = small_studio(ctx), *fox = stab_load_real(ctx, STAB_FOX, 8, 2);
    stab_chart_begin(run, "Fits by seed", (stab_axis){"seed (1)", 0}, (stab_axis){"held-out PSNR (dB)", 0});
    by_seed(run, "studio", ctx, studio, stab_fit_options(600, 3000));
    if (fox) by_seed(run, "fox", ctx, fox, stab_fit_options(300, 10000));
    sf_scene_destroy(&studio);
    if (fox) sf_scene_destroy(&fox);
    sf_context_destroy(&ctx);
}

const stab_row stab_row_11 = {
    .id = "11",
    .failure = "Runs do not repeat, and one seed is far from another",
    .cure = "Every sum is made in a fixed order: the same bytes for any number of threads.",
    .run = repeated,
};
