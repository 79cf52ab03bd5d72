/* test_select_merge.c - tentative merges, and fits that keep no more Gaussians than a scene needs. */
#include "select_fixture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fit/fitter.h"
#include "fit/select.h"
#include "fit/select_importance.h"
#include "fit/select_merge.h"
#include "fit/select_merge_candidates.h"

/* A Gaussian cut in two along its longest axis becomes what it was; one that stands apart stays. */
static void test_merge(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const float half = 0.15f; /* variances: 0.2^2 + half^2 = 0.25^2 */
    ball parts[3] = {{{half, 0, 0}, {0.2f, 0.1f, 0.1f}, 0.5f, 0.6f},
                     {{-half, 0, 0}, {0.2f, 0.1f, 0.1f}, 0.5f, 0.6f},
                     {{0, 0, 1}, {0.1f, 0.1f, 0.1f}, 0.8f, 0.6f}};
    sf_model *model = select_model_of(ctx, parts, 3, 1);
    sf_scene *scene = select_scene_of(ctx, model);
    sf_fitter *f = select_fitter_of(ctx, scene, model);
    const float effect[] = {1, 1, 1}, untouched[] = {1, INFINITY, 1};
    sf_merge_candidate *pairs;
    size_t n;
    assert_ok(ctx, sf_find_merge_candidates(f, 1e-6, effect, &pairs, &n)); /* less than the two are off */
    assert_int_equal(n, 0);
    sf_free(ctx, pairs);
    assert_ok(ctx, sf_find_merge_candidates(f, 0.2, untouched, &pairs, &n));
    assert_int_equal(n, 0);
    sf_free(ctx, pairs);
    assert_ok(ctx, sf_find_merge_candidates(f, 0.2, effect, &pairs, &n));
    assert_int_equal(n, 1);
    assert_true(pairs[0].a + pairs[0].b == 1 && pairs[0].rise > 0);
    sf_apply_merge(f, &pairs[0]);
    size_t left = pairs[0].a;
    sf_free(ctx, pairs);
    float mean[3], log_scale[3], logit;
    sf_gaussians to = {.means = mean, .log_scales = log_scale, .logit_opacities = &logit};
    assert_int_equal(sf_model_get(f->model, left, 1, &to), SF_OK);
    float longest = fmaxf(log_scale[0], fmaxf(log_scale[1], log_scale[2]));
    for (int k = 0; k < 3; k++) assert_true(fabsf(mean[k]) < 1e-6f);
    assert_true(fabsf(expf(longest) - 0.25f) < 1e-4f);
    assert_true(fabsf(log_scale[0] + log_scale[1] + log_scale[2] - logf(0.25f * 0.1f * 0.1f)) < 1e-3f);
    /* the mass of both: 2 x 0.5 x (0.2 x 0.1 x 0.1)^(2/3) = o (0.25 x 0.1 x 0.1)^(2/3), and not above 0.75 */
    double opacity = 1 / (1 + exp(-(double)logit));
    assert_true(fabs(opacity - fmin(0.75, pow(0.2 / 0.25, 2.0 / 3))) < 1e-3);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* The model's values, all of them. */
static void values_of(const sf_model *m, float *values) {
    sf_gaussians to = {values, values + 30, values + 70, values + 100, values + 110};
    assert_int_equal(sf_model_get(m, 0, m->count, &to), SF_OK);
}

/* Of two that are one and one beside others, and of two that are not: the trial of the first succeeds, that
 * of all does not, and leaves everything as it was; so does one that cannot be judged, for a view has gone.
 */
static void trial(float other_gray, int succeeds, int view_goes) {
    enum { VALUES = 300 };
    sf_context *ctx = test_context();
    ball twins[3] = {select_three[0], select_three[0], select_three[2]},
         one[2] = {select_three[0], select_three[2]};
    for (int i = 0; i < 2; i++) twins[i].opacity = 1 - sqrtf(1 - select_three[0].opacity);
    if (!succeeds) { /* they lie beside each other, of two colours, as in the pictures */
        twins[0].mean[0] = -0.2f, twins[1].mean[0] = 0.2f;
        twins[1].gray = other_gray;
    }
    sf_model *truth = succeeds ? select_model_of(ctx, one, 2, 0) : select_model_of(ctx, twins, 3, 0),
             *model = select_model_of(ctx, twins, 3, 0), *seen;
    sf_scene *scene = select_scene_of(ctx, truth);
    sf_fitter *f = select_fitter_of(ctx, scene, model);
    float before[VALUES] = {0}, during[VALUES] = {0}, after[VALUES] = {0};
    sf_importance w;
    values_of(f->model, before);
    assert_ok(ctx, sf_measure_importance(f, 0, &w));
    const float most[] = {w.score[0], w.score[1], INFINITY};
    memcpy(w.score, most, sizeof most);
    f->options.merge = 1;
    assert_ok(ctx, sf_merges_begin(f, &w));
    sf_importance_free(ctx, &w);
    assert_int_equal(f->merges.count, 1);
    values_of(f->model, during);
    assert_true(memcmp(before, during, sizeof before) != 0);
    assert_ok(ctx, sf_fitter_snapshot(f, &seen));
    values_of(seen, after);
    assert_memory_equal(before, after, sizeof before); /* a trial is not to be seen */
    sf_model_destroy(&seen);

    if (view_goes) {
        uint32_t *ids;
        size_t n;
        assert_ok(ctx, sf_scene_training_ids(scene, &ids, &n));
        assert_ok(ctx, sf_scene_remove_view(scene, ids[n - 1]));
        sf_free(ctx, ids);
    }
    assert_ok(ctx, sf_measure_importance(f, 0, &w));
    if (view_goes) assert_true(w.score[0] < 1e-6f || w.score[1] < 1e-6f); /* one was hidden */
    sf_merges_decide(f, &w, 0.1, 0);
    assert_int_equal(f->merges.count, 0);
    values_of(f->model, after);
    int going = 0;
    for (int i = 0; i < 3; i++) going += f->densify.gradient_sum[i] < 0;
    assert_int_equal(going, succeeds);
    assert_int_equal(f->merges.in_vain, !succeeds && !view_goes);
    assert_memory_equal(succeeds ? during : before, after, sizeof before);
    assert_true(succeeds || (isinf(w.score[0]) && isinf(w.score[1])));
    sf_importance_free(ctx, &w);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_model_destroy(&truth);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}
static void test_trial_succeeds(void **state) {
    (void)state;
    trial(0, 1, 0);
}
static void test_trial_fails(void **state) {
    (void)state;
    trial(0.2f, 0, 0);
}
static void test_trial_without_its_views(void **state) {
    (void)state;
    trial(0.2f, 0, 1);
}

/* From random first points, a fit that is charged has fewer Gaussians than one that is not, at nearly the
 * same quality. */
static void test_a_fit_pays(void **state) {
    (void)state;
    if (getenv("SPLATFIT_QUICK")) test_skip("SPLATFIT_QUICK is set");
    sf_context *ctx = test_context();
    sf_model *truth = select_model_of(ctx, select_three, 3, 0);
    sf_scene *scene = select_scene_of(ctx, truth);
    size_t count[2];
    double squares[2];
    for (int size = SF_SIZE_AUTO; size <= SF_SIZE_CAP; size++) {
        sf_fit_options options = sf_fit_options_default();
        sf_fitter *f;
        sf_importance w;
        options.steps = 600;
        options.plan_steps = 1000;
        options.densify_every = 20;
        options.sh_degree = 0;
        options.init = SF_INIT_RANDOM;
        options.init_random = options.max_gaussians = 1000;
        options.size = size;
        assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &f));
        assert_ok(ctx, sf_fitter_run(f, NULL, NULL));
        assert_ok(ctx, sf_measure_importance(f, 0, &w));
        count[size] = w.count, squares[size] = w.errors.squares / w.errors.values;
        sf_importance_free(ctx, &w);
        sf_fitter_destroy(&f);
    }
    if (count[0] > count[1] / 4 || !(squares[0] < 1e-4))
        print_message("%zu of %zu Gaussians, squares %g and %g\n", count[0], count[1], squares[0],
                      squares[1]);
    assert_true(count[0] >= 3 && count[0] <= count[1] / 4);
    assert_true(squares[0] < 1e-4); /* 40 dB */
    sf_scene_destroy(&scene);
    sf_model_destroy(&truth);
    sf_context_destroy(&ctx);
}

/* A fit that is saved while pairs are on trial goes on to the same bytes. */
static void test_trial_goes_on(void **state) {
    (void)state;
    if (getenv("SPLATFIT_QUICK")) test_skip("SPLATFIT_QUICK is set");
    sf_context *ctx = test_context();
    sf_model *truth = select_model_of(ctx, select_three, 3, 0), *ends[2];
    sf_scene *scene = select_scene_of(ctx, truth);
    sf_fit_options options = sf_fit_options_default();
    sf_fitter *fitters[2];
    options.steps = options.plan_steps = 1000;
    options.init = SF_INIT_RANDOM;
    options.init_random = 200;
    options.sh_degree = 1;
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &fitters[0]));
    while (fitters[0]->step < 800 && !fitters[0]->merges.count) assert_ok(ctx, sf_fitter_step(fitters[0]));
    for (int k = 0; k < 10; k++) assert_ok(ctx, sf_fitter_step(fitters[0]));
    assert_true(fitters[0]->merges.count > 0);
    assert_ok(ctx, sf_fitter_save(fitters[0], test_path("trial")));
    assert_ok(ctx, sf_fitter_load(ctx, scene, test_path("trial"), NULL, &fitters[1]));
    assert_int_equal(fitters[1]->merges.count, fitters[0]->merges.count);
    for (int i = 0; i < 2; i++) {
        for (int k = 0; k < 120; k++) assert_ok(ctx, sf_fitter_step(fitters[i]));
        assert_ok(ctx, sf_fitter_snapshot(fitters[i], &ends[i]));
        sf_fitter_destroy(&fitters[i]);
    }
    assert_int_equal(ends[0]->count, ends[1]->count);
    for (int field = 0; field <= SF_FIELD_sh1; field++)
        assert_memory_equal(ends[0]->params.field[field], ends[1]->params.field[field],
                            sf_field_values(field, ends[0]->banded[sf_field_band(field)]) * sizeof(float));
    for (int i = 0; i < 2; i++) sf_model_destroy(&ends[i]);
    sf_scene_destroy(&scene);
    sf_model_destroy(&truth);
    sf_context_destroy(&ctx);
}

/* While steps to come make up for what goes, and once before the end. */
static void test_charges_end_early(void **state) {
    (void)state;
    enum { STEPS = 3000 };
    sf_context *ctx = test_context();
    sf_model *model = select_model_of(ctx, select_three, 3, 0);
    sf_scene *scene = select_scene_of(ctx, model);
    sf_fitter *f = select_fitter_of(ctx, scene, model);
    int due = 0, last = 0, late = 0;
    f->options.steps = f->options.plan_steps = STEPS;
    f->options.merge = 0;
    for (f->step = 1; f->step <= STEPS; f->step++) {
        double fraction = (double)(f->step - 1) / STEPS;
        if (!sf_selection_is_due(f, fraction)) continue;
        assert_true(f->step % f->options.densify_every == 0 && fraction > 0.55);
        due++;
        last = late, late = (int)f->step;
    }
    assert_int_equal(late, STEPS - f->options.densify_every);
    assert_true(due > 3 && last > 0.8 * STEPS && last < 0.9 * STEPS);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* Bands that change no picture are not paid for, and go one with each charge; those that the pictures show
 * stay. */
static void test_degrees_are_paid_for(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_model *truth = select_model_of(ctx, select_three, 3, 3);
    sf_params *p = &truth->params;
    for (int k = 0; k < sf_field_components(SF_FIELD_sh1); k++) *sf_value(p, SF_FIELD_sh1, 1, k) = 0.3f;
    *sf_value(p, SF_FIELD_sh2, 2, 0) = 1e-6f;
    sf_scene *scene = select_scene_of(ctx, truth);
    sf_fitter *f = select_fitter_of(ctx, scene, truth);
    static const uint8_t left[][3] = {{2, 2, 1}, {1, 1, 0}, {0, 1, 0}, {0, 1, 0}};
    uint8_t degrees[3] = {3, 3, 2};
    for (size_t k = 0; k < sizeof left / sizeof *left; k++) {
        sf_importance w;
        assert_ok(ctx, sf_select_mark(f, 0.7, &w, degrees));
        assert_true(w.bands[1][0] > 0 && w.bands[1][1] == 0 && w.bands[0][0] == 0 && w.bands[2][1] > 0);
        assert_memory_equal(degrees, left[k], sizeof degrees);
        sf_importance_free(ctx, &w);
    }
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_model_destroy(&truth);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_merge),
        cmocka_unit_test(test_trial_succeeds),
        cmocka_unit_test(test_trial_fails),
        cmocka_unit_test(test_trial_without_its_views),
        cmocka_unit_test(test_charges_end_early),
        cmocka_unit_test(test_degrees_are_paid_for),
        cmocka_unit_test(test_trial_goes_on),
        cmocka_unit_test(test_a_fit_pays),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
