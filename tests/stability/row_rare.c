/* row_rare.c - rows 9 and 23: what few views see, and what was seen first. */
#include <math.h>

#include "fit/fitter.h"
#include "fits.h"

/* ---- row 9
 * -------------------------------------------------------------------------------------------------
 */

enum { SIDE = 32, VIEWS = 300, RARE = 100, STEPS = 900, NOTE = 15 };
#define AWAY        12.0 /* of the second ball from the first, world units */
#define OPACITY     0.8f
#define REGULARISER 0.01

/* One view in RARE looks at the ball that is AWAY, all others at the one in the middle. */
static sf_camera camera_of(int view, int *rare) {
    sf_camera camera = test_camera_around(view, VIEWS, SIDE, SIDE);
    *rare = view % RARE == 0;
    for (int k = 0; k < 3 && *rare; k++) camera.t_cw[k] -= camera.R_cw[3 * k + 2] * AWAY;
    return camera;
}

static sf_model *two_balls(sf_context *ctx) {
    sf_model *model;
    const float logit = logf(OPACITY / (1 - OPACITY)), scale = logf(0.25f);
    float means[6] = {0, 0, 0, 0, 0, (float)AWAY}, quats[8] = {1, 0, 0, 0, 1, 0, 0, 0}, log_scales[6], sh[6],
          logits[2] = {logit, logit};
    for (int k = 0; k < 6; k++) log_scales[k] = scale, sh[k] = 1;
    assert_ok(ctx, sf_model_create(ctx, 2, 0, &model));
    assert_ok(ctx, sf_model_set(model, 0, 2, &(sf_gaussians){means, quats, log_scales, logits, sh}));
    return model;
}

static sf_scene *rare_scene(sf_context *ctx, const sf_model *model) {
    static float rgb[3 * SIDE * SIDE];
    static uint8_t bytes[3 * SIDE * SIDE];
    sf_renderer *renderer;
    sf_scene *scene;
    assert_ok(ctx, sf_renderer_create(ctx, &renderer));
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    for (int v = 0, rare; v < VIEWS; v++) {
        sf_camera camera = camera_of(v, &rare);
        assert_ok(ctx, sf_render(renderer, model, &camera, NULL, &(sf_image_out){.rgb = rgb}));
        for (int i = 0; i < 3 * SIDE * SIDE; i++) bytes[i] = (uint8_t)(255 * fminf(rgb[i], 1) + 0.5f);
        sf_pixels pixels = {.rgb = bytes, .stride = 3 * (size_t)SIDE};
        assert_ok(ctx, sf_scene_add_view(scene, NULL, &camera, &pixels, SF_SPLIT_TRAIN, NULL));
    }
    sf_renderer_destroy(&renderer);
    return scene;
}

static double opacity_of(const sf_fitter *f, size_t i) {
    return i < f->model->count ? 1 / (1 + exp(-(double)f->model->params.field[SF_FIELD_logit_opacity][i]))
                               : 0;
}

/* As published: the regulariser's gradient, always of one sign, makes Adam take a whole step of its rate
 * whether the Gaussian is seen or not. */
static double regularised_unseen(double opacity, double rate) {
    double logit = log(opacity / (1 - opacity)) - rate;
    return 1 / (1 + exp(-logit));
}

enum { NOTES = STEPS / NOTE };

typedef struct two_opacities {
    double steps[NOTES], rare[NOTES], common[NOTES]; /* on the way */
    double rare_end, common_end;
} two_opacities;

static two_opacities fit_two_balls(sf_context *ctx, sf_scene *scene, const sf_model *model,
                                   double regulariser) {
    two_opacities t;
    sf_fitter *f;
    sf_fit_options options = stab_fit_options(STEPS, 2);
    options.validate = 0, options.pyramid_levels = 0, options.sh_degree = 0, options.lr_mean = 1e-5;
    options.reg_opacity = regulariser;
    assert_ok(ctx, sf_fitter_create(ctx, scene, model, &options, &f));
    for (int step = 0; step < STEPS; step++) {
        assert_ok(ctx, sf_fitter_step(f));
        if (step % NOTE) continue;
        t.steps[step / NOTE] = step + 1;
        t.common[step / NOTE] = opacity_of(f, 0), t.rare[step / NOTE] = opacity_of(f, 1);
    }
    t.common_end = opacity_of(f, 0), t.rare_end = opacity_of(f, 1);
    sf_fitter_destroy(&f);
    return t;
}

static void rarely_seen(stab_run *run) {
    sf_context *ctx = test_context();
    sf_model *model = two_balls(ctx);
    sf_scene *scene = rare_scene(ctx, model);
    two_opacities with = fit_two_balls(ctx, scene, model, REGULARISER);
    two_opacities without = fit_two_balls(ctx, scene, model, 0);
    double textbook = (double)OPACITY, unseen[NOTES];
    for (int step = 0; step < STEPS; step++) {
        textbook = regularised_unseen(textbook, sf_fit_options_default().lr_opacity);
        if (step % NOTE == 0) unseen[step / NOTE] = textbook;
    }
    stab_at_least(run, with.rare_end, 0.95 * (double)OPACITY, "",
                  "opacity of what 1 %% of the views see, from %g, at the end", (double)OPACITY);
    stab_textbook(run, textbook);
    stab_at_most(run, fabs(with.rare_end - without.rare_end), 0.01, "", "what of it is the regulariser's");
    stab_shown(run, with.common_end, "", "opacity of what the others see, at the end");
    stab_chart_begin(run, "Two Gaussians with a regulariser of opacity", (stab_axis){"steps (1)", 0},
                     (stab_axis){"opacity (1)", 0});
    stab_series_begin(run, STAB_OURS, "seen by 1 %% of the views");
    for (int i = 0; i < NOTES; i++) stab_point(run, with.steps[i], with.rare[i]);
    stab_series_begin(run, STAB_OURS, "seen by the others");
    for (int i = 0; i < NOTES; i++) stab_point(run, with.steps[i], with.common[i]);
    stab_series_begin(run, STAB_TEXTBOOK, "textbook: regularised unseen");
    for (int i = 0; i < NOTES; i++) stab_point(run, with.steps[i], unseen[i]);
    sf_scene_destroy(&scene);
    sf_model_destroy(&model);
    sf_context_destroy(&ctx);
}

const stab_row stab_row_9 = {
    .id = "9",
    .failure = "Regularisers kill what is rarely seen",
    .cure = "Only what a step's picture shows is regularised, beside Adam and not through it.",
    .run = rarely_seen,
};

/* ---- row 23
 * ------------------------------------------------------------------------------------------------
 */

enum { FRAMES = 24, STEPS_EACH = 30, AT_FIRST = 3, WINDOW = 4 };

typedef struct stream {
    size_t count;
    double views[FRAMES + 1], psnr[FRAMES + 1]; /* of the first keyframe */
    double fall;                                /* dB under its best before, the largest */
} stream;

/* Keyframes come one by one, in the order of the path; keep: how many stay, 0: all. The first one is held out
 * as well, to be looked at. */
static stream follow_stream(sf_context *ctx, size_t keep) {
    stream s = {0};
    double best = 0;
    uint32_t ids[FRAMES];
    size_t oldest = 0;
    sf_view_info view;
    sf_fitter *fitter = NULL;
    sf_scene *all = stab_load(ctx, "sim:studio?width=80&height=60&frames=24", 0, 1);
    sf_scene *scene = stab_load(ctx, "sim:studio?width=80&height=60&frames=24", 0, 1); /* its points stay */
    while (!sf_scene_get_view(scene, 0, &view)) assert_ok(ctx, sf_scene_remove_view(scene, view.id));
    sf_fit_options options = stab_fit_options((FRAMES - AT_FIRST + 1) * STEPS_EACH, 3000);
    options.validate = 0, options.cool_down = 1;
    for (size_t i = 0; i < FRAMES; i++) {
        assert_ok(ctx, sf_scene_get_view(all, i, &view));
        if (!i) test_copy_view(ctx, all, view, scene, SF_SPLIT_TEST);
        ids[i] = test_copy_view(ctx, all, view, scene, SF_SPLIT_TRAIN);
        if (i + 1 < AT_FIRST) continue;
        if (!fitter) assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &fitter));
        if (keep && i + 1 - oldest > keep) assert_ok(ctx, sf_scene_remove_view(scene, ids[oldest++]));
        for (int step = 0; step < STEPS_EACH; step++) assert_ok(ctx, sf_fitter_step(fitter));
        s.views[s.count] = (double)(i + 1);
        s.psnr[s.count] = test_held_out(ctx, scene, fitter).psnr;
        best = fmax(best, s.psnr[s.count]);
        s.fall = fmax(s.fall, best - s.psnr[s.count++]);
    }
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_scene_destroy(&all);
    return s;
}

static void forgetting(stab_run *run) {
    sf_context *ctx = test_context();
    stream ours = follow_stream(ctx, 0), textbook = follow_stream(ctx, WINDOW);
    stab_at_most(run, ours.fall, 1, "dB", "the first keyframe: largest fall under its best");
    stab_textbook(run, textbook.fall);
    stab_shown(run, ours.psnr[ours.count - 1], "dB", "the first keyframe: PSNR at the end");
    stab_textbook(run, textbook.psnr[textbook.count - 1]);
    stab_chart_begin(run, "The first keyframe as others come", (stab_axis){"keyframes so far (1)", 0},
                     (stab_axis){"PSNR (dB)", 0});
    stab_series_begin(run, STAB_OURS, "past keyframes are replayed");
    for (size_t i = 0; i < ours.count; i++) stab_point(run, ours.views[i], ours.psnr[i]);
    stab_series_begin(run, STAB_TEXTBOOK, "textbook: the last %d alone", WINDOW);
    for (size_t i = 0; i < textbook.count; i++) stab_point(run, textbook.views[i], textbook.psnr[i]);
    sf_context_destroy(&ctx);
}

const stab_row stab_row_23 = {
    .id = "23",
    .failure = "Forgetting in streams",
    .cure = "Keyframes stay in the scene, and each pass goes over all of them.",
    .run = forgetting,
};
