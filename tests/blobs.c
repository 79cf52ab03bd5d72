/* blobs.c - scenes of a given number of separate blobs, and empty pictures. */
#include "blobs.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { SIDE = 160, VIEWS = 20, HELD_OUT = 7, VALUES = 3 * SIDE * SIDE };

#define DISTANCE 2.6  /* of the cameras; the blobs lie within 0.5 of the middle */
#define FOCAL    180  /* px */
#define SIZE     0.13 /* of a blob, in mean distances of its neighbours */

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
    sf_camera camera = {.width = SIDE,
                        .height = SIDE,
                        .fx = FOCAL,
                        .fy = FOCAL,
                        .cx = SIDE / 2.0,
                        .cy = SIDE / 2.0,
                        .t_cw = {0, 0, DISTANCE}};
    test_turn_camera(&camera, right, ahead);
    return camera;
}

static uint8_t value_of(size_t count, double gray, float drawn, uint64_t *state) {
    double value = count ? (double)drawn : gray < 0 ? uniform(state) : gray;
    return (uint8_t)lrint(255 * fmin(fmax(value, 0), 1));
}

sf_scene *test_blob_scene(sf_context *ctx, size_t count, double gray) {
    static float rgb[VALUES];
    static uint8_t bytes[VALUES];
    uint64_t state = 12345;
    sf_model *model = blobs(ctx, count, &state);
    sf_renderer *renderer;
    sf_scene *scene;
    assert_ok(ctx, sf_renderer_create(ctx, &renderer));
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    for (int view = 0; view < VIEWS + HELD_OUT; view++) {
        int held_out = view >= VIEWS;
        sf_camera camera = held_out ? camera_of(view - VIEWS, HELD_OUT) : camera_of(view, VIEWS);
        sf_image_out out = {.rgb = rgb};
        assert_ok(ctx, sf_render(renderer, model, &camera, NULL, &out));
        for (int i = 0; i < VALUES; i++) bytes[i] = value_of(count, gray, rgb[i], &state);
        sf_pixels pixels = {bytes, 3 * SIDE, NULL};
        assert_ok(ctx, sf_scene_add_view(scene, NULL, &camera, &pixels,
                                         held_out ? SF_SPLIT_TEST : SF_SPLIT_TRAIN, NULL));
    }
    sf_renderer_destroy(&renderer);
    sf_model_destroy(&model);
    return scene;
}
