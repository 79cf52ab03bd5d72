/* test_select.c - what Gaussians are worth, and models of no more of them than a scene needs. */
#include "testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fit/fitter.h"
#include "fit/select.h"
#include "fit/select_importance.h"
#include "fit/select_merge.h"
#include "fit/select_merge_candidates.h"
#include "fit/views.h"

enum { VIEWS = 8, WIDTH = 64, HEIGHT = 48, PIXELS = WIDTH * HEIGHT };

static sf_camera camera_of(int view) { return test_camera_around(view, VIEWS, WIDTH, HEIGHT); }

/* A Gaussian of one colour. */
typedef struct ball {
    float mean[3], scale[3], opacity, gray;
} ball;

static sf_model *model_of(sf_context *ctx, const ball *balls, size_t count, int sh_degree) {
    sf_model *model;
    assert_ok(ctx, sf_model_create(ctx, count, sh_degree, &model));
    for (size_t i = 0; i < count; i++) {
        const ball *b = &balls[i];
        float quat[4] = {1, 0, 0, 0}, log_scale[3], sh[48] = {0}, logit = logf(b->opacity / (1 - b->opacity));
        for (int k = 0; k < 3; k++) log_scale[k] = logf(b->scale[k]), sh[k] = (b->gray - 0.5f) / 0.28209479f;
        sf_gaussians from = {(float *)b->mean, quat, log_scale, &logit, sh};
        assert_int_equal(sf_model_set(model, i, 1, &from), SF_OK);
    }
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

/* Each view of a model so many times, one after another, the first `unmasked` of them with nothing masked and
 * the others altogether. */
static sf_scene *scene_of_many(sf_context *ctx, const sf_model *model, int times, int unmasked) {
    static float rgb[3 * PIXELS];
    static uint8_t bytes[3 * PIXELS], masked[PIXELS];
    sf_scene *scene;
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    for (int view = 0; view < VIEWS; view++) {
        sf_camera camera = camera_of(view);
        draw(ctx, model, view, rgb);
        for (int i = 0; i < 3 * PIXELS; i++) bytes[i] = (uint8_t)lrintf(255 * fminf(rgb[i], 1));
        for (int k = 0; k < times; k++) {
            sf_pixels pixels = {bytes, 3 * WIDTH, k < unmasked ? NULL : masked};
            assert_ok(ctx, sf_scene_add_view(scene, NULL, &camera, &pixels, SF_SPLIT_TRAIN, NULL));
        }
    }
    return scene;
}

/* All views of a model. */
static sf_scene *scene_of(sf_context *ctx, const sf_model *model) { return scene_of_many(ctx, model, 1, 1); }

static sf_fitter *fitter_of(sf_context *ctx, sf_scene *scene, const sf_model *model) {
    sf_fit_options options = sf_fit_options_default();
    sf_fitter *f;
    options.validate = 0;
    assert_ok(ctx, sf_fitter_create(ctx, scene, model, &options, &f));
    f->sh_degree = model->sh_degree;
    return f;
}

static const ball three[] = {{{0, 0, 0}, {0.3f, 0.3f, 0.3f}, 0.8f, 0.9f},
                             {{0.2f, 0.1f, 0.3f}, {0.2f, 0.4f, 0.2f}, 0.6f, 0.4f},
                             {{-0.8f, 0.3f, 0}, {0.1f, 0.1f, 0.2f}, 0.995f, 0.7f}};

/* Where tiles err as a whole each is as one value; where values err by chance, each by itself. How bright a
 * view is has no part in it. The fewer err together the more is grown, within bounds. */
static void test_errs_together(void **state) {
    (void)state;
    enum { E = 100, BY_CHANCE = 0, IN_PART, ALIKE };
    static uint8_t bytes[3 * PIXELS];
    for (int how = BY_CHANCE; how <= ALIKE; how++) {
        const double odds = (double[]){0.5, 0.715, 1}[how]; /* of a pixel to be as its tile is */
        sf_context *ctx = test_context();
        sf_scene *scene;
        sf_errors errors;
        sf_rng rng;
        ball faint = {{0, 0, 0}, {0.01f, 0.01f, 0.01f}, 0.001f, 0.5f}; /* below 1/255: nothing is drawn */
        sf_model *model = model_of(ctx, &faint, 1, 0);
        double expected = 0;
        sf_rng_seed(&rng, 1);
        assert_ok(ctx, sf_scene_create(ctx, &scene));
        for (int view = 0; view < VIEWS; view++) {
            sf_camera camera = camera_of(view);
            sf_pixels pixels = {bytes, 3 * WIDTH, NULL};
            double lit = 0;
            for (int px = 0; px < PIXELS; px++) {
                int tile = px % WIDTH / SF_TILE + px / WIDTH / SF_TILE;
                int is_lit = sf_rng_uniform(&rng) < (tile % 2 ? odds : 1 - odds);
                for (int ch = 0; ch < 3; ch++) bytes[3 * px + ch] = (uint8_t)(10 * view + (is_lit ? E : 0));
                lit += (double)is_lit / PIXELS;
            }
            expected += 3 * PIXELS * lit * (1 - lit) * pow(E / 255.0, 2); /* what a bias leaves */
            assert_ok(ctx, sf_scene_add_view(scene, NULL, &camera, &pixels, SF_SPLIT_TRAIN, NULL));
        }
        sf_fitter *f = fitter_of(ctx, scene, model);
        assert_ok(ctx, sf_measure_errors(f, 0, 0, &errors));
        assert_true(errors.squares > 1.9 * expected);
        assert_true(fabs(errors.corrected / expected - 1) < 1e-5);
        double together = sf_correlation_area(&errors);
        assert_ok(ctx, sf_select_growth(f, 1));
        if (how == ALIKE) {
            assert_true(fabs(together / (SF_TILE * SF_TILE) - 1) < 1e-4);
            assert_true(f->select.growth_scale == 1);
        } else if (how == IN_PART) {
            assert_true(together > 40 && together < 58);
            assert_true(fabs(f->select.growth_scale / pow(60 / together, 2) - 1) < 1e-9);
        } else {
            assert_true(fabs(together - 1) < 0.2);
            assert_true(f->select.growth_scale == 2.5);
        }
        sf_fitter_destroy(&f);
        sf_scene_destroy(&scene);
        sf_model_destroy(&model);
        sf_context_destroy(&ctx);
    }
}

/* A scene that gets more views has more to err about. Growth that made each value's error less has paid all
 * the same. */
static void test_growth_while_views_come(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    ball off[3];
    memcpy(off, three, sizeof off);
    off[0].gray = 0.3f;
    sf_model *truth = model_of(ctx, three, 3, 0), *model = model_of(ctx, off, 3, 0);
    sf_scene *scene = scene_of(ctx, truth);
    sf_fitter *f = fitter_of(ctx, scene, model);
    static float rgb[3 * PIXELS];
    static uint8_t bytes[3 * PIXELS];
    assert_ok(ctx, sf_select_growth(f, 1));
    double least = f->select.min_error;
    assert_true(least > 0);
    for (int view = 0; view < VIEWS; view++) { /* each once more */
        sf_camera camera = camera_of(view);
        sf_pixels pixels = {bytes, 3 * WIDTH, NULL};
        draw(ctx, truth, view, rgb);
        for (int i = 0; i < 3 * PIXELS; i++) bytes[i] = (uint8_t)lrintf(255 * fminf(rgb[i], 1));
        assert_ok(ctx, sf_scene_add_view(scene, NULL, &camera, &pixels, SF_SPLIT_TRAIN, NULL));
    }
    assert_ok(ctx, sf_select_growth(f, 1)); /* the same model, the same error */
    assert_int_equal(f->select.vain_growths, 1);
    for (int k = 0; k < 3; k++) *sf_value(&f->model->params, SF_FIELD_sh0, 0, k) = -0.35f; /* gray 0.4 */
    assert_ok(ctx, sf_select_growth(f, 1));
    assert_int_equal(f->select.vain_growths, 0);
    assert_true(f->select.min_error < 0.95 * least);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_model_destroy(&truth);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* A view that is brighter than the model has it, and less steep, errs; but not by what Gaussians are there
 * for. */
static void test_tone_is_no_error(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_model *model = model_of(ctx, three, 3, 0);
    sf_scene *scene;
    static float rgb[3 * PIXELS];
    static uint8_t bytes[3 * PIXELS];
    sf_errors errors;
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    for (int view = 0; view < VIEWS; view++) {
        sf_camera camera = camera_of(view);
        sf_pixels pixels = {bytes, 3 * WIDTH, NULL};
        draw(ctx, model, view, rgb);
        for (int i = 0; i < 3 * PIXELS; i++)
            bytes[i] = (uint8_t)(255 * (0.7 * fmin((double)rgb[i], 1) + 0.05 * (1 + i % 3)) + 0.5);
        assert_ok(ctx, sf_scene_add_view(scene, NULL, &camera, &pixels, SF_SPLIT_TRAIN, NULL));
    }
    sf_fitter *f = fitter_of(ctx, scene, model);
    assert_ok(ctx, sf_measure_errors(f, 0, 0, &errors));
    assert_true(errors.squares > 0.005 * errors.values);
    assert_true(errors.corrected <
                2 / 12.0 / (255 * 255) * errors.values); /* rounding: a twelfth of a level's square */
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* Squared error of a model, but for Gaussian `without` (-1: none), against the views of the scene: by hand.
 */
static double squares_without(sf_context *ctx, sf_scene *scene, const ball *balls, size_t n, int without,
                              double gain, double bias) {
    static float rgb[3 * PIXELS];
    ball left[8];
    size_t count = 0;
    double squares = 0;
    for (size_t i = 0; i < n; i++)
        if ((int)i != without) left[count++] = balls[i];
    sf_model *model = model_of(ctx, left, count, 0);
    uint32_t *ids;
    size_t views;
    assert_ok(ctx, sf_scene_training_ids(scene, &ids, &views));
    for (size_t v = 0; v < views; v++) {
        sf_view *view = sf_scene_retain_id(scene, ids[v]);
        draw(ctx, model, (int)v, rgb);
        for (int px = 0; px < PIXELS; px++)
            for (int ch = 0; ch < 3; ch++) {
                double y = (1 + (gain - 1) * (1 - ch)) * (double)rgb[3 * px + ch] + bias * (1 - ch);
                double r = y - view->rgb[ch * PIXELS + px] / 255.0;
                squares += r * r;
            }
        sf_view_release(view);
    }
    sf_free(ctx, ids);
    sf_model_destroy(&model);
    return squares;
}

/* All views get a gain and a bias: less red, as much green, more blue. */
static void expose(sf_context *ctx, sf_fitter *f, double by, double bias) {
    uint32_t *ids;
    size_t n;
    const double gain[3] = {by, 1, 2 - by}, offset[3] = {bias, 0, -bias};
    f->options.exposure = 1;
    assert_ok(ctx, sf_scene_training_ids(f->scene, &ids, &n));
    assert_ok(ctx, sf_view_states_sync(&f->views, f->scene, ids, n));
    for (size_t i = 0; i < n; i++) assert_ok(ctx, sf_fitter_set_exposure(f, ids[i], gain, offset));
    sf_free(ctx, ids);
}

/* What taking one out would add is known to the digits of the sum, before it is done; of exposed pictures
 * too, which Gaussians have a part in by the gain, and no part in by the bias. */
static void worth_is_what_is_lost(double gain, double bias) {
    sf_context *ctx = test_context();
    ball off[3];
    memcpy(off, three, sizeof off);
    off[1].gray = 0.6f, off[2].scale[0] = 0.15f; /* the model is not the one of the pictures */
    sf_model *truth = model_of(ctx, three, 3, 0), *model = model_of(ctx, off, 3, 0);
    sf_scene *scene = scene_of(ctx, truth);
    sf_fitter *f = fitter_of(ctx, scene, model);
    sf_importance w;
    if (gain != 1) expose(ctx, f, gain, bias);
    assert_ok(ctx, sf_measure_importance(f, 0, &w));
    double before = squares_without(ctx, scene, off, 3, -1, gain, bias);
    assert_int_equal(w.views, VIEWS);
    assert_true(fabs(w.errors.values - 3.0 * VIEWS * PIXELS) < 1e-6);
    assert_true(fabs(w.errors.squares / before - 1) < 1e-4);
    for (int i = 0; i < 3; i++) {
        double added = squares_without(ctx, scene, off, 3, i, gain, bias) - before;
        /* faint pairs that come or go at alpha 1/255, and pixels that were finished, are all that differs */
        if (fabs((double)w.sse_change[i] / added - 1) > 0.01)
            print_message("%d: %g, not %g\n", i, (double)w.sse_change[i], added);
        assert_true(fabs((double)w.sse_change[i] / added - 1) < 0.01);
        assert_true(w.score[i] > 0 && w.error_share[i] >= 0);
    }
    sf_importance some;
    assert_ok(ctx, sf_measure_importance(f, VIEWS / 2, &some));
    assert_int_equal(some.views, VIEWS / 2);
    assert_true(fabs(some.errors.values / w.errors.values - 1) < 1e-9);
    assert_true(some.errors.squares > 0.3 * w.errors.squares && some.errors.squares < 3 * w.errors.squares);
    some.blend_weight[1] = w.blend_weight[1] = 0; /* as if nobody had looked where it is */
    assert_true(sf_importance_is_known(&some, 0) && sf_importance_is_known(&w, 0));
    assert_true(!sf_importance_is_known(&some, 1) && sf_importance_is_known(&w, 1));
    sf_importance_free(ctx, &some);
    sf_importance_free(ctx, &w);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_model_destroy(&truth);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

static void test_worth_is_what_is_lost(void **state) {
    (void)state;
    worth_is_what_is_lost(1, 0);
}
static void test_worth_of_exposed_views(void **state) {
    (void)state;
    worth_is_what_is_lost(0.8, 0.1);
}

/* Exposed half as bright in one channel, bands of that one have a quarter of the effect. */
static void test_bands_of_exposed_views(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_model *model = model_of(ctx, three, 3, 1);
    for (size_t i = 0; i < 3; i++) *sf_value(&model->params, SF_FIELD_sh0 + 1, i, 0) = 0.3f; /* red */
    sf_scene *scene = scene_of(ctx, model);
    sf_fitter *f = fitter_of(ctx, scene, model);
    sf_importance plain, exposed;
    assert_ok(ctx, sf_measure_importance(f, 0, &plain));
    expose(ctx, f, 0.5, 0.1);
    assert_ok(ctx, sf_measure_importance(f, 0, &exposed));
    for (size_t i = 0; i < 3; i++) {
        assert_true(plain.bands[i][0] > 0);
        assert_true(fabsf(exposed.bands[i][0] / plain.bands[i][0] - 0.25f) < 1e-5f);
        assert_true(fabsf(exposed.blend_weight[i] / plain.blend_weight[i] - 1) < 1e-5f);
    }
    sf_importance_free(ctx, &plain);
    sf_importance_free(ctx, &exposed);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* Sums over a part of the views stand for all, those of bands too. */
static void test_weighed_by_some(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_model *model = model_of(ctx, three, 3, 1);
    sf_scene *scene = scene_of(ctx, model);
    sf_fitter *f = fitter_of(ctx, scene, model);
    sf_importance all, some;
    f->sh_degree = 1;
    for (size_t i = 0; i < 3; i++) *sf_value(&f->model->params, SF_FIELD_sh0 + 1, i, 1) = 0.3f;
    assert_ok(ctx, sf_measure_importance(f, 0, &all));
    assert_ok(ctx, sf_measure_importance(f, VIEWS / 2, &some));
    assert_int_equal(some.tile_count, all.tile_count / 2);
    for (size_t i = 0; i < 3; i++) {
        assert_true(some.score[i] > 0.5f * all.score[i] && some.score[i] < 2 * all.score[i]);
        assert_true(some.bands[i][0] > 0.5f * all.bands[i][0] && some.bands[i][0] < 2 * all.bands[i][0]);
        assert_true(all.bands[i][0] > 0);
    }
    sf_importance_free(ctx, &some);
    sf_importance_free(ctx, &all);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* Views that are masked altogether have no part in any sum, whichever they are. */
static void test_masked_views_do_not_count(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    ball off[3];
    memcpy(off, three, sizeof off);
    off[1].gray = 0.6f;
    sf_model *truth = model_of(ctx, three, 3, 0), *model = model_of(ctx, off, 3, 0);
    sf_scene *scenes[] = {scene_of(ctx, truth), scene_of_many(ctx, truth, 2, 1)};
    sf_importance w[2];
    for (int half_masked = 0; half_masked < 2; half_masked++) {
        sf_fitter *f = fitter_of(ctx, scenes[half_masked], model);
        assert_ok(ctx, sf_measure_importance(f, VIEWS / 2, &w[half_masked]));
        sf_fitter_destroy(&f);
    }
    assert_int_equal(w[1].views, VIEWS / 2);
    assert_true(fabs(w[1].errors.values - 3.0 * VIEWS * PIXELS) < 1e-6);
    assert_true(w[1].errors.squares > 0 && w[1].errors.squares == w[0].errors.squares);
    assert_memory_equal(w[1].score, w[0].score, 3 * sizeof *w->score);
    for (int k = 0; k < 2; k++) {
        sf_importance_free(ctx, &w[k]);
        sf_scene_destroy(&scenes[k]);
    }
    sf_model_destroy(&truth);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* Of each view twice one will do to judge a trial by: what the pair is blamed for is the same. */
static void test_trial_judged_by_some(void **state) {
    (void)state;
    enum { ALL = 2 * VIEWS };
    sf_context *ctx = test_context();
    ball twins[3] = {three[0], three[0], three[2]};
    for (int i = 0; i < 2; i++) twins[i].opacity = 1 - sqrtf(1 - three[0].opacity);
    twins[0].mean[0] = -0.2f, twins[1].mean[0] = 0.2f, twins[1].gray = 0.2f;
    sf_model *model = model_of(ctx, twins, 3, 0);
    sf_scene *scene = scene_of_many(ctx, model, 2, 2);
    sf_attributed_error blame[2];
    for (int some = 0; some < 2; some++) {
        sf_fitter *f = fitter_of(ctx, scene, model);
        sf_importance w;
        assert_ok(ctx, sf_measure_importance(f, some ? VIEWS : ALL, &w));
        w.score[2] = INFINITY;
        f->options.merge = 1;
        assert_ok(ctx, sf_merges_begin(f, &w));
        sf_importance_free(ctx, &w);
        assert_int_equal(f->merges.count, 1);
        assert_ok(ctx, sf_measure_importance(f, some ? VIEWS : ALL, &w));
        blame[some] = w.attributed[f->merges.list[0].leader];
        sf_importance_free(ctx, &w);
        sf_fitter_destroy(&f);
    }
    assert_true(blame[0].now > blame[0].before);
    assert_true(fabsf(blame[1].now / blame[0].now - 1) < 1e-5f);
    assert_true(fabsf(blame[1].before / blame[0].before - 1) < 1e-5f);
    assert_true(fabsf(blame[1].values / blame[0].values - 1) < 1e-5f);
    sf_scene_destroy(&scene);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* The useless go, more than half of all where that changes nothing, and those that make the picture stay. */
static void test_price(void **state) {
    (void)state;
    enum { USELESS = 9, ALL = 3 + USELESS };
    sf_context *ctx = test_context();
    ball balls[ALL];
    memcpy(balls, three, sizeof three);
    for (int i = 0; i < USELESS; i++) /* black, on black */
        balls[3 + i] = (ball){{0.9f, 0.1f * (float)i - 0.5f, 0.8f}, {0.05f, 0.05f, 0.05f}, 0.3f, 0};
    sf_model *truth = model_of(ctx, three, 3, 0), *model = model_of(ctx, balls, ALL, 0);
    sf_scene *scene = scene_of(ctx, truth);
    sf_fitter *f = fitter_of(ctx, scene, model);
    sf_importance w;
    uint8_t degrees[ALL] = {0};
    assert_ok(ctx, sf_select_mark(f, 0.7, &w, degrees));
    sf_importance_free(ctx, &w);
    int going = 0;
    for (int i = 0; i < ALL; i++) {
        if (i < 3) assert_true(!(f->densify.gradient_sum[i] < 0));
        going += f->densify.gradient_sum[i] < 0;
    }
    assert_int_equal(going, USELESS);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_model_destroy(&truth);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* What goes at once is judged by 16 views. With more of the same in the scene it is the same that goes. */
static void test_what_goes_at_once(void **state) {
    (void)state;
    enum { FAINT = 24, ALL = 2 * FAINT + 1 };
    static const int times[] = {2, 16}; /* 16 views and 128 */
    int going[2] = {0};
    ball balls[ALL];
    for (int i = 0; i < ALL; i++) {
        float x = 0.3f * (float)(i % 6) - 0.75f, y = 0.4f * (float)(i / 6 % 4) - 0.6f;
        balls[i] = (ball){{x, y, 0}, {0.06f, 0.06f, 0.06f}, i < FAINT ? 0.1f : 0.001f, 0.9f};
    }
    for (int many = 0; many < 2; many++) {
        sf_context *ctx = test_context();
        sf_model *model = model_of(ctx, balls, ALL, 0);
        sf_scene *scene = scene_of_many(ctx, model, times[many], times[many]);
        sf_fitter *f = fitter_of(ctx, scene, model);
        sf_importance w;
        uint8_t degrees[ALL] = {0};
        double all = 0;
        assert_ok(ctx, sf_measure_importance(f, 0, &w));
        for (int i = 0; i < FAINT; i++) all += (double)w.score[i];
        double part = all / w.errors.values / pow(2.25 / 255, 2); /* of what nobody sees */
        if (part < 0.8 || part > 3) print_message("all of them: %g\n", part);
        assert_true(part > 0.8 && part < 3);
        sf_importance_free(ctx, &w);
        f->options.quality = 1e-5;                                         /* none is worth its price */
        for (int i = FAINT; i < ALL; i++) f->densify.gradient_sum[i] = -1; /* and those are going already */
        assert_ok(ctx, sf_select_mark(f, 0.7, &w, degrees));
        for (int i = 0; i < FAINT; i++) going[many] += f->densify.gradient_sum[i] < 0;
        sf_importance_free(ctx, &w);
        sf_fitter_destroy(&f);
        sf_scene_destroy(&scene);
        sf_model_destroy(&model);
        sf_context_destroy(&ctx);
    }
    if (going[0] != going[1]) print_message("%d of 16 views, %d of 128\n", going[0], going[1]);
    assert_true(going[0] > 0 && going[0] < FAINT);
    assert_int_equal(going[0], going[1]);
}

/* A Gaussian cut in two along its longest axis becomes what it was; one that stands apart stays. */
static void test_merge(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    const float half = 0.15f; /* variances: 0.2^2 + half^2 = 0.25^2 */
    ball parts[3] = {{{half, 0, 0}, {0.2f, 0.1f, 0.1f}, 0.5f, 0.6f},
                     {{-half, 0, 0}, {0.2f, 0.1f, 0.1f}, 0.5f, 0.6f},
                     {{0, 0, 1}, {0.1f, 0.1f, 0.1f}, 0.8f, 0.6f}};
    sf_model *model = model_of(ctx, parts, 3, 1);
    sf_scene *scene = scene_of(ctx, model);
    sf_fitter *f = fitter_of(ctx, scene, model);
    const float effect[] = {1, 1, 1}, untouched[] = {1, INFINITY, 1};
    sf_merge_candidate *pairs;
    size_t n;
    assert_ok(ctx, sf_find_merge_candidates(f, 1e-6, effect, &pairs, &n)); /* less than the two are off */
    assert_int_equal(n, 0);
    sf_free(ctx, pairs);
    assert_ok(ctx, sf_find_merge_candidates(f, 0.2, untouched, &pairs, &n));
    assert_int_equal(n, 0);
    sf_free(ctx, pairs);
    assert_ok(ctx, sf_find_merge_candidates(f, 0.2, effect, &pairs, &n));
    assert_int_equal(n, 1);
    assert_true(pairs[0].a + pairs[0].b == 1 && pairs[0].rise > 0);
    sf_apply_merge(f, &pairs[0]);
    size_t left = pairs[0].a;
    sf_free(ctx, pairs);
    float mean[3], log_scale[3], logit;
    sf_gaussians to = {.means = mean, .log_scales = log_scale, .logit_opacities = &logit};
    assert_int_equal(sf_model_get(f->model, left, 1, &to), SF_OK);
    float longest = fmaxf(log_scale[0], fmaxf(log_scale[1], log_scale[2]));
    for (int k = 0; k < 3; k++) assert_true(fabsf(mean[k]) < 1e-6f);
    assert_true(fabsf(expf(longest) - 0.25f) < 1e-4f);
    assert_true(fabsf(log_scale[0] + log_scale[1] + log_scale[2] - logf(0.25f * 0.1f * 0.1f)) < 1e-3f);
    /* the mass of both: 2 x 0.5 x (0.2 x 0.1 x 0.1)^(2/3) = o (0.25 x 0.1 x 0.1)^(2/3), and not above 0.75 */
    double opacity = 1 / (1 + exp(-(double)logit));
    assert_true(fabs(opacity - fmin(0.75, pow(0.2 / 0.25, 2.0 / 3))) < 1e-3);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* The model's values, all of them. */
static void values_of(const sf_model *m, float *values) {
    sf_gaussians to = {values, values + 30, values + 70, values + 100, values + 110};
    assert_int_equal(sf_model_get(m, 0, m->count, &to), SF_OK);
}

/* Of two that are one and one beside others, and of two that are not: the trial of the first succeeds, that
 * of all does not, and leaves everything as it was; so does one that cannot be judged, for a view has gone.
 */
static void trial(float other_gray, int succeeds, int view_goes) {
    enum { VALUES = 300 };
    sf_context *ctx = test_context();
    ball twins[3] = {three[0], three[0], three[2]}, one[2] = {three[0], three[2]};
    for (int i = 0; i < 2; i++) twins[i].opacity = 1 - sqrtf(1 - three[0].opacity);
    if (!succeeds) { /* they lie beside each other, of two colours, as in the pictures */
        twins[0].mean[0] = -0.2f, twins[1].mean[0] = 0.2f;
        twins[1].gray = other_gray;
    }
    sf_model *truth = succeeds ? model_of(ctx, one, 2, 0) : model_of(ctx, twins, 3, 0),
             *model = model_of(ctx, twins, 3, 0), *seen;
    sf_scene *scene = scene_of(ctx, truth);
    sf_fitter *f = fitter_of(ctx, scene, model);
    float before[VALUES] = {0}, during[VALUES] = {0}, after[VALUES] = {0};
    sf_importance w;
    values_of(f->model, before);
    assert_ok(ctx, sf_measure_importance(f, 0, &w));
    const float most[] = {w.score[0], w.score[1], INFINITY};
    memcpy(w.score, most, sizeof most);
    f->options.merge = 1;
    assert_ok(ctx, sf_merges_begin(f, &w));
    sf_importance_free(ctx, &w);
    assert_int_equal(f->merges.count, 1);
    values_of(f->model, during);
    assert_true(memcmp(before, during, sizeof before) != 0);
    assert_ok(ctx, sf_fitter_snapshot(f, &seen));
    values_of(seen, after);
    assert_memory_equal(before, after, sizeof before); /* a trial is not to be seen */
    sf_model_destroy(&seen);

    if (view_goes) {
        uint32_t *ids;
        size_t n;
        assert_ok(ctx, sf_scene_training_ids(scene, &ids, &n));
        assert_ok(ctx, sf_scene_remove_view(scene, ids[n - 1]));
        sf_free(ctx, ids);
    }
    assert_ok(ctx, sf_measure_importance(f, 0, &w));
    if (view_goes) assert_true(w.score[0] < 1e-6f || w.score[1] < 1e-6f); /* one was hidden */
    sf_merges_decide(f, &w, 0.1, 0);
    assert_int_equal(f->merges.count, 0);
    values_of(f->model, after);
    int going = 0;
    for (int i = 0; i < 3; i++) going += f->densify.gradient_sum[i] < 0;
    assert_int_equal(going, succeeds);
    assert_int_equal(f->merges.in_vain, !succeeds && !view_goes);
    assert_memory_equal(succeeds ? during : before, after, sizeof before);
    assert_true(succeeds || (isinf(w.score[0]) && isinf(w.score[1])));
    sf_importance_free(ctx, &w);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_model_destroy(&truth);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}
static void test_trial_succeeds(void **state) {
    (void)state;
    trial(0, 1, 0);
}
static void test_trial_fails(void **state) {
    (void)state;
    trial(0.2f, 0, 0);
}
static void test_trial_without_its_views(void **state) {
    (void)state;
    trial(0.2f, 0, 1);
}

/* From random first points, a fit that is charged has fewer Gaussians than one that is not, at nearly the
 * same quality. */
static void test_a_fit_pays(void **state) {
    (void)state;
    if (getenv("SPLATFIT_QUICK")) test_skip("SPLATFIT_QUICK is set");
    sf_context *ctx = test_context();
    sf_model *truth = model_of(ctx, three, 3, 0);
    sf_scene *scene = scene_of(ctx, truth);
    size_t count[2];
    double squares[2];
    for (int size = SF_SIZE_AUTO; size <= SF_SIZE_CAP; size++) {
        sf_fit_options options = sf_fit_options_default();
        sf_fitter *f;
        sf_importance w;
        options.steps = 600;
        options.plan_steps = 1000;
        options.densify_every = 20;
        options.sh_degree = 0;
        options.init = SF_INIT_RANDOM;
        options.init_random = options.max_gaussians = 1000;
        options.size = size;
        assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &f));
        assert_ok(ctx, sf_fitter_run(f, NULL, NULL));
        assert_ok(ctx, sf_measure_importance(f, 0, &w));
        count[size] = w.count, squares[size] = w.errors.squares / w.errors.values;
        sf_importance_free(ctx, &w);
        sf_fitter_destroy(&f);
    }
    if (count[0] > count[1] / 4 || !(squares[0] < 1e-4))
        print_message("%zu of %zu Gaussians, squares %g and %g\n", count[0], count[1], squares[0],
                      squares[1]);
    assert_true(count[0] >= 3 && count[0] <= count[1] / 4);
    assert_true(squares[0] < 1e-4); /* 40 dB */
    sf_scene_destroy(&scene);
    sf_model_destroy(&truth);
    sf_context_destroy(&ctx);
}

/* A fit that is saved while pairs are on trial goes on to the same bytes. */
static void test_trial_goes_on(void **state) {
    (void)state;
    if (getenv("SPLATFIT_QUICK")) test_skip("SPLATFIT_QUICK is set");
    sf_context *ctx = test_context();
    sf_model *truth = model_of(ctx, three, 3, 0), *ends[2];
    sf_scene *scene = scene_of(ctx, truth);
    sf_fit_options options = sf_fit_options_default();
    sf_fitter *fitters[2];
    options.steps = options.plan_steps = 1000;
    options.init = SF_INIT_RANDOM;
    options.init_random = 200;
    options.sh_degree = 1;
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &fitters[0]));
    while (fitters[0]->step < 800 && !fitters[0]->merges.count) assert_ok(ctx, sf_fitter_step(fitters[0]));
    for (int k = 0; k < 10; k++) assert_ok(ctx, sf_fitter_step(fitters[0]));
    assert_true(fitters[0]->merges.count > 0);
    assert_ok(ctx, sf_fitter_save(fitters[0], test_path("trial")));
    assert_ok(ctx, sf_fitter_load(ctx, scene, test_path("trial"), NULL, &fitters[1]));
    assert_int_equal(fitters[1]->merges.count, fitters[0]->merges.count);
    for (int i = 0; i < 2; i++) {
        for (int k = 0; k < 120; k++) assert_ok(ctx, sf_fitter_step(fitters[i]));
        assert_ok(ctx, sf_fitter_snapshot(fitters[i], &ends[i]));
        sf_fitter_destroy(&fitters[i]);
    }
    assert_int_equal(ends[0]->count, ends[1]->count);
    for (int field = 0; field <= SF_FIELD_sh1; field++)
        assert_memory_equal(ends[0]->params.field[field], ends[1]->params.field[field],
                            sf_field_values(field, ends[0]->banded[sf_field_band(field)]) * sizeof(float));
    for (int i = 0; i < 2; i++) sf_model_destroy(&ends[i]);
    sf_scene_destroy(&scene);
    sf_model_destroy(&truth);
    sf_context_destroy(&ctx);
}

/* While steps to come make up for what goes, and once before the end. */
static void test_charges_end_early(void **state) {
    (void)state;
    enum { STEPS = 3000 };
    sf_context *ctx = test_context();
    sf_model *model = model_of(ctx, three, 3, 0);
    sf_scene *scene = scene_of(ctx, model);
    sf_fitter *f = fitter_of(ctx, scene, model);
    int due = 0, last = 0, late = 0;
    f->options.steps = f->options.plan_steps = STEPS;
    f->options.merge = 0;
    for (f->step = 1; f->step <= STEPS; f->step++) {
        double fraction = (double)(f->step - 1) / STEPS;
        if (!sf_selection_is_due(f, fraction)) continue;
        assert_true(f->step % f->options.densify_every == 0 && fraction > 0.55);
        due++;
        last = late, late = (int)f->step;
    }
    assert_int_equal(late, STEPS - f->options.densify_every);
    assert_true(due > 3 && last > 0.8 * STEPS && last < 0.9 * STEPS);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

/* Bands that change no picture are not paid for, and go one with each charge; those that the pictures show
 * stay. */
static void test_degrees_are_paid_for(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_model *truth = model_of(ctx, three, 3, 3);
    sf_params *p = &truth->params;
    for (int k = 0; k < sf_field_components(SF_FIELD_sh1); k++) *sf_value(p, SF_FIELD_sh1, 1, k) = 0.3f;
    *sf_value(p, SF_FIELD_sh2, 2, 0) = 1e-6f;
    sf_scene *scene = scene_of(ctx, truth);
    sf_fitter *f = fitter_of(ctx, scene, truth);
    static const uint8_t left[][3] = {{2, 2, 1}, {1, 1, 0}, {0, 1, 0}, {0, 1, 0}};
    uint8_t degrees[3] = {3, 3, 2};
    for (size_t k = 0; k < sizeof left / sizeof *left; k++) {
        sf_importance w;
        assert_ok(ctx, sf_select_mark(f, 0.7, &w, degrees));
        assert_true(w.bands[1][0] > 0 && w.bands[1][1] == 0 && w.bands[0][0] == 0 && w.bands[2][1] > 0);
        assert_memory_equal(degrees, left[k], sizeof degrees);
        sf_importance_free(ctx, &w);
    }
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    sf_model_destroy(&truth);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_worth_is_what_is_lost),
        cmocka_unit_test(test_worth_of_exposed_views),
        cmocka_unit_test(test_bands_of_exposed_views),
        cmocka_unit_test(test_weighed_by_some),
        cmocka_unit_test(test_price),
        cmocka_unit_test(test_masked_views_do_not_count),
        cmocka_unit_test(test_trial_judged_by_some),
        cmocka_unit_test(test_what_goes_at_once),
        cmocka_unit_test(test_merge),
        cmocka_unit_test(test_trial_succeeds),
        cmocka_unit_test(test_trial_fails),
        cmocka_unit_test(test_trial_without_its_views),
        cmocka_unit_test(test_errs_together),
        cmocka_unit_test(test_tone_is_no_error),
        cmocka_unit_test(test_growth_while_views_come),
        cmocka_unit_test(test_charges_end_early),
        cmocka_unit_test(test_degrees_are_paid_for),
        cmocka_unit_test(test_trial_goes_on),
        cmocka_unit_test(test_a_fit_pays),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
