/* init_fixture.c - see the header. */
#include "init_fixture.h"

#include <math.h>
#include <stdlib.h>

#include "base/rng.h"
#include "scene/init.h"
#include "scene/random.h"

const double init_sh_c0 = 0.28209479177387814;

void init_place_anywhere(sf_rng *rng, size_t i, float *point) {
    (void)i;
    for (int k = 0; k < 3; k++) point[k] = (float)(20 * sf_rng_uniform(rng) - 10);
}

float *init_place(place_fn where, size_t n, uint64_t seed) {
    float *points = malloc((3 * n + 1) * sizeof *points);
    assert_non_null(points);
    sf_rng rng;
    sf_rng_seed(&rng, seed);
    for (size_t i = 0; i < n; i++) where(&rng, i, points + 3 * i);
    return points;
}

enum { WIDTH = 20, HEIGHT = 16 };

sf_camera init_camera_around(int turn) {
    static const double forward[4][2] = {{1, 0}, {0, 1}, {-1, 0}, {0, -1}};
    const double *f = forward[turn % 4];
    return (sf_camera){.width = WIDTH,
                       .height = HEIGHT,
                       .fx = 25,
                       .fy = 24,
                       .cx = 9,
                       .cy = 8.5,
                       .R_cw = {f[1], -f[0], 0, 0, 0, -1, f[0], f[1], 0},
                       .t_cw = {0, 0, 6}};
}

/* Views from four sides, each of one colour. */
const uint8_t init_side_colors[4][3] = {{255, 0, 0}, {0, 255, 0}, {10, 20, 30}, {128, 128, 128}};

sf_scene *init_scene_of(sf_context *ctx, int views) {
    sf_scene *scene;
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    for (int v = 0; v < views; v++) {
        sf_camera camera = init_camera_around(v);
        uint8_t rgb[3 * WIDTH * HEIGHT];
        for (size_t i = 0; i < sizeof rgb; i++) rgb[i] = init_side_colors[v % 4][i % 3];
        sf_pixels pixels = {.rgb = rgb, .stride = 3 * (size_t)WIDTH};
        assert_ok(ctx, sf_scene_add_view(scene, NULL, &camera, &pixels, SF_SPLIT_TRAIN, NULL));
    }
    return scene;
}

const sf_init_options init_usual = {.max_gaussians = 1000,
                                    .random_count = 300,
                                    .sh_degree = 2,
                                    .opacity = 0.1,
                                    .scale = 0.5,
                                    .extent = 10,
                                    .nearest = 0.4};

content *init_make_first(sf_scene *scene, const sf_init_options *options, uint64_t seed) {
    sf_context *ctx = scene->ctx;
    sf_rng rng;
    sf_model *model;
    sf_rng_seed(&rng, seed);
    assert_ok(ctx, sf_init_gaussians(scene, options, &rng, &model));
    assert_int_equal(sf_model_sh_degree(model), options->sh_degree);
    assert_int_equal(options->sh_degree, 2);
    content *c = calloc(1, sizeof *c);
    assert_non_null(c);
    c->count = sf_model_count(model);
    assert_between(c->count, 0, MOST);
    sf_gaussians to = {&c->means[0][0], &c->quats[0][0], &c->log_scales[0][0], c->logits, &c->sh[0][0][0]};
    assert_ok(ctx, sf_model_get(model, 0, c->count, &to));
    sf_model_destroy(&model);
    return c;
}

void init_add_points(sf_scene *scene, place_fn where, size_t n, uint64_t seed) {
    float *xyz = init_place(where, n, seed);
    uint8_t *rgb = malloc(3 * n);
    assert_non_null(rgb);
    for (size_t i = 0; i < 3 * n; i++) rgb[i] = (uint8_t)(i * 7);
    assert_ok(scene->ctx, sf_scene_add_points(scene, n, xyz, rgb));
    free(xyz);
    free(rgb);
}

void init_check_common(const content *c, const sf_init_options *options) {
    double logit = log(options->opacity / (1 - options->opacity));
    for (size_t i = 0; i < c->count; i++) {
        assert_memory_equal(c->quats[i], ((float[]){1, 0, 0, 0}), sizeof c->quats[i]);
        assert_float_equal(c->logits[i], logit, 1e-6);
        assert_true(c->log_scales[i][0] == c->log_scales[i][1] && c->log_scales[i][0] == c->log_scales[i][2]);
        for (size_t k = 1; k < COEFFICIENTS; k++)
            for (size_t ch = 0; ch < 3; ch++) assert_true(c->sh[i][k][ch] == 0);
    }
}
