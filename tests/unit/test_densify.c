/* test_densify.c - growth by error in several views, and relocation. */
#include "testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fit/densify_relocate.h"
#include "fit/densify_score.h"
#include "fit/fit.h"
#include "fit/fitter.h"
#include "fit/schedule.h"
#include "fit/select_floaters.h"
#include "fit/views.h"

enum { VIEWS = 8, WIDTH = 64, HEIGHT = 48, PIXELS = WIDTH * HEIGHT };

static const double pi = 3.141592653589793;

static sf_camera camera_of(int view) { return test_camera_around(view, VIEWS, WIDTH, HEIGHT); }

/* A round Gaussian of one colour. */
typedef struct ball {
    float mean[3], scale, opacity, gray;
} ball;

static void set_ball(sf_model *model, size_t i, const ball *b) {
    float quat[4] = {1, 0, 0, 0}, log_scale[3], sh[3], logit = logf(b->opacity / (1 - b->opacity));
    for (int k = 0; k < 3; k++) log_scale[k] = logf(b->scale), sh[k] = (b->gray - 0.5f) / 0.28209479f;
    sf_gaussians from = {(float *)b->mean, quat, log_scale, &logit, sh};
    assert_int_equal(sf_model_set(model, i, 1, &from), SF_OK);
}

static sf_model *model_of(sf_context *ctx, const ball *balls, size_t count) {
    sf_model *model;
    assert_ok(ctx, sf_model_create(ctx, count, 0, &model));
    for (size_t i = 0; i < count; i++) set_ball(model, i, &balls[i]);
    return model;
}

static void draw(sf_context *ctx, const sf_model *model, int view, float *rgb) {
    sf_renderer *renderer;
    sf_camera camera = camera_of(view);
    sf_image_out out = {.rgb = rgb};
    assert_ok(ctx, sf_renderer_create(ctx, &renderer));
    assert_ok(ctx, sf_render(renderer, model, &camera, NULL, &out));
    sf_renderer_destroy(&renderer);
}

/* All views of balls; in view `spoilt` (-1: none) the picture is white around the middle of `where`. */
static sf_scene *scene_of(sf_context *ctx, const ball *balls, size_t count, int spoilt, const float *where,
                          const uint8_t *mask) {
    static float rgb[3 * PIXELS];
    static uint8_t bytes[3 * PIXELS];
    sf_scene *scene;
    sf_model *model = model_of(ctx, balls, count);
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    for (int v = 0; v < VIEWS; v++) {
        sf_camera camera = camera_of(v);
        draw(ctx, model, v, rgb);
        for (int i = 0; i < 3 * PIXELS; i++) bytes[i] = (uint8_t)(255 * fminf(fmaxf(rgb[i], 0), 1) + 0.5f);
        double p[3];
        for (int k = 0; k < 3 && v == spoilt; k++)
            p[k] = camera.R_cw[3 * k] * where[0] + camera.R_cw[3 * k + 1] * where[1] +
                   camera.R_cw[3 * k + 2] * where[2] + camera.t_cw[k];
        for (int i = 0; i < PIXELS && v == spoilt; i++) {
            double x = i % WIDTH - (60 * p[0] / p[2] + WIDTH / 2.0);
            double y = i / WIDTH - (60 * p[1] / p[2] + HEIGHT / 2.0);
            if (x * x + y * y < 100) memset(bytes + 3 * i, 255, 3);
        }
        sf_pixels pixels = {.rgb = bytes, .stride = 3 * (size_t)WIDTH, .mask = mask};
        assert_int_equal(sf_scene_add_view(scene, NULL, &camera, &pixels, SF_SPLIT_TRAIN, NULL), SF_OK);
    }
    sf_model_destroy(&model);
    return scene;
}

static sf_fit_options options_of(int growth) {
    sf_fit_options options = sf_fit_options_default();
    options.size = SF_SIZE_CAP;
    options.densify = growth;
    options.steps = 100;
    options.max_gaussians = 64;
    options.sh_degree = 0;
    return options;
}

static sf_fitter *fitter_of(sf_context *ctx, sf_scene *scene, const ball *balls, size_t count,
                            const sf_fit_options *options) {
    sf_model *model = model_of(ctx, balls, count);
    sf_fitter *fitter;
    assert_ok(ctx, sf_fitter_create(ctx, scene, model, options, &fitter));
    sf_model_destroy(&model);
    return fitter;
}

static const float *means_of(const sf_fitter *f) { return f->model->params.field[SF_FIELD_mean]; }

static double opacity_of(const sf_fitter *f, size_t i) {
    return 1 / (1 + exp(-(double)f->model->params.field[SF_FIELD_logit_opacity][i]));
}

/* Cloning and splitting. */

/* The first of three balls grows; whatever its size is, as `split_scale` says. */
static sf_fitter *grown(sf_context *ctx, sf_scene **scene, const ball *balls, double split_scale) {
    sf_fit_options options = options_of(SF_DENSIFY_GRADIENT);
    options.max_gaussians = 4;
    options.densify_every = 1;
    options.plan_steps = 1;
    options.densify_per_step = 1e6;
    options.split_scale = split_scale;
    *scene = scene_of(ctx, balls, 3, -1, NULL, NULL);
    sf_fitter *f = fitter_of(ctx, *scene, balls, 3, &options);
    f->densify.gradient_sum[0] = f->densify.visible_count[0] = 1;
    sf_select_and_densify(f, 1);
    assert_int_equal(f->model->count, 4);
    return f;
}

static float log_scale_of(const sf_fitter *f, size_t i) {
    return f->model->params.field[SF_FIELD_log_scale][sf_at(i, 3, 0)];
}

/* What is small becomes two of its size, a little apart, that together are as opaque; what is large two
 * halves. */
static void test_clone_and_split(void **state) {
    (void)state;
    static const ball balls[] = {
        {{0, 0, 0.8f}, 0.2f, 0.9f, 0.4f}, {{0, 0, -0.8f}, 0.2f, 0.9f, 0.4f}, {{0, 0, 0}, 0.2f, 0.9f, 0.4f}};
    sf_context *ctx = test_context();
    sf_scene *scene;
    sf_fitter *f = grown(ctx, &scene, balls, 1e6);
    double moved = 0;
    for (int k = 0; k < 3; k++) {
        assert_true(means_of(f)[sf_at(0, 3, k)] == balls[0].mean[k]);
        moved += pow((double)(means_of(f)[sf_at(3, 3, k)] - balls[0].mean[k]), 2);
    }
    assert_true(moved > 0 && sqrt(moved) < 1);
    assert_true(log_scale_of(f, 0) == log_scale_of(f, 1) && log_scale_of(f, 3) == log_scale_of(f, 1));
    assert_true(opacity_of(f, 3) == opacity_of(f, 0));
    assert_true(fabs(pow(1 - opacity_of(f, 0), 2) - 0.1) < 1e-5);
    assert_true(fabs(opacity_of(f, 1) - 0.9) < 1e-5);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    f = grown(ctx, &scene, balls, 0);
    assert_true(log_scale_of(f, 0) < log_scale_of(f, 1) && log_scale_of(f, 3) == log_scale_of(f, 0));
    for (int k = 0; k < 3; k++) {
        double middle = 0.5 * (double)(means_of(f)[sf_at(0, 3, k)] + means_of(f)[sf_at(3, 3, k)]);
        assert_true(fabs(middle - (double)balls[0].mean[k]) < 1e-6);
    }
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Error. */

/* Three balls apart from each other, each seen by every view. */
enum { WRONG, SPOILT, FINE };
static const ball apart[] = {
    {{0, 0, 0.8f}, 0.2f, 0.9f, 0.4f}, {{0, 0, -0.8f}, 0.2f, 0.9f, 0.4f}, {{0, 0, 0}, 0.2f, 0.9f, 0.4f}};
enum { APART = sizeof apart / sizeof *apart };

/* The first has a colour that is wrong in every view, the second is hidden by a larger blemish in one. */
static sf_fitter *disagreeing(sf_context *ctx, sf_scene **scene, const uint8_t *mask,
                              const sf_fit_options *options) {
    ball wrong[APART];
    memcpy(wrong, apart, sizeof wrong);
    wrong[WRONG].gray = 0.45f; /* in all views together less than the blemish in one */
    *scene = scene_of(ctx, apart, APART, 3, apart[SPOILT].mean, mask);
    return fitter_of(ctx, *scene, wrong, APART, options);
}

static void end(sf_context *ctx, sf_scene *scene, sf_fitter *fitter) {
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_error_of_several_views(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene;
    sf_fit_options options = options_of(SF_DENSIFY_ERROR);
    options.max_gaussians = 4;
    options.densify_every = 1;
    options.plan_steps = 1;
    options.densify_per_step = 1e6;
    sf_fitter *f = disagreeing(ctx, &scene, NULL, &options);
    assert_ok(ctx, sf_densify_score(f));
    assert_true(f->densify.gradient_sum[WRONG] > 5 * f->densify.gradient_sum[SPOILT]);
    assert_true(f->densify.gradient_sum[WRONG] > 5 * f->densify.gradient_sum[FINE]);
    sf_select_and_densify(f, 1);
    assert_int_equal(f->model->count, 4);
    assert_true((double)means_of(f)[sf_at(3, 3, 2)] > 0.5); /* beside the first */
    end(ctx, scene, f);
}

/* What is masked everywhere is no error. */
static void test_masked_error(void **state) {
    (void)state;
    static uint8_t mask[PIXELS];
    for (int i = 0; i < PIXELS; i++) mask[i] = i / WIDTH > HEIGHT / 2 ? 255 : 0; /* the first is above */
    sf_context *ctx = test_context();
    sf_scene *scene;
    sf_fit_options options = options_of(SF_DENSIFY_ERROR);
    sf_fitter *f = disagreeing(ctx, &scene, mask, &options);
    assert_ok(ctx, sf_densify_score(f));
    assert_true(f->densify.gradient_sum[WRONG] < 1e-3);
    assert_true(f->densify.gradient_sum[WRONG] >= 0); /* it is shown: it stays */
    end(ctx, scene, f);
}

/* What other Gaussians hide in all views goes, and what no view holds stays. */
static void test_hidden(void **state) {
    (void)state;
    static const ball balls[] = {{{0, 0, 0.3f}, 0.4f, 0.995f, 0.4f},
                                 {{0, 0, 0.3f}, 0.4f, 0.995f, 0.4f},
                                 {{0, 0, 0.3f}, 0.4f, 0.995f, 0.4f},
                                 {{0, 0, 0.3f}, 0.02f, 0.5f, 0.4f}, /* as near as they are, and after them */
                                 {{0, 0, 50}, 0.2f, 0.9f, 0.4f}};
    enum { COUNT = sizeof balls / sizeof *balls };
    sf_context *ctx = test_context();
    sf_fit_options options = options_of(SF_DENSIFY_ERROR);
    sf_scene *scene = scene_of(ctx, balls, COUNT, -1, NULL, NULL);
    sf_fitter *f = fitter_of(ctx, scene, balls, COUNT, &options);
    f->densify.out_of_memory = 1;
    sf_select_and_densify(f, 0);
    assert_int_equal(f->model->count, COUNT - 1);
    assert_true(opacity_of(f, 2) > 0.9);
    assert_true(means_of(f)[sf_at(3, 3, 2)] == 50);
    end(ctx, scene, f);
}

/* Views kept for validation are not looked at: a blemish in them changes nothing. */
static void test_validation_is_not_looked_at(void **state) {
    (void)state;
    double scores[2][APART];
    for (int spoil = 0; spoil < 2; spoil++) {
        sf_context *ctx = test_context();
        sf_fit_options options = options_of(SF_DENSIFY_ERROR);
        options.validate = 4;
        options.error_views = 100;
        sf_scene *scene = scene_of(ctx, apart, APART, spoil ? 2 : -1, apart[SPOILT].mean, NULL);
        sf_fitter *f = fitter_of(ctx, scene, apart, APART, &options);
        sf_view_info info;
        assert_ok(ctx, sf_scene_get_view(scene, 2, &info));
        assert_true(sf_is_in_validation(&f->validation, info.id));
        assert_ok(ctx, sf_densify_score(f));
        memcpy(scores[spoil], f->densify.gradient_sum, sizeof scores[spoil]);
        end(ctx, scene, f);
    }
    assert_memory_equal(scores[0], scores[1], sizeof scores[0]);
}

/* Relocation. */

/* Along a line through the middle, in standard deviations: the integral of 1 - (1 - each g)^n. */
static double integral(double each, uint32_t n) {
    enum { STEPS = 4000 };
    double sum = 0, reach = 12, h = 2 * reach / STEPS;
    for (int i = 0; i <= STEPS; i++) { /* smooth and 0 at both ends: as good as exact */
        double x = -reach + i * h;
        sum += h * -expm1(n * log1p(-each * exp(-x * x / 2)));
    }
    return sum;
}

static void test_formula(void **state) {
    (void)state;
    static const double opacities[] = {1e-6, 0.006, 0.1, 0.5, 0.9, 0.995, 0.9999};
    static const uint32_t numbers[] = {1, 2, 3, 10, 51, 1000, 100000};
    for (size_t i = 0; i < sizeof opacities / sizeof *opacities; i++)
        for (size_t k = 0; k < sizeof numbers / sizeof *numbers; k++) {
            double o = opacities[i], shrink, each = sf_relocated_opacity(o, numbers[k], &shrink);
            double peak = -expm1(numbers[k] * log1p(-each)), line = shrink * integral(each, numbers[k]);
            assert_true(fabs(peak - o) < 1e-9 * o);
            assert_true(fabs(line - o * sqrt(2 * pi)) < 1e-8 * o);
            assert_true(numbers[k] > 1 ? each < o && shrink < 1 : each == o || fabs(each - o) < 1e-12);
        }
}

/* One live ball among dead ones: all become copies of it, and the picture of it stays. */
static void test_picture_stays(void **state) {
    (void)state;
    static float before[3 * PIXELS], after[3 * PIXELS];
    static const ball balls[] = {{{0, 0, 0}, 0.35f, 0.8f, 0.9f},
                                 {{0.5f, 0, 0}, 0.3f, 0.002f, 0.1f},
                                 {{0, 0.5f, 0}, 0.3f, 0.001f, 0.1f},
                                 {{0, 0, 0.5f}, 0.3f, 0.001f, 0.1f}};
    sf_context *ctx = test_context();
    sf_fit_options options = options_of(SF_DENSIFY_RELOCATE);
    sf_scene *scene = scene_of(ctx, balls, 4, -1, NULL, NULL);
    sf_fitter *f = fitter_of(ctx, scene, balls, 4, &options);
    f->model->params.field[SF_FIELD_mean][sf_at(3, 3, 0)] = NAN; /* dead too */
    ((float *)f->moments.part[0][SF_FIELD_mean])[sf_at(2, 3, 1)] = 1;
    draw(ctx, f->model, 0, before);
    assert_ok(ctx, sf_relocate(f, 2));
    draw(ctx, f->model, 0, after);
    assert_int_equal(f->model->count, 6);
    double each = -expm1(log1p(-0.8) / 6), line_before = 0, line_after = 0;
    for (size_t i = 0; i < 6; i++) {
        assert_true(fabs(opacity_of(f, i) - each) < 1e-5);
        for (int k = 0; k < 3; k++) {
            assert_true(means_of(f)[sf_at(i, 3, k)] == 0);
            assert_true(((float *)f->moments.part[0][SF_FIELD_mean])[sf_at(i, 3, k)] == 0);
        }
    }
    for (int x = 0; x < WIDTH; x++) {
        size_t at = 3 * (size_t)(HEIGHT / 2 * WIDTH + x);
        line_before += (double)before[at], line_after += (double)after[at];
    }
    size_t middle = 3 * (size_t)(HEIGHT / 2 * WIDTH + WIDTH / 2);
    assert_true(fabs((double)(before[middle] - after[middle])) < 0.01);
    assert_true(fabs(line_after / line_before - 1) <
                0.03); /* less the rims that are not drawn, and the low-pass */
    end(ctx, scene, f);
}

/* Half of them dead: all live afterwards, where the live ones are, and never more than allowed. */
static void test_dead_come_alive(void **state) {
    (void)state;
    enum { COUNT = 20, MOST = 27 };
    ball balls[COUNT];
    for (int i = 0; i < COUNT; i++)
        balls[i] = (ball){{0.05f * (float)i, 0, 0}, 0.1f, i % 2 ? 0.001f : 0.5f, 0.5f};
    sf_context *ctx = test_context();
    sf_fit_options options = options_of(SF_DENSIFY_RELOCATE);
    options.max_gaussians = MOST;
    options.densify_per_step = 1e6;
    sf_scene *scene = scene_of(ctx, balls, COUNT, -1, NULL, NULL);
    sf_fitter *f = fitter_of(ctx, scene, balls, COUNT, &options);
    for (int round = 0; round < 3; round++) {
        sf_select_and_densify(f, 1);
        assert_int_equal(f->model->count, MOST);
    }
    for (size_t i = 0; i < MOST; i++) {
        double x = (double)means_of(f)[sf_at(i, 3, 0)] / 0.1;
        assert_true(opacity_of(f, i) >= 0.0059);
        assert_true(fabs(x - round(x)) < 1e-4); /* a live one's place */
    }
    end(ctx, scene, f);
}

static void test_none_live(void **state) {
    (void)state;
    static const ball balls[] = {{{0, 0, 0}, 0.3f, 0.001f, 0.9f}, {{0, 0, 1}, 0.3f, 0.001f, 0.9f}};
    sf_context *ctx = test_context();
    sf_fit_options options = options_of(SF_DENSIFY_RELOCATE);
    sf_scene *scene = scene_of(ctx, balls, 2, -1, NULL, NULL);
    sf_fitter *f = fitter_of(ctx, scene, balls, 2, &options);
    assert_ok(ctx, sf_relocate(f, 0));
    assert_int_equal(f->model->count, 2);
    assert_true(opacity_of(f, 0) < 0.002);
    end(ctx, scene, f);
}

/* Noise moves what is faint, the wide more than the narrow, and leaves the opaque alone. */
static void test_noise(void **state) {
    (void)state;
    enum { COUNT = 48 };
    ball balls[COUNT];
    for (int i = 0; i < COUNT; i++)
        balls[i] = (ball){{0, 0, 0}, i < 32 ? 0.1f : 0.2f, i < 16 ? 0.5f : 0.001f, 0.5f};
    double spread[3] = {0, 0, 0};
    sf_context *ctx = test_context();
    sf_fit_options options = options_of(SF_DENSIFY_RELOCATE);
    sf_scene *scene = scene_of(ctx, balls, 1, -1, NULL, NULL);
    sf_fitter *f = fitter_of(ctx, scene, balls, COUNT, &options);
    sf_inject_noise(f, 1, 0, 3);
    for (size_t i = 0; i < COUNT; i++)
        for (int k = 0; k < 3; k++) {
            double moved = (double)means_of(f)[sf_at(i, 3, k)];
            spread[i / 16] += moved * moved / COUNT;
        }
    assert_true(spread[0] == 0);
    double gate = 1 / (1 + exp(100 * (0.001 - 0.005)));
    assert_true(sqrt(spread[1]) > 0.7 * gate * 0.01 && sqrt(spread[1]) < 1.3 * gate * 0.01); /* of 48 draws */
    assert_true(sqrt(spread[2]) > 0.7 * gate * 0.04 && sqrt(spread[2]) < 1.3 * gate * 0.04);
    end(ctx, scene, f);
}

/* Regularisers. */

/* Opacity and scale of what is seen fall, of what is not they stay. */
static void test_regularisers(void **state) {
    (void)state;
    static const ball balls[] = {{{0, 0, 0}, 0.3f, 0.5f, 0.9f}, {{0, 0, 50}, 0.3f, 0.5f, 0.9f}};
    sf_context *ctx = test_context();
    sf_fit_options options = options_of(SF_DENSIFY_GRADIENT);
    options.reg_opacity = options.reg_scale = 10; /* more than the loss has to say */
    options.densify_start = 1;
    sf_scene *scene = scene_of(ctx, balls, 2, -1, NULL, NULL);
    sf_fitter *f = fitter_of(ctx, scene, balls, 2, &options);
    float *scale = f->model->params.field[SF_FIELD_log_scale], unseen = scale[sf_at(1, 3, 0)];
    for (int i = 0; i < 5; i++) assert_ok(ctx, sf_fitter_step(f));
    assert_true(opacity_of(f, 0) < 0.45);
    assert_true((double)scale[sf_at(0, 3, 0)] < log(0.29));
    assert_true(f->model->params.field[SF_FIELD_logit_opacity][1] == 0);
    assert_true(scale[sf_at(1, 3, 0)] == unseen);
    end(ctx, scene, f);
}

/* Whole runs. */

static uint8_t *fitted(int threads, const sf_fit_options *options, size_t *size) {
    const char *path = test_path("m.ply");
    sf_context *ctx = test_context_threads(threads);
    sf_scene *scene;
    sf_fitter *fitter;
    sf_model *model;
    assert_ok(ctx, sf_scene_load(ctx, "sim:studio?width=64&height=48&frames=9", NULL, &scene));
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, options, &fitter));
    for (sf_status status = SF_OK; !status;) {
        status = sf_fitter_step(fitter);
        if (status) assert_int_equal(status, SF_ERR_END);
        assert_true(fitter->model->count <= (size_t)options->max_gaussians);
    }
    assert_int_equal(fitter->model->count, options->max_gaussians);
    assert_ok(ctx, sf_fitter_snapshot(fitter, &model));
    assert_ok(ctx, sf_model_save(model, path));
    sf_model_destroy(&model);
    end(ctx, scene, fitter);
    return test_read(path, size);
}

static void test_same_bytes(void **state) {
    (void)state;
    for (int growth = SF_DENSIFY_ERROR; growth <= SF_DENSIFY_RELOCATE; growth++) {
        sf_fit_options options = options_of(growth);
        options.steps = getenv("SPLATFIT_QUICK") ? 16 : 40;
        options.max_gaussians = 150;
        options.init_random = 100;
        options.densify_every = 4;
        options.densify_per_step = 1e6;
        options.exposure = options.refine_poses = 1;
        options.reg_opacity = options.reg_scale = 0.01;
        size_t size, other;
        uint8_t *first = fitted(1, &options, &size);
        for (int threads = 2; threads <= 3; threads++) {
            uint8_t *again = fitted(threads, &options, &other);
            assert_int_equal(size, other);
            assert_memory_equal(first, again, size);
            free(again);
        }
        options.seed = 2;
        uint8_t *seeded = fitted(1, &options, &other);
        assert_false(size == other && !memcmp(first, seeded, size));
        free(seeded);
        free(first);
    }
}

/* Growth by a half is not seen: held-out views lose less than 0.1 dB, early and late. With the loss of a run
 * of 770 steps; with that of 200, which is all but squared, the third growth loses 0.11 to 0.14. */
static void test_growth_is_not_seen(void **state) {
    (void)state;
    int quick = getenv("SPLATFIT_QUICK") != NULL;
    sf_context *ctx = test_context();
    sf_scene *scene;
    assert_ok(ctx, sf_scene_load(ctx, "sim:studio?width=80&height=60&frames=16", NULL, &scene));
    sf_fit_options options = sf_fit_options_default();
    options.size = SF_SIZE_CAP;
    options.steps = 200;
    options.densify_every = 1000; /* grows when the test says so */
    options.max_gaussians = 100000;
    options.densify_per_step = 1e6;
    options.densify_rate = 0.5;
    options.huber_delta = 0.1;
    sf_fitter *f;
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &f));
    for (int growth = 0; growth < (quick ? 1 : 3); growth++) {
        for (int step = 0; step < 30; step++) assert_ok(ctx, sf_fitter_step(f));
        size_t count = f->model->count;
        double before = test_held_out(ctx, scene, f).psnr;
        sf_select_and_densify(f, sf_fraction(f));
        double after = test_held_out(ctx, scene, f).psnr;
        if (!(after > before - 0.1)) print_message("growth %d: %.2f to %.2f dB\n", growth, before, after);
        assert_true(after > before - 0.1);
        assert_true(f->model->count > count + 2 * count / 5);
    }
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* What a training camera is inside of is scored to go: in two standard deviations along its own axes; what
 * only comes near one stays, also where its longest axis would reach. The first camera is at (-4, 0, 0). */
static void test_veils_go(void **state) {
    (void)state;
    static const ball balls[] = {{{0, 0, 0}, 0.3f, 0.9f, 0.4f},    {{-3, 0, 0}, 0.6f, 0.05f, 0.9f},
                                 {{-3, 0, 0}, 0.45f, 0.05f, 0.9f}, {{-3, 0, 0}, 0.3f, 0.05f, 0.9f},
                                 {{-3, 0, 0}, 0.3f, 0.05f, 0.9f},  {{-3, 0, 0}, 0.3f, 0.05f, 0.9f},
                                 {{-3, 0, 0}, 0.3f, 0.05f, 0.9f},  {{-4, 0, 0.01f}, 0.02f, 0.9f, 0.9f}};
    enum { BALLS = sizeof balls / sizeof *balls };
    /* longest axes of balls 3 to 6, of which the last two are turned from x to y and back */
    static const int longest[] = {1, 0, 1, 0};
    static const int goes[BALLS] = {0, 1, 0, 0, 1, 1, 0, 0}; /* the last is too near to be drawn */
    sf_context *ctx = test_context();
    sf_fit_options options = options_of(SF_DENSIFY_GRADIENT);
    options.max_gaussians = BALLS;
    sf_scene *scene = scene_of(ctx, balls, 1, -1, NULL, NULL);
    sf_fitter *f = fitter_of(ctx, scene, balls, BALLS, &options);
    for (size_t k = 0; k < 4; k++) {
        *sf_value(&f->model->params, SF_FIELD_log_scale, 3 + k, longest[k]) = logf(0.9f);
        if (k >= 2) *sf_value(&f->model->params, SF_FIELD_quat, 3 + k, 3) = 1; /* a quarter about z */
    }
    assert_ok(ctx, sf_mark_floaters(f));
    for (size_t i = 0; i < BALLS; i++) assert_int_equal(f->densify.gradient_sum[i] < 0, goes[i]);

    /* where the camera stands is what the fit has learned of it */
    uint32_t *ids;
    size_t n;
    assert_ok(ctx, sf_scene_training_ids(scene, &ids, &n));
    assert_ok(ctx, sf_view_states_sync(&f->views, scene, ids, n));
    for (int k = 0; k < 3; k++) f->views.states[0].t_cw[k] *= 4;
    memset(f->densify.gradient_sum, 0, BALLS * sizeof *f->densify.gradient_sum);
    assert_ok(ctx, sf_mark_floaters(f));
    for (size_t i = 0; i < BALLS; i++) assert_false(f->densify.gradient_sum[i] < 0);
    sf_free(ctx, ids);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* What stands nearer to a training camera than 0.6 of where what it sees begins (here 3.8) is scored to go;
 * not what is beside the picture or behind the camera, and nothing where the camera sees too little to tell.
 */
static void test_what_stands_before_a_lens_goes(void **state) {
    (void)state;
    enum { PLACES = 5, MOST = 800, FEW = 80 };
    static const struct {
        float mean[3];
        int goes;
    } places[PLACES] = {
        {{-2, 0, 0}, 1}, {{-1.5f, 0, 0}, 0}, {{-2.6f, 0.3f, 0.2f}, 1}, {{-3, 1.5f, 0}, 0}, {{-5, 0, 0}, 0}};
    static ball balls[PLACES + MOST];
    sf_context *ctx = test_context();
    for (size_t i = 0; i < PLACES + MOST; i++) {
        balls[i] = (ball){{0, 0, 0}, 0.02f, 0.3f, 0.5f};
        for (size_t k = 0; k < 3; k++)
            balls[i].mean[k] = i < PLACES ? places[i].mean[k] : 0.2f * sinf((float)(7 * i + 31 * k * i));
    }
    static const size_t crowds[] = {MOST, FEW};
    for (size_t pass = 0; pass < 2; pass++) {
        size_t crowd = crowds[pass];
        sf_fit_options options = options_of(SF_DENSIFY_GRADIENT);
        options.max_gaussians = (uint32_t)(PLACES + crowd);
        sf_scene *scene = scene_of(ctx, balls, 1, -1, NULL, NULL);
        sf_fitter *f = fitter_of(ctx, scene, balls, PLACES + crowd, &options);
        assert_ok(ctx, sf_mark_floaters(f));
        for (size_t i = 0; i < PLACES + crowd; i++)
            assert_int_equal(f->densify.gradient_sum[i] < 0, crowd == MOST && i < PLACES && places[i].goes);
        sf_fitter_destroy(&f);
        sf_scene_destroy(&scene);
    }
    sf_context_destroy(&ctx);
}

/* Adam's moments of a value. */
typedef struct moment {
    float m, v;
} moment;

static moment moment_of(const sf_fitter *f, int field, size_t i, int c) {
    size_t at = sf_at(i, sf_field_components(field), c);
    const uint32_t *first = f->moments.part[0][field];
    if (f->moments.format == SF_MOMENTS_HALF)
        return (moment){sf_float_of(first[at] & 0xffff0000u), sf_float_of((first[at] & 0xffffu) << 15)};
    return (moment){sf_float_of(first[at]), ((const float *)f->moments.part[1][field])[at]};
}

/* Halves of a split have no direction, and a part of the squares of what they were: colours and opacity all,
 * shapes a tenth (16 bits keep 8 of a fraction). With none the first steps would be 1 / sqrt(1 - beta2) times
 * too long. The others' moments stay. */
static void check_newcomers(int format) {
    enum { MOST = 1000 }; /* few enough to keep their places */
    sf_context *ctx = test_context();
    sf_scene *scene;
    assert_ok(ctx, sf_scene_load(ctx, "sim:studio?width=64&height=48&frames=9", NULL, &scene));
    sf_fit_options options = sf_fit_options_default();
    options.steps = 40, options.densify_every = 1000, options.sh_degree = 0;
    options.max_gaussians = 700, options.densify_per_step = 1e6, options.densify_rate = 0.3;
    options.max_scale = 0.015; /* none is a veil */
    options.moments = format;
    sf_fitter *f;
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &f));
    f->options.max_gaussians = MOST;
    for (int step = 0; step < 10; step++) assert_ok(ctx, sf_fitter_step(f));
    static moment was[MOST][SF_FIELD_COUNT][4];
    size_t count = f->model->count, halves = 0;
    for (size_t i = 0; i < count; i++)
        for (int field = 0; field <= SF_FIELD_sh0; field++)
            for (int c = 0; c < sf_field_components(field); c++) was[i][field][c] = moment_of(f, field, i, c);
    sf_select_and_densify(f, sf_fraction(f));
    size_t grown = f->model->count - count;
    assert_true(grown > 100 && f->model->count <= MOST);
    for (size_t i = 0; i < count; i++) {
        int half = moment_of(f, SF_FIELD_sh0, i, 0).m == 0 && was[i][SF_FIELD_sh0][0].m != 0;
        halves += (size_t)half;
        for (int field = 0; field <= SF_FIELD_sh0; field++)
            for (int c = 0; c < sf_field_components(field); c++) {
                moment is = moment_of(f, field, i, c), old = was[i][field][c];
                double part = !half || field >= SF_FIELD_logit_opacity ? 1 : 0.1;
                assert_true(is.m == (half ? 0 : old.m));
                assert_true(fabs((double)is.v - part * (double)old.v) <= part * (double)old.v / 128);
            }
    }
    assert_int_equal(halves, grown);
    for (size_t j = count; j < f->model->count; j++) assert_true(moment_of(f, SF_FIELD_sh0, j, 0).m == 0);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}
static void test_newcomers_do_not_leap(void **state) {
    (void)state;
    check_newcomers(SF_MOMENTS_FLOAT);
    check_newcomers(SF_MOMENTS_HALF);
}

/* No axis grows beyond max_scale, and nothing is taken away for it. */
static void test_no_giants(void **state) {
    (void)state;
    enum { COUNT = 2 };
    static const ball truth[1] = {{{0, 0, 0}, 1, 0.9f, 0.9f}};
    static const ball first[COUNT] = {{{0, 0, 0}, 0.5f, 0.9f, 0.9f}, {{0.5f, 0, 0}, 2, 0.9f, 0.9f}};
    sf_context *ctx = test_context();
    sf_scene *scene = scene_of(ctx, truth, 1, -1, NULL, NULL);
    sf_model *from = model_of(ctx, first, COUNT);
    sf_scene_info info;
    sf_scene_get_info(scene, &info);
    sf_fit_options options = sf_fit_options_default();
    options.steps = 40;
    options.max_gaussians = COUNT;
    options.max_scale = 0.6 / info.extent;
    sf_fitter *f;
    assert_ok(ctx, sf_fitter_create(ctx, scene, from, &options, &f));
    assert_ok(ctx, sf_fitter_run(f, NULL, NULL));
    assert_int_equal(f->model->count, COUNT);
    float log_scales[3 * COUNT], most = -INFINITY;
    sf_model_get(f->model, 0, COUNT, &(sf_gaussians){.log_scales = log_scales});
    for (int k = 0; k < 3 * COUNT; k++) most = fmaxf(most, log_scales[k]);
    assert_true(most <= logf(0.6f) + 1e-5f);
    assert_true(most > logf(0.59f));
    sf_fitter_destroy(&f);
    sf_model_destroy(&from);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_clone_and_split),
        cmocka_unit_test(test_no_giants),
        cmocka_unit_test(test_growth_is_not_seen),
        cmocka_unit_test(test_newcomers_do_not_leap),
        cmocka_unit_test(test_veils_go),
        cmocka_unit_test(test_what_stands_before_a_lens_goes),
        cmocka_unit_test(test_error_of_several_views),
        cmocka_unit_test(test_masked_error),
        cmocka_unit_test(test_hidden),
        cmocka_unit_test(test_validation_is_not_looked_at),
        cmocka_unit_test(test_formula),
        cmocka_unit_test(test_picture_stays),
        cmocka_unit_test(test_dead_come_alive),
        cmocka_unit_test(test_none_live),
        cmocka_unit_test(test_noise),
        cmocka_unit_test(test_regularisers),
        cmocka_unit_test(test_same_bytes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
