/* test_prune.c - pruning: what is of no use goes, what is left renders the same; at random it does not. */
#include "testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "scene/gaussians.h"

enum { VIEWS = 6, WIDTH = 64, HEIGHT = 48, PIXELS = WIDTH * HEIGHT, USED = 60, USELESS = 60 };

static sf_camera camera_of(int view) { return test_camera_around(view, VIEWS, WIDTH, HEIGHT); }

static float noise(unsigned *state) {
    *state = *state * 1664525u + 1013904223u;
    return (float)(*state >> 8) / (float)(1 << 24) - 0.5f;
}

/* Balls of many colours in the first half; in the other faint ones, hidden ones, ones behind all cameras.
 * Bands above 0 are used by the first third. */
static sf_model *model_of(sf_context *ctx) {
    sf_model *model;
    unsigned seed = 7;
    assert_ok(ctx, sf_model_create(ctx, USED + USELESS, 1, &model));
    for (size_t i = 0; i < USED + USELESS; i++) {
        int useless = i % 2 == 1;
        float mean[3], quat[4] = {1, 0, 0, 0}, scale[3], sh[12], logit = useless && i % 4 == 1 ? -7.0f : 2.0f;
        for (int k = 0; k < 3; k++) {
            mean[k] = 2 * noise(&seed) + (useless && i % 4 == 3 ? 100.0f : 0.0f);
            scale[k] = logf(0.12f);
        }
        for (int k = 0; k < 12; k++) sh[k] = k < 3 ? 2 * noise(&seed) : i < USED / 3 ? noise(&seed) : 1e-5f;
        sf_gaussians from = {mean, quat, scale, &logit, sh};
        assert_ok(ctx, sf_model_set(model, i, 1, &from));
    }
    return model;
}

/* Pictures of the model, one of each kind of error added; the first view is held out. */
static sf_scene *scene_of(sf_context *ctx, const sf_model *model) {
    static float rgb[3 * PIXELS];
    static uint8_t bytes[3 * PIXELS];
    sf_scene *scene;
    sf_renderer *renderer;
    unsigned seed = 3;
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    assert_ok(ctx, sf_renderer_create(ctx, &renderer));
    for (int v = 0; v < VIEWS; v++) {
        sf_camera camera = camera_of(v);
        assert_ok(ctx, sf_render(renderer, model, &camera, NULL, &(sf_image_out){.rgb = rgb}));
        for (int i = 0; i < 3 * PIXELS; i++)
            bytes[i] = (uint8_t)(255 * fminf(fmaxf(rgb[i] + 0.08f * noise(&seed), 0), 1) + 0.5f);
        sf_pixels pixels = {.rgb = bytes, .stride = 3 * (size_t)WIDTH};
        assert_ok(ctx,
                  sf_scene_add_view(scene, NULL, &camera, &pixels, v ? SF_SPLIT_TRAIN : SF_SPLIT_TEST, NULL));
    }
    sf_renderer_destroy(&renderer);
    return scene;
}

typedef struct fixture {
    sf_context *ctx;
    sf_model *model;
    sf_scene *scene;
} fixture;

static fixture start(int threads) {
    fixture f = {.ctx = test_context_threads(threads)};
    f.model = model_of(f.ctx);
    f.scene = scene_of(f.ctx, f.model);
    return f;
}

static void stop_job(fixture *f) {
    sf_scene_destroy(&f->scene);
    sf_model_destroy(&f->model);
    sf_context_destroy(&f->ctx);
}

/* Mean PSNR of the training views, by the public renderer. */
static double psnr_of(const fixture *f, const sf_model *model) {
    static float rgb[3 * PIXELS], truth[3 * PIXELS];
    sf_renderer *renderer;
    sf_scene_info info;
    sf_render_options options = sf_render_options_default();
    double sum = 0;
    sf_scene_get_info(f->scene, &info);
    options.near_plane = (float)(sf_fit_options_default().near_plane * info.extent);
    assert_ok(f->ctx, sf_renderer_create(f->ctx, &renderer));
    for (size_t i = 0; i < info.views; i++) {
        sf_view_info view;
        sf_quality quality;
        assert_ok(f->ctx, sf_scene_get_view(f->scene, i, &view));
        if (view.split != SF_SPLIT_TRAIN) continue;
        assert_ok(f->ctx, sf_scene_get_pixels(f->scene, view.id, truth, NULL));
        assert_ok(f->ctx, sf_render(renderer, model, &view.camera, &options, &(sf_image_out){.rgb = rgb}));
        assert_ok(f->ctx, sf_compare(renderer, WIDTH, HEIGHT, rgb, truth, NULL, &quality));
        sum += quality.psnr;
    }
    sf_renderer_destroy(&renderer);
    return sum / (double)info.train_views;
}

static sf_model *pruned_by(const fixture *f, const sf_prune_options *options, sf_prune_result *result) {
    sf_model *pruned;
    assert_ok(f->ctx, sf_prune(f->ctx, f->scene, f->model, options, &pruned, result));
    return pruned;
}

/* Bands above 0 that are not 0, and Gaussians of no use that are left. */
static void count(const sf_model *model, size_t *bands, size_t *useless) {
    *bands = *useless = 0;
    for (size_t i = 0; i < sf_model_count(model); i++) {
        float mean[3], logit, sh[12];
        sf_gaussians to = {.means = mean, .logit_opacities = &logit, .sh = sh};
        assert_int_equal(sf_model_get(model, i, 1, &to), SF_OK);
        int used = 0;
        for (int k = 3; k < 12; k++) used |= sh[k] != 0;
        *bands += (size_t)used;
        *useless += mean[0] > 50 || logit < 0;
    }
}

/* The useless half goes, bands that are nothing go, and the loss is what was asked for. */
static void test_useless_ones_go(void **state) {
    (void)state;
    fixture f = start(2);
    sf_prune_result result;
    size_t bands, useless;
    sf_model *pruned = pruned_by(&f, NULL, &result);
    count(pruned, &bands, &useless);
    assert_int_equal(useless, 0);
    assert_true(sf_model_count(pruned) <= USED && sf_model_count(pruned) >= USED / 2);
    assert_true(bands <= USED / 2 && bands > 0);
    assert_true(fabs(result.psnr_before - psnr_of(&f, f.model)) < 1e-3);
    assert_true(fabs(result.psnr_after - psnr_of(&f, pruned)) < 1e-3);
    assert_true(result.psnr_after >= result.psnr_before - 0.1);
    assert_true(result.renders > 3);
    assert_int_equal(sf_model_count(f.model), USED + USELESS);
    sf_model_destroy(&pruned);

    sf_prune_options options = sf_prune_options_default();
    options.keep_sh = 1;
    pruned = pruned_by(&f, &options, &result);
    count(pruned, &bands, &useless);
    assert_int_equal(bands, sf_model_count(pruned));
    assert_int_equal(useless, 0);
    sf_model_destroy(&pruned);
    stop_job(&f);
}

/* To a number: by worth nothing is lost, at random much is. */
static void test_random_is_worse(void **state) {
    (void)state;
    fixture f = start(2);
    sf_prune_result by_worth, at_random;
    sf_prune_options options = sf_prune_options_default();
    options.keep = USED;
    sf_model *pruned = pruned_by(&f, &options, &by_worth);
    assert_int_equal(sf_model_count(pruned), USED);
    sf_model_destroy(&pruned);
    options.random = 1;
    pruned = pruned_by(&f, &options, &at_random);
    assert_int_equal(sf_model_count(pruned), USED);
    sf_model_destroy(&pruned);
    assert_true(by_worth.psnr_after > by_worth.psnr_before - 0.05);
    assert_true(at_random.psnr_after < by_worth.psnr_after - 3);

    options.keep = 0; /* as many at random as the loss allows: few */
    pruned = pruned_by(&f, &options, &at_random);
    assert_true(at_random.psnr_after >= at_random.psnr_before - options.loss);
    assert_true(sf_model_count(pruned) > USED);
    sf_model_destroy(&pruned);
    stop_job(&f);
}

/* Fitting on makes good what more pruning costs; the loss holds. */
static void test_refitting_lets_more_go(void **state) {
    (void)state;
    fixture f = start(2);
    sf_prune_result without, with;
    sf_prune_options options = sf_prune_options_default();
    options.keep_sh = 1;
    options.loss = 0.5;
    sf_model *pruned = pruned_by(&f, &options, &without), *refitted;
    options.refit_steps = getenv("SPLATFIT_QUICK") ? 20 : 60;
    refitted = pruned_by(&f, &options, &with);
    assert_true(with.psnr_after >= with.psnr_before - options.loss);
    assert_true(fabs(with.psnr_after - psnr_of(&f, refitted)) < 1e-3);
    if (!getenv("SPLATFIT_QUICK")) assert_true(sf_model_count(refitted) < sf_model_count(pruned));
    sf_model_destroy(&refitted);
    sf_model_destroy(&pruned);
    stop_job(&f);
}

/* The same values for any number of threads. */
static void test_threads_make_no_difference(void **state) {
    (void)state;
    float *sh[2];
    size_t n[2];
    for (int k = 0; k < 2; k++) {
        fixture f = start(1 + 2 * k);
        sf_model *pruned = pruned_by(&f, NULL, NULL);
        n[k] = sf_model_count(pruned);
        sh[k] = calloc(12 * n[k], sizeof *sh[k]);
        assert_ok(f.ctx, sf_model_get(pruned, 0, n[k], &(sf_gaussians){.sh = sh[k]}));
        sf_model_destroy(&pruned);
        stop_job(&f);
    }
    assert_int_equal(n[0], n[1]);
    assert_memory_equal(sh[0], sh[1], 12 * n[0] * sizeof *sh[0]);
    free(sh[0]);
    free(sh[1]);
}

static void test_what_is_wrong_is_named(void **state) {
    (void)state;
    fixture f = start(1);
    static const struct {
        sf_prune_options options;
        const char *part;
    } cases[] = {{{.loss = -1}, "loss: -1 dB"},
                 {{.loss = 101}, "loss: 101 dB"},
                 {{.loss = NAN}, "loss: "},
                 {{.keep = USED + USELESS + 1}, "keep: 121 is more"},
                 {{.refit_steps = -1}, "refit_steps: -1"}};
    sf_model *pruned, *none;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        assert_status(f.ctx, sf_prune(f.ctx, f.scene, f.model, &cases[i].options, &pruned, NULL),
                      SF_ERR_ARGUMENT);
        assert_error_names(f.ctx, cases[i].part);
        assert_null(pruned);
    }
    assert_ok(f.ctx, sf_model_create(f.ctx, 0, 0, &none));
    assert_status(f.ctx, sf_prune(f.ctx, f.scene, none, NULL, &pruned, NULL), SF_ERR_EMPTY);
    assert_error_names(f.ctx, "model: holds no Gaussian");
    sf_model_destroy(&none);
    sf_scene *empty;
    assert_ok(f.ctx, sf_scene_create(f.ctx, &empty));
    assert_status(f.ctx, sf_prune(f.ctx, empty, f.model, NULL, &pruned, NULL), SF_ERR_EMPTY);
    assert_null(pruned);
    sf_scene_destroy(&empty);
    stop_job(&f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_useless_ones_go),        cmocka_unit_test(test_random_is_worse),
        cmocka_unit_test(test_refitting_lets_more_go), cmocka_unit_test(test_threads_make_no_difference),
        cmocka_unit_test(test_what_is_wrong_is_named),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
