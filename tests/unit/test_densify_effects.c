/* test_densify_effects.c - what densification does to pictures; floaters, giants. */
#include "densify_fixture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fit/fit.h"
#include "fit/fitter.h"
#include "fit/schedule.h"
#include "fit/select_floaters.h"
#include "fit/views.h"

/* Growth by a half is not seen: held-out views lose less than 0.1 dB, early and late. With the loss of a run
 * of 770 steps; with that of 200, which is all but squared, the third growth loses 0.11 to 0.14. */
static void test_growth_is_not_seen(void **state) {
    (void)state;
    int quick = getenv("SPLATFIT_QUICK") != NULL;
    sf_context *ctx = test_context();
    sf_scene *scene;
    assert_ok(ctx, sf_scene_load(ctx, "sim:studio?width=80&height=60&frames=16", NULL, &scene));
    sf_fit_options options = sf_fit_options_default();
    options.size = SF_SIZE_CAP;
    options.steps = 200;
    options.densify_every = 1000; /* grows when the test says so */
    options.max_gaussians = 100000;
    options.densify_per_step = 1e6;
    options.densify_rate = 0.5;
    options.huber_delta = 0.1;
    sf_fitter *f;
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &f));
    for (int growth = 0; growth < (quick ? 1 : 3); growth++) {
        for (int step = 0; step < 30; step++) assert_ok(ctx, sf_fitter_step(f));
        size_t count = f->model->count;
        double before = test_held_out(ctx, scene, f).psnr;
        sf_select_and_densify(f, sf_fraction(f));
        double after = test_held_out(ctx, scene, f).psnr;
        if (!(after > before - 0.1)) print_message("growth %d: %.2f to %.2f dB\n", growth, before, after);
        assert_true(after > before - 0.1);
        assert_true(f->model->count > count + 2 * count / 5);
    }
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* What a training camera is inside of is scored to go: in two standard deviations along its own axes; what
 * only comes near one stays, also where its longest axis would reach. The first camera is at (-4, 0, 0). */
static void test_veils_go(void **state) {
    (void)state;
    static const ball balls[] = {{{0, 0, 0}, 0.3f, 0.9f, 0.4f},    {{-3, 0, 0}, 0.6f, 0.05f, 0.9f},
                                 {{-3, 0, 0}, 0.45f, 0.05f, 0.9f}, {{-3, 0, 0}, 0.3f, 0.05f, 0.9f},
                                 {{-3, 0, 0}, 0.3f, 0.05f, 0.9f},  {{-3, 0, 0}, 0.3f, 0.05f, 0.9f},
                                 {{-3, 0, 0}, 0.3f, 0.05f, 0.9f},  {{-4, 0, 0.01f}, 0.02f, 0.9f, 0.9f}};
    enum { BALLS = sizeof balls / sizeof *balls };
    /* longest axes of balls 3 to 6, of which the last two are turned from x to y and back */
    static const int longest[] = {1, 0, 1, 0};
    static const int goes[BALLS] = {0, 1, 0, 0, 1, 1, 0, 1};
    sf_context *ctx = test_context();
    sf_fit_options options = densify_options_of(SF_DENSIFY_GRADIENT);
    options.max_gaussians = BALLS;
    sf_scene *scene = densify_scene_of(ctx, balls, 1, -1, NULL, NULL);
    sf_fitter *f = densify_fitter_of(ctx, scene, balls, BALLS, &options);
    for (size_t k = 0; k < 4; k++) {
        *sf_value(&f->model->params, SF_FIELD_log_scale, 3 + k, longest[k]) = logf(0.9f);
        if (k >= 2) *sf_value(&f->model->params, SF_FIELD_quat, 3 + k, 3) = 1; /* a quarter about z */
    }
    assert_ok(ctx, sf_mark_floaters(f));
    for (size_t i = 0; i < BALLS; i++) assert_int_equal(f->densify.gradient_sum[i] < 0, goes[i]);

    /* where the camera stands is what the fit has learned of it */
    uint32_t *ids;
    size_t n;
    assert_ok(ctx, sf_scene_training_ids(scene, &ids, &n));
    assert_ok(ctx, sf_view_states_sync(&f->views, scene, ids, n));
    for (int k = 0; k < 3; k++) f->views.states[0].t_cw[k] *= 4;
    memset(f->densify.gradient_sum, 0, BALLS * sizeof *f->densify.gradient_sum);
    assert_ok(ctx, sf_mark_floaters(f));
    for (size_t i = 0; i < BALLS; i++) assert_false(f->densify.gradient_sum[i] < 0);
    sf_free(ctx, ids);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* What stands nearer to a training camera than 0.6 of where what it sees begins (here 3.8) is scored to go;
 * not what is beside the picture or behind the camera, and nothing where the camera sees too little to tell.
 */
static void test_what_stands_before_a_lens_goes(void **state) {
    (void)state;
    enum { PLACES = 5, MOST = 800, FEW = 80 };
    static const struct {
        float mean[3];
        int goes;
    } places[PLACES] = {
        {{-2, 0, 0}, 1}, {{-1.5f, 0, 0}, 0}, {{-2.6f, 0.3f, 0.2f}, 1}, {{-3, 1.5f, 0}, 0}, {{-5, 0, 0}, 0}};
    static ball balls[PLACES + MOST];
    sf_context *ctx = test_context();
    for (size_t i = 0; i < PLACES + MOST; i++) {
        balls[i] = (ball){{0, 0, 0}, 0.02f, 0.3f, 0.5f};
        for (size_t k = 0; k < 3; k++)
            balls[i].mean[k] = i < PLACES ? places[i].mean[k] : 0.2f * sinf((float)(7 * i + 31 * k * i));
    }
    static const size_t crowds[] = {MOST, FEW};
    for (size_t pass = 0; pass < 2; pass++) {
        size_t crowd = crowds[pass];
        sf_fit_options options = densify_options_of(SF_DENSIFY_GRADIENT);
        options.max_gaussians = (uint32_t)(PLACES + crowd);
        sf_scene *scene = densify_scene_of(ctx, balls, 1, -1, NULL, NULL);
        sf_fitter *f = densify_fitter_of(ctx, scene, balls, PLACES + crowd, &options);
        assert_ok(ctx, sf_mark_floaters(f));
        for (size_t i = 0; i < PLACES + crowd; i++)
            assert_int_equal(f->densify.gradient_sum[i] < 0, crowd == MOST && i < PLACES && places[i].goes);
        sf_fitter_destroy(&f);
        sf_scene_destroy(&scene);
    }
    sf_context_destroy(&ctx);
}

/* Adam's moments of a value. */
typedef struct moment {
    float m, v;
} moment;

static moment moment_of(const sf_fitter *f, int field, size_t i, int c) {
    size_t at = sf_at(i, sf_field_components(field), c);
    const uint32_t *first = f->moments.part[0][field];
    if (f->moments.format == SF_MOMENTS_HALF)
        return (moment){sf_float_of(first[at] & 0xffff0000u), sf_float_of((first[at] & 0xffffu) << 15)};
    return (moment){sf_float_of(first[at]), ((const float *)f->moments.part[1][field])[at]};
}

/* Halves of a split have no direction, and a part of the squares of what they were: colours and opacity all,
 * shapes a tenth (16 bits keep 8 of a fraction). With none the first steps would be 1 / sqrt(1 - beta2) times
 * too long. The others' moments stay. */
static void check_newcomers(int format) {
    enum { MOST = 1000 }; /* few enough to keep their places */
    sf_context *ctx = test_context();
    sf_scene *scene;
    assert_ok(ctx, sf_scene_load(ctx, "sim:studio?width=64&height=48&frames=9", NULL, &scene));
    sf_fit_options options = sf_fit_options_default();
    options.steps = 40, options.densify_every = 1000, options.sh_degree = 0;
    options.max_gaussians = 700, options.densify_per_step = 1e6, options.densify_rate = 0.3;
    options.max_scale = 0.015; /* none is a veil */
    options.moments = format;
    sf_fitter *f;
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &f));
    f->options.max_gaussians = MOST;
    for (int step = 0; step < 10; step++) assert_ok(ctx, sf_fitter_step(f));
    static moment was[MOST][SF_FIELD_COUNT][4];
    size_t count = f->model->count, halves = 0;
    for (size_t i = 0; i < count; i++)
        for (int field = 0; field <= SF_FIELD_sh0; field++)
            for (int c = 0; c < sf_field_components(field); c++) was[i][field][c] = moment_of(f, field, i, c);
    sf_select_and_densify(f, sf_fraction(f));
    size_t grown = f->model->count - count;
    assert_true(grown > 100 && f->model->count <= MOST);
    for (size_t i = 0; i < count; i++) {
        int half = moment_of(f, SF_FIELD_sh0, i, 0).m == 0 && was[i][SF_FIELD_sh0][0].m != 0;
        halves += (size_t)half;
        for (int field = 0; field <= SF_FIELD_sh0; field++)
            for (int c = 0; c < sf_field_components(field); c++) {
                moment is = moment_of(f, field, i, c), old = was[i][field][c];
                double part = !half || field >= SF_FIELD_logit_opacity ? 1 : 0.1;
                assert_true(is.m == (half ? 0 : old.m));
                assert_true(fabs((double)is.v - part * (double)old.v) <= part * (double)old.v / 128);
            }
    }
    assert_int_equal(halves, grown);
    for (size_t j = count; j < f->model->count; j++) assert_true(moment_of(f, SF_FIELD_sh0, j, 0).m == 0);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}
static void test_newcomers_do_not_leap(void **state) {
    (void)state;
    check_newcomers(SF_MOMENTS_FLOAT);
    check_newcomers(SF_MOMENTS_HALF);
}

/* No axis grows beyond max_scale, in half pictures at the depths of 3.5 to 4.5 in which the cameras see it,
 * and nothing is taken away for it. */
static void test_no_giants(void **state) {
    (void)state;
    enum { COUNT = 2 };
    static const ball truth[1] = {{{0, 0, 0}, 1, 0.9f, 0.9f}};
    static const ball first[COUNT] = {{{0, 0, 0}, 0.5f, 0.9f, 0.9f}, {{0.5f, 0, 0}, 2, 0.9f, 0.9f}};
    sf_context *ctx = test_context();
    sf_scene *scene = densify_scene_of(ctx, truth, 1, -1, NULL, NULL);
    sf_model *from = densify_model_of(ctx, first, COUNT);
    double half = sqrt(WIDTH * HEIGHT) / (2 * 60.0);
    sf_fit_options options = sf_fit_options_default();
    options.extent = 1;
    options.steps = 40;
    options.max_gaussians = COUNT;
    options.max_scale = 0.6 / (4 * half);
    sf_fitter *f;
    assert_ok(ctx, sf_fitter_create(ctx, scene, from, &options, &f));
    assert_ok(ctx, sf_fitter_run(f, NULL, NULL));
    assert_int_equal(f->model->count, COUNT);
    float log_scales[3 * COUNT], most = -INFINITY;
    sf_model_get(f->model, 0, COUNT, &(sf_gaussians){.log_scales = log_scales});
    for (int k = 0; k < 3 * COUNT; k++) most = fmaxf(most, log_scales[k]);
    assert_true(most <= logf(0.6f * 4.5f / 4) + 1e-5f);
    assert_true(most > logf(0.59f * 3.5f / 4));
    sf_fitter_destroy(&f);
    sf_model_destroy(&from);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_no_giants),
        cmocka_unit_test(test_growth_is_not_seen),
        cmocka_unit_test(test_newcomers_do_not_leap),
        cmocka_unit_test(test_veils_go),
        cmocka_unit_test(test_what_stands_before_a_lens_goes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
