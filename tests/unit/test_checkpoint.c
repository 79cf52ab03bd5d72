/* test_checkpoint.c - fits that are interrupted and continued make the same bytes; runs limited by time are
 * repeated. */
#include "checkpoint_fixture.h"

#include <stdlib.h>

#include "fit/fitter.h"
#include "fit/reorder.h"

/* Of a fresh scene. */
static void end_all(run *r) {
    checkpoint_end(r);
    sf_scene_destroy(&r->scene);
    sf_context_destroy(&r->ctx);
}

/* The bytes. */

static int64_t whole(void) { return getenv("SPLATFIT_QUICK") ? 16 : 40; }

/* Interrupted after each step in turn: in passes of 7 views and between them, at growth, between resolutions,
 * with other numbers of threads. */
static sf_fit_end check_interrupted_every(const sf_fit_options *options, int64_t every) {
    static const int threads[] = {1, 2, 4};
    const char *path = test_path("c");
    run r = checkpoint_start(2, options);
    assert_ok(r.ctx, sf_fitter_run(r.fitter, NULL, NULL));
    content expected = checkpoint_model_of(&r);
    sf_fit_progress reached = checkpoint_progress_of(&r);
    checkpoint_end(&r);
    run writer = checkpoint_start(4, options);
    for (int64_t at = 0; at <= reached.step; at += every) {
        assert_ok(writer.ctx, sf_fitter_save(writer.fitter, path));
        run reader = checkpoint_go_on(threads[at % 3], path);
        assert_int_equal(checkpoint_progress_of(&reader).step, at);
        assert_ok(reader.ctx, sf_fitter_run(reader.fitter, NULL, NULL));
        checkpoint_assert_same(&expected, checkpoint_model_of(&reader));
        sf_fit_progress p = checkpoint_progress_of(&reader);
        assert_true(p.loss == reached.loss);
        assert_memory_equal(p.background, reached.background, sizeof p.background);
        assert_int_equal(p.skipped_values, reached.skipped_values);
        assert_int_equal(p.step, reached.step);
        assert_int_equal(p.best_step, reached.best_step);
        assert_int_equal(p.end, reached.end);
        checkpoint_end(&reader);
        if (at + every <= reached.step) checkpoint_take_steps(&writer, every);
    }
    checkpoint_end(&writer);
    free(expected.data);
    return reached.end;
}

static void check_interrupted(const sf_fit_options *options) {
    assert_int_equal(check_interrupted_every(options, 1), SF_FIT_COMPLETE);
}

static void test_same_bytes(void **state) {
    (void)state;
    sf_fit_options options = checkpoint_short_fit(whole());
    check_interrupted(&options);
}

static void test_same_bytes_otherwise(void **state) {
    (void)state;
    test_skip_emulated();
    sf_fit_options options = checkpoint_short_fit(whole() / 2);
    options.background = SF_BACKGROUND_RANDOM;
    options.sh_degree = 1;
    options.antialiased = 1;
    options.densify_every = 3;
    check_interrupted(&options);
}

/* Other ways to grow, with all that is learned of views. */
static void test_same_bytes_however_grown(void **state) {
    (void)state;
    test_skip_emulated();
    for (int growth = SF_DENSIFY_ERROR; growth <= SF_DENSIFY_RELOCATE; growth++) {
        sf_fit_options options = checkpoint_short_fit(whole() / 2);
        options.densify = growth;
        options.densify_every = 3;
        options.validate = 4;
        options.exposure = options.refine_poses = options.refine_intrinsics = 1;
        options.reg_opacity = options.reg_scale = 0.01;
        options.ema_steps = growth == SF_DENSIFY_ERROR ? 5 : 0;
        check_interrupted(&options);
    }
}

static void test_same_bytes_with_half_moments(void **state) {
    (void)state;
    test_skip_emulated();
    sf_fit_options options = checkpoint_short_fit(whole() / 2);
    options.moments = SF_MOMENTS_HALF;
    options.densify_every = 3;
    check_interrupted(&options);
}

/* Steps that spoil the model: its best comes back, and the views of validation join the others. */
static void test_same_bytes_when_stopped(void **state) {
    (void)state;
    test_skip_emulated();
    if (getenv("SPLATFIT_QUICK")) test_skip("SPLATFIT_QUICK is set");
    sf_fit_options options = checkpoint_short_fit(300);
    options.validate = 3;
    options.patience = 0.05;
    options.pyramid_end = options.densify_end = 0.1;
    options.size = SF_SIZE_CAP;
    options.lr_mean = 0.05;
    options.lr_mean_final = 1;
    assert_int_equal(check_interrupted_every(&options, 23), SF_FIT_VALIDATION);
}

/* Gaussian i gets degree (i + shift) % 4, shift counting upwards. */
static void mix_degrees(const run *r, size_t shift) {
    sf_fitter *f = r->fitter;
    sf_remap_entry *places = calloc(f->model->count, sizeof *places);
    assert_non_null(places);
    for (size_t i = 0; i < f->model->count; i++)
        places[i] = (sf_remap_entry){(uint32_t)i, (uint8_t)((i + shift) % 4)};
    assert_ok(r->ctx, sf_reorder(f, places, f->model->count, NULL));
    free(places);
}

/* Degrees that differ, and change in the course of a run that keeps its best model: N + N steps are 2N. */
static void check_degrees(int moments) {
    const char *path = test_path("d");
    int64_t half = whole() / 4;
    sf_fit_options options = checkpoint_short_fit(2 * half);
    options.densify_every = 3;
    options.validate = 4;
    options.moments = moments;
    content expected = {0};
    for (int64_t at = -1; at <= half; at += half / 2) { /* interrupted at step half + at; the first is not */
        run r = checkpoint_start(2, &options);
        mix_degrees(&r, 0);
        checkpoint_take_steps(&r, half);
        mix_degrees(&r, 1);
        if (at >= 0) {
            size_t degrees[4], back[4];
            checkpoint_take_steps(&r, at);
            assert_ok(r.ctx, sf_fitter_save(r.fitter, path));
            sf_model_degrees(r.fitter->model, degrees);
            checkpoint_end(&r);
            r = checkpoint_go_on(1, path);
            sf_model_degrees(r.fitter->model, back);
            assert_true(degrees[0] && degrees[1] && degrees[2] && degrees[3]);
            assert_memory_equal(back, degrees, sizeof back);
        }
        assert_ok(r.ctx, sf_fitter_run(r.fitter, NULL, NULL));
        if (at < 0)
            expected = checkpoint_model_of(&r), at = -(half / 2);
        else
            checkpoint_assert_same(&expected, checkpoint_model_of(&r));
        checkpoint_end(&r);
    }
    free(expected.data);
}

static void test_same_bytes_of_mixed_degrees(void **state) {
    (void)state;
    check_degrees(SF_MOMENTS_FLOAT);
    check_degrees(SF_MOMENTS_HALF);
}

/* A checkpoint of a checkpoint is the same but for its time; saving changes nothing. */
static void test_again_and_again(void **state) {
    (void)state;
    test_skip_emulated();
    sf_fit_options options = checkpoint_short_fit(whole());
    run r = checkpoint_start(1, &options);
    assert_ok(r.ctx, sf_fitter_run(r.fitter, NULL, NULL));
    content expected = checkpoint_model_of(&r);
    checkpoint_end(&r);
    r = checkpoint_start(2, &options);
    while (checkpoint_progress_of(&r).step < options.steps) {
        checkpoint_take_steps(&r, 1);
        assert_ok(r.ctx, sf_fitter_save(r.fitter, test_path("a")));
        checkpoint_end(&r);
        r = checkpoint_go_on(1 + (int)(options.steps % 3), test_path("a"));
    }
    assert_status(r.ctx, sf_fitter_step(r.fitter), SF_ERR_END);
    checkpoint_assert_same(&expected, checkpoint_model_of(&r));
    free(expected.data);
    checkpoint_end(&r);
}

/* A model gone on from keeps its own schedule. */
static void test_gone_on_model(void **state) {
    (void)state;
    test_skip_emulated();
    sf_fit_options options = checkpoint_short_fit(10);
    run r = checkpoint_start(1, &options);
    sf_model *model;
    assert_ok(r.ctx, sf_fitter_run(r.fitter, NULL, NULL));
    assert_ok(r.ctx, sf_fitter_snapshot(r.fitter, &model));
    sf_fitter_destroy(&r.fitter);
    assert_ok(r.ctx, sf_fitter_create(r.ctx, r.scene, model, &options, &r.fitter));
    checkpoint_take_steps(&r, 4);
    assert_ok(r.ctx, sf_fitter_save(r.fitter, test_path("g")));
    assert_ok(r.ctx, sf_fitter_run(r.fitter, NULL, NULL));
    content expected = checkpoint_model_of(&r);
    run other = checkpoint_go_on(2, test_path("g"));
    assert_ok(other.ctx, sf_fitter_run(other.fitter, NULL, NULL));
    assert_int_equal(checkpoint_progress_of(&other).level, 0);
    checkpoint_assert_same(&expected, checkpoint_model_of(&other));
    free(expected.data);
    checkpoint_end(&other);
    sf_model_destroy(&model);
    checkpoint_end(&r);
}

/* View `place` left in the middle of a pass. */
static void check_view_that_left(size_t place) {
    sf_fit_options options = checkpoint_short_fit(20);
    options.validate = 3;
    run r = checkpoint_fresh_scene(1), other = checkpoint_fresh_scene(2);
    sf_view_info view;
    checkpoint_begin(&r, &options);
    checkpoint_take_steps(&r, 3);
    assert_ok(r.ctx, sf_scene_get_view(r.scene, place, &view));
    assert_ok(r.ctx, sf_scene_remove_view(r.scene, view.id));
    assert_ok(r.ctx, sf_fitter_save(r.fitter, test_path("v")));
    assert_status(other.ctx, sf_fitter_load(other.ctx, other.scene, test_path("v"), NULL, &other.fitter),
                  SF_ERR_ARGUMENT);
    assert_error_names(other.ctx, "views: 9, in the checkpoint 8");
    assert_ok(other.ctx, sf_scene_get_view(other.scene, place, &view));
    assert_ok(other.ctx, sf_scene_remove_view(other.scene, view.id));
    assert_ok(other.ctx, sf_fitter_load(other.ctx, other.scene, test_path("v"), NULL, &other.fitter));
    assert_ok(r.ctx, sf_fitter_run(r.fitter, NULL, NULL));
    assert_ok(other.ctx, sf_fitter_run(other.fitter, NULL, NULL));
    content expected = checkpoint_model_of(&r);
    checkpoint_assert_same(&expected, checkpoint_model_of(&other));
    free(expected.data);
    end_all(&r);
    end_all(&other);
}

/* Of 0 .. 8, 0 and 8 are held out; 2 and 5 are kept out to validate. */
static void test_view_that_left(void **state) {
    (void)state;
    test_skip_emulated();
    check_view_that_left(5);
    check_view_that_left(1);
}

/* Time. */

/* The time that has passed is part of the run, the time between is not. */
static void test_time_goes_on(void **state) {
    (void)state;
    test_skip_emulated();
    sf_fit_options options = checkpoint_short_fit(0);
    options.time_limit = 1000;
    run r = checkpoint_start(1, &options);
    checkpoint_rest(0.05);
    checkpoint_take_steps(&r, 3);
    double before = checkpoint_progress_of(&r).seconds;
    assert_ok(r.ctx, sf_fitter_save(r.fitter, test_path("t")));
    checkpoint_rest(0.05);
    run other = checkpoint_go_on(1, test_path("t"));
    double after = checkpoint_progress_of(&other).seconds;
    assert_true(before >= 0.05);
    assert_true(after >= before);
    checkpoint_end(&r);
    checkpoint_end(&other);
}

/* A run limited by time, interrupted once, and the run that follows its plan: the same bytes. */
static void test_plan(void **state) {
    (void)state;
    test_skip_emulated();
    sf_fit_options options = checkpoint_short_fit(0);
    options.time_limit = getenv("SPLATFIT_QUICK") ? 1 : 0.4;
    run r = checkpoint_start(2, &options);
    while (checkpoint_progress_of(&r).fraction < 0.5) checkpoint_take_steps(&r, 1);
    assert_ok(r.ctx, sf_fitter_save(r.fitter, test_path("p")));
    checkpoint_end(&r);
    r = checkpoint_go_on(1, test_path("p"));
    assert_ok(r.ctx, sf_fitter_run(r.fitter, NULL, NULL));
    content expected = checkpoint_model_of(&r);
    int64_t steps = checkpoint_progress_of(&r).step;
    size_t count, again;
    assert_ok(r.ctx, sf_fitter_get_plan(r.fitter, NULL, 0, &count));
    assert_int_equal(count, steps);
    uint32_t *ticks = malloc((count + 1) * sizeof *ticks);
    assert_non_null(ticks);
    assert_ok(r.ctx, sf_fitter_get_plan(r.fitter, ticks, count, &again));
    sf_fitter_get_options(r.fitter, &options); /* with what was planned */
    checkpoint_end(&r);
    options.time_limit = 1e-3; /* its own clock would end it at once */
    r = checkpoint_start(4, &options);
    assert_ok(r.ctx, sf_fitter_follow(r.fitter, ticks, count));
    checkpoint_take_steps(&r, steps / 2);
    assert_ok(r.ctx, sf_fitter_save(r.fitter, test_path("p")));
    checkpoint_end(&r);
    r = checkpoint_go_on(2, test_path("p"));
    assert_ok(r.ctx, sf_fitter_run(r.fitter, NULL, NULL));
    assert_int_equal(checkpoint_progress_of(&r).step, steps);
    checkpoint_assert_same(&expected, checkpoint_model_of(&r));
    checkpoint_end(&r);
    free(expected.data);
    free(ticks);
}

static void test_bad_plans(void **state) {
    (void)state;
    static const uint32_t falling[] = {3, 2}, beyond[] = {1, SF_PLAN_TICKS}, good[] = {0, 5, 5};
    sf_fit_options options = checkpoint_short_fit(0);
    options.time_limit = 100;
    run r = checkpoint_start(1, &options);
    assert_status(r.ctx, sf_fitter_follow(r.fitter, falling, 2), SF_ERR_ARGUMENT);
    assert_error_names(r.ctx, "plan: step 1: 2 ");
    assert_status(r.ctx, sf_fitter_follow(r.fitter, beyond, 2), SF_ERR_ARGUMENT);
    assert_ok(r.ctx, sf_fitter_follow(r.fitter, good, 3));
    checkpoint_take_steps(&r, 3);
    assert_status(r.ctx, sf_fitter_step(r.fitter), SF_ERR_END);
    assert_status(r.ctx, sf_fitter_follow(r.fitter, good, 3), SF_ERR_ARGUMENT);
    assert_error_names(r.ctx, "has begun");
    checkpoint_end(&r);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_same_bytes),
        cmocka_unit_test(test_same_bytes_otherwise),
        cmocka_unit_test(test_same_bytes_however_grown),
        cmocka_unit_test(test_same_bytes_with_half_moments),
        cmocka_unit_test(test_same_bytes_of_mixed_degrees),
        cmocka_unit_test(test_again_and_again),
        cmocka_unit_test(test_same_bytes_when_stopped),
        cmocka_unit_test(test_gone_on_model),
        cmocka_unit_test(test_view_that_left),
        cmocka_unit_test(test_time_goes_on),
        cmocka_unit_test(test_plan),
        cmocka_unit_test(test_bad_plans),
    };
    return cmocka_run_group_tests(tests, NULL, checkpoint_close_scenes);
}
