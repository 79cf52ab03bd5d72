/* fit_fixture.c - see the header. */
#include "fit_fixture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"

sf_camera fit_camera_of(int view) {
    double angle = 2 * 3.14159265358979 * view / VIEWS, height = view % 2 ? 0.35 : -0.2;
    double forward[3] = {cos(angle) * cos(height), sin(angle) * cos(height), sin(height)};
    double right[3] = {sin(angle), -cos(angle), 0};
    sf_camera c = {
        .width = WIDTH, .height = HEIGHT, .fx = 60, .fy = 60, .cx = WIDTH / 2.0, .cy = HEIGHT / 2.0};
    for (int k = 0; k < 3; k++) {
        int a = (k + 1) % 3, b = (k + 2) % 3;
        c.R_cw[k] = right[k];
        c.R_cw[3 + k] = forward[a] * right[b] - forward[b] * right[a];
        c.R_cw[6 + k] = forward[k];
    }
    c.t_cw[2] = 4;
    return c;
}

/* Values of the true Gaussians, of SH degree 0. */
typedef struct truth {
    float means[TRUE_COUNT][3], quats[TRUE_COUNT][4], log_scales[TRUE_COUNT][3], logits[TRUE_COUNT],
        sh[TRUE_COUNT][3];
} truth;

static truth make_truth(void) {
    truth t;
    sf_rng rng;
    sf_rng_seed(&rng, 11);
    for (int i = 0; i < TRUE_COUNT; i++) {
        for (int k = 0; k < 3; k++) {
            t.means[i][k] = (float)(0.5 * sf_rng_normal(&rng));
            t.log_scales[i][k] = (float)(log(0.15) + 0.4 * sf_rng_normal(&rng));
            t.sh[i][k] = (float)(3 * sf_rng_uniform(&rng) - 1.5);
        }
        for (int k = 0; k < 4; k++) t.quats[i][k] = (float)sf_rng_normal(&rng);
        t.logits[i] = (float)(4 * sf_rng_uniform(&rng) - 1);
    }
    return t;
}

sf_model *fit_true_model(sf_context *ctx) {
    truth t = make_truth();
    sf_gaussians from = {&t.means[0][0], &t.quats[0][0], &t.log_scales[0][0], t.logits, &t.sh[0][0]};
    sf_model *model;
    assert_ok(ctx, sf_model_create(ctx, TRUE_COUNT, 0, &model));
    assert_ok(ctx, sf_model_set(model, 0, TRUE_COUNT, &from));
    return model;
}

void fit_add_picture(sf_scene *scene, const sf_camera *camera, const float *rgb, const uint8_t *mask,
                     sf_split split) {
    static uint8_t bytes[3 * PIXELS];
    for (int i = 0; i < 3 * PIXELS; i++) bytes[i] = (uint8_t)(255 * fminf(fmaxf(rgb[i], 0), 1) + 0.5f);
    sf_pixels pixels = {.rgb = bytes, .stride = 3 * (size_t)WIDTH, .mask = mask};
    assert_int_equal(sf_scene_add_view(scene, NULL, camera, &pixels, split, NULL), SF_OK);
}

void fit_add_views(sf_context *ctx, sf_scene *scene, int first, int end, const float *background) {
    static float rgb[3 * PIXELS];
    sf_model *model = fit_true_model(ctx);
    sf_renderer *renderer;
    sf_render_options options = sf_render_options_default();
    memcpy(options.background, background, sizeof options.background);
    assert_ok(ctx, sf_renderer_create(ctx, &renderer));
    for (int v = first; v < end; v++) {
        sf_camera camera = fit_camera_of(v);
        sf_image_out out = {.rgb = rgb};
        assert_ok(ctx, sf_render(renderer, model, &camera, &options, &out));
        fit_add_picture(scene, &camera, rgb, NULL, SF_SPLIT_TRAIN);
    }
    sf_renderer_destroy(&renderer);
    sf_model_destroy(&model);
}

void fit_add_points(sf_scene *scene) {
    truth t = make_truth();
    uint8_t rgb[TRUE_COUNT][3];
    sf_rng rng;
    sf_rng_seed(&rng, 12);
    for (int i = 0; i < TRUE_COUNT; i++)
        for (int k = 0; k < 3; k++) {
            t.means[i][k] += (float)(0.05 * sf_rng_normal(&rng));
            rgb[i][k] = (uint8_t)(255 * fminf(fmaxf(0.5f + 0.282f * t.sh[i][k], 0), 1));
        }
    assert_int_equal(sf_scene_add_points(scene, TRUE_COUNT, &t.means[0][0], &rgb[0][0]), SF_OK);
}

sf_scene *fit_empty_scene(sf_context *ctx) {
    sf_scene *scene;
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    return scene;
}

const float fit_black[3] = {0, 0, 0};

sf_scene *fit_small_scene(sf_context *ctx) {
    sf_scene *scene = fit_empty_scene(ctx);
    fit_add_views(ctx, scene, 0, VIEWS, fit_black);
    fit_add_points(scene);
    return scene;
}

void fit_skip_if_quick(void) {
    if (getenv("SPLATFIT_QUICK")) test_skip("SPLATFIT_QUICK is set, and this takes hundreds of steps");
}

sf_fit_options fit_short_fit(int64_t steps) {
    sf_fit_options options = sf_fit_options_default();
    options.steps = steps;
    options.max_gaussians = 200;
    options.densify_every = 10;
    return options;
}

sf_fitter *fit_start(sf_context *ctx, sf_scene *scene, const sf_fit_options *options) {
    sf_fitter *fitter;
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, options, &fitter));
    return fitter;
}

sf_fit_progress fit_progress_of(const sf_fitter *fitter) {
    sf_fit_progress p;
    sf_fitter_get_progress(fitter, &p);
    return p;
}

void fit_take_steps(sf_context *ctx, sf_fitter *fitter, int steps) {
    for (int i = 0; i < steps; i++) assert_ok(ctx, sf_fitter_step(fitter));
}

double fit_psnr_of(sf_context *ctx, sf_scene *scene, sf_fitter *fitter) {
    static float drawn[3 * PIXELS], picture[3 * PIXELS];
    sf_renderer *renderer;
    sf_scene_info info;
    double sum = 0;
    sf_scene_get_info(scene, &info);
    assert_ok(ctx, sf_renderer_create(ctx, &renderer));
    for (size_t i = 0; i < info.views; i++) {
        sf_view_info view;
        sf_quality quality;
        sf_image_out out = {.rgb = drawn};
        assert_ok(ctx, sf_scene_get_view(scene, i, &view));
        assert_ok(ctx, sf_scene_get_pixels(scene, view.id, picture, NULL));
        assert_ok(ctx, sf_fitter_render(fitter, &view.camera, &out));
        assert_ok(ctx, sf_compare(renderer, WIDTH, HEIGHT, drawn, picture, NULL, &quality));
        sum += quality.psnr;
    }
    sf_renderer_destroy(&renderer);
    return sum / (double)info.views;
}

content fit_content_of_model(const sf_model *model) {
    size_t n = sf_model_count(model), k = (size_t)sf_model_sh_degree(model) + 1, sh = 3 * k * k;
    content c = {n, n * (11 + sh), calloc(n * (11 + sh) + 1, sizeof(float))};
    assert_non_null(c.values);
    float *at = c.values;
    sf_gaussians to = {at, at + 3 * n, at + 7 * n, at + 10 * n, at + 11 * n};
    assert_int_equal(sf_model_get(model, 0, n, &to), SF_OK);
    return c;
}

content fit_content_of(sf_context *ctx, const sf_fitter *fitter) {
    sf_model *model;
    assert_ok(ctx, sf_fitter_snapshot(fitter, &model));
    content c = fit_content_of_model(model);
    sf_model_destroy(&model);
    return c;
}

void fit_assert_same(const content *a, content b) {
    assert_int_equal(a->count, b.count);
    assert_int_equal(a->size, b.size);
    for (size_t i = 0; i < a->size; i++)
        if (memcmp(&a->values[i], &b.values[i], sizeof(float)))
            fail_msg("value %zu of %zu: %.9g is not %.9g", i, a->size, (double)a->values[i],
                     (double)b.values[i]);
    free(b.values);
}

int fit_is_same(const content *a, const content *b) {
    return a->size == b->size && !memcmp(a->values, b->values, a->size * sizeof(float));
}

void fit_assert_sound(sf_context *ctx, const sf_fitter *fitter) {
    sf_model *model;
    assert_ok(ctx, sf_fitter_snapshot(fitter, &model));
    assert_true(sf_model_count(model) > 0);
    assert_ok(ctx, sf_model_save(model, "/dev/null"));
    sf_model_destroy(&model);
}

content fit_end(sf_context *ctx, sf_scene *scene, sf_fitter *fitter) {
    content c = fit_content_of(ctx, fitter);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
    return c;
}

content fit_fitted_by(int threads, const sf_fit_options *options) {
    sf_context *ctx = test_context_threads(threads);
    sf_scene *scene = fit_small_scene(ctx);
    sf_fitter *fitter = fit_start(ctx, scene, options);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    return fit_end(ctx, scene, fitter);
}
