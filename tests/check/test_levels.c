/* test_levels.c - a whole fit, its set of Gaussians frozen, ends alike at every level of this machine. */
#include "../testing.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

/* Levels differ by rounding, and a fit spreads it. */
static const double MOST_DIFFERENCE_DB = 0.05;

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
    options.densify_every = options.steps + 1; /* nothing grows and nothing is pruned */
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &fitter));
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    double psnr = test_held_out(ctx, scene, fitter).psnr;
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
