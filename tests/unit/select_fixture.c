/* select_fixture.c - see the header. */
#include "select_fixture.h"

#include <math.h>

#include "fit/fitter.h"

sf_camera select_camera_of(int view) { return test_camera_around(view, VIEWS, WIDTH, HEIGHT); }

sf_model *select_model_of(sf_context *ctx, const ball *balls, size_t count, int sh_degree) {
    sf_model *model;
    assert_ok(ctx, sf_model_create(ctx, count, sh_degree, &model));
    for (size_t i = 0; i < count; i++) {
        const ball *b = &balls[i];
        float quat[4] = {1, 0, 0, 0}, log_scale[3], sh[48] = {0}, logit = logf(b->opacity / (1 - b->opacity));
        for (int k = 0; k < 3; k++) log_scale[k] = logf(b->scale[k]), sh[k] = (b->gray - 0.5f) / 0.28209479f;
        sf_gaussians from = {(float *)b->mean, quat, log_scale, &logit, sh};
        assert_int_equal(sf_model_set(model, i, 1, &from), SF_OK);
    }
    return model;
}

sf_scene *select_scene_of_many(sf_context *ctx, const sf_model *model, int times, int unmasked) {
    static float rgb[3 * PIXELS];
    static uint8_t bytes[3 * PIXELS], masked[PIXELS];
    sf_scene *scene;
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    for (int view = 0; view < VIEWS; view++) {
        sf_camera camera = select_camera_of(view);
        test_draw(ctx, model, &camera, rgb);
        for (int i = 0; i < 3 * PIXELS; i++) bytes[i] = (uint8_t)lrintf(255 * fminf(rgb[i], 1));
        for (int k = 0; k < times; k++) {
            sf_pixels pixels = {bytes, 3 * WIDTH, k < unmasked ? NULL : masked};
            assert_ok(ctx, sf_scene_add_view(scene, NULL, &camera, &pixels, SF_SPLIT_TRAIN, NULL));
        }
    }
    return scene;
}

sf_scene *select_scene_of(sf_context *ctx, const sf_model *model) {
    return select_scene_of_many(ctx, model, 1, 1);
}

sf_fitter *select_fitter_of(sf_context *ctx, sf_scene *scene, const sf_model *model) {
    sf_fit_options options = sf_fit_options_default();
    sf_fitter *f;
    options.validate = 0;
    options.extent = 1; /* so that the model stays in the world's unit */
    assert_ok(ctx, sf_fitter_create(ctx, scene, model, &options, &f));
    f->sh_degree = model->sh_degree;
    return f;
}

const ball select_three[3] = {{{0, 0, 0}, {0.3f, 0.3f, 0.3f}, 0.8f, 0.9f},
                              {{0.2f, 0.1f, 0.3f}, {0.2f, 0.4f, 0.2f}, 0.6f, 0.4f},
                              {{-0.8f, 0.3f, 0}, {0.1f, 0.1f, 0.2f}, 0.995f, 0.7f}};
