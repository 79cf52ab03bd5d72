/* test_fit_views.c - training views that come, go, are masked or alone; backgrounds. */
#include "fit_fixture.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

/* A view of one colour. */
static void add_plain_view(sf_scene *scene, int view, const float *color, const uint8_t *mask) {
    static float rgb[3 * PIXELS];
    sf_camera camera = fit_camera_of(view);
    for (int i = 0; i < 3 * PIXELS; i++) rgb[i] = color[i % 3];
    fit_add_picture(scene, &camera, rgb, mask, SF_SPLIT_TRAIN);
}

/* Views. */

static void remove_all_views(sf_context *ctx, sf_scene *scene) {
    sf_view_info view;
    while (!sf_scene_get_view(scene, 0, &view)) assert_ok(ctx, sf_scene_remove_view(scene, view.id));
}

static void test_no_view_to_start_with(void **state) {
    (void)state;
    static float rgb[3 * PIXELS];
    sf_context *ctx = test_context();
    sf_scene *scene = fit_empty_scene(ctx);
    sf_fitter *fitter;
    sf_camera camera = fit_camera_of(0);
    fit_add_points(scene);
    fit_add_picture(scene, &camera, rgb, NULL, SF_SPLIT_TEST); /* held out: not to be learned from */
    assert_status(ctx, sf_fitter_create(ctx, scene, NULL, NULL, &fitter), SF_ERR_EMPTY);
    assert_null(fitter);
    assert_error_names(ctx, "no training view");
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* The last view goes: the step says so and leaves the model whole; a new view, and it goes on. */
static void test_last_view_goes(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = fit_small_scene(ctx);
    sf_fit_options options = fit_short_fit(60);
    sf_fitter *fitter = fit_start(ctx, scene, &options);
    fit_take_steps(ctx, fitter, 15);
    content before = fit_content_of(ctx, fitter);
    remove_all_views(ctx, scene);
    assert_status(ctx, sf_fitter_step(fitter), SF_ERR_EMPTY);
    assert_error_names(ctx, "no training view is left");
    assert_status(ctx, sf_fitter_run(fitter, NULL, NULL), SF_ERR_EMPTY);
    assert_int_equal(fit_progress_of(fitter).step, 15);
    fit_assert_same(&before, fit_content_of(ctx, fitter));
    fit_add_views(ctx, scene, 3, 4, fit_black);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    assert_int_equal(fit_progress_of(fitter).step, 60);
    fit_assert_sound(ctx, fitter);
    free(before.values);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Half of the views are there from the start, the others come: the fit gets better on those. */
static void test_views_come(void **state) {
    (void)state;
    fit_skip_if_quick();
    sf_context *ctx = test_context();
    sf_scene *scene = fit_empty_scene(ctx), *all = fit_small_scene(ctx);
    fit_add_views(ctx, scene, 0, 2, fit_black);
    fit_add_points(scene);
    sf_fit_options options = fit_short_fit(300);
    sf_fitter *fitter = fit_start(ctx, scene, &options);
    fit_take_steps(ctx, fitter, 100);
    double before = fit_psnr_of(ctx, all, fitter);
    sf_view_info view;
    assert_ok(ctx, sf_scene_get_view(scene, 0, &view));
    assert_ok(ctx, sf_scene_remove_view(scene, view.id));
    fit_add_views(ctx, scene, 2, VIEWS, fit_black);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    double after = fit_psnr_of(ctx, all, fitter);
    print_message("two views: %.2f dB on all, then with the others %.2f dB\n", before, after);
    assert_true(after >= before + 5);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_scene_destroy(&all);
    sf_context_destroy(&ctx);
}

/* Nothing is learned from a view that is masked altogether. */
static void test_fully_masked_view(void **state) {
    (void)state;
    static const uint8_t nothing[PIXELS];
    static const float white[3] = {1, 1, 1};
    sf_context *ctx = test_context();
    sf_scene *scene = fit_empty_scene(ctx);
    add_plain_view(scene, 0, white, nothing);
    fit_add_points(scene);
    sf_fit_options options = fit_short_fit(30);
    options.prune_opacity = 0;
    sf_fitter *fitter = fit_start(ctx, scene, &options);
    content before = fit_content_of(ctx, fitter);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    assert_int_equal(fit_progress_of(fitter).step, 30);
    assert_int_equal(fit_progress_of(fitter).skipped_values, 0);
    fit_assert_same(&before, fit_content_of(ctx, fitter));
    free(before.values);
    sf_fitter_destroy(&fitter);

    fit_add_views(ctx, scene, 0, VIEWS, fit_black); /* among others it does no harm */
    options = fit_short_fit(150);
    fitter = fit_start(ctx, scene, &options);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    sf_view_info view;
    assert_ok(ctx, sf_scene_get_view(scene, 0, &view));
    assert_ok(ctx, sf_scene_remove_view(scene, view.id));
    assert_true(fit_psnr_of(ctx, scene, fitter) >= 24);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* What lies under a mask has no influence, to the bit. */
static content fitted_to_left_half(const float *hidden) {
    static float rgb[3 * PIXELS];
    static uint8_t mask[PIXELS];
    sf_context *ctx = test_context();
    sf_scene *scene = fit_empty_scene(ctx);
    sf_fit_options options = fit_short_fit(40);
    for (int v = 0; v < 3; v++) {
        for (int i = 0; i < PIXELS; i++) {
            mask[i] = i % WIDTH < WIDTH / 2 ? 255 : 0;
            for (int c = 0; c < 3; c++) rgb[3 * i + c] = mask[i] ? 0.5f : hidden[c];
        }
        sf_camera camera = fit_camera_of(v);
        fit_add_picture(scene, &camera, rgb, mask, SF_SPLIT_TRAIN);
    }
    fit_add_points(scene);
    sf_fitter *fitter = fit_start(ctx, scene, &options);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    return fit_end(ctx, scene, fitter);
}

static void test_mask_hides(void **state) {
    (void)state;
    static const float red[3] = {1, 0, 0}, blue[3] = {0, 0.2f, 1};
    content a = fitted_to_left_half(red);
    fit_assert_same(&a, fitted_to_left_half(blue));
    free(a.values);
}

/* Backgrounds and modes. */

static void assert_background(const sf_fitter *fitter, double red, double green, double blue, double within) {
    sf_fit_progress p = fit_progress_of(fitter);
    sf_render_options options;
    double expected[3] = {red, green, blue};
    sf_fitter_render_options(fitter, &options);
    for (int k = 0; k < 3; k++) {
        if (!(fabs((double)p.background[k] - expected[k]) <= within))
            fail_msg("background[%d] is %g, not %g", k, (double)p.background[k], expected[k]);
        assert_true(options.background[k] == p.background[k]);
    }
}

/* A fit over a known background. */
static sf_fitter *fit_over(sf_context *ctx, sf_scene *scene, int background, int64_t steps) {
    sf_fit_options options = fit_short_fit(steps);
    options.init = SF_INIT_POINTS;
    options.background = background;
    options.background_red = 0.25;
    options.background_green = 0.5;
    options.background_blue = 1;
    sf_fitter *fitter = fit_start(ctx, scene, &options);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    fit_assert_sound(ctx, fitter);
    return fitter;
}

static void test_fixed_backgrounds(void **state) {
    (void)state;
    fit_skip_if_quick();
    sf_context *ctx = test_context();
    static const struct {
        int kind;
        float color[3];
    } cases[] = {{SF_BACKGROUND_BLACK, {0, 0, 0}},
                 {SF_BACKGROUND_WHITE, {1, 1, 1}},
                 {SF_BACKGROUND_COLOR, {0.25f, 0.5f, 1}},
                 {SF_BACKGROUND_RANDOM, {0, 0, 0}}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const float *c = cases[i].color;
        sf_scene *scene = fit_empty_scene(ctx);
        fit_add_views(ctx, scene, 0, VIEWS, c);
        fit_add_points(scene);
        sf_fitter *fitter = fit_over(ctx, scene, cases[i].kind, 200);
        assert_background(fitter, (double)c[0], (double)c[1], (double)c[2], 0);
        double psnr = fit_psnr_of(ctx, scene, fitter);
        print_message("background %d: %.2f dB\n", cases[i].kind, psnr);
        /* where it may not stay empty, the black of the pictures must be filled with Gaussians first */
        assert_true(psnr >= (cases[i].kind == SF_BACKGROUND_RANDOM ? 15 : 24));
        sf_fitter_destroy(&fitter);
        sf_scene_destroy(&scene);
    }
    sf_context_destroy(&ctx);
}

static void test_background_is_found(void **state) {
    (void)state;
    test_skip_emulated();
    static const float colors[2][3] = {{0.2f, 0.6f, 0.45f}, {1, 0, 0.8f}};
    sf_context *ctx = test_context();
    for (int i = getenv("SPLATFIT_QUICK") ? 1 : 0; i < 2; i++) {
        const float *c = colors[i];
        sf_scene *scene = fit_empty_scene(ctx);
        fit_add_views(ctx, scene, 0, VIEWS, c);
        fit_add_points(scene);
        sf_fitter *fitter = fit_over(ctx, scene, SF_BACKGROUND_AUTO, 250);
        assert_background(fitter, (double)c[0], (double)c[1], (double)c[2], 0.05);
        assert_true(fit_psnr_of(ctx, scene, fitter) >= 25);
        sf_fitter_destroy(&fitter);
        sf_scene_destroy(&scene);
    }
    sf_context_destroy(&ctx);
}

static void test_antialiased(void **state) {
    (void)state;
    fit_skip_if_quick();
    sf_context *ctx = test_context();
    sf_scene *scene = fit_small_scene(ctx);
    for (int on = 0; on < 2; on++) {
        sf_fit_options options = fit_short_fit(200);
        options.antialiased = on;
        sf_fitter *fitter = fit_start(ctx, scene, &options);
        sf_model *model;
        assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
        assert_ok(ctx, sf_fitter_snapshot(fitter, &model));
        assert_int_equal(sf_model_antialiased(model), on);
        assert_true(fit_psnr_of(ctx, scene, fitter) >= 23);
        sf_model_destroy(&model);
        sf_fitter_destroy(&fitter);
    }
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static const char *const compensation_lines[] = {"is marked as antialiased (mip): the fit is so too",
                                                 "antialiased: the model to start from is not marked so"};

/* A model that was fitted so is gone on with so, and what differs from the option is said. */
static void test_antialiased_from(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = fit_small_scene(ctx);
    sf_model *from = fit_true_model(ctx), *model;
    sf_fit_options options = fit_short_fit(1);
    sf_fitter *fitter;
    for (int i = 0; i < 4; i++) {
        int marked = i % 2, asked = i / 2;
        sf_model_set_antialiased(from, marked);
        options.antialiased = asked;
        test_log_clear();
        assert_ok(ctx, sf_fitter_create(ctx, scene, from, &options, &fitter));
        assert_ok(ctx, sf_fitter_snapshot(fitter, &model));
        assert_int_equal(sf_model_antialiased(model), marked || asked);
        assert_int_equal(strstr(test_log, compensation_lines[0]) != NULL, marked && !asked);
        assert_int_equal(strstr(test_log, compensation_lines[1]) != NULL, !marked && asked);
        sf_model_destroy(&model);
        sf_fitter_destroy(&fitter);
    }
    sf_model_destroy(&from);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Scenes that teach little. */

static void test_plain_scenes(void **state) {
    (void)state;
    test_skip_emulated();
    static const struct {
        float color[3];
        int views, points;
    } cases[] = {{{0, 0, 0}, 1, 1}, {{0, 0, 0}, 2, 0}, {{0.3f, 0.7f, 0.1f}, 3, 1}, {{1, 1, 1}, 1, 0}};
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        sf_scene *scene = fit_empty_scene(ctx);
        for (int v = 0; v < cases[i].views; v++) add_plain_view(scene, v, cases[i].color, NULL);
        if (cases[i].points) fit_add_points(scene);
        sf_fit_options options = fit_short_fit(getenv("SPLATFIT_QUICK") ? 20 : 50);
        options.max_gaussians = 80;
        sf_fitter *fitter = fit_start(ctx, scene, &options);
        assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
        sf_model *model;
        assert_ok(ctx, sf_fitter_snapshot(fitter, &model)); /* of a black scene nothing need be left */
        assert_ok(ctx, sf_model_save(model, "/dev/null"));
        assert_int_equal(fit_progress_of(fitter).skipped_values, 0);
        sf_model_destroy(&model);
        sf_fitter_destroy(&fitter);
        sf_scene_destroy(&scene);
    }
    sf_context_destroy(&ctx);
}

static void test_single_view(void **state) {
    (void)state;
    fit_skip_if_quick();
    sf_context *ctx = test_context();
    sf_scene *scene = fit_empty_scene(ctx);
    fit_add_views(ctx, scene, 5, 6, fit_black);
    fit_add_points(scene);
    sf_fit_options options = fit_short_fit(200);
    sf_fitter *fitter = fit_start(ctx, scene, &options);
    double before = fit_psnr_of(ctx, scene, fitter);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    assert_true(fit_psnr_of(ctx, scene, fitter) >= before + 8);
    fit_assert_sound(ctx, fitter);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* A view of one grey, of any size up to 17 x 31 pixels. */
static void add_tiny_view(sf_context *ctx, sf_scene *scene, int32_t width, int32_t height) {
    sf_camera camera = fit_camera_of(0);
    uint8_t rgb[3 * 17 * 31];
    memset(rgb, 90, sizeof rgb);
    camera.width = width, camera.height = height;
    camera.cx = width / 2.0, camera.cy = height / 2.0;
    sf_pixels pixels = {.rgb = rgb, .stride = 3 * (size_t)width};
    assert_ok(ctx, sf_scene_add_view(scene, NULL, &camera, &pixels, SF_SPLIT_TRAIN, NULL));
}

/* Pictures of a pixel, of a row and of a column: smaller than a tile, than the window of SSIM, than a level.
 */
static void test_tiny_pictures(void **state) {
    (void)state;
    static const int32_t sizes[][2] = {{1, 1}, {33, 1}, {1, 33}, {17, 31}};
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        sf_scene *scene = fit_empty_scene(ctx);
        add_tiny_view(ctx, scene, sizes[i][0], sizes[i][1]);
        fit_add_points(scene);
        sf_fit_options options = fit_short_fit(30);
        sf_fitter *fitter = fit_start(ctx, scene, &options);
        assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
        fit_assert_sound(ctx, fitter);
        sf_fitter_destroy(&fitter);
        sf_scene_destroy(&scene);
    }
    sf_context_destroy(&ctx);
}

/* Memory that runs out. */

typedef struct ration {
    atomic_int left; /* allocations that still succeed */
    atomic_int held;
} ration;

static void *ration_alloc(void *user, size_t size) {
    ration *r = user;
    void *block = atomic_fetch_sub(&r->left, 1) > 0 ? malloc(size) : NULL;
    if (block) atomic_fetch_add(&r->held, 1);
    return block;
}

static void ration_free(void *user, void *block) {
    ration *r = user;
    atomic_fetch_sub(&r->held, 1);
    free(block);
}

/* Each allocation of a short fit fails in turn: no fitter, or a step that is not done and can be done later.
 */
static void check_out_of_memory(int growth) {
    enum { STEPS = 6, PLENTY = 1 << 30 };
    ration r;
    atomic_init(&r.left, PLENTY);
    atomic_init(&r.held, 0);
    sf_allocator allocator = {ration_alloc, ration_free, &r};
    sf_context_options context_options = {.allocator = &allocator, .threads = 1};
    sf_context *ctx;
    assert_int_equal(sf_context_create(&ctx, &context_options), SF_OK);
    sf_scene *scene = fit_empty_scene(ctx);
    add_tiny_view(ctx, scene, 17, 9);
    fit_add_points(scene);
    sf_fit_options options = fit_short_fit(STEPS);
    options.densify_every = 2;
    options.densify_start = 0;
    options.densify = growth;
    int idle = atomic_load(&r.held), refused_fitters = 0, refused_steps = 0;
    for (int allowed = 0, done = 0; !done; allowed++) {
        sf_fitter *fitter;
        atomic_store(&r.left, allowed);
        sf_status status = sf_fitter_create(ctx, scene, NULL, &options, &fitter);
        if (status) {
            assert_status(ctx, status, SF_ERR_MEMORY);
            assert_null(fitter);
            refused_fitters++;
        } else {
            status = sf_fitter_run(fitter, NULL, NULL);
            done = atomic_load(&r.left) >= 0; /* none was refused */
            if (status) assert_status(ctx, status, SF_ERR_MEMORY);
            refused_steps += status != SF_OK;
            assert_true(!done || !status);
            atomic_store(&r.left, PLENTY);
            assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
            assert_int_equal(fit_progress_of(fitter).step, STEPS);
            fit_assert_sound(ctx, fitter);
            sf_fitter_destroy(&fitter);
        }
        assert_int_equal(atomic_load(&r.held), idle);
    }
    assert_true(refused_fitters > 10 && refused_steps > 10);
    atomic_store(&r.left, PLENTY);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
    assert_int_equal(atomic_load(&r.held), 0);
}

static void test_out_of_memory(void **state) {
    (void)state;
    test_skip_emulated();
    for (int growth = SF_DENSIFY_GRADIENT; growth <= SF_DENSIFY_RELOCATE; growth++)
        check_out_of_memory(growth);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_no_view_to_start_with),
        cmocka_unit_test(test_last_view_goes),
        cmocka_unit_test(test_views_come),
        cmocka_unit_test(test_fully_masked_view),
        cmocka_unit_test(test_mask_hides),
        cmocka_unit_test(test_fixed_backgrounds),
        cmocka_unit_test(test_background_is_found),
        cmocka_unit_test(test_antialiased),
        cmocka_unit_test(test_antialiased_from),
        cmocka_unit_test(test_plain_scenes),
        cmocka_unit_test(test_single_view),
        cmocka_unit_test(test_tiny_pictures),
        cmocka_unit_test(test_out_of_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
