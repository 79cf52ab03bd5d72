/* test_levels.c - a whole fit, its set of Gaussians frozen, ends alike at every level of this machine. */
#include "../testing.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

/* Levels differ by rounding, and a fit spreads it. */
static const double MOST_DIFFERENCE_DB = 0.05;

static double held_out_psnr(sf_context *ctx, sf_scene *scene, sf_fitter *fitter) {
    sf_renderer *renderer;
    sf_scene_info info;
    double mean = 0;
    assert_ok(ctx, sf_renderer_create(ctx, &renderer));
    sf_scene_get_info(scene, &info);
    for (size_t i = 0; i < info.views; i++) {
        sf_view_info view;
        assert_ok(ctx, sf_scene_get_view(scene, i, &view));
        if (view.split != SF_SPLIT_TEST) continue;
        size_t pixels = (size_t)view.camera.width * (size_t)view.camera.height;
        float *truth = malloc(6 * pixels * sizeof *truth), *drawn = truth + 3 * pixels;
        assert_non_null(truth);
        sf_quality quality;
        sf_image_out out = {.rgb = drawn};
        assert_ok(ctx, sf_scene_get_pixels(scene, view.id, truth, NULL));
        assert_ok(ctx, sf_fitter_render(fitter, &view.camera, &out));
        assert_ok(ctx,
                  sf_compare(renderer, view.camera.width, view.camera.height, drawn, truth, NULL, &quality));
        mean += quality.psnr / (double)info.test_views;
        free(truth);
    }
    sf_renderer_destroy(&renderer);
    return mean;
}

static double fit_at(const char *isa) {
    sf_context *ctx = NULL;
    sf_scene *scene;
    sf_fitter *fitter;
    sf_context_options context_options = {.threads = 2, .isa = isa};
    int quick = getenv("SPLATFIT_QUICK") != NULL;
    const char *project =
        quick ? "sim:studio?width=48&height=32&frames=16" : "sim:studio?width=160&height=120&frames=24";
    assert_int_equal(sf_context_create(&ctx, &context_options), SF_OK);
    assert_string_equal(sf_context_isa(ctx), isa);
    assert_ok(ctx, sf_scene_load(ctx, project, NULL, &scene));
    sf_fit_options options = sf_fit_options_default();
    options.steps = quick ? 40 : 200;
    options.max_gaussians = quick ? 1000 : 8000;
    options.grow_every = options.steps + 1; /* nothing grows and nothing is pruned */
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &fitter));
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    double psnr = held_out_psnr(ctx, scene, fitter);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
    return psnr;
}

static void test_frozen_fits_end_alike(void **state) {
    (void)state;
    double scalar = fit_at("scalar");
    sf_isa_info info;
    print_message("scalar: %.3f dB\n", scalar);
    for (size_t i = 1; !sf_isa_describe(i, &info); i++) {
        if (!info.usable) {
            print_message("%s: not on this machine\n", info.name);
            continue;
        }
        double psnr = fit_at(info.name);
        print_message("%s: %.3f dB\n", info.name, psnr);
        assert_true(fabs(psnr - scalar) <= MOST_DIFFERENCE_DB);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_frozen_fits_end_alike)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
