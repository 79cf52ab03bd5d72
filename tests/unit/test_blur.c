/* test_blur.c - training views that are less sharp than the model: found, named, and trained on less; and
 * nothing else taken for them. */
#include "testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "disturb.h"
#include "fit/fitter.h"
#include "fit/validation.h"

#define STUDIO "sim:studio?width=64&height=48&frames=24"

/* Of 24 frames every 8th is held out. */
enum { VIEWS = 21, BLURRED = 7, STEPS = 120, JUDGED = 40 };

static sf_fit_options short_fit(void) {
    sf_fit_options options = sf_fit_options_default();
    options.steps = STEPS;
    options.max_gaussians = 1000;
    options.validate = 0;
    options.sh_degree = 1;
    options.densify_every = 20;
    return options;
}

/* After `steps`; the fitter is the caller's. */
static sf_fitter *fit_for(sf_scene *scene, const sf_fit_options *options, int steps) {
    sf_fitter *fitter;
    test_log_clear();
    assert_ok(scene->ctx, sf_fitter_create(scene->ctx, scene, NULL, options, &fitter));
    for (int i = 0; i < steps; i++) assert_ok(scene->ctx, sf_fitter_step(fitter));
    return fitter;
}

/* Whether view `number` of the training views was found blurred; ids count them in their order. */
static int is_found(const sf_fitter *fitter, size_t number) {
    uint32_t *ids;
    size_t count;
    assert_ok(fitter->ctx, sf_scene_training_ids(fitter->scene, &ids, &count));
    assert_true(number < count);
    int found = sf_is_blurred(&fitter->blur, ids[number]);
    sf_free(fitter->ctx, ids);
    return found;
}

/* Those and no others are, and the log says so. */
static void assert_a_third_found(const sf_fitter *fitter) {
    assert_int_equal(fitter->blur.count, BLURRED);
    for (size_t i = 0; i < VIEWS; i++) assert_int_equal(is_found(fitter, i), i % 3 == 1);
    test_assert_contains(test_log, "blur: 7 of 21 training views are less sharp than the model", __FILE__,
                         __LINE__);
    for (size_t i = 0; i < BLURRED; i++) {
        sf_view *view = sf_scene_retain_id(fitter->scene, fitter->blur.ids[i]);
        test_assert_contains(test_log, view->name, __FILE__, __LINE__);
        sf_view_release(view);
    }
}

static void assert_none_found(const sf_fitter *fitter) {
    assert_int_equal(fitter->blur.count, 0);
    assert_null(strstr(test_log, "blur"));
}

/* Along the rows, along the columns, and in all directions; not before the model knows anything. */
static void test_found(void **state) {
    (void)state;
    static const test_smear smears[] = {{2, 0}, {0, 2}, {2, 2}, {5, 0}};
    sf_context *ctx = test_context();
    sf_fit_options options = short_fit();
    for (size_t i = 0; i < sizeof smears / sizeof *smears; i++) {
        test_smear smear = smears[i];
        sf_scene *scene = test_changed_scene(ctx, STUDIO, test_blur_a_third, &smear);
        sf_fitter *fitter = fit_for(scene, &options, JUDGED);
        assert_none_found(fitter);
        assert_ok(ctx, sf_fitter_step(fitter));
        assert_a_third_found(fitter);
        sf_fitter_destroy(&fitter);
        sf_scene_destroy(&scene);
    }
    sf_context_destroy(&ctx);
}

/* Sharp views, also over backgrounds drawn at random; too dark ones, a third blurred where nobody wants to
 * know, or too few to tell. */
static void test_nothing_else_found(void **state) {
    (void)state;
    if (test_is_quick()) test_skip("SPLATFIT_QUICK is set, and test_found goes the same way");
    test_smear smear = {4, 0};
    const struct {
        test_change change;
        double blur;
        size_t views;
        int background;
    } cases[] = {{NULL, 0.33, VIEWS, SF_BACKGROUND_BLACK},
                 {NULL, 0.33, VIEWS, SF_BACKGROUND_RANDOM},
                 {test_wander, 0.33, VIEWS, SF_BACKGROUND_BLACK},
                 {test_blur_a_third, 0, VIEWS, SF_BACKGROUND_BLACK},
                 {test_blur_a_third, 0.33, 7, SF_BACKGROUND_BLACK}};
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        sf_scene *scene = test_changed_scene(ctx, STUDIO, cases[i].change, &smear);
        sf_fit_options options = short_fit();
        options.blur = cases[i].blur;
        options.background = cases[i].background;
        test_thin_out(ctx, scene, cases[i].views);
        sf_fitter *fitter = fit_for(scene, &options, STEPS);
        assert_none_found(fitter);
        sf_fitter_destroy(&fitter);
        sf_scene_destroy(&scene);
    }
    sf_context_destroy(&ctx);
}

/* Where none is blurred the looking changes nothing. */
static void test_looking_is_free(void **state) {
    (void)state;
    if (test_is_quick()) test_skip("SPLATFIT_QUICK is set, and test_found goes the same way");
    sf_context *ctx = test_context();
    sf_scene *scene = test_changed_scene(ctx, STUDIO, NULL, NULL);
    uint8_t *bytes[2];
    size_t sizes[2];
    for (int looking = 0; looking < 2; looking++) {
        const char *path = test_path("model.ply");
        sf_fit_options options = short_fit();
        options.blur = looking ? options.blur : 0;
        sf_fitter *fitter = fit_for(scene, &options, STEPS);
        sf_model *model;
        assert_ok(ctx, sf_fitter_snapshot(fitter, &model));
        assert_ok(ctx, sf_model_save(model, path));
        bytes[looking] = test_read(path, &sizes[looking]);
        sf_model_destroy(&model);
        sf_fitter_destroy(&fitter);
    }
    assert_int_equal(sizes[0], sizes[1]);
    assert_memory_equal(bytes[0], bytes[1], sizes[0]);
    free(bytes[0]);
    free(bytes[1]);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Each pass has all sharp views; of the blurred ones about a quarter, but some. */
static void test_trained_on_less(void **state) {
    (void)state;
    enum { PASSES = 60 };
    test_smear smear = {4, 0};
    sf_context *ctx = test_context();
    sf_scene *scene = test_changed_scene(ctx, STUDIO, test_blur_a_third, &smear);
    sf_fit_options options = short_fit();
    options.open_end = 1;
    options.max_gaussians = 50; /* quick, and still enough to tell */
    options.init_random = 50;
    sf_fitter *fitter = fit_for(scene, &options, JUDGED + 1);
    assert_a_third_found(fitter);
    size_t blurred = 0;
    for (int passes = 0; passes < PASSES;) {
        assert_ok(ctx, sf_fitter_step(fitter));
        if (fitter->sampler.at != 1) continue; /* one begins */
        size_t now = 0;
        for (size_t i = 0; i < fitter->sampler.count; i++)
            now += sf_is_blurred(&fitter->blur, fitter->sampler.ids[i]);
        assert_int_equal(fitter->sampler.count - now, VIEWS - BLURRED);
        blurred += now, passes++;
    }
    /* 105 of 420 expected, 8.9 the standard deviation */
    assert_between(blurred, 60, 150);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Of the views that are kept out those that are blurred say nothing of the model, and what was best by them
 * is no longer. */
static void test_no_measure(void **state) {
    (void)state;
    test_smear smear = {4, 0};
    sf_context *ctx = test_context();
    sf_scene *scene = test_changed_scene(ctx, STUDIO, test_blur_a_third, &smear);
    sf_fit_options options = short_fit();
    options.validate = 3; /* the middle one of three: all that are kept out are blurred */
    sf_fitter *fitter = fit_for(scene, &options, JUDGED);
    double psnr;
    size_t views;
    assert_true(fitter->validation.best_psnr > 0);
    assert_ok(ctx, sf_measure_validation(fitter, &psnr, &views));
    assert_int_equal(views, BLURRED);
    assert_ok(ctx, sf_fitter_step(fitter));
    assert_a_third_found(fitter);
    assert_true(isnan(fitter->validation.best_psnr));
    assert_ok(ctx, sf_measure_validation(fitter, &psnr, &views));
    assert_int_equal(views, 0);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* A run that goes on knows them, and makes the same bytes, from before and from after they were found. */
static void test_gone_on(void **state) {
    (void)state;
    test_smear smear = {4, 0};
    sf_context *ctx = test_context();
    sf_scene *scene = test_changed_scene(ctx, STUDIO, test_blur_a_third, &smear);
    sf_fit_options options = short_fit();
    const char *path = test_path("checkpoint");
    double loss = 0;
    for (int at = 0; at <= JUDGED + 20; at += JUDGED / 2) {
        sf_fitter *fitter = fit_for(scene, &options, at);
        sf_fit_progress p;
        assert_ok(ctx, sf_fitter_save(fitter, path));
        sf_fitter_destroy(&fitter);
        assert_ok(ctx, sf_fitter_load(ctx, scene, path, NULL, &fitter));
        assert_int_equal(fitter->blur.count, at > JUDGED ? BLURRED : 0);
        assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
        assert_a_third_found(fitter);
        sf_fitter_get_progress(fitter, &p);
        if (!at) loss = p.loss;
        assert_true(p.loss == loss && loss > 0);
        sf_fitter_destroy(&fitter);
    }
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* What a mask hides is neither sharp nor blurred, and a view that it hides altogether is not judged. */
static void test_masked(void **state) {
    (void)state;
    enum { WIDTH = 64, HEIGHT = 48 };
    static uint8_t mask[WIDTH * HEIGHT], rgb[3 * WIDTH * HEIGHT];
    sf_context *ctx = test_context();
    sf_scene *from = test_changed_scene(ctx, STUDIO, NULL, NULL), *scene;
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    size_t number = 0;
    sf_view_info info;
    for (size_t i = 0; !sf_scene_get_view(from, i, &info); i++) {
        if (info.split != SF_SPLIT_TRAIN) continue;
        sf_view *view = sf_scene_retain_id(from, info.id);
        for (size_t at = 0; at < WIDTH * HEIGHT; at++) {
            int hidden = number == 5 || (number % 4 == 1 && at % WIDTH >= WIDTH / 2);
            mask[at] = hidden ? 0 : 255;
            for (size_t ch = 0; ch < 3; ch++)
                rgb[3 * at + ch] = hidden ? 128 : view->rgb[ch * WIDTH * HEIGHT + at];
        }
        sf_view_release(view);
        sf_pixels pixels = {.rgb = rgb, .stride = 3 * (size_t)WIDTH, .mask = mask};
        assert_ok(ctx, sf_scene_add_view(scene, NULL, &info.camera, &pixels, SF_SPLIT_TRAIN, NULL));
        number++;
    }
    sf_fit_options options = short_fit();
    sf_fitter *fitter = fit_for(scene, &options, STEPS);
    assert_int_equal(fitter->blur.judged, 1);
    assert_none_found(fitter);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_scene_destroy(&from);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_found),           cmocka_unit_test(test_nothing_else_found),
        cmocka_unit_test(test_looking_is_free), cmocka_unit_test(test_trained_on_less),
        cmocka_unit_test(test_no_measure),      cmocka_unit_test(test_gone_on),
        cmocka_unit_test(test_masked),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
