/* test_fit.c - fits of a small scene that the library drew itself: what they reach, and what stops them. */
#include "testing.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"

/* The scene: 60 Gaussians in a ball, seen by 12 cameras that look at its middle from all around. */

enum { TRUE_COUNT = 60, VIEWS = 12, WIDTH = 64, HEIGHT = 48, PIXELS = WIDTH * HEIGHT };

static sf_camera camera_of(int view) {
    double angle = 2 * 3.14159265358979 * view / VIEWS, height = view % 2 ? 0.35 : -0.2;
    double forward[3] = {cos(angle) * cos(height), sin(angle) * cos(height), sin(height)};
    double right[3] = {sin(angle), -cos(angle), 0};
    sf_camera c = {
        .width = WIDTH, .height = HEIGHT, .fx = 60, .fy = 60, .cx = WIDTH / 2.0, .cy = HEIGHT / 2.0};
    for (int k = 0; k < 3; k++) {
        int a = (k + 1) % 3, b = (k + 2) % 3;
        c.R_cw[k] = right[k];
        c.R_cw[3 + k] = forward[a] * right[b] - forward[b] * right[a];
        c.R_cw[6 + k] = forward[k];
    }
    c.t_cw[2] = 4;
    return c;
}

/* Values of the true Gaussians, of SH degree 0. */
typedef struct truth {
    float means[TRUE_COUNT][3], quats[TRUE_COUNT][4], log_scales[TRUE_COUNT][3], logits[TRUE_COUNT],
        sh[TRUE_COUNT][3];
} truth;

static truth make_truth(void) {
    truth t;
    sf_rng rng;
    sf_rng_seed(&rng, 11);
    for (int i = 0; i < TRUE_COUNT; i++) {
        for (int k = 0; k < 3; k++) {
            t.means[i][k] = (float)(0.5 * sf_rng_normal(&rng));
            t.log_scales[i][k] = (float)(log(0.15) + 0.4 * sf_rng_normal(&rng));
            t.sh[i][k] = (float)(3 * sf_rng_uniform(&rng) - 1.5);
        }
        for (int k = 0; k < 4; k++) t.quats[i][k] = (float)sf_rng_normal(&rng);
        t.logits[i] = (float)(4 * sf_rng_uniform(&rng) - 1);
    }
    return t;
}

static sf_model *true_model(sf_context *ctx) {
    truth t = make_truth();
    sf_gaussians from = {&t.means[0][0], &t.quats[0][0], &t.log_scales[0][0], t.logits, &t.sh[0][0]};
    sf_model *model;
    assert_ok(ctx, sf_model_create(ctx, TRUE_COUNT, 0, &model));
    assert_ok(ctx, sf_model_set(model, 0, TRUE_COUNT, &from));
    return model;
}

static void add_picture(sf_scene *scene, const sf_camera *camera, const float *rgb, const uint8_t *mask,
                        sf_split split) {
    static uint8_t bytes[3 * PIXELS];
    for (int i = 0; i < 3 * PIXELS; i++) bytes[i] = (uint8_t)(255 * fminf(fmaxf(rgb[i], 0), 1) + 0.5f);
    sf_pixels pixels = {.rgb = bytes, .stride = 3 * (size_t)WIDTH, .mask = mask};
    assert_int_equal(sf_scene_add_view(scene, NULL, camera, &pixels, split, NULL), SF_OK);
}

/* The views `first` .. `end`-1 of the true model over a background. */
static void add_views(sf_context *ctx, sf_scene *scene, int first, int end, const float *background) {
    static float rgb[3 * PIXELS];
    sf_model *model = true_model(ctx);
    sf_renderer *renderer;
    sf_render_options options = sf_render_options_default();
    memcpy(options.background, background, sizeof options.background);
    assert_ok(ctx, sf_renderer_create(ctx, &renderer));
    for (int v = first; v < end; v++) {
        sf_camera camera = camera_of(v);
        sf_image_out out = {.rgb = rgb};
        assert_ok(ctx, sf_render(renderer, model, &camera, &options, &out));
        add_picture(scene, &camera, rgb, NULL, SF_SPLIT_TRAIN);
    }
    sf_renderer_destroy(&renderer);
    sf_model_destroy(&model);
}

/* The true means, off by what structure from motion is off by. */
static void add_points(sf_scene *scene) {
    truth t = make_truth();
    uint8_t rgb[TRUE_COUNT][3];
    sf_rng rng;
    sf_rng_seed(&rng, 12);
    for (int i = 0; i < TRUE_COUNT; i++)
        for (int k = 0; k < 3; k++) {
            t.means[i][k] += (float)(0.05 * sf_rng_normal(&rng));
            rgb[i][k] = (uint8_t)(255 * fminf(fmaxf(0.5f + 0.282f * t.sh[i][k], 0), 1));
        }
    assert_int_equal(sf_scene_add_points(scene, TRUE_COUNT, &t.means[0][0], &rgb[0][0]), SF_OK);
}

static sf_scene *empty_scene(sf_context *ctx) {
    sf_scene *scene;
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    return scene;
}

static const float black[3] = {0, 0, 0};

static sf_scene *small_scene(sf_context *ctx) {
    sf_scene *scene = empty_scene(ctx);
    add_views(ctx, scene, 0, VIEWS, black);
    add_points(scene);
    return scene;
}

/* A view of one colour. */
static void add_plain_view(sf_scene *scene, int view, const float *color, const uint8_t *mask) {
    static float rgb[3 * PIXELS];
    sf_camera camera = camera_of(view);
    for (int i = 0; i < 3 * PIXELS; i++) rgb[i] = color[i % 3];
    add_picture(scene, &camera, rgb, mask, SF_SPLIT_TRAIN);
}

static void skip_if_quick(void) {
    if (getenv("SPLATFIT_QUICK")) test_skip("SPLATFIT_QUICK is set, and this takes hundreds of steps");
}

static sf_fit_options short_fit(int64_t steps) {
    sf_fit_options options = sf_fit_options_default();
    options.steps = steps;
    options.max_gaussians = 200;
    options.densify_every = 10;
    return options;
}

static sf_fitter *start(sf_context *ctx, sf_scene *scene, const sf_fit_options *options) {
    sf_fitter *fitter;
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, options, &fitter));
    return fitter;
}

static sf_fit_progress progress_of(const sf_fitter *fitter) {
    sf_fit_progress p;
    sf_fitter_get_progress(fitter, &p);
    return p;
}

static void take_steps(sf_context *ctx, sf_fitter *fitter, int steps) {
    for (int i = 0; i < steps; i++) assert_ok(ctx, sf_fitter_step(fitter));
}

/* Mean PSNR of the fit over all views of the scene. */
static double psnr_of(sf_context *ctx, sf_scene *scene, sf_fitter *fitter) {
    static float drawn[3 * PIXELS], picture[3 * PIXELS];
    sf_renderer *renderer;
    sf_scene_info info;
    double sum = 0;
    sf_scene_get_info(scene, &info);
    assert_ok(ctx, sf_renderer_create(ctx, &renderer));
    for (size_t i = 0; i < info.views; i++) {
        sf_view_info view;
        sf_quality quality;
        sf_image_out out = {.rgb = drawn};
        assert_ok(ctx, sf_scene_get_view(scene, i, &view));
        assert_ok(ctx, sf_scene_get_pixels(scene, view.id, picture, NULL));
        assert_ok(ctx, sf_fitter_render(fitter, &view.camera, &out));
        assert_ok(ctx, sf_compare(renderer, WIDTH, HEIGHT, drawn, picture, NULL, &quality));
        sum += quality.psnr;
    }
    sf_renderer_destroy(&renderer);
    return sum / (double)info.views;
}

/* All values of a model in one array. */
typedef struct content {
    size_t count, size;
    float *values;
} content;

static content content_of_model(const sf_model *model) {
    size_t n = sf_model_count(model), k = (size_t)sf_model_sh_degree(model) + 1, sh = 3 * k * k;
    content c = {n, n * (11 + sh), calloc(n * (11 + sh) + 1, sizeof(float))};
    assert_non_null(c.values);
    float *at = c.values;
    sf_gaussians to = {at, at + 3 * n, at + 7 * n, at + 10 * n, at + 11 * n};
    assert_int_equal(sf_model_get(model, 0, n, &to), SF_OK);
    return c;
}

static content content_of(sf_context *ctx, const sf_fitter *fitter) {
    sf_model *model;
    assert_ok(ctx, sf_fitter_snapshot(fitter, &model));
    content c = content_of_model(model);
    sf_model_destroy(&model);
    return c;
}

/* To the bit; frees b. */
static void assert_same(const content *a, content b) {
    assert_int_equal(a->count, b.count);
    assert_int_equal(a->size, b.size);
    for (size_t i = 0; i < a->size; i++)
        if (memcmp(&a->values[i], &b.values[i], sizeof(float)))
            fail_msg("value %zu of %zu: %.9g is not %.9g", i, a->size, (double)a->values[i],
                     (double)b.values[i]);
    free(b.values);
}

static int is_same(const content *a, const content *b) {
    return a->size == b->size && !memcmp(a->values, b->values, a->size * sizeof(float));
}

/* A model that any viewer can take: it is written, which checks every value. */
static void assert_sound(sf_context *ctx, const sf_fitter *fitter) {
    sf_model *model;
    assert_ok(ctx, sf_fitter_snapshot(fitter, &model));
    assert_true(sf_model_count(model) > 0);
    assert_ok(ctx, sf_model_save(model, "/dev/null"));
    sf_model_destroy(&model);
}

/* The whole run of one thread count; the caller frees the values. */
static content fitted_by(int threads, const sf_fit_options *options) {
    sf_context *ctx = test_context_threads(threads);
    sf_scene *scene = small_scene(ctx);
    sf_fitter *fitter = start(ctx, scene, options);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    content c = content_of(ctx, fitter);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
    return c;
}

/* What a fit reaches. */

/* From points it gains at least 8 dB and comes to 27. */
static void test_from_points(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = small_scene(ctx);
    sf_fit_options options = short_fit(300);
    options.init = SF_INIT_POINTS;
    sf_fitter *fitter = start(ctx, scene, &options);
    assert_int_equal(progress_of(fitter).gaussians, TRUE_COUNT);
    double before = psnr_of(ctx, scene, fitter);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    double after = psnr_of(ctx, scene, fitter);
    print_message("from points: %.2f dB, then %.2f dB\n", before, after);
    assert_true(after >= 27);
    assert_true(after >= before + 8);
    assert_sound(ctx, fitter);
    sf_fitter_destroy(&fitter);
    assert_null(fitter);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* The true model, disturbed. */
static sf_model *disturbed_model(sf_context *ctx) {
    sf_model *model = true_model(ctx);
    content c = content_of_model(model);
    sf_rng rng;
    sf_rng_seed(&rng, 13);
    for (size_t i = 0; i < c.size; i++)
        c.values[i] += (float)((i < 3 * c.count ? 0.03 : 0.3) * sf_rng_normal(&rng));
    float *at = c.values;
    sf_gaussians from = {at, at + 3 * c.count, at + 7 * c.count, at + 10 * c.count, at + 11 * c.count};
    assert_ok(ctx, sf_model_set(model, 0, c.count, &from));
    free(c.values);
    return model;
}

/* The disturbed model is brought back: at least 8 dB better, without a Gaussian more. */
static void test_from_a_disturbed_model(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = small_scene(ctx);
    sf_model *model = disturbed_model(ctx);
    sf_fit_options options = short_fit(300);
    options.max_gaussians = TRUE_COUNT;
    sf_fitter *fitter;
    assert_ok(ctx, sf_fitter_create(ctx, scene, model, &options, &fitter));
    sf_model_destroy(&model); /* the fitter has its own copy */
    double before = psnr_of(ctx, scene, fitter);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    double after = psnr_of(ctx, scene, fitter);
    print_message("from a disturbed model: %.2f dB, then %.2f dB\n", before, after);
    assert_true(after >= before + 8);
    assert_between(progress_of(fitter).gaussians, 1, TRUE_COUNT);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Without points, from Gaussians at random. */
static void test_from_nothing(void **state) {
    (void)state;
    skip_if_quick();
    sf_context *ctx = test_context();
    sf_scene *scene = empty_scene(ctx);
    add_views(ctx, scene, 0, VIEWS, black);
    sf_fit_options options = short_fit(300);
    options.init_random = 150;
    sf_fitter *fitter = start(ctx, scene, &options);
    assert_int_equal(progress_of(fitter).gaussians, 150);
    double before = psnr_of(ctx, scene, fitter);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    double after = psnr_of(ctx, scene, fitter);
    print_message("from nothing: %.2f dB, then %.2f dB\n", before, after);
    assert_true(after >= before + 5);
    assert_sound(ctx, fitter);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* The same bytes, whatever the number of threads and however often; other ones by another seed. */
static void test_same_bytes(void **state) {
    (void)state;
    static const int threads[] = {1, 2, 3, 4, 8};
    sf_fit_options options = short_fit(getenv("SPLATFIT_QUICK") ? 22 : 40);
    options.background = SF_BACKGROUND_RANDOM;
    content first = fitted_by(1, &options);
    for (size_t i = 0; i < sizeof threads / sizeof *threads; i++)
        assert_same(&first, fitted_by(threads[i], &options));
    options.seed = 2;
    content other = fitted_by(2, &options);
    assert_false(is_same(&first, &other));
    free(first.values);
    free(other.values);
}

/* So it is with moments of 16 bits; they are not the floats. */
static void test_same_bytes_with_half_moments(void **state) {
    (void)state;
    test_skip_emulated();
    sf_fit_options options = short_fit(getenv("SPLATFIT_QUICK") ? 12 : 40);
    content floats = fitted_by(1, &options);
    options.moments = SF_MOMENTS_HALF;
    content first = fitted_by(1, &options);
    assert_same(&first, fitted_by(2, &options));
    assert_same(&first, fitted_by(4, &options));
    assert_false(is_same(&first, &floats));
    free(first.values);
    free(floats.values);
}

static double psnr_with_moments(int moments, double beta2, int64_t seed) {
    sf_context *ctx = test_context();
    sf_scene *scene = small_scene(ctx);
    sf_fit_options options = short_fit(200);
    options.init = SF_INIT_POINTS;
    options.moments = moments;
    options.adam_beta2 = beta2;
    options.densify_per_step = 0;
    options.seed = seed;
    sf_fitter *fitter = start(ctx, scene, &options);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    double psnr = psnr_of(ctx, scene, fitter);
    assert_sound(ctx, fitter);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
    return psnr;
}

/* They reach what floats reach: without growth, and before a small scene falls into one of several ends.
 * With 0.999, where it is hard, since v changes by less than its last bit a step, and with the plan's decay.
 * Which view came when moves a run by some tenths of a decibel, so their mean is meant. */
static void test_half_moments_are_as_good(void **state) {
    (void)state;
    skip_if_quick();
    enum { SEEDS = 8 };
    const double betas[] = {0.999, sf_fit_options_default().adam_beta2};
    for (int b = 0; b < 2; b++) {
        double gain = 0;
        for (int64_t seed = 1; seed <= SEEDS; seed++) {
            double floats = psnr_with_moments(SF_MOMENTS_FLOAT, betas[b], seed),
                   halves = psnr_with_moments(SF_MOMENTS_HALF, betas[b], seed);
            print_message("adam_beta2 %g, moments as floats: %.2f dB, of 16 bits: %.2f dB\n", betas[b],
                          floats, halves);
            assert_true(halves >= floats - 0.5);
            gain += (halves - floats) / SEEDS;
        }
        assert_true(gain >= -0.2);
    }
}

/* A model gone on from keeps what it had: after 20 steps no more than 0.5 dB are lost. */
static void test_going_on(void **state) {
    (void)state;
    test_skip_emulated();
    sf_context *ctx = test_context();
    sf_scene *scene = small_scene(ctx);
    sf_fit_options options = short_fit(getenv("SPLATFIT_QUICK") ? 80 : 200);
    sf_fitter *fitter = start(ctx, scene, &options);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    double before = psnr_of(ctx, scene, fitter);
    content fitted = content_of(ctx, fitter);
    sf_model *model;
    assert_ok(ctx, sf_fitter_snapshot(fitter, &model));
    sf_fitter_destroy(&fitter);
    options.steps = 20;
    assert_ok(ctx, sf_fitter_create(ctx, scene, model, &options, &fitter));
    assert_same(&fitted, content_of(ctx, fitter));
    assert_true(fabs(psnr_of(ctx, scene, fitter) - before) < 1e-9);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    double after = psnr_of(ctx, scene, fitter);
    print_message("going on: %.2f dB, then %.2f dB\n", before, after);
    assert_true(after >= before - 0.5);
    assert_int_equal(progress_of(fitter).level, 0); /* no coarse pictures again */
    free(fitted.values);
    sf_model_destroy(&model);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_degree_gone_on_with(void **state) {
    (void)state;
    static const int degrees[][3] = {{0, 3, 3}, {2, 0, 2}, {1, 1, 1}}; /* of the model, asked for, had */
    sf_context *ctx = test_context();
    sf_scene *scene = small_scene(ctx);
    for (size_t i = 0; i < 3; i++) {
        sf_model *from, *model;
        sf_fitter *fitter;
        sf_fit_options options = short_fit(5);
        options.sh_degree = degrees[i][1];
        assert_ok(ctx, sf_model_create(ctx, 5, degrees[i][0], &from));
        assert_ok(ctx, sf_fitter_create(ctx, scene, from, &options, &fitter));
        take_steps(ctx, fitter, 1);
        assert_int_equal(progress_of(fitter).sh_degree, degrees[i][2]); /* all bands at once */
        assert_ok(ctx, sf_fitter_snapshot(fitter, &model));
        assert_int_equal(sf_model_sh_degree(model), degrees[i][2]);
        sf_model_destroy(&model);
        sf_model_destroy(&from);
        sf_fitter_destroy(&fitter);
    }
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* The number of Gaussians. */

static void test_cap_holds(void **state) {
    (void)state;
    static const int64_t caps[] = {1, 7, 16, 17, 60, 61, 64, 100};
    sf_context *ctx = test_context();
    sf_scene *scene = small_scene(ctx);
    for (size_t i = 0; i < sizeof caps / sizeof *caps; i += getenv("SPLATFIT_QUICK") ? 3 : 1) {
        sf_fit_options options = short_fit(50);
        options.init = SF_INIT_POINTS;
        options.max_gaussians = caps[i];
        options.densify_every = 2;
        options.densify_end = 1;
        sf_fitter *fitter = start(ctx, scene, &options);
        size_t cap = (size_t)caps[i], most = progress_of(fitter).gaussians;
        assert_int_equal(most, cap < TRUE_COUNT ? cap : TRUE_COUNT);
        for (int step = 0; step < 50; step++) {
            take_steps(ctx, fitter, 1);
            size_t count = progress_of(fitter).gaussians;
            if (count > cap) fail_msg("%zu Gaussians after step %d, cap %zu", count, step + 1, cap);
            most = count > most ? count : most;
        }
        assert_true(most > cap - cap / 10 - 1); /* and it is used */
        assert_sound(ctx, fitter);
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
    sf_scene *scene = small_scene(ctx);
    sf_fit_options options = short_fit(40);
    options.densify_every = 4;
    options.densify_rate = 0.1;
    options.size = SF_SIZE_CAP;
    options.max_gaussians = 1000;
    sf_fitter *fitter = start(ctx, scene, &options);
    size_t before = progress_of(fitter).gaussians;
    for (int step = 0; step < 40; step++) {
        take_steps(ctx, fitter, 1);
        size_t count = progress_of(fitter).gaussians;
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
    sf_scene *scene = small_scene(ctx);
    sf_model *model = true_model(ctx);
    sf_fit_options options = short_fit(10);
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
    sf_scene *scene = small_scene(ctx);
    sf_fit_options options = short_fit(10);
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
    sf_scene *scene = small_scene(ctx);
    sf_fit_options options = short_fit(40);
    sf_fitter *fitter = start(ctx, scene, &options);
    log_of_run log = {0};
    assert_ok(ctx, sf_fitter_run(fitter, follow, &log));
    assert_int_equal(log.calls, 40);
    assert_int_equal(log.level, 0);
    assert_int_equal(log.degree, 3);
    content ended = content_of(ctx, fitter);
    assert_int_equal(sf_fitter_step(fitter), SF_ERR_END);
    assert_ok(ctx, sf_fitter_run(fitter, follow, &log)); /* nothing left to do */
    assert_int_equal(log.calls, 40);
    assert_int_equal(progress_of(fitter).step, 40);
    assert_same(&ended, content_of(ctx, fitter));
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
    sf_scene *scene = small_scene(ctx);
    sf_fit_options options = short_fit(1);
    sf_fitter *fitter = start(ctx, scene, &options);
    take_steps(ctx, fitter, 1);
    double limit = 0.5 + 10 * progress_of(fitter).seconds; /* emulated, a step can take a second */
    sf_fitter_destroy(&fitter);
    options = short_fit(0);
    options.time_limit = limit;
    options.validate =
        0; /* the limit is long where the first step was slow, and views kept out end such a run */
    fitter = start(ctx, scene, &options);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    sf_fit_progress p = progress_of(fitter);
    assert_true(p.fraction == 1 && p.seconds >= limit);
    assert_int_equal(p.steps, 0);
    assert_true(p.step > 0);
    assert_sound(ctx, fitter);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Seconds taken out of the run count neither as its time nor against its limit; negative ones are put in. */
static void test_time_taken_out(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = small_scene(ctx);
    sf_fit_options options = short_fit(0);
    options.time_limit = 1e6;
    sf_fitter *fitter = start(ctx, scene, &options);
    take_steps(ctx, fitter, 1);
    sf_fitter_skip_time(fitter, -2e6);
    assert_true(progress_of(fitter).seconds >= 2e6);
    assert_status(ctx, sf_fitter_step(fitter), SF_ERR_END);
    sf_fitter_skip_time(fitter, 1.5e6);
    assert_true(progress_of(fitter).fraction >= 0.5 && progress_of(fitter).fraction < 1);
    take_steps(ctx, fitter, 1);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_snapshot_stays(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = small_scene(ctx);
    sf_fit_options options = short_fit(60);
    sf_fitter *fitter = start(ctx, scene, &options);
    sf_model *model;
    take_steps(ctx, fitter, 10);
    assert_ok(ctx, sf_fitter_snapshot(fitter, &model));
    content taken = content_of_model(model), now = content_of(ctx, fitter);
    assert_same(&taken, now);
    take_steps(ctx, fitter, 20);
    now = content_of(ctx, fitter);
    assert_false(is_same(&taken, &now));
    sf_gaussians change = {.means = (float[]){7, 8, 9}};
    assert_ok(ctx, sf_model_set(model, 0, 1, &change));
    assert_same(&now, content_of(ctx, fitter)); /* nor does the fit see the copy's changes */
    change.means = taken.values;
    assert_ok(ctx, sf_model_set(model, 0, 1, &change));
    sf_fitter_destroy(&fitter);
    assert_same(&taken, content_of_model(model)); /* it outlives the fitter */
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
    sf_fit_options options = short_fit(60);
    content whole = fitted_by(2, &options);
    sf_context *ctx = test_context();
    sf_scene *scene = small_scene(ctx);
    sf_fitter *fitter = start(ctx, scene, &options);
    canceller c = {fitter, 23};
    assert_status(ctx, sf_fitter_run(fitter, cancel_at, &c), SF_ERR_CANCELLED);
    assert_int_equal(progress_of(fitter).step, 23);
    assert_int_equal(sf_fitter_step(fitter), SF_ERR_CANCELLED);
    assert_int_equal(progress_of(fitter).step, 23);
    assert_sound(ctx, fitter);
    sf_fitter_resume(fitter);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    assert_int_equal(progress_of(fitter).step, 60);
    assert_same(&whole, content_of(ctx, fitter)); /* as if nothing had happened */
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
    sf_scene *scene = small_scene(ctx);
    sf_fit_options options = short_fit(100000000);
    sf_fitter *fitter = start(ctx, scene, &options);
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
    assert_sound(ctx, fitter);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
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
    sf_scene *scene = empty_scene(ctx);
    sf_fitter *fitter;
    sf_camera camera = camera_of(0);
    add_points(scene);
    add_picture(scene, &camera, rgb, NULL, SF_SPLIT_TEST); /* held out: not to be learned from */
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
    sf_scene *scene = small_scene(ctx);
    sf_fit_options options = short_fit(60);
    sf_fitter *fitter = start(ctx, scene, &options);
    take_steps(ctx, fitter, 15);
    content before = content_of(ctx, fitter);
    remove_all_views(ctx, scene);
    assert_status(ctx, sf_fitter_step(fitter), SF_ERR_EMPTY);
    assert_error_names(ctx, "no training view is left");
    assert_status(ctx, sf_fitter_run(fitter, NULL, NULL), SF_ERR_EMPTY);
    assert_int_equal(progress_of(fitter).step, 15);
    assert_same(&before, content_of(ctx, fitter));
    add_views(ctx, scene, 3, 4, black);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    assert_int_equal(progress_of(fitter).step, 60);
    assert_sound(ctx, fitter);
    free(before.values);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Half of the views are there from the start, the others come: the fit gets better on those. */
static void test_views_come(void **state) {
    (void)state;
    skip_if_quick();
    sf_context *ctx = test_context();
    sf_scene *scene = empty_scene(ctx), *all = small_scene(ctx);
    add_views(ctx, scene, 0, 2, black);
    add_points(scene);
    sf_fit_options options = short_fit(300);
    sf_fitter *fitter = start(ctx, scene, &options);
    take_steps(ctx, fitter, 100);
    double before = psnr_of(ctx, all, fitter);
    sf_view_info view;
    assert_ok(ctx, sf_scene_get_view(scene, 0, &view));
    assert_ok(ctx, sf_scene_remove_view(scene, view.id));
    add_views(ctx, scene, 2, VIEWS, black);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    double after = psnr_of(ctx, all, fitter);
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
    sf_scene *scene = empty_scene(ctx);
    add_plain_view(scene, 0, white, nothing);
    add_points(scene);
    sf_fit_options options = short_fit(30);
    options.prune_opacity = 0;
    sf_fitter *fitter = start(ctx, scene, &options);
    content before = content_of(ctx, fitter);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    assert_int_equal(progress_of(fitter).step, 30);
    assert_int_equal(progress_of(fitter).skipped_values, 0);
    assert_same(&before, content_of(ctx, fitter));
    free(before.values);
    sf_fitter_destroy(&fitter);

    add_views(ctx, scene, 0, VIEWS, black); /* among others it does no harm */
    options = short_fit(150);
    fitter = start(ctx, scene, &options);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    sf_view_info view;
    assert_ok(ctx, sf_scene_get_view(scene, 0, &view));
    assert_ok(ctx, sf_scene_remove_view(scene, view.id));
    assert_true(psnr_of(ctx, scene, fitter) >= 24);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* What lies under a mask has no influence, to the bit. */
static content fitted_to_left_half(const float *hidden) {
    static float rgb[3 * PIXELS];
    static uint8_t mask[PIXELS];
    sf_context *ctx = test_context();
    sf_scene *scene = empty_scene(ctx);
    sf_fit_options options = short_fit(40);
    for (int v = 0; v < 3; v++) {
        for (int i = 0; i < PIXELS; i++) {
            mask[i] = i % WIDTH < WIDTH / 2 ? 255 : 0;
            for (int c = 0; c < 3; c++) rgb[3 * i + c] = mask[i] ? 0.5f : hidden[c];
        }
        sf_camera camera = camera_of(v);
        add_picture(scene, &camera, rgb, mask, SF_SPLIT_TRAIN);
    }
    add_points(scene);
    sf_fitter *fitter = start(ctx, scene, &options);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    content c = content_of(ctx, fitter);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
    return c;
}

static void test_mask_hides(void **state) {
    (void)state;
    static const float red[3] = {1, 0, 0}, blue[3] = {0, 0.2f, 1};
    content a = fitted_to_left_half(red);
    assert_same(&a, fitted_to_left_half(blue));
    free(a.values);
}

/* Backgrounds and modes. */

static void assert_background(const sf_fitter *fitter, double red, double green, double blue, double within) {
    sf_fit_progress p = progress_of(fitter);
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
    sf_fit_options options = short_fit(steps);
    options.init = SF_INIT_POINTS;
    options.background = background;
    options.background_red = 0.25;
    options.background_green = 0.5;
    options.background_blue = 1;
    sf_fitter *fitter = start(ctx, scene, &options);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    assert_sound(ctx, fitter);
    return fitter;
}

static void test_fixed_backgrounds(void **state) {
    (void)state;
    skip_if_quick();
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
        sf_scene *scene = empty_scene(ctx);
        add_views(ctx, scene, 0, VIEWS, c);
        add_points(scene);
        sf_fitter *fitter = fit_over(ctx, scene, cases[i].kind, 200);
        assert_background(fitter, (double)c[0], (double)c[1], (double)c[2], 0);
        double psnr = psnr_of(ctx, scene, fitter);
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
        sf_scene *scene = empty_scene(ctx);
        add_views(ctx, scene, 0, VIEWS, c);
        add_points(scene);
        sf_fitter *fitter = fit_over(ctx, scene, SF_BACKGROUND_AUTO, 250);
        assert_background(fitter, (double)c[0], (double)c[1], (double)c[2], 0.05);
        assert_true(psnr_of(ctx, scene, fitter) >= 25);
        sf_fitter_destroy(&fitter);
        sf_scene_destroy(&scene);
    }
    sf_context_destroy(&ctx);
}

static void test_antialiased(void **state) {
    (void)state;
    skip_if_quick();
    sf_context *ctx = test_context();
    sf_scene *scene = small_scene(ctx);
    for (int on = 0; on < 2; on++) {
        sf_fit_options options = short_fit(200);
        options.antialiased = on;
        sf_fitter *fitter = start(ctx, scene, &options);
        sf_model *model;
        assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
        assert_ok(ctx, sf_fitter_snapshot(fitter, &model));
        assert_int_equal(sf_model_antialiased(model), on);
        assert_true(psnr_of(ctx, scene, fitter) >= 23);
        sf_model_destroy(&model);
        sf_fitter_destroy(&fitter);
    }
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* A model that was fitted so is gone on with so. */
static void test_antialiased_from(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = small_scene(ctx);
    sf_model *from = true_model(ctx), *model;
    sf_fit_options options = short_fit(1);
    sf_fitter *fitter;
    sf_model_set_antialiased(from, 1);
    assert_ok(ctx, sf_fitter_create(ctx, scene, from, &options, &fitter));
    assert_ok(ctx, sf_fitter_snapshot(fitter, &model));
    assert_true(sf_model_antialiased(model));
    sf_model_destroy(&from);
    sf_model_destroy(&model);
    sf_fitter_destroy(&fitter);
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
        sf_scene *scene = empty_scene(ctx);
        for (int v = 0; v < cases[i].views; v++) add_plain_view(scene, v, cases[i].color, NULL);
        if (cases[i].points) add_points(scene);
        sf_fit_options options = short_fit(getenv("SPLATFIT_QUICK") ? 20 : 50);
        options.max_gaussians = 80;
        sf_fitter *fitter = start(ctx, scene, &options);
        assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
        sf_model *model;
        assert_ok(ctx, sf_fitter_snapshot(fitter, &model)); /* of a black scene nothing need be left */
        assert_ok(ctx, sf_model_save(model, "/dev/null"));
        assert_int_equal(progress_of(fitter).skipped_values, 0);
        sf_model_destroy(&model);
        sf_fitter_destroy(&fitter);
        sf_scene_destroy(&scene);
    }
    sf_context_destroy(&ctx);
}

static void test_single_view(void **state) {
    (void)state;
    skip_if_quick();
    sf_context *ctx = test_context();
    sf_scene *scene = empty_scene(ctx);
    add_views(ctx, scene, 5, 6, black);
    add_points(scene);
    sf_fit_options options = short_fit(200);
    sf_fitter *fitter = start(ctx, scene, &options);
    double before = psnr_of(ctx, scene, fitter);
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    assert_true(psnr_of(ctx, scene, fitter) >= before + 8);
    assert_sound(ctx, fitter);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* A view of one grey, of any size up to 17 x 31 pixels. */
static void add_tiny_view(sf_context *ctx, sf_scene *scene, int32_t width, int32_t height) {
    sf_camera camera = camera_of(0);
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
        sf_scene *scene = empty_scene(ctx);
        add_tiny_view(ctx, scene, sizes[i][0], sizes[i][1]);
        add_points(scene);
        sf_fit_options options = short_fit(30);
        sf_fitter *fitter = start(ctx, scene, &options);
        assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
        assert_sound(ctx, fitter);
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
    sf_scene *scene = empty_scene(ctx);
    add_tiny_view(ctx, scene, 17, 9);
    add_points(scene);
    sf_fit_options options = short_fit(STEPS);
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
            assert_int_equal(progress_of(fitter).step, STEPS);
            assert_sound(ctx, fitter);
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
        cmocka_unit_test(test_from_points),
        cmocka_unit_test(test_from_a_disturbed_model),
        cmocka_unit_test(test_from_nothing),
        cmocka_unit_test(test_same_bytes),
        cmocka_unit_test(test_same_bytes_with_half_moments),
        cmocka_unit_test(test_half_moments_are_as_good),
        cmocka_unit_test(test_going_on),
        cmocka_unit_test(test_degree_gone_on_with),
        cmocka_unit_test(test_cap_holds),
        cmocka_unit_test(test_growth_is_gradual),
        cmocka_unit_test(test_cap_below_the_model),
        cmocka_unit_test(test_bad_options),
        cmocka_unit_test(test_progress_and_end),
        cmocka_unit_test(test_time_limit),
        cmocka_unit_test(test_time_taken_out),
        cmocka_unit_test(test_snapshot_stays),
        cmocka_unit_test(test_cancel_and_resume),
        cmocka_unit_test(test_cancel_any_time),
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
