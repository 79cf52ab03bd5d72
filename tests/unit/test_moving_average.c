/* test_moving_average.c - means of the last steps in the place of the last one. */
#include "testing.h"

#include <math.h>
#include <string.h>

#include "fit/fitter.h"
#include "fit/moving_average.h"
#include "fit/optimizer_state.h"

enum { WIDTH = 64, HEIGHT = 48, STEPS = 20, MEAN = 5 };

static sf_fitter *fitter_of(sf_context *ctx, int64_t ema_steps, int64_t densify_every, sf_scene **scene) {
    sf_fitter *f;
    sf_fit_options options = sf_fit_options_default();
    options.steps = 100;
    options.max_gaussians = 2000;
    options.densify_every = densify_every;
    options.ema_steps = ema_steps;
    options.extent = 1; /* so that the model stays in the world's unit: what is saved is not rounded */
    assert_ok(ctx, sf_scene_load(ctx, "sim:studio?width=64&height=48&frames=9", NULL, scene));
    assert_ok(ctx, sf_fitter_create(ctx, *scene, NULL, &options, &f));
    return f;
}

static double value_of(const sf_model *m, int field, size_t i, int c) {
    return (double)*sf_value(&m->params, field, i, c);
}

/* Values of a Gaussian that have a mean: those up to sh0. */
static int next_value(int *field, int *c) {
    if (++*c == sf_field_components(*field)) *c = 0, ++*field;
    return sf_has_momentum(*field);
}

/* What is shown and what is saved is m += (p - m) / n, from the first model on; the fit itself goes on as it
 * would. Higher SH are those of the last step. */
static void test_means_are_shown(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene[2];
    sf_fitter *plain = fitter_of(ctx, 0, 1000, &scene[0]), *f = fitter_of(ctx, MEAN, 1000, &scene[1]);
    size_t count = f->model->count, values = 0;
    static double mean[2000][14];
    assert_true(count > 100 && count <= 2000);
    for (int step = 0; step <= STEPS; step++) {
        values = 0;
        for (size_t i = 0; i < count; i++) {
            int k = 0, field = 0, c = -1;
            while (next_value(&field, &c)) {
                double p = value_of(plain->model, field, i, c);
                mean[i][k] += (p - mean[i][k]) / (step ? MEAN : 1);
                k++, values++;
            }
        }
        if (step == STEPS) break;
        assert_ok(ctx, sf_fitter_step(plain));
        assert_ok(ctx, sf_fitter_step(f));
    }
    assert_int_equal(values, 14 * count);
    sf_model *saved;
    assert_ok(ctx, sf_fitter_snapshot(f, &saved));
    const sf_model *shown = sf_fitter_average_model(f);
    double moved = 0;
    for (size_t i = 0; i < count; i++) {
        int k = 0, field = 0, c = -1;
        while (next_value(&field, &c)) {
            double p = value_of(plain->model, field, i, c), m = value_of(shown, field, i, c);
            assert_true(value_of(f->model, field, i, c) == p);
            if (!(fabs(m - mean[i][k]) < 1e-5 * (1 + fabs(p))))
                fail_msg("field %d of %zu: %g, not %g", field, i, m, mean[i][k]);
            assert_true(value_of(saved, field, i, c) == m);
            moved = fmax(moved, fabs(m - p));
            k++;
        }
        for (c = 0; i < shown->banded[1] && c < sf_field_components(SF_FIELD_sh1); c++)
            assert_true(value_of(shown, SF_FIELD_sh1, i, c) == value_of(f->model, SF_FIELD_sh1, i, c));
    }
    assert_true(moved > 0.01); /* else nothing was tested */
    sf_model_destroy(&saved);
    sf_fitter_destroy(&f);
    sf_fitter_destroy(&plain);
    for (int k = 0; k < 2; k++) sf_scene_destroy(&scene[k]);
    sf_context_destroy(&ctx);
}

/* Axes that no picture holds up shrink to the least that a file may hold: the mean is a hair beyond it, and
 * the whole model was not written. */
static void test_means_can_be_saved(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene;
    sf_fitter *f = fitter_of(ctx, MEAN, 1000, &scene);
    float *lag = f->moments.part[2][SF_FIELD_log_scale],
          *log_scale = f->model->params.field[SF_FIELD_log_scale];
    assert_ok(ctx, sf_fitter_step(f));
    log_scale[0] = SF_LOG_SCALE_LEAST_TRAINED, lag[0] = -4e-6F;
    log_scale[1] = SF_LOG_SCALE_MOST, lag[1] = 4e-6F;
    sf_model *saved, *read;
    assert_ok(ctx, sf_fitter_snapshot(f, &saved));
    assert_ok(ctx, sf_model_save(saved, test_path("shrunk.ply")));
    assert_ok(ctx, sf_model_load(ctx, test_path("shrunk.ply"), &read));
    assert_int_equal(read->count, f->model->count);
    assert_true(value_of(sf_fitter_average_model(f), SF_FIELD_log_scale, 0, 0) ==
                (double)SF_LOG_SCALE_LEAST_TRAINED);
    sf_model_destroy(&read);
    sf_model_destroy(&saved);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* A picture of the fit is one of what it shows; without means that is the model itself. */
static void test_means_are_drawn(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    for (int n = 0; n <= MEAN; n += MEAN) {
        sf_scene *scene;
        sf_fitter *f = fitter_of(ctx, n, 1000, &scene);
        for (int step = 0; step < STEPS; step++) assert_ok(ctx, sf_fitter_step(f));
        sf_model *saved;
        sf_renderer *renderer;
        sf_camera camera;
        sf_render_options options;
        static float drawn[3 * WIDTH * HEIGHT], right[3 * WIDTH * HEIGHT];
        sf_image_out out = {.rgb = drawn};
        assert_true((sf_fitter_average_model(f) == f->model) == !n);
        assert_ok(ctx, sf_fitter_snapshot(f, &saved));
        assert_ok(ctx, sf_fitter_get_camera(f, 1, &camera));
        assert_ok(ctx, sf_fitter_render(f, &camera, &out));
        sf_fitter_render_options(f, &options);
        out.rgb = right;
        assert_ok(ctx, sf_renderer_create(ctx, &renderer));
        assert_ok(ctx, sf_render(renderer, saved, &camera, &options, &out));
        assert_memory_equal(drawn, right, sizeof drawn);
        sf_renderer_destroy(&renderer);
        sf_model_destroy(&saved);
        sf_fitter_destroy(&f);
        sf_scene_destroy(&scene);
    }
    sf_context_destroy(&ctx);
}

/* What has just come has no past: it is shown as it is. What was there keeps its own, wherever it moved to.
 */
static void test_newcomers_have_no_past(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene;
    sf_fitter *f = fitter_of(ctx, MEAN, 1000, &scene);
    for (int step = 0; step < STEPS; step++) assert_ok(ctx, sf_fitter_step(f));
    size_t count = f->model->count, fresh = 0, added;
    f->options.max_gaussians = 3000; /* there is room for more */
    double lags = 0, lags_after = 0;
    for (size_t i = 0; i < count; i++)
        lags += value_of(sf_fitter_average_model(f), SF_FIELD_logit_opacity, i, 0) -
                value_of(f->model, SF_FIELD_logit_opacity, i, 0);
    static const float xyz[] = {0.1f, 0.2f, 0.3f, -0.1f, 0.2f, 0.3f}, radius[] = {0.05f, 0.05f};
    static const uint8_t rgb[6] = {200, 100, 50, 50, 100, 200};
    assert_ok(ctx, sf_fitter_add_points(f, 2, xyz, rgb, radius, &added));
    assert_int_equal(added, 2);
    assert_int_equal(f->model->count, count + 2);
    const sf_model *shown = sf_fitter_average_model(f);
    for (size_t i = 0; i < count + 2; i++) {
        int field = 0, c = -1, same = 1;
        while (next_value(&field, &c))
            same &= value_of(shown, field, i, c) == value_of(f->model, field, i, c);
        fresh += (size_t)same;
        lags_after +=
            value_of(shown, SF_FIELD_logit_opacity, i, 0) - value_of(f->model, SF_FIELD_logit_opacity, i, 0);
    }
    assert_int_equal(fresh, 2);
    assert_true(fabs(lags) > 1e-3);
    assert_float_equal(lags_after, lags, 1e-3 * fabs(lags));
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_means_are_shown),
        cmocka_unit_test(test_means_can_be_saved),
        cmocka_unit_test(test_means_are_drawn),
        cmocka_unit_test(test_newcomers_have_no_past),
    };
    return cmocka_run_group_tests_name("shown", tests, NULL, NULL);
}
