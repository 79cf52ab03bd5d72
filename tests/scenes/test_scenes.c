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
    int slow;          /* left out with SPLATFIT_QUICK: others show nearly the same */
} fit_case;

static const fit_case studio = {"sim:studio", NULL, 1500, 40000, 28.0, 0};
static const fit_case fox = {"fox", "images_4", 1000, 40000, 28.5, 0};
static const fit_case fox_centred = {"fox-centred-270", NULL, 1000, 40000, 28.5, 1};
static const fit_case tagboard = {"rbt-tagboard", "images_2", 1000, 40000, 26.0, 1};

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
    if (c->slow && test_is_quick()) test_skip("SPLATFIT_QUICK is set");
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

typedef struct peak {
    sf_context *ctx;
    sf_scene *scene;
    sf_fitter *fitter;
    double psnr; /* dB, the best held-out one on the way */
} peak;

static void look(void *user, const sf_fit_progress *p) {
    peak *best = user;
    if (p->step % 100) return;
    double psnr = test_held_out(best->ctx, best->scene, best->fitter).psnr;
    if (psnr > best->psnr) best->psnr = psnr;
}

static const size_t three = 3, six = 6;

/* However few the views, the fit ends near the best that it had. */
static void few_views_end_near_the_best(void **state) {
    size_t views = *(const size_t *)*state;
    char path[1024];
    if (views != three && test_is_quick()) test_skip("SPLATFIT_QUICK is set");
    snprintf(path, sizeof path, "%s/%s", test_data(), fox_centred.project);
    peak best = {.ctx = test_context_threads(0)};
    assert_ok(best.ctx, sf_scene_load(best.ctx, path, NULL, &best.scene));
    test_thin_out(best.ctx, best.scene, views);
    sf_fit_options options = sf_fit_options_default();
    options.steps = fox_centred.steps;
    options.max_gaussians = fox_centred.max_gaussians;
    assert_ok(best.ctx, sf_fitter_create(best.ctx, best.scene, NULL, &options, &best.fitter));
    assert_ok(best.ctx, sf_fitter_run(best.fitter, look, &best));
    double end = test_held_out(best.ctx, best.scene, best.fitter).psnr;
    sf_fit_progress progress;
    sf_fitter_get_progress(best.fitter, &progress);
    print_message("%s, %zu views: %.2f dB after %lld steps, %.2f at best\n", fox_centred.project, views, end,
                  (long long)progress.step, best.psnr);
    assert_true(end >= best.psnr - 0.3);
    sf_fitter_destroy(&best.fitter);
    sf_scene_destroy(&best.scene);
    sf_context_destroy(&best.ctx);
}

#define CASE(c)                                                                                              \
    { #c, reaches_its_quality, NULL, NULL, (void *)&c }

#define FEW(n)                                                                                               \
    { "fox_centred with " #n, few_views_end_near_the_best, NULL, NULL, (void *)&n }

int main(void) {
    const struct CMUnitTest tests[] = {CASE(studio),   CASE(fox),  CASE(fox_centred),
                                       CASE(tagboard), FEW(three), FEW(six)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
