/* random.c - random scenes, for the reference and for the library alike. */
#include "random.h"
#include "../testing.h"

#include <math.h>
#include <stdlib.h>

static double rounded(double value) { return (double)(float)value; }

/* A rotation by the quaternion (1, x, y, z), rounded to floats: orthonormal to 1e-7. */
static void small_rotation(double x, double y, double z, double R[9]) {
    double n = 1 + x * x + y * y + z * z;
    const double exact[9] = {
        1 - 2 * (y * y + z * z) / n, 2 * (x * y - z) / n,         2 * (x * z + y) / n,
        2 * (x * y + z) / n,         1 - 2 * (x * x + z * z) / n, 2 * (y * z - x) / n,
        2 * (x * z - y) / n,         2 * (y * z + x) / n,         1 - 2 * (x * x + y * y) / n};
    for (int k = 0; k < 9; k++) R[k] = rounded(exact[k]);
}

sf_camera test_random_camera(sf_rng *rng, int width, int height) {
    double longest = width > height ? width : height;
    sf_camera camera = {.width = width,
                        .height = height,
                        .fx = rounded(longest * test_random_between(rng, 0.8, 1)),
                        .fy = rounded(longest * test_random_between(rng, 0.8, 1)),
                        .cx = rounded(width * test_random_between(rng, 0.45, 0.55)),
                        .cy = rounded(height * test_random_between(rng, 0.45, 0.55))};
    double turn[3];
    for (int k = 0; k < 3; k++) {
        turn[k] = test_random_between(rng, -0.15, 0.15);
        camera.t_cw[k] = rounded(test_random_between(rng, -1, 1));
    }
    small_rotation(turn[0], turn[1], turn[2], camera.R_cw);
    return camera;
}

void test_random_place(test_ref_scene *scene, size_t i, const double camera_point[3]) {
    const sf_camera *c = &scene->camera;
    for (size_t k = 0; k < 3; k++) {
        double sum = 0;
        for (size_t r = 0; r < 3; r++) sum += c->R_cw[3 * r + k] * (camera_point[r] - c->t_cw[r]);
        scene->gaussians.means[3 * i + k] = rounded(sum);
    }
}

test_ref_scene test_random_scene(uint64_t seed, size_t count, int sh_degree, int width, int height) {
    sf_rng rng;
    sf_rng_seed(&rng, seed);
    test_ref_scene scene = {.camera = test_random_camera(&rng, width, height),
                            .count = count,
                            .sh_degree = sh_degree,
                            .gaussians = test_ref_gaussians_create(count, sh_degree),
                            .background = {0.25, 0.5, 0.75},
                            .near_plane = 0.25};
    test_ref_gaussians *g = &scene.gaussians;
    const sf_camera *c = &scene.camera;
    size_t values = 3 * (size_t)(sh_degree + 1) * (size_t)(sh_degree + 1);
    for (size_t i = 0; i < count; i++) {
        double z = test_random_between(&rng, 0.1, 6);
        double x = z * test_random_between(&rng, -1.6, 1.6) * width / (2 * c->fx);
        double y = z * test_random_between(&rng, -1.6, 1.6) * height / (2 * c->fy);
        test_random_place(&scene, i, (const double[]){x, y, z});
        for (size_t k = 0; k < 4; k++) g->quats[4 * i + k] = rounded(sf_rng_normal(&rng));
        for (size_t k = 0; k < 3; k++) g->log_scales[3 * i + k] = rounded(-2.5 + 0.8 * sf_rng_normal(&rng));
        g->logit_opacities[i] = rounded(1.5 * sf_rng_normal(&rng));
        for (size_t k = 0; k < values; k++) g->sh[values * i + k] = rounded(0.4 * sf_rng_normal(&rng));
    }
    return scene;
}

static float *floats(size_t n) {
    float *values = calloc(n ? n : 1, sizeof *values);
    assert_non_null(values);
    return values;
}

sf_gaussians test_gaussians_create(size_t count, int sh_degree) {
    size_t coefficients = (size_t)(sh_degree + 1) * (size_t)(sh_degree + 1);
    return (sf_gaussians){.means = floats(3 * count),
                          .quats = floats(4 * count),
                          .log_scales = floats(3 * count),
                          .logit_opacities = floats(count),
                          .sh = floats(3 * coefficients * count)};
}

void test_gaussians_list(const sf_gaussians *g, float *list[TEST_REF_ARRAYS]) {
    list[0] = g->means;
    list[1] = g->quats;
    list[2] = g->log_scales;
    list[3] = g->logit_opacities;
    list[4] = g->sh;
}

void test_gaussians_free(sf_gaussians *g) {
    float *list[TEST_REF_ARRAYS];
    test_gaussians_list(g, list);
    for (int i = 0; i < TEST_REF_ARRAYS; i++) free(list[i]);
    *g = (sf_gaussians){0};
}

sf_model *test_model_of(sf_context *ctx, const test_ref_scene *scene) {
    sf_model *model;
    sf_gaussians g = test_gaussians_create(scene->count, scene->sh_degree);
    float *to[TEST_REF_ARRAYS];
    test_ref_array from[TEST_REF_ARRAYS];
    test_gaussians_list(&g, to);
    test_ref_list(&scene->gaussians, scene->sh_degree, from);
    for (int a = 0; a < TEST_REF_ARRAYS; a++)
        for (size_t k = 0; k < scene->count * from[a].width; k++) to[a][k] = (float)from[a].values[k];
    assert_ok(ctx, sf_model_create(ctx, scene->count, scene->sh_degree, &model));
    assert_ok(ctx, sf_model_set(model, 0, scene->count, &g));
    sf_model_set_antialiased(model, scene->antialiased);
    test_gaussians_free(&g);
    return model;
}

sf_render_options test_render_options_of(const test_ref_scene *scene) {
    sf_render_options options = sf_render_options_default();
    for (int k = 0; k < 3; k++) options.background[k] = (float)scene->background[k];
    options.near_plane = (float)scene->near_plane;
    return options;
}
