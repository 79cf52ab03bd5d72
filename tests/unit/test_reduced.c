/* test_reduced.c - pictures that stand for larger ones: as their averages, whatever the size. */
#include "testing.h"

#include <math.h>

#include "reference/random.h"
#include "render/workspace.h"

enum { SIDE = 64 };

/* One Gaussian in the middle of a picture of SIDE / factor, drawn as that of SIDE in averages, or as it is
 * anywhere. Red, [SIDE / factor][SIDE / factor]. */
static void draw(double pixels, int factor, int reduced, double *red) {
    sf_context *ctx = test_context();
    test_ref_scene scene = test_random_scene(3, 1, 0, SIDE, SIDE);
    int side = SIDE / factor;
    scene.camera = (sf_camera){.width = SIDE, .height = SIDE, .fx = SIDE, .fy = SIDE, .cx = 29.3, .cy = 33.8};
    for (int k = 0; k < 3; k++) scene.camera.R_cw[4 * k] = 1;
    for (int k = 0; k < 3; k++) {
        scene.gaussians.means[k] = k == 2 ? 4 : 0;
        scene.gaussians.log_scales[k] = log(4 * pixels / SIDE);
    }
    scene.gaussians.logit_opacities[0] = -1;
    scene.gaussians.sh[0] = 1;
    sf_model *model = test_model_of(ctx, &scene);
    sf_workspace ws;
    sf_workspace_init(&ws, ctx);
    sf_camera camera = sf_camera_downscaled(&scene.camera, factor);
    assert_ok(ctx, sf_workspace_look(&ws, &camera, 0.1f));
    if (reduced) sf_workspace_reduced(&ws, factor);
    assert_ok(ctx, sf_stage_project(&ws, model, 0, 0));
    assert_ok(ctx, sf_stage_bin(&ws));
    sf_stage_blend(&ws, (const float[3]){0, 0, 0}, 0);
    for (int y = 0; y < side; y++)
        for (int x = 0; x < side; x++)
            red[y * side + x] = (double)ws.rgb[0][(size_t)y * ws.stride + (size_t)x];
    sf_workspace_free(&ws);
    sf_model_destroy(&model);
    test_ref_gaussians_free(&scene.gaussians);
    sf_context_destroy(&ctx);
}

/* Root mean square between a picture of SIDE / factor and the averages of that of SIDE, in parts of these. */
static double apart(const double *large, const double *small, int factor) {
    double squares = 0, all = 0;
    int side = SIDE / factor;
    for (int y = 0; y < SIDE; y += factor)
        for (int x = 0; x < SIDE; x += factor) {
            double mean = 0;
            for (int i = 0; i < factor * factor; i++)
                mean += large[(y + i / factor) * SIDE + x + i % factor] / (factor * factor);
            squares += pow(small[y / factor * side + x / factor] - mean, 2);
            all += mean * mean;
        }
    assert_true(all > 0.02);
    return sqrt(squares / all);
}

static void are_averages_of_large_ones(void **state) {
    (void)state;
    static double large[SIDE * SIDE], small[SIDE * SIDE], as_it_is[SIDE * SIDE];
    for (double pixels = 2; pixels < 8; pixels *= 1.5) {
        draw(pixels, 1, 1, large);
        draw(pixels, 1, 0, small);
        assert_memory_equal(large, small, sizeof large);
        for (int factor = 2; factor <= 4; factor *= 2) {
            draw(pixels, factor, 1, small);
            draw(pixels, factor, 0, as_it_is);
            double with = apart(large, small, factor), without = apart(large, as_it_is, factor);
            print_message("%.1f px, 1/%d: %.4f apart, %.4f with the usual low-pass\n", pixels, factor, with,
                          without);
            assert_true(with < 0.6 * without);
            assert_true(with < 0.3 * factor * factor / (pixels * pixels));
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(are_averages_of_large_ones)};
    return cmocka_run_group_tests_name("reduced", tests, NULL, NULL);
}
