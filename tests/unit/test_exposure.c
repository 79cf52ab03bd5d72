/* test_exposure.c - a gain and a bias per channel and training picture, and the PSNR that leaves them out. */
#include "disturb.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "fit/exposure.h"
#include "render/workspace.h"

/* 1. The gradient */

enum { WIDTH = 37, HEIGHT = 29, PIXELS = WIDTH * HEIGHT };

typedef struct stage {
    sf_context *ctx;
    sf_workspace ws;
    sf_exposure exposure;
    sf_view_state view;
    double lambda;
} stage;

/* Dark enough to stay below white; the targets are far enough away for L1 to keep its signs. */
static void stage_create(stage *s, double lambda) {
    const sf_camera camera = {
        .width = WIDTH, .height = HEIGHT, .fx = 1, .fy = 1, .R_cw = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    static float x[3 * PIXELS], target[3 * PIXELS];
    sf_rng rng;
    sf_rng_seed(&rng, 5);
    for (int i = 0; i < 3 * PIXELS; i++) {
        x[i] = (float)(0.3 + 0.3 * sf_rng_uniform(&rng));
        target[i] = x[i] + (sf_rng_uniform(&rng) < 0.4 ? 0.3f : -0.25f);
    }
    *s = (stage){.ctx = test_context(), .lambda = lambda};
    for (int ch = 0; ch < 3; ch++) {
        s->view.log_gain[ch] = 0.1 - 0.07 * ch;
        s->view.bias[ch] = 0.02 * ch - 0.03;
    }
    sf_workspace_init(&s->ws, s->ctx);
    assert_ok(s->ctx, sf_workspace_look(&s->ws, &camera, 1));
    assert_ok(s->ctx, sf_workspace_loss_room(&s->ws));
    assert_ok(s->ctx, sf_exposure_room(&s->exposure, &s->ws));
    sf_copy_in(&s->ws, x, NULL, s->ws.rgb);
    sf_copy_in(&s->ws, target, NULL, s->ws.target);
}

static void stage_free(stage *s) {
    sf_exposure_free(&s->exposure, s->ctx);
    sf_workspace_free(&s->ws);
    sf_context_destroy(&s->ctx);
}

static double loss_of(stage *s, double gradient[6]) {
    sf_loss_value loss;
    sf_expose(&s->exposure, &s->ws, &s->view);
    sf_stage_loss(&s->ws, s->lambda, 0, PIXELS, 0, 1, &loss);
    sf_expose_bwd(&s->exposure, &s->ws, &s->view, gradient);
    return loss.loss;
}

static void values_match_differences(stage *s) {
    double gradient[6], other[6], worst = 0, largest = 0;
    const double step = 0.004;
    loss_of(s, gradient);
    for (int k = 0; k < 6; k++) {
        double *value = k < 3 ? &s->view.log_gain[k] : &s->view.bias[k - 3], kept = *value;
        *value = kept + step;
        double up = loss_of(s, other);
        *value = kept - step;
        double slope = (up - loss_of(s, other)) / (2 * step);
        *value = kept;
        worst = fmax(worst, fabs(slope - gradient[k]));
        largest = fmax(largest, fabs(slope));
    }
    print_message("lambda %g: values %.1e", s->lambda, worst / largest);
    assert_true(worst <= 2e-3 * largest);
}

static void pixels_match_differences(stage *s) {
    double other[6], worst = 0, largest = 0;
    loss_of(s, other);
    for (size_t n = 0; n < 24; n++) {
        size_t ch = n % 3, at = (n * 5 % HEIGHT) * s->ws.stride + n * 7 % WIDTH;
        float kept = s->ws.rgb[ch][at], step = 0.02f;
        double gradient = (double)s->ws.d_rgb[ch][at];
        s->ws.rgb[ch][at] = kept + step;
        double up = loss_of(s, other);
        s->ws.rgb[ch][at] = kept - step;
        double slope = (up - loss_of(s, other)) / (2 * (double)step);
        s->ws.rgb[ch][at] = kept;
        loss_of(s, other);
        worst = fmax(worst, fabs(slope - gradient));
        largest = fmax(largest, fabs(slope));
    }
    print_message(", pixels %.1e\n", worst / largest);
    assert_true(worst <= 1e-2 * largest);
}

static void gradients_match_differences(void **state) {
    (void)state;
    static const double lambdas[] = {0, 0.2, 1};
    for (size_t i = 0; i < 3; i++) {
        stage s;
        stage_create(&s, lambdas[i]);
        values_match_differences(&s);
        pixels_match_differences(&s);
        stage_free(&s);
    }
}

/* The render comes back to the bit; what would have to be brighter than white is left alone. */
static void render_comes_back(void **state) {
    (void)state;
    stage s;
    double gradient[6];
    stage_create(&s, 0);
    size_t planes = s.ws.stride * s.ws.plane_rows;
    float *kept = malloc(planes * sizeof *kept);
    assert_non_null(kept);
    s.ws.rgb[1][3] = 2, s.ws.target[1][3] = 1.5f; /* wants to be brighter */
    s.ws.rgb[1][4] = 2, s.ws.target[1][4] = 0.5f; /* wants to be darker */
    memcpy(kept, s.ws.rgb[1], planes * sizeof *kept);
    loss_of(&s, gradient);
    assert_memory_equal(kept, s.ws.rgb[1], planes * sizeof *kept);
    assert_true(s.ws.d_rgb[1][3] == 0 && s.ws.d_rgb[1][4] > 0);
    free(kept);
    stage_free(&s);
}

/* 2. The corrected figure */

static sf_quality quality_of(sf_context *ctx, const float *rgb, const float *target, const float *weight) {
    sf_renderer *renderer;
    sf_quality quality;
    assert_ok(ctx, sf_renderer_create(ctx, &renderer));
    assert_ok(ctx, sf_compare(renderer, WIDTH, HEIGHT, rgb, target, weight, &quality));
    sf_renderer_destroy(&renderer);
    return quality;
}

/* What differs by gain and bias alone is the same but for that; an error of the right half shows, one of the
 * left half's masked pixels does not. */
static void exposure_is_corrected_for(void **state) {
    (void)state;
    static float rgb[3 * PIXELS], target[3 * PIXELS], weight[PIXELS];
    static const double gains[3] = {0.7, 1.3, 1}, biases[3] = {0.1, -0.05, 0.2};
    sf_context *ctx = test_context();
    sf_rng rng;
    sf_rng_seed(&rng, 6);
    for (size_t i = 0; i < 3 * PIXELS; i++) {
        rgb[i] = (float)(0.1 + 0.5 * sf_rng_uniform(&rng));
        target[i] = (float)(gains[i % 3] * (double)rgb[i] + biases[i % 3]);
        weight[i / 3] = i / 3 % WIDTH == 2 ? 0 : 0.5f;
    }
    sf_quality quality = quality_of(ctx, rgb, target, NULL);
    assert_true(quality.psnr < 20);
    assert_true(quality.psnr_corrected > 90);
    for (size_t y = 0; y < HEIGHT; y++) target[3 * (y * WIDTH + 2)] = 0; /* in the masked column */
    assert_true(quality_of(ctx, rgb, target, NULL).psnr_corrected < 60);
    assert_true(quality_of(ctx, rgb, target, weight).psnr_corrected > 90);
    /* 0.1 in one pixel of one channel, which weighs as all others of the right half do */
    target[3 * (5 * WIDTH + WIDTH - 1)] += 0.1f;
    double mse = 0.01 / (3.0 * HEIGHT * (WIDTH - WIDTH / 2));
    double got = quality_of(ctx, rgb, target, weight).psnr_corrected;
    assert_true(fabs(got + 10 * log10(mse)) < 0.05);
    sf_context_destroy(&ctx);
}

/* What is brighter than white to one camera is seen by another with less light, and the other way round. */
static void white_is_corrected_for(void **state) {
    (void)state;
    static float rgb[3 * PIXELS], target[3 * PIXELS];
    static const double gains[3] = {0.5, 0.8, 1.6};
    sf_context *ctx = test_context();
    sf_rng rng;
    sf_rng_seed(&rng, 7);
    size_t white = 0, beyond = 0;
    for (size_t i = 0; i < 3 * PIXELS; i++) {
        double light = 0.1 + 1.2 * sf_rng_uniform(&rng);
        rgb[i] = (float)light;
        target[i] = (float)fmin(gains[i % 3] * light + 0.02, 1);
        white += target[i] == 1, beyond += rgb[i] > 1;
    }
    assert_true(white > PIXELS / 4 && beyond > PIXELS / 4);
    assert_true(quality_of(ctx, rgb, target, NULL).psnr_corrected > 90);
    rgb[0] = INFINITY, rgb[1] = NAN; /* one of each among others */
    assert_true(isfinite(quality_of(ctx, rgb, target, NULL).psnr_corrected));
    for (size_t i = 0; i < 3 * PIXELS; i++) target[i] = 1; /* says nothing of a gain */
    sf_quality quality = quality_of(ctx, rgb, target, NULL);
    assert_true(quality.psnr_corrected == quality.psnr);
    sf_context_destroy(&ctx);
}

/* Pictures of one colour have no gain, and a half may be masked altogether. */
static void nothing_to_correct_by(void **state) {
    (void)state;
    static float rgb[3 * PIXELS], target[3 * PIXELS], weight[PIXELS];
    sf_context *ctx = test_context();
    for (size_t i = 0; i < 3 * PIXELS; i++) {
        rgb[i] = 0.25f;
        target[i] = 0.5f;
        weight[i / 3] = i / 3 % WIDTH < WIDTH / 2 ? 0 : 1;
    }
    assert_true(quality_of(ctx, rgb, target, NULL).psnr_corrected > 90);
    sf_quality quality = quality_of(ctx, rgb, target, weight);
    assert_true(quality.psnr_corrected == quality.psnr);
    sf_context_destroy(&ctx);
}

/* 3. Fits */

#define STUDIO "sim:studio?width=80&height=60&frames=24"

static sf_fit_options small_fit(int exposure) {
    sf_fit_options options = sf_fit_options_default();
    options.validate = 0;
    options.size = SF_SIZE_CAP;
    options.steps = test_is_quick() ? 60 : 2000;
    options.max_gaussians = 3000;
    options.exposure = exposure;
    return options;
}

/* The mean of a few fits, which stray by a tenth of a dB. */
static sf_quality fitted(sf_context *ctx, test_change change, int exposure) {
    enum { SEEDS = 3 };
    sf_quality mean = {0};
    for (int seed = 1; seed <= SEEDS; seed++) {
        sf_scene *scene = test_changed_scene(ctx, STUDIO, change, NULL);
        sf_fit_options options = small_fit(exposure);
        sf_fitter *fitter;
        options.seed = seed;
        assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &fitter));
        assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
        sf_quality quality = test_held_out(ctx, scene, fitter);
        mean.psnr += quality.psnr / SEEDS;
        mean.psnr_corrected += quality.psnr_corrected / SEEDS;
        sf_fitter_destroy(&fitter);
        sf_scene_destroy(&scene);
    }
    print_message("%s, exposure %s: %.2f dB, corrected %.2f dB\n",
                  change == test_wander ? "wandering" : "steady", exposure ? "on" : "off", mean.psnr,
                  mean.psnr_corrected);
    return mean;
}

/* The corrected figure is the fair one: pictures that were too bright and too dark do not tell which of them
 * is right, and the held-out ones are brighter than all. */
static void wandering_exposure_costs_little(void **state) {
    (void)state;
    if (test_is_quick()) test_skip("SPLATFIT_QUICK is set, and this takes thousands of steps");
    sf_context *ctx = test_context();
    sf_quality plain = fitted(ctx, test_dim, 0), steady = fitted(ctx, test_dim, 1);
    sf_quality without = fitted(ctx, test_wander, 0), with = fitted(ctx, test_wander, 1);
    assert_true(steady.psnr_corrected >= plain.psnr_corrected - 0.1);
    assert_true(with.psnr_corrected >= plain.psnr_corrected - 0.3);
    assert_true(with.psnr_corrected >= without.psnr_corrected + 1);
    sf_context_destroy(&ctx);
}

/* Gains with a mean logarithm of 0, biases with a mean of 0, and the brighter pictures' gains the greater; a
 * view that goes takes its own with it, one that comes brings new ones. */
static void mean_is_held(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = test_changed_scene(ctx, STUDIO, test_wander, NULL);
    sf_fit_options options = small_fit(1);
    options.steps = 300;
    sf_fitter *fitter;
    sf_scene_info info;
    sf_view_info view;
    double gain[3], bias[3], sum[6] = {0}, difference = 0;
    int number = 0;
    sf_scene_get_info(scene, &info);
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &fitter));
    assert_ok(ctx, sf_scene_get_view(scene, 1, &view));
    assert_status(ctx, sf_fitter_get_exposure(fitter, view.id, gain, bias), SF_ERR_ARGUMENT);
    for (int i = 0; i < (test_is_quick() ? 50 : 200); i++) assert_ok(ctx, sf_fitter_step(fitter));
    for (size_t i = 0; i < info.views; i++) {
        assert_ok(ctx, sf_scene_get_view(scene, i, &view));
        if (view.split != SF_SPLIT_TRAIN) continue;
        assert_ok(ctx, sf_fitter_get_exposure(fitter, view.id, gain, bias));
        for (int k = 0; k < 3; k++) sum[k] += log(gain[k]), sum[3 + k] += bias[k];
        difference += number++ % 2 ? -gain[1] : gain[1];
    }
    for (int k = 0; k < 6; k++) assert_true(fabs(sum[k]) < 1e-9);
    print_message("mean gain of the bright pictures less that of the dark ones %.2f\n",
                  2 * difference / number);
    assert_true(difference > 0);
    assert_ok(ctx, sf_scene_get_view(scene, 1, &view));
    const double chosen[3] = {1.2, 1.1, 1.3}, offset[3] = {0.01, 0.02, -0.01}, none[3] = {1, 0, 1};
    assert_status(ctx, sf_fitter_set_exposure(fitter, view.id, none, offset), SF_ERR_ARGUMENT);
    assert_status(ctx, sf_fitter_set_exposure(fitter, UINT32_MAX, chosen, offset), SF_ERR_ARGUMENT);
    assert_ok(ctx, sf_fitter_set_exposure(fitter, view.id, chosen, offset));
    assert_ok(ctx, sf_fitter_get_exposure(fitter, view.id, gain, bias));
    for (int k = 0; k < 3; k++)
        assert_true(fabs(gain[k] - chosen[k]) < 1e-12 && fabs(bias[k] - offset[k]) < 1e-12);
    uint32_t gone = view.id;
    assert_ok(ctx, sf_scene_remove_view(scene, gone));
    for (size_t i = 0; i < info.train_views; i++) assert_ok(ctx, sf_fitter_step(fitter));
    assert_status(ctx, sf_fitter_get_exposure(fitter, gone, gain, bias), SF_ERR_ARGUMENT);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(gradients_match_differences),    cmocka_unit_test(render_comes_back),
        cmocka_unit_test(exposure_is_corrected_for),      cmocka_unit_test(white_is_corrected_for),
        cmocka_unit_test(nothing_to_correct_by),          cmocka_unit_test(mean_is_held),
        cmocka_unit_test(wandering_exposure_costs_little)};
    return cmocka_run_group_tests_name("exposure", tests, NULL, NULL);
}
