/* test_recovery.c - a fit that diverges goes back and on; no value that is poisoned in its course reaches the
 * result. */
#include "testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fit/fitter.h"

#define SCENE "sim:studio?width=64&height=64&frames=9"

typedef struct setup {
    sf_context *ctx;
    sf_scene *scene;
    sf_fit_options options;
} setup;

static int open_setup(void **state) {
    static setup s;
    s.ctx = test_context();
    assert_ok(s.ctx, sf_scene_load(s.ctx, SCENE, NULL, &s.scene));
    s.options = sf_fit_options_default();
    s.options.steps = getenv("SPLATFIT_QUICK") ? 120 : 240;
    s.options.max_gaussians = 300;
    s.options.densify_every = 20;
    *state = &s;
    return 0;
}

static int close_setup(void **state) {
    setup *s = *state;
    sf_scene_destroy(&s->scene);
    sf_context_destroy(&s->ctx);
    return 0;
}

static sf_fitter *start(setup *s, const sf_fit_options *options) {
    sf_fitter *f;
    assert_ok(s->ctx, sf_fitter_create(s->ctx, s->scene, NULL, options, &f));
    return f;
}

static void take_steps(setup *s, sf_fitter *f, int64_t steps) {
    for (int64_t i = 0; i < steps; i++) assert_ok(s->ctx, sf_fitter_step(f));
}

static sf_fit_progress progress_of(const sf_fitter *f) {
    sf_fit_progress p;
    sf_fitter_get_progress(f, &p);
    return p;
}

static int is_finite(const sf_model *m) {
    for (int field = 0; field < SF_FIELD_COUNT; field++)
        for (size_t i = 0; i < m->banded[sf_field_band(field)]; i++)
            for (int c = 0; c < sf_field_components(field); c++)
                if (!isfinite(*sf_value(&m->params, field, i, c))) return 0;
    return 1;
}

/* What no fit makes of pictures. */
static void spoil(sf_fitter *f) {
    const sf_params *p = &f->model->params;
    for (size_t i = 0; i < f->model->count; i++)
        for (int c = 0; c < sf_field_components(SF_FIELD_sh0); c++)
            *sf_value(p, SF_FIELD_sh0, i, c) = i % 2 ? 40.0f : -40.0f;
}

static void test_a_sound_fit_is_left_alone(void **state) {
    setup *s = *state;
    sf_fitter *f = start(s, &s->options);
    test_log_clear();
    assert_ok(s->ctx, sf_fitter_run(f, NULL, NULL));
    assert_int_equal(progress_of(f).diverged, 0);
    assert_true(f->recovery.lr_scale == 1);
    assert_null(strstr(test_log, "diverged"));
    sf_fitter_destroy(&f);
}

static void test_what_diverged_goes_back(void **state) {
    setup *s = *state;
    sf_fitter *f = start(s, &s->options);
    assert_ok(s->ctx, sf_fitter_run(f, NULL, NULL));
    double sound = progress_of(f).loss;
    sf_fitter_destroy(&f);
    f = start(s, &s->options);
    take_steps(s, f, 60);
    spoil(f);
    test_log_clear();
    take_steps(s, f, 12);
    assert_int_equal(progress_of(f).diverged, 1);
    test_assert_contains(test_log, "the fit diverged", __FILE__, __LINE__);
    assert_true(f->recovery.lr_scale == 0.5);
    assert_ok(s->ctx, sf_fitter_run(f, NULL, NULL));
    print_message("loss %.3f, of a sound fit %.3f\n", progress_of(f).loss, sound);
    assert_true(progress_of(f).loss < 2 * sound); /* it has had half of the steps, at half the rates */
    assert_true(is_finite(f->model));
    sf_fitter_destroy(&f);
}

/* From the first step on, so that no median was ever good. */
static void test_rates_that_are_too_high_are_lowered(void **state) {
    setup *s = *state;
    sf_fit_options o = s->options;
    o.lr_mean = 0.5, o.lr_mean_final = 1, o.lr_sh0 = 1, o.lr_sh_rest = 1, o.lr_scale = 1, o.lr_opacity = 1;
    o.validate = 0;
    sf_fitter *f = start(s, &o);
    assert_ok(s->ctx, sf_fitter_run(f, NULL, NULL));
    sf_fit_progress p = progress_of(f);
    print_message("loss %.3f, %.3f at the start, diverged %d times\n", p.loss, f->recovery.initial_loss,
                  (int)p.diverged);
    assert_true(p.diverged > 0);
    assert_true(f->recovery.lr_scale < 1);
    assert_true(p.loss < 1.3 * f->recovery.initial_loss); /* twice that, and more, where nothing goes back */
    assert_true(is_finite(f->model));
    sf_fitter_destroy(&f);
}

/* A first step that ends in nothing finite is taken back as well. */
static void test_first_loss_that_is_not_finite(void **state) {
    setup *s = *state;
    sf_fitter *f = start(s, &s->options);
    take_steps(s, f, 1);
    for (size_t i = 0; i < f->model->count; i++) *sf_value(&f->model->params, SF_FIELD_sh0, i, 0) = 3e38f;
    take_steps(s, f, 1);
    assert_int_equal(progress_of(f).diverged, 1);
    take_steps(s, f, 10);
    assert_true(progress_of(f).loss < f->recovery.initial_loss + 0.1);
    sf_fitter_destroy(&f);
}

static void make_noise(void *user, size_t number, sf_camera *camera, uint8_t *rgb) {
    (void)number;
    size_t size = 3 * (size_t)camera->width * (size_t)camera->height;
    for (size_t i = 0; i < size; i++) rgb[i] = (uint8_t)(256 * sf_rng_uniform(user));
}

/* Finer pictures of noise lose much more than coarse ones: no fit could do otherwise. */
static void test_noise_is_no_divergence(void **state) {
    setup *s = *state;
    sf_rng rng;
    sf_rng_seed(&rng, 5);
    sf_scene *scene = test_changed_scene(s->ctx, SCENE, make_noise, &rng);
    sf_fitter *f;
    sf_fit_options options = s->options;
    options.steps = 240;        /* enough to fit what is coarse */
    options.huber_delta = 1e-9; /* of L1 noise is the greater part */
    assert_ok(s->ctx, sf_fitter_create(s->ctx, scene, NULL, &options, &f));
    take_steps(s, f, 10);
    double coarse = progress_of(f).loss;
    assert_ok(s->ctx, sf_fitter_run(f, NULL, NULL));
    print_message("coarse %.3f, fine %.3f, at the start %.3f\n", coarse, progress_of(f).loss,
                  f->recovery.initial_loss);
    assert_true(progress_of(f).loss > 1.2 * coarse);
    assert_int_equal(progress_of(f).diverged, 0);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
}

/* A loss that is not finite is noticed in its own step, and what went before comes back. */
static void test_loss_that_is_not_finite(void **state) {
    setup *s = *state;
    sf_fitter *f = start(s, &s->options);
    take_steps(s, f, 40);
    for (size_t i = 0; i < f->model->count; i++) *sf_value(&f->model->params, SF_FIELD_sh0, i, 0) = 3e38f;
    take_steps(s, f, 1);
    assert_int_equal(progress_of(f).diverged, 1);
    assert_true(isfinite(progress_of(f).loss));
    assert_ok(s->ctx, sf_fitter_run(f, NULL, NULL));
    assert_true(is_finite(f->model));
    assert_true(progress_of(f).loss < 0.5);
    sf_fitter_destroy(&f);
}

/* A fit that went back is resumed as any other. */
static void test_checkpoint_after_going_back(void **state) {
    setup *s = *state;
    sf_model *whole, *resumed;
    sf_fitter *f = start(s, &s->options), *g;
    take_steps(s, f, 30);
    spoil(f);
    take_steps(s, f, 25);
    assert_int_equal(progress_of(f).diverged, 1);
    assert_ok(s->ctx, sf_fitter_save(f, test_path("c")));
    assert_ok(s->ctx, sf_fitter_load(s->ctx, s->scene, test_path("c"), NULL, &g));
    take_steps(s, f, 30);
    take_steps(s, g, 30);
    assert_int_equal(progress_of(g).diverged, progress_of(f).diverged);
    assert_ok(s->ctx, sf_fitter_snapshot(f, &whole));
    assert_ok(s->ctx, sf_fitter_snapshot(g, &resumed));
    assert_int_equal(whole->count, resumed->count);
    for (int field = 0; field < SF_FIELD_COUNT; field++)
        assert_memory_equal(whole->params.field[field], resumed->params.field[field],
                            sf_field_values(field, whole->banded[sf_field_band(field)]) * sizeof(float));
    sf_model_destroy(&whole);
    sf_model_destroy(&resumed);
    sf_fitter_destroy(&f);
    sf_fitter_destroy(&g);
}

/* Views that are masked altogether have no loss: not the least one that the others are compared with, nor a
 * part in the mean that is shown. */
static void test_masked_views_have_no_loss(void **state) {
    setup *s = *state;
    sf_scene *scene;
    sf_fitter *f;
    assert_ok(s->ctx, sf_scene_load(s->ctx, SCENE, NULL, &scene));
    for (size_t i = 0; i < scene->view_count; i++) {
        sf_view *view = scene->views[i];
        if (view->weight || i % 4 == 2) continue; /* some stay */
        view->weight = sf_calloc(s->ctx, (size_t)view->camera.width * (size_t)view->camera.height, 1);
        assert_non_null(view->weight);
    }
    sf_fit_options o = s->options;
    o.validate = 0;
    assert_ok(s->ctx, sf_fitter_create(s->ctx, scene, NULL, &o, &f));
    int known = 0;
    for (int step = 0; step < 40; step++) {
        take_steps(s, f, 1);
        double last = f->losses[step];
        known += !isnan(last);
        assert_true(isnan(last) ? !known : last > 0.02);
        assert_true(known ? progress_of(f).loss > 0.02 : progress_of(f).loss == 0);
        assert_true(f->recovery.min_loss == 0 || f->recovery.min_loss > 0.02);
    }
    assert_true(known > 20);
    assert_int_equal(progress_of(f).diverged, 0);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
}

/* Each kind of value of some Gaussians becomes `value` in the middle of a fit. */
static void poison(setup *s, int field, float value) {
    sf_fit_options o = s->options;
    o.steps = 60;
    sf_fitter *f = start(s, &o);
    take_steps(s, f, 25);
    for (size_t i = 0; i < f->model->banded[sf_field_band(field)]; i += 7)
        for (int c = 0; c < sf_field_components(field); c++)
            *sf_value(&f->model->params, field, i, c) = value;
    assert_ok(s->ctx, sf_fitter_run(f, NULL, NULL));
    sf_fit_progress p = progress_of(f);
    if (!is_finite(f->model) || !isfinite(p.loss) || !(p.loss < 0.6) || !p.gaussians)
        fail_msg("field %d, %g: loss %g, %zu Gaussians, finite: %d", field, (double)value, p.loss,
                 p.gaussians, is_finite(f->model));
    if (!isfinite(value) && !p.skipped_values && !p.diverged)
        fail_msg("field %d, %g: nothing was counted", field, (double)value);
    sf_fitter_destroy(&f);
}

static void test_poisoned_values(void **state) {
    static const float values[] = {NAN, INFINITY, -INFINITY, 1e38f, -1e38f, 1e-40f};
    for (int field = 0; field < SF_FIELD_COUNT; field++)
        for (size_t v = 0; v < sizeof values / sizeof *values; v++) poison(*state, field, values[v]);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_sound_fit_is_left_alone),
        cmocka_unit_test(test_what_diverged_goes_back),
        cmocka_unit_test(test_rates_that_are_too_high_are_lowered),
        cmocka_unit_test(test_first_loss_that_is_not_finite),
        cmocka_unit_test(test_noise_is_no_divergence),
        cmocka_unit_test(test_loss_that_is_not_finite),
        cmocka_unit_test(test_checkpoint_after_going_back),
        cmocka_unit_test(test_masked_views_have_no_loss),
        cmocka_unit_test(test_poisoned_values),
    };
    return cmocka_run_group_tests_name("guard", tests, open_setup, close_setup);
}
