/* test_validation.c - the views that are kept out of the training: which they are, that they say when to
 * stop, and that the end learns from them too. */
#include "testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fit/fitter.h"
#include "fit/validation.h"

static sf_context *ctx;
static sf_scene *studio; /* all of it for training */

static sf_scene *load_studio(const char *name) {
    sf_scene *scene;
    sf_load_options load = sf_load_options_default();
    load.hold_out = 0;
    assert_ok(ctx, sf_scene_load(ctx, name, &load, &scene));
    return scene;
}

static int load(void **state) {
    (void)state;
    ctx = test_context();
    studio = load_studio("sim:studio?width=48&height=36&frames=20");
    return 0;
}

static int unload(void **state) {
    (void)state;
    sf_scene_destroy(&studio);
    sf_context_destroy(&ctx);
    return 0;
}

static sf_fit_options short_fit(int64_t steps) {
    sf_fit_options options = sf_fit_options_default();
    options.steps = steps;
    options.validate = 8; /* too few steps for it else */
    options.max_gaussians = 600;
    options.init_random = 600;
    options.init = SF_INIT_RANDOM;
    options.densify_every = 20;
    options.sh_degree = 1;
    return options;
}

static sf_fitter *start(sf_scene *scene, const sf_fit_options *options) {
    sf_fitter *fitter;
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, options, &fitter));
    return fitter;
}

static sf_fit_progress progress_of(const sf_fitter *fitter) {
    sf_fit_progress p;
    sf_fitter_get_progress(fitter, &p);
    return p;
}

static void take_steps(sf_fitter *fitter, int steps) {
    for (int i = 0; i < steps; i++) assert_ok(ctx, sf_fitter_step(fitter));
}

/* View i of the studio, in grey. */
static uint32_t add_view(sf_scene *scene, size_t i) {
    static uint8_t grey[3 * 48 * 36];
    sf_view_info info;
    uint32_t id;
    memset(grey, 100, sizeof grey);
    sf_pixels pixels = {.rgb = grey, .stride = 3 * 48};
    assert_ok(ctx, sf_scene_get_view(studio, i, &info));
    assert_ok(ctx, sf_scene_add_view(scene, NULL, &info.camera, &pixels, SF_SPLIT_TRAIN, &id));
    return id;
}

/* Which */

static void test_every_eighth(void **state) {
    (void)state;
    static const struct {
        int views;
        double target;
        int kept_out[3];
    } cases[] = {{1, 0, {-1}},     {7, 0, {-1}},         {8, 0, {4, -1}},
                 {12, 0, {4, -1}}, {20, 0, {4, 12, -1}}, {2, 50, {-1}},
                 {3, 50, {1, -1}}, {6, 50, {4, -1}},     {20, 50, {4, 12, -1}}};
    for (size_t c = 0; c < sizeof cases / sizeof *cases; c++) {
        sf_scene *scene;
        sf_fit_options options = short_fit(10);
        options.target_psnr = cases[c].target;
        assert_ok(ctx, sf_scene_create(ctx, &scene));
        const int *next = cases[c].kept_out;
        uint32_t ids[20];
        for (int i = 0; i < cases[c].views; i++) ids[i] = add_view(scene, (size_t)i);
        sf_fitter *fitter = start(scene, &options);
        for (int i = 0; i < cases[c].views; i++) {
            assert_int_equal(sf_is_in_validation(&fitter->validation, ids[i]), i == *next);
            next += i == *next;
        }
        sf_fitter_destroy(&fitter);
        options.validate = 0, options.target_psnr = 0;
        fitter = start(scene, &options);
        for (int i = 0; i < cases[c].views; i++)
            assert_false(sf_is_in_validation(&fitter->validation, ids[i]));
        sf_fitter_destroy(&fitter);
        sf_scene_destroy(&scene);
    }
}

/* Views never change sides; of those that come some are kept out. */
static void test_views_that_come_and_go(void **state) {
    (void)state;
    sf_scene *scene;
    sf_fit_options options = short_fit(1000);
    options.validate = 3;
    uint32_t ids[16];
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    for (size_t i = 0; i < 2; i++) ids[i] = add_view(scene, i);
    sf_fitter *fitter = start(scene, &options);
    take_steps(fitter, 4);
    ids[2] = add_view(scene, 2);
    take_steps(fitter, 4);
    for (size_t i = 0; i < 3; i++) assert_int_equal(sf_is_in_validation(&fitter->validation, ids[i]), i == 2);
    for (size_t i = 3; i < 16; i++) ids[i] = add_view(scene, i);
    take_steps(fitter, 4); /* from the next pass on */
    for (size_t i = 0; i < 16; i++)
        assert_int_equal(sf_is_in_validation(&fitter->validation, ids[i]), i == 2 || (i > 3 && i % 3 == 1));
    assert_ok(ctx, sf_scene_remove_view(scene, ids[4]));
    assert_ok(ctx, sf_scene_remove_view(scene, ids[2]));
    take_steps(fitter, 50);
    for (size_t i = 0; i < 16; i++)
        if (i != 2 && i != 4)
            assert_int_equal(sf_is_in_validation(&fitter->validation, ids[i]), i > 4 && i % 3 == 1);
    double psnr;
    size_t views;
    assert_ok(ctx, sf_measure_validation(fitter, &psnr, &views));
    assert_int_equal(views, 3);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
}

/* They are looked at as the views that are held out are in the end: with the focal lengths that were learned
 * of their camera. */
static void test_looks_with_refined_focal_lengths(void **state) {
    (void)state;
    static float rgb[3 * 48 * 36], target[3 * 48 * 36];
    sf_fit_options options = short_fit(200);
    options.refine_intrinsics = 1;
    sf_fitter *fitter = start(studio, &options);
    sf_renderer *renderer;
    sf_image_out out = {.rgb = rgb};
    double expected = 0, psnr;
    size_t views;
    take_steps(fitter, 60);
    assert_int_equal(fitter->views.lens_count, 1);
    for (int k = 0; k < 2; k++) fitter->views.lenses[0].log_focal[k] = 0.1;
    fitter->sh_degree = fitter->model->sh_degree;
    assert_ok(ctx, sf_renderer_create(ctx, &renderer));
    for (size_t i = 0; i < fitter->validation.count; i++) {
        sf_camera camera;
        sf_quality quality;
        assert_ok(ctx, sf_fitter_get_camera(fitter, fitter->validation.ids[i], &camera));
        assert_ok(ctx, sf_fitter_render(fitter, &camera, &out));
        assert_ok(ctx, sf_scene_get_pixels(studio, fitter->validation.ids[i], target, NULL));
        assert_ok(ctx, sf_compare(renderer, 48, 36, rgb, target, NULL, &quality));
        expected += quality.psnr / (double)fitter->validation.count;
    }
    assert_ok(ctx, sf_measure_validation(fitter, &psnr, &views));
    assert_int_equal(views, fitter->validation.count);
    assert_true(fabs(psnr - expected) < 1e-3);
    sf_renderer_destroy(&renderer);
    sf_fitter_destroy(&fitter);
}

/* When */

static float *means_of(sf_fitter *fitter, size_t *n) {
    sf_model *model;
    assert_ok(ctx, sf_fitter_snapshot(fitter, &model));
    *n = 3 * sf_model_count(model);
    float *means = malloc(*n * sizeof *means);
    assert_non_null(means);
    sf_gaussians to = {.means = means};
    assert_ok(ctx, sf_model_get(model, 0, sf_model_count(model), &to));
    sf_model_destroy(&model);
    return means;
}

/* Means before the rates fall and at the end, without and with a blemish in all views of validation. */
static void compare_with_blemish(double target, int *same_before, int *same_at_end) {
    enum { STEPS = 60, SETTLING = 12 };
    float *means[2][2];
    size_t n[2][2];
    for (int spoil = 0; spoil < 2; spoil++) {
        sf_scene *scene = load_studio("sim:studio?width=48&height=36&frames=12");
        sf_fit_options options = short_fit(STEPS);
        options.patience = 0;
        options.target_psnr = target;
        sf_fitter *fitter = start(scene, &options);
        for (size_t i = 0; i < scene->view_count; i++)
            if (spoil && sf_is_in_validation(&fitter->validation, scene->views[i]->id))
                memset(scene->views[i]->rgb, 77, 3 * 48 * 36);
        take_steps(fitter, STEPS - SETTLING);
        means[spoil][0] = means_of(fitter, &n[spoil][0]);
        take_steps(fitter, SETTLING);
        means[spoil][1] = means_of(fitter, &n[spoil][1]);
        sf_fitter_destroy(&fitter);
        sf_scene_destroy(&scene);
    }
    int same[2];
    for (int at = 0; at < 2; at++) {
        same[at] = n[0][at] == n[1][at] && !memcmp(means[0][at], means[1][at], n[0][at] * sizeof(float));
        free(means[0][at]);
        free(means[1][at]);
    }
    *same_before = same[0], *same_at_end = same[1];
}

static void test_the_end_learns_from_all(void **state) {
    (void)state;
    int before, at_end;
    compare_with_blemish(0, &before, &at_end);
    assert_true(before);
    assert_false(at_end);
    compare_with_blemish(100, &before, &at_end); /* a target is looked for to the end */
    assert_true(before);
    assert_true(at_end);
}

/* Once growth is over the views join where the newest look is the best: patience would last until the rates
 * fall anyway. */
static void test_who_gains_needs_no_watching(void **state) {
    (void)state;
    enum { STEPS = 200 };
    sf_fit_options options = short_fit(STEPS);
    options.size = SF_SIZE_CAP;
    options.pyramid_levels = 0;
    options.densify_end = 0.3;
    options.patience = 0.4;
    uint32_t kept_out = studio->views[4]->id;
    sf_fitter *fitter = start(studio, &options);
    int joined = 0;
    for (int step = 1; !joined && step <= 0.8 * STEPS; step++) {
        take_steps(fitter, 1);
        sf_fit_progress p = progress_of(fitter);
        joined = !sf_is_in_validation(&fitter->validation, kept_out);
        if (!joined) continue;
        assert_true(p.fraction >= 0.4 && p.fraction < 0.79);
        assert_int_equal(p.best_step, step - 1); /* it was looked at before the step */
    }
    assert_true(joined);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    assert_int_equal(progress_of(fitter).end, SF_FIT_COMPLETE);
    sf_fitter_destroy(&fitter);
}

/* Few views, and rates that make too much of them. */

typedef struct curve {
    sf_fitter *fitter;
    sf_scene *scene;
    double best, end;
} curve;

static double held_out(const curve *c) { return test_held_out(ctx, c->scene, c->fitter).psnr; }

static void follow(void *user, const sf_fit_progress *p) {
    curve *c = user;
    if (p->step % 20) return;
    c->best = fmax(c->best, held_out(c));
}

static sf_fit_progress fit_few(int64_t validate, int64_t seed, curve *c) {
    sf_load_options load = sf_load_options_default();
    load.hold_out = 3;
    *c = (curve){0};
    assert_ok(ctx, sf_scene_load(ctx, "sim:studio?width=48&height=36&frames=9", &load, &c->scene));
    sf_fit_options options = short_fit(600);
    options.sh_degree = 3;
    options.lr_sh_rest = 0.05;
    options.lr_boost = 1, options.huber_delta = 1e-9;
    options.size = SF_SIZE_CAP;
    options.pyramid_levels = 0;
    options.densify_end = 0.1;
    options.validate = validate, options.seed = seed;
    c->fitter = start(c->scene, &options);
    assert_ok(ctx, sf_fitter_run(c->fitter, follow, c));
    c->end = held_out(c);
    sf_fit_progress p = progress_of(c->fitter);
    sf_fitter_destroy(&c->fitter);
    sf_scene_destroy(&c->scene);
    return p;
}

static void test_few_views_stop_near_the_best(void **state) {
    (void)state;
    if (getenv("SPLATFIT_QUICK")) test_skip("SPLATFIT_QUICK is set");
    enum { SEEDS = 4 };
    double lost = 0, gained = 0; /* means: single runs stray by 0.3 dB */
    for (int64_t seed = 1; seed <= SEEDS; seed++) {
        curve without, with;
        sf_fit_progress p = fit_few(0, seed, &without);
        assert_int_equal(p.end, SF_FIT_COMPLETE);
        p = fit_few(6, seed, &with);
        print_message("to the end %.2f of %.2f dB; stopped after %d steps %.2f of %.2f dB\n", without.end,
                      without.best, (int)p.step, with.end, with.best);
        assert_true(without.end < without.best - 0.5); /* more is worse */
        assert_int_equal(p.end, SF_FIT_VALIDATION);
        assert_true(p.best_step < p.step && p.step < 500);
        lost += (with.best - with.end) / SEEDS;
        gained += (with.end - without.end) / SEEDS;
    }
    assert_true(lost < 0.3);
    assert_true(gained > 0.3);
}

/* Why */

static void test_runs_say_why_they_end(void **state) {
    (void)state;
    sf_fit_options options = short_fit(20);
    sf_fitter *fitter = start(studio, &options);
    assert_int_equal(progress_of(fitter).end, SF_FIT_GOES_ON);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    assert_int_equal(progress_of(fitter).end, SF_FIT_COMPLETE);
    assert_status(ctx, sf_fitter_step(fitter), SF_ERR_END);
    sf_fitter_destroy(&fitter);
    options.target_psnr = 3;
    fitter = start(studio, &options);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    assert_int_equal(progress_of(fitter).end, SF_FIT_TARGET);
    sf_fitter_destroy(&fitter);
    options = short_fit(0);
    options.time_limit = 0.05;
    fitter = start(studio, &options);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    assert_int_equal(progress_of(fitter).end, SF_FIT_TIME);
    sf_fitter_destroy(&fitter);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_every_eighth),
        cmocka_unit_test(test_views_that_come_and_go),
        cmocka_unit_test(test_looks_with_refined_focal_lengths),
        cmocka_unit_test(test_the_end_learns_from_all),
        cmocka_unit_test(test_who_gains_needs_no_watching),
        cmocka_unit_test(test_few_views_stop_near_the_best),
        cmocka_unit_test(test_runs_say_why_they_end),
    };
    return cmocka_run_group_tests_name("validate", tests, load, unload);
}
