/* test_blobs.c - as many Gaussians as a scene has: blobs that stand apart, from random first points, and
 * pictures of nothing. */
#include "../blobs.h"

#include <stdlib.h>
#include <string.h>

enum { FIRST = 1000, STEPS = 6000 };

typedef struct scene_case {
    const char *name;
    size_t blobs;
    double gray;        /* of pictures without blobs; below 0: noise */
    size_t least, most; /* Gaussians in the end */
    double psnr;        /* dB, at least */
    int slow;
} scene_case;

static const scene_case one = {"1 blob", 1, 0, 1, 2, 40, 0}, five = {"5 blobs", 5, 0, 4, 6, 40, 1},
                        twenty = {"20 blobs", 20, 0, 16, 24, 40, 0},
                        hundred = {"100 blobs", 100, 0, 80, 120, 40, 1},
                        many = {"500 blobs", 500, 0, 400, 600, 40, 1}, black = {"black", 0, 0, 0, 1, 50, 1},
                        gray = {"one gray", 0, 0.37, 0, 1, 50, 0}, noise = {"noise", 0, -1, 0, 10000, 10, 1};

/* As many Gaussians as there are, within a fifth, and within 1 of a few; pictures of nothing need none. */
static void finds_the_size(void **state) {
    const scene_case *c = *state;
    if (c->slow && getenv("SPLATFIT_QUICK")) {
        print_message("skipped: SPLATFIT_QUICK\n");
        skip();
    }
    sf_context *ctx = test_context_threads(0);
    sf_scene *scene = test_blob_scene(ctx, c->blobs, c->gray);
    sf_fitter *fitter;
    sf_fit_options options = sf_fit_options_default();
    sf_fit_progress progress;
    options.init = SF_INIT_RANDOM;
    options.init_random = FIRST;
    options.steps = STEPS;
    if (!c->blobs) options.background = SF_BACKGROUND_AUTO;
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &fitter));
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    sf_fitter_get_progress(fitter, &progress);
    double psnr = test_held_out(ctx, scene, fitter).psnr;
    print_message("%s: %zu Gaussians, %.2f dB held out; %.0f s\n", c->name, progress.gaussians, psnr,
                  progress.seconds);
    assert_true(progress.gaussians >= c->least && progress.gaussians <= c->most);
    assert_true(psnr > c->psnr);
    if (c->gray < 0) assert_non_null(strstr(test_log, "densification ends at ")); /* and says why */
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

#define CASE(c)                                                                                              \
    { #c, finds_the_size, NULL, NULL, (void *)&c }

int main(void) {
    const struct CMUnitTest tests[] = {CASE(one),  CASE(five),  CASE(twenty), CASE(hundred),
                                       CASE(many), CASE(black), CASE(gray),   CASE(noise)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
