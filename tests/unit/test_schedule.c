/* test_schedule.c - what is planned for a run, and the views that are kept out of the training to end it. */
#include "testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fit/fitter.h"
#include "fit/schedule.h"
#include "fit/validation.h"

static sf_context *ctx;
static sf_scene *scene;

static int load(void **state) {
    (void)state;
    ctx = test_context();
    assert_ok(ctx, sf_scene_load(ctx, "sim:studio?width=48&height=36&frames=18", NULL, &scene));
    return 0;
}

static int unload(void **state) {
    (void)state;
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
    return 0;
}

static sf_fit_options short_fit(int64_t steps) {
    sf_fit_options options = sf_fit_options_default();
    options.steps = steps;
    options.max_gaussians = 1000;
    options.init = SF_INIT_POINTS;
    options.densify_every = 20;
    options.sh_degree = 1;
    return options;
}

static sf_fitter *start(const sf_fit_options *options) {
    sf_fitter *fitter;
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, options, &fitter));
    return fitter;
}

/* By value: there is padding between the fields. */
static void assert_same_options(const sf_fit_options *a, const sf_fit_options *b) {
    sf_option_info info;
    for (size_t i = 0; !sf_fit_option_info(i, &info); i++) {
        char of_a[64], of_b[64];
        assert_ok(ctx, sf_fit_options_get(a, info.name, of_a, sizeof of_a));
        assert_ok(ctx, sf_fit_options_get(b, info.name, of_b, sizeof of_b));
        assert_string_equal(of_a, of_b);
    }
}

/* The plan */

static sf_fit_options planned(sf_fit_options options) {
    sf_fitter *fitter = start(&options);
    options = fitter->options;
    sf_fitter_destroy(&fitter);
    return options;
}

static void test_longer_runs_have_shorter_phases(void **state) {
    (void)state;
    sf_fit_options brief = planned(short_fit(100)), lengthy = planned(short_fit(20000));
    assert_int_equal(brief.plan_steps, 100);
    assert_int_equal(lengthy.plan_steps, 20000);
    const double ends[][2] = {{brief.pyramid_end, lengthy.pyramid_end},
                              {brief.pyramid_mix, lengthy.pyramid_mix},
                              {brief.sh_end, lengthy.sh_end},
                              {brief.densify_end, lengthy.densify_end}};
    for (size_t i = 0; i < sizeof ends / sizeof *ends; i++) {
        assert_true(ends[i][0] > 0.2 && ends[i][0] < 1);
        assert_true(ends[i][1] > 0 && ends[i][1] < 0.1);
        assert_true(ends[i][1] * 20000 > ends[i][0] * 100); /* in steps they are longer */
    }
}

static void test_brief_runs_make_large_steps(void **state) {
    (void)state;
    static const int64_t steps[] = {100, 825, 20000};
    sf_fit_options plans[3];
    for (int i = 0; i < 3; i++) {
        sf_fit_options options = short_fit(steps[i]);
        options.densify_every = 0;
        plans[i] = planned(options);
    }
    sf_fit_options brief = plans[0], usual = plans[1], lengthy = plans[2];
    assert_true(brief.lr_boost == 6 && fabs(usual.lr_boost - sqrt(8)) < 1e-9 && lengthy.lr_boost == 1);
    assert_true(brief.huber_delta == 0.4 && fabs(usual.huber_delta - 100.0 / 825 * 0.75) < 1e-9);
    assert_true(lengthy.huber_delta == 0); /* L1 */
    assert_int_equal(brief.densify_every, 12);
    assert_int_equal(usual.densify_every, 100);
    assert_int_equal(lengthy.densify_every, 100);
    sf_fit_options options = short_fit(825);
    sf_fitter *f = start(&options);
    assert_true(fabs(sf_scheduled_rate(f, 0, SF_FIELD_log_scale) - sqrt(8) * options.lr_scale) < 1e-9);
    assert_true(fabs(sf_scheduled_rate(f, 0, SF_FIELD_sh1) - sqrt(8) * options.lr_sh_rest) < 1e-9);
    assert_true(fabs(sf_scheduled_rate(f, 0, SF_FIELD_logit_opacity) - pow(8, 0.25) * options.lr_opacity) <
                1e-9);
    assert_true(fabs(sf_scheduled_rate(f, 0, SF_FIELD_sh0) - options.lr_sh0) < 1e-12);
    sf_fitter *on;
    assert_ok(ctx, sf_fitter_create(ctx, scene, f->model, &options, &on));
    assert_true(on->options.lr_boost == 1); /* its shapes are what they are */
    sf_fitter_destroy(&on);
    sf_fitter_destroy(&f);
}

/* Each view once a pass, and two views one after another never nearer than a fifth of all. */
static void test_views_far_apart_follow_one_another(void **state) {
    (void)state;
    sf_fit_options options = short_fit(100);
    options.validate = 0;
    sf_fitter *f = start(&options);
    uint32_t first = 0;
    int differ = 0;
    for (int pass = 0; pass < 4; pass++) {
        assert_ok(ctx, sf_fitter_step(f));
        size_t n = f->sampler.count, seen = 0;
        assert_true(n >= 10);
        for (size_t k = 0; k < n; k++) {
            size_t at = 0;
            for (size_t j = 0; j < n; j++) at += f->sampler.ids[j] < f->sampler.ids[k];
            assert_false(seen >> at & 1);
            seen |= (size_t)1 << at;
            size_t next = 0;
            for (size_t j = 0; j < n; j++) next += f->sampler.ids[j] < f->sampler.ids[(k + 1) % n];
            size_t apart = next > at ? next - at : at - next;
            assert_true(k + 1 == n || (5 * apart >= n && 5 * (n - apart) >= n));
        }
        differ += pass && f->sampler.ids[0] != first;
        first = f->sampler.ids[0];
        while (f->sampler.at < n) assert_ok(ctx, sf_fitter_step(f));
    }
    assert_true(differ > 0);
    sf_fitter_destroy(&f);
}

static void test_what_the_user_chose_stays(void **state) {
    (void)state;
    sf_fit_options options = short_fit(100);
    options.pyramid_end = 0.31, options.densify_end = 0.32, options.sh_end = 0.33, options.plan_steps = 5000;
    options.pyramid_mix = 0.34;
    options.densify_every = 35, options.validate = 5, options.lr_boost = 1.5, options.huber_delta = 0.25;
    sf_fit_options got = planned(options);
    assert_same_options(&got, &options);
}

static void test_time_is_planned_as_steps(void **state) {
    (void)state;
    sf_fit_options options = short_fit(0);
    options.time_limit = 1000;
    sf_fit_options lengthy = planned(options);
    assert_true(lengthy.plan_steps > 1000);
    options.plan_steps = 77;
    assert_int_equal(planned(options).plan_steps, 77);
}

/* Looks at views would take the time of its steps. */
static void test_little_time_is_spent_on_steps(void **state) {
    (void)state;
    sf_fit_options options = short_fit(0);
    options.time_limit = 1000;
    options.plan_steps = SF_SHORT_TIME;
    sf_fitter *fitter = start(&options);
    assert_true(fitter->validation.count > 0);
    assert_int_equal(fitter->options.validate, SF_VALIDATE_EVERY);
    assert_true(fitter->options.blur > 0);
    assert_true(sf_fraction_at(fitter, 0.1) < 0.11);
    fitter->step = SF_SHORT_TIME / 2;
    assert_true(fabs(sf_fraction_at(fitter, 0.1) - 0.5) < 1e-9); /* of the planned steps */
    sf_fitter_destroy(&fitter);

    options.plan_steps = SF_SHORT_TIME - 1;
    fitter = start(&options);
    assert_int_equal(fitter->validation.count, 0);
    assert_int_equal(fitter->options.validate, 0);
    assert_true(fitter->options.blur == 0);
    fitter->step = SF_SHORT_TIME / 2;
    assert_true(fabs(sf_fraction_at(fitter, 0.1) - 0.1) < 1e-9); /* of the time alone */
    sf_fitter_destroy(&fitter);

    options.validate = 4; /* who asks for them has them */
    fitter = start(&options);
    assert_true(fitter->validation.count > 0);
    assert_int_equal(fitter->options.validate, 4);
    sf_fitter_destroy(&fitter);

    options.validate = -1;
    options.target_psnr = 30; /* needs them */
    fitter = start(&options);
    assert_true(fitter->validation.count > 0);
    sf_fitter_destroy(&fitter);
}

/* What few views do not need others may miss: a short run of them grows less too. */
static void test_few_views_are_not_charged(void **state) {
    (void)state;
    for (size_t views = 7; views <= 8; views++) {
        sf_load_options load = sf_load_options_default();
        sf_scene *few;
        sf_fitter *fitter;
        load.hold_out = 0;
        assert_ok(ctx, sf_scene_load(ctx, "sim:studio?width=48&height=36&frames=10", &load, &few));
        test_thin_out(ctx, few, views);
        for (int brief = 0; brief < 2; brief++) {
            sf_fit_options options = short_fit(SF_SHORT_RUN - brief);
            options.size = SF_SIZE_AUTO;
            assert_ok(ctx, sf_fitter_create(ctx, few, NULL, &options, &fitter));
            assert_int_equal(fitter->options.size, views < 8 || brief ? SF_SIZE_CAP : SF_SIZE_AUTO);
            assert_true(fitter->select.growth_scale == (views < 8 ? 7.0 / 8 : 0));
            sf_fitter_destroy(&fitter);
        }
        sf_scene_destroy(&few);
    }
}

static void test_growth_is_bounded_by_the_plan(void **state) {
    (void)state;
    sf_fit_options options = short_fit(100);
    options.max_gaussians = 100000;
    options.densify_per_step = 2;
    sf_fitter *fitter = start(&options);
    size_t first = fitter->first_count;
    assert_int_equal(sf_planned_count(fitter, 1), first + 200);
    assert_int_equal(fitter->options.size, SF_SIZE_CAP);
    fitter->options.plan_steps = SF_SHORT_RUN;
    assert_int_equal(sf_planned_count(fitter, 1), first + 2 * SF_SHORT_RUN);
    assert_int_equal(sf_planned_count(fitter, 0), first);
    fitter->select.growth_scale = 2.5;
    assert_int_equal(sf_planned_count(fitter, 1), first + 5 * SF_SHORT_RUN);
    fitter->select.growth_scale = 0;
    assert_true(sf_planned_count(fitter, fitter->options.densify_end / 2) > first);
    sf_fitter_destroy(&fitter);
    options.max_gaussians = (int64_t)first + 10;
    fitter = start(&options);
    assert_int_equal(sf_planned_count(fitter, 1), first + 10);
    sf_fitter_destroy(&fitter);
}

static void test_resolution_and_rates_follow_the_plan(void **state) {
    (void)state;
    sf_fit_options options = short_fit(1000);
    sf_fitter *f = start(&options);
    const sf_fit_options *o = &f->options;
    int halves = 0;
    assert_int_equal(sf_scheduled_level(f, 0, 4096, 4096), 2);
    assert_int_equal(sf_scheduled_level(f, o->pyramid_end - 1e-9, 4096, 4096), 1);
    for (f->step = 0; f->step < 10; f->step++) halves += sf_scheduled_level(f, o->pyramid_end, 4096, 4096);
    assert_int_equal(halves, 5);
    for (f->step = 0; f->step < 10; f->step++)
        assert_int_equal(sf_scheduled_level(f, o->pyramid_mix, 4096, 4096), 0);
    assert_int_equal(sf_finest_level(f, 0), 2);
    assert_int_equal(sf_finest_level(f, o->pyramid_end - 1e-9), 1);
    assert_int_equal(sf_finest_level(f, o->pyramid_end), 0); /* also while every other step is coarser */
    assert_int_equal(sf_scheduled_level(f, 0, 40, 40), 0);   /* never below 32 px */
    double before = sf_scheduled_rate(f, o->cool_down, SF_FIELD_sh0),
           end = sf_scheduled_rate(f, 1, SF_FIELD_sh0);
    assert_true(before == o->lr_sh0);
    assert_true(fabs(end - o->cool_down_rate * o->lr_sh0) < 1e-12);
    sf_fitter_destroy(&f);
}

static void test_presets_have_names(void **state) {
    (void)state;
    sf_fit_options draft, standard, high, kept;
    sf_fit_options defaults = sf_fit_options_default();
    assert_ok(ctx, sf_fit_options_preset(ctx, "draft", &draft));
    assert_ok(ctx, sf_fit_options_preset(ctx, "standard", &standard));
    assert_ok(ctx, sf_fit_options_preset(ctx, "high", &high));
    assert_same_options(&standard, &defaults);
    assert_true(draft.steps < standard.steps && standard.steps < high.steps);
    assert_true(draft.max_gaussians < standard.max_gaussians && standard.max_gaussians <= high.max_gaussians);
    kept = draft;
    assert_status(ctx, sf_fit_options_preset(ctx, "best", &kept), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "\"best\"");
    assert_same_options(&kept, &draft);
}

/* Validation */

/* The model's means after some steps. */
static float *means_after(const sf_fit_options *options, int steps, size_t *n) {
    sf_fitter *fitter = start(options);
    for (int i = 0; i < steps; i++) assert_ok(ctx, sf_fitter_step(fitter));
    sf_model *model;
    assert_ok(ctx, sf_fitter_snapshot(fitter, &model));
    *n = 3 * sf_model_count(model);
    float *means = malloc(*n * sizeof *means);
    assert_non_null(means);
    sf_gaussians to = {.means = means};
    assert_ok(ctx, sf_model_get(model, 0, sf_model_count(model), &to));
    sf_model_destroy(&model);
    sf_fitter_destroy(&fitter);
    return means;
}

/* What stands in the views of validation has no influence on the steps before the rates fall. */
static void test_validation_views_teach_nothing(void **state) {
    (void)state;
    sf_fit_options options = short_fit(60);
    options.validate = 4;
    options.patience = 0;
    size_t n, same, spoilt = 0;
    float *before = means_after(&options, 30, &n);
    sf_fitter *fitter = start(&options);
    for (size_t i = 0; i < scene->view_count; i++) {
        sf_view *view = scene->views[i];
        if (view->split != SF_SPLIT_TRAIN || !sf_is_in_validation(&fitter->validation, view->id)) continue;
        memset(view->rgb, 77, 3 * (size_t)view->camera.width * (size_t)view->camera.height);
        spoilt++;
    }
    sf_fitter_destroy(&fitter);
    assert_true(spoilt >= 2);
    float *after = means_after(&options, 30, &same);
    assert_int_equal(n, same);
    assert_memory_equal(before, after, n * sizeof *before);
    free(before);
    free(after);
}

static void keep_best(void *user, const sf_fit_progress *p) {
    double *best = user;
    if (p->validation_psnr > *best) *best = p->validation_psnr;
}

/* A run that spoils its model at the end gives the best one. */
static void test_the_best_model_comes_back(void **state) {
    (void)state;
    sf_fit_options options = short_fit(200);
    options.validate = 4;
    options.patience = 0;
    options.size = SF_SIZE_CAP;
    options.lr_mean = 0.05; /* far too much */
    options.lr_mean_final = 1;
    options.cool_down = 1;
    sf_fitter *fitter = start(&options);
    double best = 0, psnr;
    size_t views;
    assert_ok(ctx, sf_fitter_run(fitter, keep_best, &best));
    assert_ok(ctx, sf_measure_validation(fitter, &psnr, &views));
    assert_true(views >= 2);
    assert_true(best > 5);
    assert_true(psnr >= best - 0.011); /* gains below 0.01 dB are none */
    sf_fit_progress p;
    sf_fitter_get_progress(fitter, &p);
    assert_true(fabs(p.validation_psnr - psnr) < 1e-9);
    sf_fitter_destroy(&fitter);
}

static void test_a_target_ends_the_run(void **state) {
    (void)state;
    sf_fit_options options = short_fit(100000);
    options.target_psnr = 14;
    options.plan_steps = 200;
    sf_fitter *fitter = start(&options);
    fitter->options.steps = 400; /* far enough */
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    sf_fit_progress p;
    sf_fitter_get_progress(fitter, &p);
    assert_true(p.validation_psnr >= 14);
    assert_true(p.step < 400);
    assert_status(ctx, sf_fitter_step(fitter), SF_ERR_END);
    sf_fitter_destroy(&fitter);
}

/* Where nothing is learned any more, the run settles at once. */
static void test_patience_ends_the_run(void **state) {
    (void)state;
    sf_fit_options options = short_fit(400);
    options.validate = 4;
    options.patience = 0.1;
    options.lr_mean = options.lr_sh0 = options.lr_sh_rest = options.lr_opacity = options.lr_scale = 0;
    options.lr_quat = 0;
    options.max_gaussians = 1;
    options.densify_end = 0.01;
    options.pyramid_levels = 0;
    sf_fitter *fitter = start(&options);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    sf_fit_progress p;
    sf_fitter_get_progress(fitter, &p);
    assert_true(p.fraction < 0.5);
    assert_true(p.fraction > options.patience);
    assert_int_equal(p.end, SF_FIT_VALIDATION);
    assert_true(p.best_step <= 0.1 * 400); /* at the first look */
    sf_fitter_destroy(&fitter);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_longer_runs_have_shorter_phases),
        cmocka_unit_test(test_brief_runs_make_large_steps),
        cmocka_unit_test(test_views_far_apart_follow_one_another),
        cmocka_unit_test(test_what_the_user_chose_stays),
        cmocka_unit_test(test_time_is_planned_as_steps),
        cmocka_unit_test(test_little_time_is_spent_on_steps),
        cmocka_unit_test(test_few_views_are_not_charged),
        cmocka_unit_test(test_growth_is_bounded_by_the_plan),
        cmocka_unit_test(test_resolution_and_rates_follow_the_plan),
        cmocka_unit_test(test_presets_have_names),
        cmocka_unit_test(test_the_best_model_comes_back),
        cmocka_unit_test(test_a_target_ends_the_run),
        cmocka_unit_test(test_patience_ends_the_run),
        cmocka_unit_test(test_validation_views_teach_nothing), /* the last: it spoils the scene */
    };
    return cmocka_run_group_tests_name("schedule", tests, load, unload);
}
