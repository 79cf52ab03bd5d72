/* test_fit_cache.c - fits whose pictures are in a file: the same bytes as from memory. */
#include "fit_fixture.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "scene/scene.h"

#define SCENE "sim:studio?width=64&height=48&frames=24"
/* So large that a few pixels are read without the rest. */
#define LARGE "sim:studio?width=200&height=150&frames=12"
enum { ALL = 24 * 3 * 64 * 48, ALL_LARGE = 12 * 3 * 200 * 150 };

static sf_scene *load_named(sf_context *ctx, const char *name, int64_t memory) {
    sf_load_options options = sf_load_options_default();
    options.memory = memory;
    return test_load_scene(ctx, name, &options);
}

/* memory: of the load alone. */
static sf_scene *load(sf_context *ctx, int64_t memory) { return load_named(ctx, SCENE, memory); }

/* All that reads pictures: first points, steps at three resolutions, validation, model selection, blur. */
static sf_fit_options every_reader(sf_init init) {
    sf_fit_options options = fit_short_fit(test_is_quick() ? 30 : 60);
    options.max_gaussians = 400;
    options.init = init;
    options.init_random = 300;
    options.validate = 4;
    return options;
}

static content fit_with(int threads, int64_t memory, const sf_fit_options *options) {
    sf_context *ctx = test_context_threads(threads);
    sf_scene *scene = load(ctx, memory);
    sf_view *view = sf_scene_retain_id(scene, 1);
    assert_true((view->cache != NULL) == (memory > 0));
    sf_view_release(view);
    sf_fitter *fitter = fit_start(ctx, scene, options);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    return fit_end(ctx, scene, fitter);
}

static void test_same_model(void **state) {
    (void)state;
    static const sf_init inits[] = {SF_INIT_AUTO, SF_INIT_SWEEP, SF_INIT_RANDOM};
    for (int i = 0; i < (test_is_quick() ? 1 : 3); i++) {
        sf_fit_options options = every_reader(inits[i]);
        content memory = fit_with(2, 0, &options);
        fit_assert_same(&memory, fit_with(3 - i, ALL, &options));
        free(memory.values);
    }
}

static content first_of_large(int64_t memory) {
    sf_context *ctx = test_context();
    sf_scene *scene = load_named(ctx, LARGE, memory);
    sf_fit_options options = every_reader(SF_INIT_RANDOM);
    options.init_random = 20;
    sf_fitter *fitter = fit_start(ctx, scene, &options);
    return fit_end(ctx, scene, fitter);
}

static void test_single_pixels(void **state) {
    (void)state;
    content memory = first_of_large(0);
    assert_int_equal(memory.count, 20);
    fit_assert_same(&memory, first_of_large(ALL_LARGE));
    free(memory.values);
}

/* Half a run from memory, the other half from a file. */
static void test_resume(void **state) {
    (void)state;
    sf_fit_options options = every_reader(SF_INIT_AUTO);
    const char *path = test_path("c.fit");
    content whole = fit_with(2, 0, &options);
    sf_context *ctx = test_context();
    sf_scene *memory = load(ctx, 0), *file = load(ctx, ALL);
    sf_fitter *fitter = fit_start(ctx, memory, &options);
    fit_take_steps(ctx, fitter, (int)options.steps / 2);
    assert_ok(ctx, sf_fitter_save(fitter, path));
    sf_fitter_destroy(&fitter);
    assert_ok(ctx, sf_fitter_load(ctx, file, path, NULL, &fitter));
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    fit_assert_same(&whole, fit_content_of(ctx, fitter));
    free(whole.values);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&memory);
    sf_scene_destroy(&file);
    sf_context_destroy(&ctx);
}

/* The forecast counts the buffers, not the pictures. */
static void test_forecast(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_fit_options options = fit_short_fit(30);
    sf_scene *file = load(ctx, ALL);
    assert_true(sf_scene_missing_bytes(file, 0) <= 4 * 3 * 64 * 48);
    sf_memory_bill bill;
    assert_ok(ctx, sf_fit_memory(ctx, file, &options, &bill));
    assert_true(bill.before > 0);
    sf_scene_destroy(&file);
    sf_context_destroy(&ctx);
}

/* The disk fails in the middle of a run: the fit says so, and what it has can be written. */
static void test_failing_disk(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_fit_options options = fit_short_fit(30);
    int fd = dup(0);
    close(fd);
    sf_scene *scene = load(ctx, ALL);
    sf_fitter *fitter = fit_start(ctx, scene, &options);
    fit_take_steps(ctx, fitter, 3);
    assert_int_equal(ftruncate(fd, 0), 0);
    sf_status status = SF_OK;
    for (int i = 0; i < 20 && !status; i++) status = sf_fitter_step(fitter); /* buffers hold a few */
    assert_int_equal(status, SF_ERR_IO);
    assert_error_names(ctx, "cannot be read again from ");
    fit_assert_sound(ctx, fitter);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_same_model),   cmocka_unit_test(test_single_pixels),
        cmocka_unit_test(test_resume),       cmocka_unit_test(test_forecast),
        cmocka_unit_test(test_failing_disk),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
