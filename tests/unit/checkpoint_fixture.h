/* checkpoint_fixture.h - fits that are interrupted, and their files. */
#ifndef TESTS_UNIT_CHECKPOINT_FIXTURE_H
#define TESTS_UNIT_CHECKPOINT_FIXTURE_H

#include "testing.h"

#define SCENE "sim:studio?width=64&height=48&frames=9"

typedef struct run {
    sf_context *ctx;
    sf_scene *scene;
    sf_fitter *fitter;
} run;

run checkpoint_fresh_scene(int threads);
run checkpoint_open_scene(int threads);
int checkpoint_close_scenes(void **state);
void checkpoint_begin(run *r, const sf_fit_options *options);
run checkpoint_start(int threads, const sf_fit_options *options);
run checkpoint_go_on(int threads, const char *path);
void checkpoint_end(run *r);
void checkpoint_take_steps(const run *r, int64_t steps);

/* Every stage of a run within `steps`: growth every 7 steps, three resolutions, all degrees. */
sf_fit_options checkpoint_short_fit(int64_t steps);

typedef struct content {
    uint8_t *data;
    size_t size;
} content;

content checkpoint_read_content(const char *path);
content checkpoint_model_of(const run *r);

/* Frees b. */
void checkpoint_assert_same(const content *a, content b);
sf_fit_progress checkpoint_progress_of(const run *r);
void checkpoint_rest(double seconds);

#endif
