/* densify_fixture.c - see the header. */
#include "densify_fixture.h"

#include <math.h>
#include <string.h>

static sf_camera camera_of(int view) { return test_camera_around(view, VIEWS, WIDTH, HEIGHT); }

static void set_ball(sf_model *model, size_t i, const ball *b) {
    float quat[4] = {1, 0, 0, 0}, log_scale[3], sh[3], logit = logf(b->opacity / (1 - b->opacity));
    for (int k = 0; k < 3; k++) log_scale[k] = logf(b->scale), sh[k] = (b->gray - 0.5f) / 0.28209479f;
    sf_gaussians from = {(float *)b->mean, quat, log_scale, &logit, sh};
    assert_int_equal(sf_model_set(model, i, 1, &from), SF_OK);
}

sf_model *densify_model_of(sf_context *ctx, const ball *balls, size_t count) {
    sf_model *model;
    assert_ok(ctx, sf_model_create(ctx, count, 0, &model));
    for (size_t i = 0; i < count; i++) set_ball(model, i, &balls[i]);
    return model;
}

sf_scene *densify_scene_of(sf_context *ctx, const ball *balls, size_t count, int spoilt, const float *where,
                           const uint8_t *mask) {
    static float rgb[3 * PIXELS];
    static uint8_t bytes[3 * PIXELS];
    sf_scene *scene;
    sf_model *model = densify_model_of(ctx, balls, count);
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    for (int v = 0; v < VIEWS; v++) {
        sf_camera camera = camera_of(v);
        test_draw(ctx, model, &camera, rgb);
        for (int i = 0; i < 3 * PIXELS; i++) bytes[i] = (uint8_t)(255 * fminf(fmaxf(rgb[i], 0), 1) + 0.5f);
        double p[3];
        for (int k = 0; k < 3 && v == spoilt; k++)
            p[k] = camera.R_cw[3 * k] * where[0] + camera.R_cw[3 * k + 1] * where[1] +
                   camera.R_cw[3 * k + 2] * where[2] + camera.t_cw[k];
        for (int i = 0; i < PIXELS && v == spoilt; i++) {
            double x = i % WIDTH - (60 * p[0] / p[2] + WIDTH / 2.0);
            double y = i / WIDTH - (60 * p[1] / p[2] + HEIGHT / 2.0);
            if (x * x + y * y < 100) memset(bytes + 3 * i, 255, 3);
        }
        sf_pixels pixels = {.rgb = bytes, .stride = 3 * (size_t)WIDTH, .mask = mask};
        assert_int_equal(sf_scene_add_view(scene, NULL, &camera, &pixels, SF_SPLIT_TRAIN, NULL), SF_OK);
    }
    sf_model_destroy(&model);
    return scene;
}

sf_fit_options densify_options_of(int growth) {
    sf_fit_options options = sf_fit_options_default();
    options.size = SF_SIZE_CAP;
    options.densify = growth;
    options.steps = 100;
    options.max_gaussians = 64;
    options.sh_degree = 0;
    options.extent = 1; /* so that means and scales are in the world's unit */
    return options;
}

sf_fitter *densify_fitter_of(sf_context *ctx, sf_scene *scene, const ball *balls, size_t count,
                             const sf_fit_options *options) {
    sf_model *model = densify_model_of(ctx, balls, count);
    sf_fitter *fitter;
    assert_ok(ctx, sf_fitter_create(ctx, scene, model, options, &fitter));
    sf_model_destroy(&model);
    return fitter;
}
