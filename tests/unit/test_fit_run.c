/* test_fit_run.c - the number of Gaussians, options, progress, time and cancellation of a fit. */
#include "fit_fixture.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>

/* The number of Gaussians. */

static void test_cap_holds(void **state) {
    (void)state;
    static const int64_t caps[] = {1, 7, 16, 17, 60, 61, 64, 100};
    sf_context *ctx = test_context();
    sf_scene *scene = fit_small_scene(ctx);
    for (size_t i = 0; i < sizeof caps / sizeof *caps; i += getenv("SPLATFIT_QUICK") ? 3 : 1) {
        sf_fit_options options = fit_short_fit(50);
        options.init = SF_INIT_POINTS;
        options.max_gaussians = caps[i];
        options.densify_every = 2;
        options.densify_end = 1;
        sf_fitter *fitter = fit_start(ctx, scene, &options);
        size_t cap = (size_t)caps[i], most = fit_progress_of(fitter).gaussians;
        assert_int_equal(most, cap < TRUE_COUNT ? cap : TRUE_COUNT);
        for (int step = 0; step < 50; step++) {
            fit_take_steps(ctx, fitter, 1);
            size_t count = fit_progress_of(fitter).gaussians;
            if (count > cap) fail_msg("%zu Gaussians after step %d, cap %zu", count, step + 1, cap);
            most = count > most ? count : most;
        }
        assert_true(most > cap - cap / 10 - 1); /* and it is used */
        fit_assert_sound(ctx, fitter);
        sf_fitter_destroy(&fitter);
    }
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* No more at once than densify_rate says, and with it there is growth. */
static void test_growth_is_gradual(void **state) {
    (void)state;
    test_skip_emulated();
    sf_context *ctx = test_context();
    sf_scene *scene = fit_small_scene(ctx);
    sf_fit_options options = fit_short_fit(40);
    options.densify_every = 4;
    options.densify_rate = 0.1;
    options.size = SF_SIZE_CAP;
    options.max_gaussians = 1000;
    sf_fitter *fitter = fit_start(ctx, scene, &options);
    size_t before = fit_progress_of(fitter).gaussians;
    for (int step = 0; step < 40; step++) {
        fit_take_steps(ctx, fitter, 1);
        size_t count = fit_progress_of(fitter).gaussians;
        assert_true(count <= before + before / 10);
        before = count;
    }
    assert_true(before > TRUE_COUNT + TRUE_COUNT / 2);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_cap_below_the_model(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = fit_small_scene(ctx);
    sf_model *model = fit_true_model(ctx);
    sf_fit_options options = fit_short_fit(10);
    options.max_gaussians = TRUE_COUNT - 1;
    sf_fitter *fitter = (sf_fitter *)&options;
    assert_status(ctx, sf_fitter_create(ctx, scene, model, &options, &fitter), SF_ERR_ARGUMENT);
    assert_null(fitter);
    assert_error_names(ctx, "max_gaussians: 59");
    assert_error_names(ctx, "60");
    options.max_gaussians = TRUE_COUNT;
    assert_ok(ctx, sf_fitter_create(ctx, scene, model, &options, &fitter));
    sf_fitter_destroy(&fitter);
    sf_model_destroy(&model);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Steps, the end, and what is told in between. */

static void test_bad_options(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = fit_small_scene(ctx);
    sf_fit_options options = fit_short_fit(10);
    sf_fitter *fitter;
    options.lr_opacity = NAN;
    assert_status(ctx, sf_fitter_create(ctx, scene, NULL, &options, &fitter), SF_ERR_ARGUMENT);
    assert_null(fitter);
    assert_error_names(ctx, "lr_opacity");
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

typedef struct log_of_run {
    int64_t calls, level, degree;
    double fraction;
} log_of_run;

static void follow(void *user, const sf_fit_progress *p) {
    log_of_run *log = user;
    assert_int_equal(p->step, ++log->calls);
    assert_int_equal(p->steps, 40);
    assert_true(p->fraction == (double)p->step / 40 && p->fraction > log->fraction);
    assert_true(isfinite(p->loss) && p->loss > 0);
    assert_true(p->seconds >= 0 && p->eta_seconds >= 0);
    assert_true(log->calls == 1 || (p->level <= log->level && p->sh_degree >= log->degree));
    log->level = p->level;
    log->degree = p->sh_degree;
    log->fraction = p->fraction;
}

static void test_progress_and_end(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = fit_small_scene(ctx);
    sf_fit_options options = fit_short_fit(40);
    sf_fitter *fitter = fit_start(ctx, scene, &options);
    log_of_run log = {0};
    assert_ok(ctx, sf_fitter_run(fitter, follow, &log));
    assert_int_equal(log.calls, 40);
    assert_int_equal(log.level, 0);
    assert_int_equal(log.degree, 3);
    content ended = fit_content_of(ctx, fitter);
    assert_int_equal(sf_fitter_step(fitter), SF_ERR_END);
    assert_ok(ctx, sf_fitter_run(fitter, follow, &log)); /* nothing left to do */
    assert_int_equal(log.calls, 40);
    assert_int_equal(fit_progress_of(fitter).step, 40);
    fit_assert_same(&ended, fit_content_of(ctx, fitter));
    free(ended.values);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* By time alone: it ends, with a model. How many steps that were is the machine's affair. */
static void test_time_limit(void **state) {
    (void)state;
    test_skip_emulated();
    sf_context *ctx = test_context();
    sf_scene *scene = fit_small_scene(ctx);
    sf_fit_options options = fit_short_fit(1);
    sf_fitter *fitter = fit_start(ctx, scene, &options);
    fit_take_steps(ctx, fitter, 1);
    double limit = 0.5 + 10 * fit_progress_of(fitter).seconds; /* emulated, a step can take a second */
    sf_fitter_destroy(&fitter);
    options = fit_short_fit(0);
    options.time_limit = limit;
    options.validate =
        0; /* the limit is long where the first step was slow, and views kept out end such a run */
    fitter = fit_start(ctx, scene, &options);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    sf_fit_progress p = fit_progress_of(fitter);
    assert_true(p.fraction == 1 && p.seconds >= limit);
    assert_int_equal(p.steps, 0);
    assert_true(p.step > 0);
    fit_assert_sound(ctx, fitter);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Seconds taken out of the run count neither as its time nor against its limit; negative ones are put in. */
static void test_time_taken_out(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = fit_small_scene(ctx);
    sf_fit_options options = fit_short_fit(0);
    options.time_limit = 1e6;
    sf_fitter *fitter = fit_start(ctx, scene, &options);
    fit_take_steps(ctx, fitter, 1);
    sf_fitter_skip_time(fitter, -2e6);
    assert_true(fit_progress_of(fitter).seconds >= 2e6);
    assert_status(ctx, sf_fitter_step(fitter), SF_ERR_END);
    sf_fitter_skip_time(fitter, 1.5e6);
    assert_true(fit_progress_of(fitter).fraction >= 0.5 && fit_progress_of(fitter).fraction < 1);
    fit_take_steps(ctx, fitter, 1);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_snapshot_stays(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = fit_small_scene(ctx);
    sf_fit_options options = fit_short_fit(60);
    sf_fitter *fitter = fit_start(ctx, scene, &options);
    sf_model *model;
    fit_take_steps(ctx, fitter, 10);
    assert_ok(ctx, sf_fitter_snapshot(fitter, &model));
    content taken = fit_content_of_model(model), now = fit_content_of(ctx, fitter);
    fit_assert_same(&taken, now);
    fit_take_steps(ctx, fitter, 20);
    now = fit_content_of(ctx, fitter);
    assert_false(fit_is_same(&taken, &now));
    sf_gaussians change = {.means = (float[]){7, 8, 9}};
    assert_ok(ctx, sf_model_set(model, 0, 1, &change));
    fit_assert_same(&now, fit_content_of(ctx, fitter)); /* nor does the fit see the copy's changes */
    change.means = taken.values;
    assert_ok(ctx, sf_model_set(model, 0, 1, &change));
    sf_fitter_destroy(&fitter);
    fit_assert_same(&taken, fit_content_of_model(model)); /* it outlives the fitter */
    free(taken.values);
    free(now.values);
    sf_model_destroy(&model);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Cancelling. */

typedef struct canceller {
    sf_fitter *fitter;
    int64_t at;
} canceller;

static void *cancel(void *user) {
    sf_fitter_cancel(user);
    return NULL;
}

/* Another thread cancels while this step is the last one done. */
static void cancel_at(void *user, const sf_fit_progress *p) {
    canceller *c = user;
    pthread_t thread;
    if (p->step != c->at) return;
    assert_int_equal(pthread_create(&thread, NULL, cancel, c->fitter), 0);
    assert_int_equal(pthread_join(thread, NULL), 0);
}

static void test_cancel_and_resume(void **state) {
    (void)state;
    sf_fit_options options = fit_short_fit(60);
    content whole = fit_fitted_by(2, &options);
    sf_context *ctx = test_context();
    sf_scene *scene = fit_small_scene(ctx);
    sf_fitter *fitter = fit_start(ctx, scene, &options);
    canceller c = {fitter, 23};
    assert_status(ctx, sf_fitter_run(fitter, cancel_at, &c), SF_ERR_CANCELLED);
    assert_int_equal(fit_progress_of(fitter).step, 23);
    assert_int_equal(sf_fitter_step(fitter), SF_ERR_CANCELLED);
    assert_int_equal(fit_progress_of(fitter).step, 23);
    fit_assert_sound(ctx, fitter);
    sf_fitter_resume(fitter);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    assert_int_equal(fit_progress_of(fitter).step, 60);
    fit_assert_same(&whole, fit_content_of(ctx, fitter)); /* as if nothing had happened */
    free(whole.values);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

typedef struct waiter {
    sf_fitter *fitter;
    atomic_int steps, cancelled;
    int64_t after; /* steps done after the call had come back */
} waiter;

static void *cancel_soon(void *user) {
    waiter *w = user;
    while (atomic_load(&w->steps) < 5) continue;
    sf_fitter_cancel(w->fitter);
    atomic_store(&w->cancelled, 1);
    return NULL;
}

static void count_steps(void *user, const sf_fit_progress *p) {
    waiter *w = user;
    (void)p;
    w->after += atomic_load(&w->cancelled);
    atomic_fetch_add(&w->steps, 1);
}

/* In the middle of whatever the run is doing: the step in progress is the last. */
static void test_cancel_any_time(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = fit_small_scene(ctx);
    sf_fit_options options = fit_short_fit(100000000);
    sf_fitter *fitter = fit_start(ctx, scene, &options);
    for (int round = 0; round < 5; round++) {
        waiter w = {.fitter = fitter};
        pthread_t thread;
        assert_int_equal(pthread_create(&thread, NULL, cancel_soon, &w), 0);
        assert_status(ctx, sf_fitter_run(fitter, count_steps, &w), SF_ERR_CANCELLED);
        assert_int_equal(pthread_join(thread, NULL), 0);
        assert_true(atomic_load(&w.steps) >= 5);
        assert_true(w.after <= 1);
        sf_fitter_resume(fitter);
    }
    fit_assert_sound(ctx, fitter);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_cap_holds),           cmocka_unit_test(test_growth_is_gradual),
        cmocka_unit_test(test_cap_below_the_model), cmocka_unit_test(test_bad_options),
        cmocka_unit_test(test_progress_and_end),    cmocka_unit_test(test_time_limit),
        cmocka_unit_test(test_time_taken_out),      cmocka_unit_test(test_snapshot_stays),
        cmocka_unit_test(test_cancel_and_resume),   cmocka_unit_test(test_cancel_any_time),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
