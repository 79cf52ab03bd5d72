/* test_scenes.c - whole fits, held to the quality that is promised: the embedded scene, and real ones where
 * SPLATFIT_DATA names their folder. Each prints its figures. */
#include "../testing.h"

#include <stdio.h>
#include <stdlib.h>
#include <sys/resource.h>

typedef struct fit_case {
    const char *project; /* in SPLATFIT_DATA, or a simulated scene */
    const char *images;
    int64_t steps, max_gaussians;
    double least_psnr; /* dB, mean over the held-out views */
} fit_case;

static const fit_case studio = {"sim:studio", NULL, 1500, 40000, 28.0};
static const fit_case fox = {"fox", "images_4", 1000, 40000, 28.5};
static const fit_case fox_centred = {"fox-centred-270", NULL, 1000, 40000, 28.5};
static const fit_case tagboard = {"rbt-tagboard", "images_2", 1000, 40000, 26.0};

static const double MOST_MEMORY_MB = 400;

static double peak_memory_mb(void) {
    struct rusage usage;
    assert_int_equal(getrusage(RUSAGE_SELF, &usage), 0);
    return (double)usage.ru_maxrss / 1024;
}

static void reaches_its_quality(void **state) {
    const fit_case *c = *state;
    char path[1024];
    int simulated = c == &studio;
    snprintf(path, sizeof path, "%s%s%s", simulated ? "" : test_data(), simulated ? "" : "/", c->project);
    sf_context *ctx = test_context_threads(0);
    sf_scene *scene;
    sf_fitter *fitter;
    sf_load_options load = sf_load_options_default();
    load.images = c->images;
    assert_ok(ctx, sf_scene_load(ctx, path, &load, &scene));
    sf_fit_options options = sf_fit_options_default();
    options.steps = c->steps;
    options.max_gaussians = c->max_gaussians;
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &fitter));
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));

    sf_fit_progress progress;
    sf_fitter_get_progress(fitter, &progress);
    sf_quality quality = test_held_out(ctx, scene, fitter);
    print_message(
        "%s: %.2f dB, SSIM %.4f held out; %lld steps, %zu Gaussians, %.1f ms a step, peak memory %.0f MB\n",
        c->project, quality.psnr, quality.ssim, (long long)progress.step, progress.gaussians,
        1e3 * progress.seconds / (double)progress.step, peak_memory_mb());
    assert_true(quality.psnr >= c->least_psnr);
    assert_true(progress.gaussians <= (size_t)c->max_gaussians);
    assert_true(peak_memory_mb() < MOST_MEMORY_MB);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

#define CASE(c)                                                                                              \
    { #c, reaches_its_quality, NULL, NULL, (void *)&c }

int main(void) {
    const struct CMUnitTest tests[] = {CASE(studio), CASE(fox), CASE(fox_centred), CASE(tagboard)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
