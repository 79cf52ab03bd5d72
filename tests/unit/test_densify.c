/* test_densify.c - splits and clones, densification by error, relocation. */
#include "densify_fixture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fit/densify_relocate.h"
#include "fit/densify_score.h"
#include "fit/fit.h"
#include "fit/fitter.h"

static const double pi = 3.141592653589793;

static const float *means_of(const sf_fitter *f) { return f->model->params.field[SF_FIELD_mean]; }

static double opacity_of(const sf_fitter *f, size_t i) {
    return 1 / (1 + exp(-(double)f->model->params.field[SF_FIELD_logit_opacity][i]));
}

/* Cloning and splitting. */

/* The first of three balls grows; whatever its size is, as `split_scale` says. */
static sf_fitter *grown(sf_context *ctx, sf_scene **scene, const ball *balls, double split_scale) {
    sf_fit_options options = densify_options_of(SF_DENSIFY_GRADIENT);
    options.max_gaussians = 4;
    options.densify_every = 1;
    options.plan_steps = 1;
    options.densify_per_step = 1e6;
    options.split_scale = split_scale;
    *scene = densify_scene_of(ctx, balls, 3, -1, NULL, NULL);
    sf_fitter *f = densify_fitter_of(ctx, *scene, balls, 3, &options);
    f->densify.gradient_sum[0] = f->densify.visible_count[0] = 1;
    f->units.inverse[0] = 1;
    sf_select_and_densify(f, 1);
    assert_int_equal(f->model->count, 4);
    return f;
}

static float log_scale_of(const sf_fitter *f, size_t i) {
    return f->model->params.field[SF_FIELD_log_scale][sf_at(i, 3, 0)];
}

/* What is small becomes two of its size, a little apart, that together are as opaque; what is large two
 * halves. */
static void test_clone_and_split(void **state) {
    (void)state;
    static const ball balls[] = {
        {{0, 0, 0.8f}, 0.2f, 0.9f, 0.4f}, {{0, 0, -0.8f}, 0.2f, 0.9f, 0.4f}, {{0, 0, 0}, 0.2f, 0.9f, 0.4f}};
    sf_context *ctx = test_context();
    sf_scene *scene;
    sf_fitter *f = grown(ctx, &scene, balls, 1e6);
    double moved = 0;
    for (int k = 0; k < 3; k++) {
        assert_true(means_of(f)[sf_at(0, 3, k)] == balls[0].mean[k]);
        moved += pow((double)(means_of(f)[sf_at(3, 3, k)] - balls[0].mean[k]), 2);
    }
    assert_true(moved > 0 && sqrt(moved) < 1);
    assert_true(log_scale_of(f, 0) == log_scale_of(f, 1) && log_scale_of(f, 3) == log_scale_of(f, 1));
    assert_true(opacity_of(f, 3) == opacity_of(f, 0));
    assert_true(fabs(pow(1 - opacity_of(f, 0), 2) - 0.1) < 1e-5);
    assert_true(fabs(opacity_of(f, 1) - 0.9) < 1e-5);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    f = grown(ctx, &scene, balls, 0);
    assert_true(log_scale_of(f, 0) < log_scale_of(f, 1) && log_scale_of(f, 3) == log_scale_of(f, 0));
    for (int k = 0; k < 3; k++) {
        double middle = 0.5 * (double)(means_of(f)[sf_at(0, 3, k)] + means_of(f)[sf_at(3, 3, k)]);
        assert_true(fabs(middle - (double)balls[0].mean[k]) < 1e-6);
    }
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Error. */

/* Three balls apart from each other, each seen by every view. */
enum { WRONG, SPOILT, FINE };
static const ball apart[] = {
    {{0, 0, 0.8f}, 0.2f, 0.9f, 0.4f}, {{0, 0, -0.8f}, 0.2f, 0.9f, 0.4f}, {{0, 0, 0}, 0.2f, 0.9f, 0.4f}};
enum { APART = sizeof apart / sizeof *apart };

/* The first has a colour that is wrong in every view, the second is hidden by a larger blemish in one. */
static sf_fitter *disagreeing(sf_context *ctx, sf_scene **scene, const uint8_t *mask,
                              const sf_fit_options *options) {
    ball wrong[APART];
    memcpy(wrong, apart, sizeof wrong);
    wrong[WRONG].gray = 0.45f; /* in all views together less than the blemish in one */
    *scene = densify_scene_of(ctx, apart, APART, 3, apart[SPOILT].mean, mask);
    return densify_fitter_of(ctx, *scene, wrong, APART, options);
}

static void end(sf_context *ctx, sf_scene *scene, sf_fitter *fitter) {
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_error_of_several_views(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene;
    sf_fit_options options = densify_options_of(SF_DENSIFY_ERROR);
    options.max_gaussians = 4;
    options.densify_every = 1;
    options.plan_steps = 1;
    options.densify_per_step = 1e6;
    sf_fitter *f = disagreeing(ctx, &scene, NULL, &options);
    assert_ok(ctx, sf_densify_score(f));
    assert_true(f->densify.gradient_sum[WRONG] > 5 * f->densify.gradient_sum[SPOILT]);
    assert_true(f->densify.gradient_sum[WRONG] > 5 * f->densify.gradient_sum[FINE]);
    sf_select_and_densify(f, 1);
    assert_int_equal(f->model->count, 4);
    assert_true((double)means_of(f)[sf_at(3, 3, 2)] > 0.5); /* beside the first */
    end(ctx, scene, f);
}

/* What is masked everywhere is no error. */
static void test_masked_error(void **state) {
    (void)state;
    static uint8_t mask[PIXELS];
    for (int i = 0; i < PIXELS; i++) mask[i] = i / WIDTH > HEIGHT / 2 ? 255 : 0; /* the first is above */
    sf_context *ctx = test_context();
    sf_scene *scene;
    sf_fit_options options = densify_options_of(SF_DENSIFY_ERROR);
    sf_fitter *f = disagreeing(ctx, &scene, mask, &options);
    assert_ok(ctx, sf_densify_score(f));
    assert_true(f->densify.gradient_sum[WRONG] < 1e-3);
    assert_true(f->densify.gradient_sum[WRONG] >= 0); /* it is shown: it stays */
    end(ctx, scene, f);
}

/* What other Gaussians hide in all views goes, and what no view holds stays. */
static void test_hidden(void **state) {
    (void)state;
    static const ball balls[] = {{{0, 0, 0.3f}, 0.4f, 0.995f, 0.4f},
                                 {{0, 0, 0.3f}, 0.4f, 0.995f, 0.4f},
                                 {{0, 0, 0.3f}, 0.4f, 0.995f, 0.4f},
                                 {{0, 0, 0.3f}, 0.02f, 0.5f, 0.4f}, /* as near as they are, and after them */
                                 {{0, 0, 50}, 0.2f, 0.9f, 0.4f}};
    enum { COUNT = sizeof balls / sizeof *balls };
    sf_context *ctx = test_context();
    sf_fit_options options = densify_options_of(SF_DENSIFY_ERROR);
    sf_scene *scene = densify_scene_of(ctx, balls, COUNT, -1, NULL, NULL);
    sf_fitter *f = densify_fitter_of(ctx, scene, balls, COUNT, &options);
    f->densify.out_of_memory = 1;
    sf_select_and_densify(f, 0);
    assert_int_equal(f->model->count, COUNT - 1);
    assert_true(opacity_of(f, 2) > 0.9);
    assert_true(means_of(f)[sf_at(3, 3, 2)] == 50);
    end(ctx, scene, f);
}

/* Views kept for validation are not looked at: a blemish in them changes nothing. */
static void test_validation_is_not_looked_at(void **state) {
    (void)state;
    double scores[2][APART];
    for (int spoil = 0; spoil < 2; spoil++) {
        sf_context *ctx = test_context();
        sf_fit_options options = densify_options_of(SF_DENSIFY_ERROR);
        options.validate = 4;
        options.error_views = 100;
        sf_scene *scene = densify_scene_of(ctx, apart, APART, spoil ? 2 : -1, apart[SPOILT].mean, NULL);
        sf_fitter *f = densify_fitter_of(ctx, scene, apart, APART, &options);
        sf_view_info info;
        assert_ok(ctx, sf_scene_get_view(scene, 2, &info));
        assert_true(sf_is_in_validation(&f->validation, info.id));
        assert_ok(ctx, sf_densify_score(f));
        memcpy(scores[spoil], f->densify.gradient_sum, sizeof scores[spoil]);
        end(ctx, scene, f);
    }
    assert_memory_equal(scores[0], scores[1], sizeof scores[0]);
}

/* Relocation. */

/* Along a line through the middle, in standard deviations: the integral of 1 - (1 - each g)^n. */
static double integral(double each, uint32_t n) {
    enum { STEPS = 4000 };
    double sum = 0, reach = 12, h = 2 * reach / STEPS;
    for (int i = 0; i <= STEPS; i++) { /* smooth and 0 at both ends: as good as exact */
        double x = -reach + i * h;
        sum += h * -expm1(n * log1p(-each * exp(-x * x / 2)));
    }
    return sum;
}

static void test_formula(void **state) {
    (void)state;
    static const double opacities[] = {1e-6, 0.006, 0.1, 0.5, 0.9, 0.995, 0.9999};
    static const uint32_t numbers[] = {1, 2, 3, 10, 51, 1000, 100000};
    for (size_t i = 0; i < sizeof opacities / sizeof *opacities; i++)
        for (size_t k = 0; k < sizeof numbers / sizeof *numbers; k++) {
            double o = opacities[i], shrink, each = sf_relocated_opacity(o, numbers[k], &shrink);
            double peak = -expm1(numbers[k] * log1p(-each)), line = shrink * integral(each, numbers[k]);
            assert_true(fabs(peak - o) < 1e-9 * o);
            assert_true(fabs(line - o * sqrt(2 * pi)) < 1e-8 * o);
            assert_true(numbers[k] > 1 ? each < o && shrink < 1 : each == o || fabs(each - o) < 1e-12);
        }
}

/* One live ball among dead ones: all become copies of it, and the picture of it stays. */
static void test_picture_stays(void **state) {
    (void)state;
    static float before[3 * PIXELS], after[3 * PIXELS];
    static const ball balls[] = {{{0, 0, 0}, 0.35f, 0.8f, 0.9f},
                                 {{0.5f, 0, 0}, 0.3f, 0.002f, 0.1f},
                                 {{0, 0.5f, 0}, 0.3f, 0.001f, 0.1f},
                                 {{0, 0, 0.5f}, 0.3f, 0.001f, 0.1f}};
    sf_context *ctx = test_context();
    sf_fit_options options = densify_options_of(SF_DENSIFY_RELOCATE);
    sf_scene *scene = densify_scene_of(ctx, balls, 4, -1, NULL, NULL);
    sf_fitter *f = densify_fitter_of(ctx, scene, balls, 4, &options);
    f->model->params.field[SF_FIELD_mean][sf_at(3, 3, 0)] = NAN; /* dead too */
    ((float *)f->moments.part[0][SF_FIELD_mean])[sf_at(2, 3, 1)] = 1;
    sf_camera camera = test_camera_around(0, VIEWS, WIDTH, HEIGHT);
    test_draw(ctx, f->model, &camera, before);
    assert_ok(ctx, sf_relocate(f, 2));
    test_draw(ctx, f->model, &camera, after);
    assert_int_equal(f->model->count, 6);
    double each = -expm1(log1p(-0.8) / 6), line_before = 0, line_after = 0;
    for (size_t i = 0; i < 6; i++) {
        assert_true(fabs(opacity_of(f, i) - each) < 1e-5);
        for (int k = 0; k < 3; k++) {
            assert_true(means_of(f)[sf_at(i, 3, k)] == 0);
            assert_true(((float *)f->moments.part[0][SF_FIELD_mean])[sf_at(i, 3, k)] == 0);
        }
    }
    for (int x = 0; x < WIDTH; x++) {
        size_t at = 3 * (size_t)(HEIGHT / 2 * WIDTH + x);
        line_before += (double)before[at], line_after += (double)after[at];
    }
    size_t middle = 3 * (size_t)(HEIGHT / 2 * WIDTH + WIDTH / 2);
    assert_true(fabs((double)(before[middle] - after[middle])) < 0.01);
    assert_true(fabs(line_after / line_before - 1) <
                0.03); /* less the rims that are not drawn, and the low-pass */
    end(ctx, scene, f);
}

/* Half of them dead: all live afterwards, where the live ones are, and never more than allowed. */
static void test_dead_come_alive(void **state) {
    (void)state;
    enum { COUNT = 20, MOST = 27 };
    ball balls[COUNT];
    for (int i = 0; i < COUNT; i++)
        balls[i] = (ball){{0.05f * (float)i, 0, 0}, 0.1f, i % 2 ? 0.001f : 0.5f, 0.5f};
    sf_context *ctx = test_context();
    sf_fit_options options = densify_options_of(SF_DENSIFY_RELOCATE);
    options.max_gaussians = MOST;
    options.densify_per_step = 1e6;
    sf_scene *scene = densify_scene_of(ctx, balls, COUNT, -1, NULL, NULL);
    sf_fitter *f = densify_fitter_of(ctx, scene, balls, COUNT, &options);
    for (int round = 0; round < 3; round++) {
        sf_select_and_densify(f, 1);
        assert_int_equal(f->model->count, MOST);
    }
    for (size_t i = 0; i < MOST; i++) {
        double x = (double)means_of(f)[sf_at(i, 3, 0)] / 0.1;
        assert_true(opacity_of(f, i) >= 0.0059);
        assert_true(fabs(x - round(x)) < 1e-4); /* a live one's place */
    }
    end(ctx, scene, f);
}

static void test_none_live(void **state) {
    (void)state;
    static const ball balls[] = {{{0, 0, 0}, 0.3f, 0.001f, 0.9f}, {{0, 0, 1}, 0.3f, 0.001f, 0.9f}};
    sf_context *ctx = test_context();
    sf_fit_options options = densify_options_of(SF_DENSIFY_RELOCATE);
    sf_scene *scene = densify_scene_of(ctx, balls, 2, -1, NULL, NULL);
    sf_fitter *f = densify_fitter_of(ctx, scene, balls, 2, &options);
    assert_ok(ctx, sf_relocate(f, 0));
    assert_int_equal(f->model->count, 2);
    assert_true(opacity_of(f, 0) < 0.002);
    end(ctx, scene, f);
}

/* Noise moves what is faint, the wide more than the narrow, and leaves the opaque alone. */
static void test_noise(void **state) {
    (void)state;
    enum { COUNT = 48 };
    ball balls[COUNT];
    for (int i = 0; i < COUNT; i++)
        balls[i] = (ball){{0, 0, 0}, i < 32 ? 0.1f : 0.2f, i < 16 ? 0.5f : 0.001f, 0.5f};
    double spread[3] = {0, 0, 0};
    sf_context *ctx = test_context();
    sf_fit_options options = densify_options_of(SF_DENSIFY_RELOCATE);
    sf_scene *scene = densify_scene_of(ctx, balls, 1, -1, NULL, NULL);
    sf_fitter *f = densify_fitter_of(ctx, scene, balls, COUNT, &options);
    for (int i = 0; i < COUNT; i++) f->units.inverse[i] = 1;
    sf_inject_noise(f, 1, 0, 3);
    for (size_t i = 0; i < COUNT; i++)
        for (int k = 0; k < 3; k++) {
            double moved = (double)means_of(f)[sf_at(i, 3, k)];
            spread[i / 16] += moved * moved / COUNT;
        }
    assert_true(spread[0] == 0);
    double gate = 1 / (1 + exp(100 * (0.001 - 0.005)));
    assert_true(sqrt(spread[1]) > 0.7 * gate * 0.01 && sqrt(spread[1]) < 1.3 * gate * 0.01); /* of 48 draws */
    assert_true(sqrt(spread[2]) > 0.7 * gate * 0.04 && sqrt(spread[2]) < 1.3 * gate * 0.04);
    end(ctx, scene, f);
}

/* Regularisers. */

/* Opacity and scale of what is seen fall, of what is not they stay. */
static void test_regularisers(void **state) {
    (void)state;
    static const ball balls[] = {{{0, 0, 0}, 0.3f, 0.5f, 0.9f}, {{0, 0, 50}, 0.3f, 0.5f, 0.9f}};
    sf_context *ctx = test_context();
    sf_fit_options options = densify_options_of(SF_DENSIFY_GRADIENT);
    options.reg_opacity = options.reg_scale = 10; /* more than the loss has to say */
    options.densify_start = 1;
    sf_scene *scene = densify_scene_of(ctx, balls, 2, -1, NULL, NULL);
    sf_fitter *f = densify_fitter_of(ctx, scene, balls, 2, &options);
    float *scale = f->model->params.field[SF_FIELD_log_scale], unseen = scale[sf_at(1, 3, 0)];
    for (int i = 0; i < 5; i++) assert_ok(ctx, sf_fitter_step(f));
    assert_true(opacity_of(f, 0) < 0.45);
    assert_true((double)scale[sf_at(0, 3, 0)] < log(0.29));
    assert_true(f->model->params.field[SF_FIELD_logit_opacity][1] == 0);
    assert_true(scale[sf_at(1, 3, 0)] == unseen);
    end(ctx, scene, f);
}

/* Whole runs. */

static uint8_t *fitted(int threads, const sf_fit_options *options, size_t *size) {
    const char *path = test_path("m.ply");
    sf_context *ctx = test_context_threads(threads);
    sf_scene *scene;
    sf_fitter *fitter;
    sf_model *model;
    assert_ok(ctx, sf_scene_load(ctx, "sim:studio?width=64&height=48&frames=9", NULL, &scene));
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, options, &fitter));
    for (sf_status status = SF_OK; !status;) {
        status = sf_fitter_step(fitter);
        if (status) assert_int_equal(status, SF_ERR_END);
        assert_true(fitter->model->count <= (size_t)options->max_gaussians);
    }
    assert_int_equal(fitter->model->count, options->max_gaussians);
    assert_ok(ctx, sf_fitter_snapshot(fitter, &model));
    assert_ok(ctx, sf_model_save(model, path));
    sf_model_destroy(&model);
    end(ctx, scene, fitter);
    return test_read(path, size);
}

static void test_same_bytes(void **state) {
    (void)state;
    for (int growth = SF_DENSIFY_ERROR; growth <= SF_DENSIFY_RELOCATE; growth++) {
        sf_fit_options options = densify_options_of(growth);
        options.steps = getenv("SPLATFIT_QUICK") ? 16 : 40;
        options.max_gaussians = 150;
        options.init_random = 100;
        options.densify_every = 4;
        options.densify_per_step = 1e6;
        options.exposure = options.refine_poses = 1;
        options.reg_opacity = options.reg_scale = 0.01;
        size_t size, other;
        uint8_t *first = fitted(1, &options, &size);
        for (int threads = 2; threads <= 3; threads++) {
            uint8_t *again = fitted(threads, &options, &other);
            assert_int_equal(size, other);
            assert_memory_equal(first, again, size);
            free(again);
        }
        options.seed = 2;
        uint8_t *seeded = fitted(1, &options, &other);
        assert_false(size == other && !memcmp(first, seeded, size));
        free(seeded);
        free(first);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_clone_and_split),
        cmocka_unit_test(test_error_of_several_views),
        cmocka_unit_test(test_masked_error),
        cmocka_unit_test(test_hidden),
        cmocka_unit_test(test_validation_is_not_looked_at),
        cmocka_unit_test(test_formula),
        cmocka_unit_test(test_picture_stays),
        cmocka_unit_test(test_dead_come_alive),
        cmocka_unit_test(test_none_live),
        cmocka_unit_test(test_noise),
        cmocka_unit_test(test_regularisers),
        cmocka_unit_test(test_same_bytes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
