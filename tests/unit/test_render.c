/* test_render.c - the renderer and its gradient against the float64 reference. Values that hurt, and
 * many layers, are rows of tests/stability. */
#include "testing.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "reference/outcome.h"

/* float32 against float64, as for the golden cases: pictures absolute, in units of a colour, which is about
 * 1; gradients relative to the largest of their array. A pair that lies within rounding of a threshold
 * (1/255, the stop at 1e-4) goes either way and is worth up to 1/255: the seeds here have none. */
static const double PICTURE_BOUND = 1e-5, GRADIENT_BOUND = 2e-4;

/* ---- a render and its gradient --------------------------------------------------------------------------
 */

static float *floats(size_t n) {
    float *values = calloc(n ? n : 1, sizeof *values);
    assert_non_null(values);
    return values;
}

static void assert_same(const test_outcome *a, const test_outcome *b) {
    const char *apart = test_outcome_apart(a, b);
    if (apart) fail_msg("they differ in %s", apart);
}

/* ---- against float64 ------------------------------------------------------------------------------------
 */

static int failures;

static void within(const char *name, double error, double bound) {
    int failed = !(error <= bound);
    failures += failed;
    print_message(" %s %.1e%s", name, error, failed ? " (!)" : "");
}

static void compare_pictures(const test_outcome *o, const test_ref_frame *frame) {
    double deepest = 1;
    for (size_t k = 0; k < frame->visible; k++)
        deepest = fmax(deepest, frame->splats[frame->order[k]].camera_point[2]);
    within("rgb", test_worst_of(o->rgb, frame->rgb, 3 * o->pixels), PICTURE_BOUND);
    within("T", test_worst_of(o->transmittance, frame->transmittance, o->pixels), PICTURE_BOUND);
    within("depth", test_worst_of(o->depth, frame->depth, o->pixels) / deepest, PICTURE_BOUND);
}

static void compare_gradients(const test_outcome *o, const test_ref_grads *expected, double pose_bound) {
    float *got[TEST_REF_ARRAYS];
    test_ref_array list[TEST_REF_ARRAYS];
    test_gaussians_list(&o->gradient, got);
    test_ref_list(&expected->gaussians, o->sh_degree, list);
    for (int a = 0; a < TEST_REF_ARRAYS; a++) {
        size_t n = o->count * list[a].width;
        double worst = test_worst_of(got[a], list[a].values, n);
        within(list[a].name, test_relative(worst, list[a].values, n), GRADIENT_BOUND);
    }
    double pose = test_worst_of_doubles(o->pose, expected->pose, 6);
    double background = test_worst_of_doubles(o->background, expected->background, 3);
    within("pose", test_relative(pose, expected->pose, 6), pose_bound);
    double focal = test_worst_of_doubles(o->focal, expected->focal, 2);
    within("focal", test_relative(focal, expected->focal, 2), pose_bound);
    within("background", test_relative(background, expected->background, 3), GRADIENT_BOUND);
}

/* Renders the scene both ways and holds every array to its bound. */
static test_ref_counts check_scene(const char *name, const test_ref_scene *scene, double pose_bound) {
    test_outcome o = test_outcome_alone(scene, 2);
    test_ref_frame frame;
    test_ref_grads grads;
    test_ref_outcome(scene, &frame, &grads);
    failures = 0;
    print_message("%s:", name);
    compare_pictures(&o, &frame);
    compare_gradients(&o, &grads, pose_bound);
    print_message("\n");
    test_ref_counts counts = frame.counts;
    test_ref_grads_free(&grads);
    test_ref_frame_free(&frame);
    test_outcome_free(&o);
    assert_int_equal(failures, 0);
    return counts;
}

static void random_scenes_match_the_reference(void **state) {
    (void)state;
    static const int sizes[][2] = {{77, 45}, {31, 90}, {16, 16}, {130, 7}};
    test_ref_counts all = {0};
    for (int k = 0; k < 8; k++) {
        const int *size = sizes[k % 4];
        size_t count = test_is_quick() ? 80 : 200;
        test_ref_scene scene = test_random_scene(200 + (uint64_t)k, count, k % 4, size[0], size[1]);
        char name[64];
        scene.antialiased = k >= 4;
        snprintf(name, sizeof name, "%dx%d, degree %d%s", size[0], size[1], scene.sh_degree,
                 scene.antialiased ? ", antialiased" : "");
        test_ref_counts counts = check_scene(name, &scene, GRADIENT_BOUND);
        assert_true(counts.pairs > 5 * count);
        all.saturated += counts.saturated;
        all.wide += counts.wide;
        all.stopped_pixels += counts.stopped_pixels;
        all.clamped_channels += counts.clamped_channels;
        test_ref_gaussians_free(&scene.gaussians);
    }
    assert_true(all.saturated > 0 || all.stopped_pixels > 0);
    assert_true(all.wide > 0 && all.clamped_channels > 0);
}

/* Far below a pixel the compensation is held at its least, and passes no gradient. */
static void compensation_ends_at_its_least(void **state) {
    (void)state;
    test_ref_scene scene = test_random_scene(220, test_is_quick() ? 250 : 800, 1, 40, 30);
    scene.antialiased = 1;
    for (size_t i = 0; i < scene.count; i++) {
        scene.gaussians.logit_opacities[i] = 4;
        for (size_t k = 0; i % 8 && k < 3; k++) scene.gaussians.log_scales[3 * i + k] = -9;
    }
    test_ref_counts counts = check_scene("sub-pixel, antialiased", &scene, GRADIENT_BOUND);
    assert_true(counts.floored > 20 && counts.pairs > 10 * counts.floored);
    test_ref_gaussians_free(&scene.gaussians);
}

static void thread_count_does_not_matter(void **state) {
    (void)state;
    static const int threads[] = {2, 3, 4, 8};
    test_ref_scene scene = test_random_scene(31, test_is_quick() ? 300 : 1000, 3, 77, 45);
    test_outcome one = test_outcome_alone(&scene, 1);
    for (size_t t = 0; t < sizeof threads / sizeof *threads; t++) {
        test_outcome many = test_outcome_alone(&scene, threads[t]);
        assert_same(&one, &many);
        test_outcome_free(&many);
    }
    test_outcome_free(&one);
    test_ref_gaussians_free(&scene.gaussians);
}

/* Bands above the degree rendered are as if they were not there. */
static void lower_degree_leaves_bands_out(void **state) {
    (void)state;
    test_ref_scene full = test_random_scene(41, 150, 3, 50, 40), cut = test_random_scene(41, 150, 1, 50, 40);
    for (int a = 0; a < TEST_REF_ARRAYS - 1; a++) {
        test_ref_array from[TEST_REF_ARRAYS], to[TEST_REF_ARRAYS];
        test_ref_list(&full.gaussians, 3, from);
        test_ref_list(&cut.gaussians, 1, to);
        memcpy(to[a].values, from[a].values, full.count * to[a].width * sizeof(double));
    }
    for (size_t i = 0; i < full.count; i++)
        memcpy(cut.gaussians.sh + 12 * i, full.gaussians.sh + 48 * i, 12 * sizeof(double));

    sf_context *ctx = test_context();
    sf_renderer *renderer;
    assert_ok(ctx, sf_renderer_create(ctx, &renderer));
    test_outcome expected = test_outcome_of(ctx, renderer, &cut), got = test_outcome_create(&full);
    sf_model *model = test_model_of(ctx, &full);
    sf_render_options options = test_render_options_of(&full);
    sf_render_grads grads = {.gaussians = got.gradient};
    float *d_rgb = test_d_rgb(got.pixels);
    options.sh_degree = 1;
    assert_ok(ctx, sf_render(renderer, model, &full.camera, &options, &(sf_image_out){.rgb = got.rgb}));
    assert_ok(ctx, sf_render_backward(renderer, model, d_rgb, &grads));
    assert_memory_equal(got.rgb, expected.rgb, 3 * got.pixels * sizeof(float));
    assert_memory_equal(got.gradient.means, expected.gradient.means, 3 * got.count * sizeof(float));
    for (size_t i = 0; i < full.count; i++) {
        assert_memory_equal(got.gradient.sh + 48 * i, expected.gradient.sh + 12 * i, 12 * sizeof(float));
        for (size_t k = 12; k < 48; k++) assert_true(got.gradient.sh[48 * i + k] == 0);
    }
    free(d_rgb);
    test_outcome_free(&got);
    test_outcome_free(&expected);
    sf_model_destroy(&model);
    sf_renderer_destroy(&renderer);
    sf_context_destroy(&ctx);
    test_ref_gaussians_free(&full.gaussians);
    test_ref_gaussians_free(&cut.gaussians);
}

/* ---- arguments ------------------------------------------------------------------------------------------
 */

/* A small scene with a model and a renderer. */
typedef struct stage {
    test_ref_scene scene;
    sf_context *ctx;
    sf_model *model;
    sf_renderer *renderer;
    sf_render_options options;
} stage;

static void set_stage(stage *s, uint64_t seed) {
    s->scene = test_random_scene(seed, 60, 2, 40, 30);
    s->ctx = test_context();
    s->model = test_model_of(s->ctx, &s->scene);
    s->options = test_render_options_of(&s->scene);
    assert_ok(s->ctx, sf_renderer_create(s->ctx, &s->renderer));
}

static void clear_stage(stage *s) {
    sf_renderer_destroy(&s->renderer);
    sf_model_destroy(&s->model);
    sf_context_destroy(&s->ctx);
    test_ref_gaussians_free(&s->scene.gaussians);
}

static void assert_option_refused(stage *s, const sf_render_options *options, const char *name) {
    sf_image_out nothing = {0};
    assert_status(s->ctx, sf_render(s->renderer, s->model, &s->scene.camera, options, &nothing),
                  SF_ERR_ARGUMENT);
    assert_error_names(s->ctx, name);
}

static void bad_options_are_refused(void **state) {
    (void)state;
    static const float near_planes[] = {-1, NAN, INFINITY};
    stage s;
    set_stage(&s, 3);
    for (size_t i = 0; i < sizeof near_planes / sizeof *near_planes; i++) {
        sf_render_options options = s.options;
        options.near_plane = near_planes[i];
        assert_option_refused(&s, &options, "near_plane");
    }
    sf_render_options options = s.options;
    options.sh_degree = 3;
    assert_option_refused(&s, &options, "sh_degree: 3");
    clear_stage(&s);
}

static void bad_cameras_are_refused(void **state) {
    (void)state;
    stage s;
    set_stage(&s, 3);
    sf_camera good = s.scene.camera, bad[14];
    size_t n = sizeof bad / sizeof *bad;
    for (size_t i = 0; i < n; i++) bad[i] = good;
    bad[0].width = 0;
    bad[1].height = -1;
    bad[2].width = 65536;
    bad[3].height = 65536;
    bad[4].fx = 0;
    bad[5].fy = -20;
    bad[6].fx = NAN;
    bad[7].cx = NAN;
    bad[8].cy = INFINITY;
    bad[9].R_cw[4] = NAN;
    bad[10].R_cw[0] *= 1.01;
    bad[11].t_cw[2] = INFINITY;
    memset(bad[12].R_cw, 0, sizeof bad[12].R_cw);
    for (int k = 0; k < 3; k++) bad[13].R_cw[k] = -bad[13].R_cw[k]; /* a mirror */
    for (size_t i = 0; i < n; i++) {
        s.scene.camera = bad[i];
        assert_option_refused(&s, &s.options, "camera");
    }
    clear_stage(&s);
}

static void backward_needs_its_render(void **state) {
    (void)state;
    stage s;
    set_stage(&s, 4);
    sf_model *fewer, *lower;
    sf_image_out nothing = {0};
    sf_render_grads grads = {0};
    float *d_rgb = test_d_rgb(40 * 30);
    assert_ok(s.ctx, sf_model_create(s.ctx, 59, 2, &fewer));
    assert_ok(s.ctx, sf_model_create(s.ctx, 60, 1, &lower));
    assert_status(s.ctx, sf_render_backward(s.renderer, s.model, d_rgb, &grads), SF_ERR_ARGUMENT);
    assert_ok(s.ctx, sf_render(s.renderer, s.model, &s.scene.camera, &s.options, &nothing));
    assert_status(s.ctx, sf_render_backward(s.renderer, fewer, d_rgb, &grads), SF_ERR_ARGUMENT);
    assert_status(s.ctx, sf_render_backward(s.renderer, lower, d_rgb, &grads), SF_ERR_ARGUMENT);
    assert_ok(s.ctx, sf_render_backward(s.renderer, s.model, d_rgb, &grads));

    /* one that failed is none */
    s.options.near_plane = -1;
    assert_option_refused(&s, &s.options, "near_plane");
    assert_status(s.ctx, sf_render_backward(s.renderer, s.model, d_rgb, &grads), SF_ERR_ARGUMENT);
    assert_error_names(s.ctx, "model");
    sf_model_destroy(&fewer);
    sf_model_destroy(&lower);
    free(d_rgb);
    clear_stage(&s);
}

/* The way back reads the arrays of what was rendered: another model's are other ones, though it has as many
 * Gaussians of the same degree, and those of a model that is gone are no more. */
static void backward_takes_no_other_model(void **state) {
    (void)state;
    stage s;
    set_stage(&s, 4);
    sf_model *other = test_model_of(s.ctx, &s.scene);
    sf_image_out nothing = {0};
    sf_render_grads grads = {0};
    float opacity = 0.25f, *d_rgb = test_d_rgb(40 * 30);
    sf_gaussians one = {.logit_opacities = &opacity};
    sf_similarity twice = {.scale = 2, .R = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    const double low[3] = {-1e9, -1e9, -1e9}, high[3] = {1e9, 1e9, 1e9};
    for (int change = 0; change < 5; change++) {
        assert_ok(s.ctx, sf_render(s.renderer, s.model, &s.scene.camera, &s.options, &nothing));
        assert_status(s.ctx, sf_render_backward(s.renderer, other, d_rgb, &grads), SF_ERR_ARGUMENT);
        assert_ok(s.ctx, sf_render_backward(s.renderer, s.model, d_rgb, &grads));
        if (change == 0) assert_ok(s.ctx, sf_model_set(s.model, 7, 1, &one));
        if (change == 1) assert_ok(s.ctx, sf_model_transform(s.model, &twice));
        if (change == 2) sf_model_set_antialiased(s.model, 1);
        if (change == 3) assert_ok(s.ctx, sf_model_crop(s.model, low, high));
        if (change == 4) assert_ok(s.ctx, sf_model_pack(s.model));
        assert_status(s.ctx, sf_render_backward(s.renderer, s.model, d_rgb, &grads), SF_ERR_ARGUMENT);
        assert_error_names(s.ctx, "model: not the one that was rendered last");
    }
    assert_ok(s.ctx, sf_render(s.renderer, s.model, &s.scene.camera, &s.options, &nothing));
    sf_model_destroy(&s.model);
    s.model = test_model_of(s.ctx, &s.scene); /* may well stand where the other one did */
    assert_status(s.ctx, sf_render_backward(s.renderer, s.model, d_rgb, &grads), SF_ERR_ARGUMENT);
    sf_model_destroy(&other);
    free(d_rgb);
    clear_stage(&s);
}

/* What is asked for does not change it. */
static void outputs_are_optional(void **state) {
    (void)state;
    stage s;
    set_stage(&s, 5);
    test_outcome all = test_outcome_of(s.ctx, s.renderer, &s.scene), part = test_outcome_create(&s.scene);
    const sf_camera *camera = &s.scene.camera;
    float *d_rgb = test_d_rgb(part.pixels);
    assert_ok(s.ctx, sf_render(s.renderer, s.model, camera, &s.options, &(sf_image_out){.rgb = part.rgb}));
    assert_ok(s.ctx, sf_render_backward(s.renderer, s.model, d_rgb,
                                        &(sf_render_grads){.gaussians.means = part.gradient.means}));
    assert_memory_equal(part.rgb, all.rgb, 3 * all.pixels * sizeof(float));
    assert_memory_equal(part.gradient.means, all.gradient.means, 3 * all.count * sizeof(float));
    assert_ok(s.ctx,
              sf_render(s.renderer, s.model, camera, &s.options, &(sf_image_out){.depth = part.depth}));
    assert_ok(s.ctx, sf_render_backward(s.renderer, s.model, d_rgb, &(sf_render_grads){.pose = part.pose}));
    assert_memory_equal(part.depth, all.depth, all.pixels * sizeof(float));
    assert_memory_equal(part.pose, all.pose, sizeof all.pose);
    assert_ok(s.ctx, sf_render_backward(s.renderer, s.model, d_rgb, &(sf_render_grads){.focal = part.focal}));
    assert_memory_equal(part.focal, all.focal, sizeof all.focal);
    free(d_rgb);
    test_outcome_free(&all);
    test_outcome_free(&part);
    clear_stage(&s);
}

static void no_options_are_the_defaults(void **state) {
    (void)state;
    stage s;
    set_stage(&s, 6);
    float *a = floats(3 * 40 * 30), *b = floats(3 * 40 * 30);
    sf_render_options defaults = sf_render_options_default();
    assert_ok(s.ctx, sf_render(s.renderer, s.model, &s.scene.camera, NULL, &(sf_image_out){.rgb = a}));
    assert_ok(s.ctx, sf_render(s.renderer, s.model, &s.scene.camera, &defaults, &(sf_image_out){.rgb = b}));
    assert_memory_equal(a, b, 3 * 40 * 30 * sizeof(float));

    sf_model_set_antialiased(s.model, 1);
    assert_ok(s.ctx, sf_render(s.renderer, s.model, &s.scene.camera, NULL, &(sf_image_out){.rgb = b}));
    assert_memory_not_equal(a, b, 3 * 40 * 30 * sizeof(float));
    defaults.antialiased = 0; /* against what the model says */
    assert_ok(s.ctx, sf_render(s.renderer, s.model, &s.scene.camera, &defaults, &(sf_image_out){.rgb = b}));
    assert_memory_equal(a, b, 3 * 40 * 30 * sizeof(float));
    free(a);
    free(b);
    clear_stage(&s);
}

static void empty_model_is_the_background(void **state) {
    (void)state;
    test_ref_scene scene = test_random_scene(7, 0, 1, 19, 21);
    test_outcome o = test_outcome_alone(&scene, 2);
    double sums[3] = {0};
    for (size_t i = 0; i < 3 * o.pixels; i++) {
        assert_true(o.rgb[i] == (float)scene.background[i % 3]);
        sums[i % 3] += (double)test_d_rgb_at(i);
    }
    for (size_t i = 0; i < o.pixels; i++) assert_true(o.transmittance[i] == 1 && o.depth[i] == 0);
    for (int k = 0; k < 6; k++) assert_true(o.pose[k] == 0);
    for (int k = 0; k < 3; k++) assert_true(fabs(o.background[k] - sums[k]) < 1e-9 * fabs(sums[k]));
    test_outcome_free(&o);
    test_ref_gaussians_free(&scene.gaussians);
}

/* A renderer keeps its workspace: nothing of an earlier picture or model shows. */
static void renderer_can_be_used_again(void **state) {
    (void)state;
    size_t many = test_is_quick() ? 60 : 300;
    test_ref_scene scenes[] = {test_random_scene(61, many, 3, 150, 100), test_random_scene(62, 20, 1, 17, 9),
                               test_random_scene(63, many, 3, 90, 166), test_random_scene(64, 0, 0, 33, 33)};
    enum { SCENES = sizeof scenes / sizeof *scenes };
    sf_context *ctx = test_context();
    sf_renderer *renderer;
    assert_ok(ctx, sf_renderer_create(ctx, &renderer));
    for (size_t k = 0; k < 2 * SCENES; k++) {
        test_outcome again = test_outcome_of(ctx, renderer, &scenes[k % SCENES]),
                     fresh = test_outcome_alone(&scenes[k % SCENES], 2);
        assert_same(&again, &fresh);
        test_outcome_free(&again);
        test_outcome_free(&fresh);
    }
    sf_renderer_destroy(&renderer);
    sf_context_destroy(&ctx);
    for (size_t k = 0; k < SCENES; k++) test_ref_gaussians_free(&scenes[k].gaussians);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(random_scenes_match_the_reference),
        cmocka_unit_test(compensation_ends_at_its_least),
        cmocka_unit_test(thread_count_does_not_matter),
        cmocka_unit_test(lower_degree_leaves_bands_out),
        cmocka_unit_test(bad_options_are_refused),
        cmocka_unit_test(bad_cameras_are_refused),
        cmocka_unit_test(backward_needs_its_render),
        cmocka_unit_test(backward_takes_no_other_model),
        cmocka_unit_test(outputs_are_optional),
        cmocka_unit_test(no_options_are_the_defaults),
        cmocka_unit_test(empty_model_is_the_background),
        cmocka_unit_test(renderer_can_be_used_again),
    };
    return cmocka_run_group_tests_name("render", tests, NULL, NULL);
}
