/* test_blobs.c - as many Gaussians as a scene has: blobs that stand apart, from random first points, and
 * pictures of nothing. */
#include "../testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { SIDE = 160, VIEWS = 20, HELD_OUT = 7, VALUES = 3 * SIDE * SIDE, FIRST = 1000, STEPS = 6000 };

#define DISTANCE 2.6  /* of the cameras; the blobs lie within 0.5 of the middle */
#define FOCAL    180  /* px */
#define SIZE     0.13 /* of a blob, in mean distances of its neighbours */

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

static double uniform(uint64_t *state) {
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (double)(*state >> 33) / 2147483648.0;
}

static double squared_distance(const double *a, const double *b) {
    double sum = 0;
    for (int k = 0; k < 3; k++) sum += (a[k] - b[k]) * (a[k] - b[k]);
    return sum;
}

/* The best of many places: far from all before it. */
static void place(double *points, size_t i, uint64_t *state) {
    double best = -1;
    for (int tried = 0; tried < 200; tried++) {
        double nearest = INFINITY, p[3];
        for (int k = 0; k < 3; k++) p[k] = uniform(state) - 0.5;
        for (size_t j = 0; j < i; j++) nearest = fmin(nearest, squared_distance(p, points + 3 * j));
        if (nearest > best) best = nearest, memcpy(points + 3 * i, p, sizeof p);
    }
}

static sf_model *blobs(sf_context *ctx, size_t count, uint64_t *state) {
    sf_model *model;
    double *points = malloc(count * 3 * sizeof *points), spacing = 1 / cbrt((double)count);
    assert_non_null(points);
    assert_ok(ctx, sf_model_create(ctx, count, 0, &model));
    for (size_t i = 0; i < count; i++) {
        const float quat[4] = {1, 0, 0, 0}, logit = logf(0.9f / 0.1f);
        float mean[3], log_scale[3], sh[3];
        place(points, i, state);
        for (int k = 0; k < 3; k++) {
            mean[k] = (float)points[3 * i + (size_t)k];
            log_scale[k] = (float)(log(SIZE * spacing) + 0.3 * (uniform(state) - 0.5));
            sh[k] = (float)((0.2 + 0.75 * uniform(state) - 0.5) / 0.28209479);
        }
        sf_gaussians from = {mean, (float *)quat, log_scale, (float *)&logit, sh};
        assert_int_equal(sf_model_set(model, i, 1, &from), SF_OK);
    }
    free(points);
    return model;
}

/* All around, evenly, of `views`; it looks at the middle. */
static sf_camera camera_of(int view, int views) {
    double z = 1 - 2 * (view + 0.5) / views, turn = 2.39996323 * view, r = sqrt(1 - z * z);
    const double ahead[3] = {-r * cos(turn), -r * sin(turn), -z};
    const double right[3] = {-sin(turn), cos(turn), 0};
    const double down[3] = {ahead[1] * right[2] - ahead[2] * right[1],
                            ahead[2] * right[0] - ahead[0] * right[2],
                            ahead[0] * right[1] - ahead[1] * right[0]};
    sf_camera camera = {.width = SIDE,
                        .height = SIDE,
                        .fx = FOCAL,
                        .fy = FOCAL,
                        .cx = SIDE / 2.0,
                        .cy = SIDE / 2.0,
                        .t_cw = {0, 0, DISTANCE}};
    memcpy(camera.R_cw, right, sizeof right);
    memcpy(camera.R_cw + 3, down, sizeof down);
    memcpy(camera.R_cw + 6, ahead, sizeof ahead);
    return camera;
}

static uint8_t value_of(const scene_case *c, float drawn, uint64_t *state) {
    double value = c->blobs ? (double)drawn : c->gray < 0 ? uniform(state) : c->gray;
    return (uint8_t)lrint(255 * fmin(fmax(value, 0), 1));
}

static sf_scene *scene_of(sf_context *ctx, const scene_case *c) {
    static float rgb[VALUES];
    static uint8_t bytes[VALUES];
    uint64_t state = 12345;
    sf_model *model = blobs(ctx, c->blobs, &state);
    sf_renderer *renderer;
    sf_scene *scene;
    assert_ok(ctx, sf_renderer_create(ctx, &renderer));
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    for (int view = 0; view < VIEWS + HELD_OUT; view++) {
        int held_out = view >= VIEWS;
        sf_camera camera = held_out ? camera_of(view - VIEWS, HELD_OUT) : camera_of(view, VIEWS);
        sf_image_out out = {.rgb = rgb};
        assert_ok(ctx, sf_render(renderer, model, &camera, NULL, &out));
        for (int i = 0; i < VALUES; i++) bytes[i] = value_of(c, rgb[i], &state);
        sf_pixels pixels = {bytes, 3 * SIDE, NULL};
        assert_ok(ctx, sf_scene_add_view(scene, NULL, &camera, &pixels,
                                         held_out ? SF_SPLIT_TEST : SF_SPLIT_TRAIN, NULL));
    }
    sf_renderer_destroy(&renderer);
    sf_model_destroy(&model);
    return scene;
}

/* As many Gaussians as there are, within a fifth, and within 1 of a few; pictures of nothing need none. */
static void finds_the_size(void **state) {
    const scene_case *c = *state;
    if (c->slow && getenv("SPLATFIT_QUICK")) {
        print_message("skipped: SPLATFIT_QUICK\n");
        skip();
    }
    sf_context *ctx = test_context_threads(0);
    sf_scene *scene = scene_of(ctx, c);
    sf_fitter *fitter;
    sf_fit_options options = sf_fit_options_default();
    sf_fit_progress progress;
    options.first = SF_FIRST_RANDOM;
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
