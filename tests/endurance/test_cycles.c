/* test_cycles.c - a program that makes and destroys everything again and again: context, scene, fitter,
 * renderer, models, files. Its resident memory must not grow.
 *
 * CYCLES  how many (10000)
 */
#include "testing.h"

#include <stdio.h>
#include <stdlib.h>

#include "base/memory.h"

enum { VIEWS = 9, WIDTH = 32, HEIGHT = 24, PIXELS = WIDTH * HEIGHT, POINTS = 40, STEPS = 12 };

/* The first part of the cycles fills what the C library keeps. The least block that malloc gives takes 32
 * bytes: one lost in each of the other 9,000 would make 280 kB. */
static const double settled = 0.1, slack_kb = 192;

static void fill_scene(sf_scene *scene) {
    static uint8_t rgb[3 * PIXELS];
    float xyz[3 * POINTS];
    for (int v = 0; v < VIEWS; v++) {
        sf_camera camera = test_camera_around(v, VIEWS, WIDTH, HEIGHT);
        sf_pixels pixels = {.rgb = rgb, .stride = 3 * (size_t)WIDTH};
        for (int i = 0; i < 3 * PIXELS; i++) rgb[i] = (uint8_t)(i * (v + 3) % 251);
        assert_int_equal(sf_scene_add_view(scene, NULL, &camera, &pixels, SF_SPLIT_TRAIN, NULL), SF_OK);
    }
    for (int i = 0; i < 3 * POINTS; i++) xyz[i] = (float)((i * 37) % 101) / 101 - 0.5f;
    assert_int_equal(sf_scene_add_points(scene, POINTS, xyz, NULL), SF_OK);
}

/* Another way through the fitter each time. */
static sf_fit_options options_of(int cycle) {
    sf_fit_options o = sf_fit_options_default();
    o.steps = STEPS;
    o.max_gaussians = 3 * POINTS;
    o.densify_every = 3;
    o.size = cycle % 2 ? SF_SIZE_CAP : SF_SIZE_AUTO;
    o.moments = cycle / 2 % 2 ? SF_MOMENTS_HALF : SF_MOMENTS_FLOAT;
    o.densify = cycle % 3;
    o.exposure = o.refine_poses = o.refine_intrinsics = cycle % 5 == 0;
    o.validate = cycle % 7 ? 0 : 3;
    return o;
}

static void use_renderer(sf_context *ctx, const sf_model *model) {
    static float rgb[3 * PIXELS], means[3 * 3 * POINTS];
    sf_camera camera = test_camera_around(1, VIEWS, WIDTH, HEIGHT);
    sf_image_out out = {.rgb = rgb};
    sf_render_grads grads = {.gaussians = {.means = means}};
    sf_renderer *renderer;
    assert_ok(ctx, sf_renderer_create(ctx, &renderer));
    assert_ok(ctx, sf_render(renderer, model, &camera, NULL, &out));
    assert_ok(ctx, sf_render_backward(renderer, model, rgb, &grads));
    sf_renderer_destroy(&renderer);
    assert_null(renderer);
}

/* Through a file of each kind by turns. */
static void use_model(sf_context *ctx, const sf_model *model, int cycle) {
    static const char *const names[] = {"m.ply", "m.spz", "m.splat"};
    const char *path = test_path(names[cycle % 3]);
    sf_model *read;
    assert_ok(ctx, sf_model_save(model, path));
    assert_ok(ctx, sf_model_load(ctx, path, &read));
    assert_int_equal(sf_model_count(read), sf_model_count(model));
    sf_model_destroy(&read);
}

/* Through a checkpoint in the middle. */
static void fit(sf_context *ctx, sf_scene *scene, int cycle, sf_model **model) {
    sf_fit_options options = options_of(cycle);
    sf_fitter *fitter;
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &fitter));
    for (int i = 0; i < STEPS / 2; i++) assert_ok(ctx, sf_fitter_step(fitter));
    assert_ok(ctx, sf_fitter_save(fitter, test_path("c.fit")));
    sf_fitter_destroy(&fitter);
    assert_ok(ctx, sf_fitter_load(ctx, scene, test_path("c.fit"), NULL, &fitter));
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    assert_ok(ctx, sf_fitter_snapshot(fitter, model));
    sf_fitter_destroy(&fitter);
    assert_null(fitter);
}

static void go_round(int cycle) {
    sf_context *ctx = test_context_threads(1 + cycle % 3);
    sf_scene *scene;
    sf_model *model;
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    fill_scene(scene);
    fit(ctx, scene, cycle, &model);
    use_renderer(ctx, model);
    use_model(ctx, model, cycle);
    sf_model_destroy(&model);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
    test_log_clear();
}

static void test_memory_does_not_grow(void **state) {
    (void)state;
    const char *text = getenv("CYCLES");
    int cycles = text ? atoi(text) : 10000, first = (int)(settled * cycles);
    double kb = (double)sf_memory_resident() / 1024, before = 0, most = 0;
    print_message("%.0f kB resident at first\n", kb);
    assert_true(kb > 0);
    assert_true(cycles >= 10);
    for (int cycle = 1; cycle <= cycles; cycle++) {
        go_round(cycle);
        kb = (double)sf_memory_resident() / 1024;
        if (cycle <= first)
            before = kb > before ? kb : before;
        else
            most = kb > most ? kb : most;
        if (cycle % (cycles / 10) == 0) print_message("%.0f kB after %d cycles\n", kb, cycle);
    }
    print_message("at most %.0f kB in the first %d cycles, %.0f kB in the others\n", before, first, most);
    assert_true(most <= before + slack_kb);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_memory_does_not_grow),
    };
    return cmocka_run_group_tests_name("cycles", tests, NULL, NULL);
}
