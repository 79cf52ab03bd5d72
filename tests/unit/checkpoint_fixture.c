/* checkpoint_fixture.c - see the header. */
#include "checkpoint_fixture.h"

#include <stdlib.h>
#include <time.h>

run checkpoint_fresh_scene(int threads) {
    run r = {.ctx = test_context_threads(threads)};
    assert_ok(r.ctx, sf_scene_load(r.ctx, SCENE, NULL, &r.scene));
    return r;
}

/* The scene is made once for each number of threads. */
enum { MOST_THREADS = 4 };
static run opened[MOST_THREADS + 1];

run checkpoint_open_scene(int threads) {
    if (!opened[threads].ctx) opened[threads] = checkpoint_fresh_scene(threads);
    return opened[threads];
}

int checkpoint_close_scenes(void **state) {
    (void)state;
    for (int i = 0; i <= MOST_THREADS; i++) {
        sf_scene_destroy(&opened[i].scene);
        sf_context_destroy(&opened[i].ctx);
    }
    return 0;
}

void checkpoint_begin(run *r, const sf_fit_options *options) {
    assert_ok(r->ctx, sf_fitter_create(r->ctx, r->scene, NULL, options, &r->fitter));
}

run checkpoint_start(int threads, const sf_fit_options *options) {
    run r = checkpoint_open_scene(threads);
    checkpoint_begin(&r, options);
    return r;
}

run checkpoint_go_on(int threads, const char *path) {
    run r = checkpoint_open_scene(threads);
    assert_ok(r.ctx, sf_fitter_load(r.ctx, r.scene, path, NULL, &r.fitter));
    return r;
}

void checkpoint_end(run *r) { sf_fitter_destroy(&r->fitter); }

void checkpoint_take_steps(const run *r, int64_t steps) {
    for (int64_t i = 0; i < steps; i++) assert_ok(r->ctx, sf_fitter_step(r->fitter));
}

sf_fit_options checkpoint_short_fit(int64_t steps) {
    sf_fit_options options = sf_fit_options_default();
    options.steps = steps;
    options.max_gaussians = 300;
    options.init_random = 100;
    options.densify_every = 7;
    options.background = SF_BACKGROUND_AUTO;
    return options;
}

content checkpoint_read_content(const char *path) {
    content c;
    c.data = test_read(path, &c.size);
    return c;
}

content checkpoint_model_of(const run *r) {
    const char *path = test_path("model.ply");
    sf_model *model;
    assert_ok(r->ctx, sf_fitter_snapshot(r->fitter, &model));
    assert_ok(r->ctx, sf_model_save(model, path));
    sf_model_destroy(&model);
    return checkpoint_read_content(path);
}

void checkpoint_assert_same(const content *a, content b) {
    assert_int_equal(a->size, b.size);
    assert_memory_equal(a->data, b.data, a->size);
    free(b.data);
}

sf_fit_progress checkpoint_progress_of(const run *r) {
    sf_fit_progress p;
    sf_fitter_get_progress(r->fitter, &p);
    return p;
}

void checkpoint_rest(double seconds) {
    struct timespec t = {.tv_nsec = (long)(1e9 * seconds)};
    nanosleep(&t, NULL);
}
