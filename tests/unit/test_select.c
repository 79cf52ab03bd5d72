/* test_select.c - importance of Gaussians, and pruning by it. */
#include "select_fixture.h"

#include <math.h>
#include <string.h>

#include "fit/fitter.h"
#include "fit/select.h"
#include "fit/select_importance.h"
#include "fit/select_merge.h"
#include "fit/views.h"

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
        sf_model *model = select_model_of(ctx, &faint, 1, 0);
        double expected = 0;
        sf_rng_seed(&rng, 1);
        assert_ok(ctx, sf_scene_create(ctx, &scene));
        for (int view = 0; view < VIEWS; view++) {
            sf_camera camera = select_camera_of(view);
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
        sf_fitter *f = select_fitter_of(ctx, scene, model);
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
    memcpy(off, select_three, sizeof off);
    off[0].gray = 0.3f;
    sf_model *truth = select_model_of(ctx, select_three, 3, 0), *model = select_model_of(ctx, off, 3, 0);
    sf_scene *scene = select_scene_of(ctx, truth);
    sf_fitter *f = select_fitter_of(ctx, scene, model);
    static float rgb[3 * PIXELS];
    static uint8_t bytes[3 * PIXELS];
    assert_ok(ctx, sf_select_growth(f, 1));
    double least = f->select.min_error;
    assert_true(least > 0);
    for (int view = 0; view < VIEWS; view++) { /* each once more */
        sf_camera camera = select_camera_of(view);
        sf_pixels pixels = {bytes, 3 * WIDTH, NULL};
        test_draw(ctx, truth, &camera, rgb);
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
    sf_model *model = select_model_of(ctx, select_three, 3, 0);
    sf_scene *scene;
    static float rgb[3 * PIXELS];
    static uint8_t bytes[3 * PIXELS];
    sf_errors errors;
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    for (int view = 0; view < VIEWS; view++) {
        sf_camera camera = select_camera_of(view);
        sf_pixels pixels = {bytes, 3 * WIDTH, NULL};
        test_draw(ctx, model, &camera, rgb);
        for (int i = 0; i < 3 * PIXELS; i++)
            bytes[i] = (uint8_t)(255 * (0.7 * fmin((double)rgb[i], 1) + 0.05 * (1 + i % 3)) + 0.5);
        assert_ok(ctx, sf_scene_add_view(scene, NULL, &camera, &pixels, SF_SPLIT_TRAIN, NULL));
    }
    sf_fitter *f = select_fitter_of(ctx, scene, model);
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
    sf_model *model = select_model_of(ctx, left, count, 0);
    uint32_t *ids;
    size_t views;
    assert_ok(ctx, sf_scene_training_ids(scene, &ids, &views));
    for (size_t v = 0; v < views; v++) {
        sf_view *view = sf_scene_retain_id(scene, ids[v]);
        test_draw(ctx, model, &view->camera, rgb);
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
    memcpy(off, select_three, sizeof off);
    off[1].gray = 0.6f, off[2].scale[0] = 0.15f; /* the model is not the one of the pictures */
    sf_model *truth = select_model_of(ctx, select_three, 3, 0), *model = select_model_of(ctx, off, 3, 0);
    sf_scene *scene = select_scene_of(ctx, truth);
    sf_fitter *f = select_fitter_of(ctx, scene, model);
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
    sf_model *model = select_model_of(ctx, select_three, 3, 1);
    for (size_t i = 0; i < 3; i++) *sf_value(&model->params, SF_FIELD_sh0 + 1, i, 0) = 0.3f; /* red */
    sf_scene *scene = select_scene_of(ctx, model);
    sf_fitter *f = select_fitter_of(ctx, scene, model);
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
    sf_model *model = select_model_of(ctx, select_three, 3, 1);
    sf_scene *scene = select_scene_of(ctx, model);
    sf_fitter *f = select_fitter_of(ctx, scene, model);
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
    memcpy(off, select_three, sizeof off);
    off[1].gray = 0.6f;
    sf_model *truth = select_model_of(ctx, select_three, 3, 0), *model = select_model_of(ctx, off, 3, 0);
    sf_scene *scenes[] = {select_scene_of(ctx, truth), select_scene_of_many(ctx, truth, 2, 1)};
    sf_importance w[2];
    for (int half_masked = 0; half_masked < 2; half_masked++) {
        sf_fitter *f = select_fitter_of(ctx, scenes[half_masked], model);
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
    ball twins[3] = {select_three[0], select_three[0], select_three[2]};
    for (int i = 0; i < 2; i++) twins[i].opacity = 1 - sqrtf(1 - select_three[0].opacity);
    twins[0].mean[0] = -0.2f, twins[1].mean[0] = 0.2f, twins[1].gray = 0.2f;
    sf_model *model = select_model_of(ctx, twins, 3, 0);
    sf_scene *scene = select_scene_of_many(ctx, model, 2, 2);
    sf_attributed_error blame[2];
    for (int some = 0; some < 2; some++) {
        sf_fitter *f = select_fitter_of(ctx, scene, model);
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
    memcpy(balls, select_three, sizeof select_three);
    for (int i = 0; i < USELESS; i++) /* black, on black */
        balls[3 + i] = (ball){{0.9f, 0.1f * (float)i - 0.5f, 0.8f}, {0.05f, 0.05f, 0.05f}, 0.3f, 0};
    sf_model *truth = select_model_of(ctx, select_three, 3, 0), *model = select_model_of(ctx, balls, ALL, 0);
    sf_scene *scene = select_scene_of(ctx, truth);
    sf_fitter *f = select_fitter_of(ctx, scene, model);
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
        sf_model *model = select_model_of(ctx, balls, ALL, 0);
        sf_scene *scene = select_scene_of_many(ctx, model, times[many], times[many]);
        sf_fitter *f = select_fitter_of(ctx, scene, model);
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
        cmocka_unit_test(test_errs_together),
        cmocka_unit_test(test_tone_is_no_error),
        cmocka_unit_test(test_growth_while_views_come),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
