/* row_pictures.c - row 20: black, constant and masked pictures. */
#include <stdlib.h>
#include <string.h>

#include "lab.h"

enum { WIDTH = 80, HEIGHT = 60, PIXELS = WIDTH * HEIGHT };

typedef struct result {
    double psnr; /* dB, held out */
    size_t gaussians;
    uint64_t skipped;
} result;

static result fit(sf_context *ctx, sf_scene *scene, int64_t steps, int background) {
    sf_fitter *fitter;
    sf_fit_progress progress;
    sf_fit_options options = sf_fit_options_default();
    options.steps = steps, options.max_gaussians = 1500, options.background = background;
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &fitter));
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    sf_fitter_get_progress(fitter, &progress);
    result r = {test_held_out(ctx, scene, fitter).psnr, progress.gaussians, progress.skipped_values};
    sf_fitter_destroy(&fitter);
    return r;
}

/* What the pictures of a copy of the scene are. */
typedef enum content {
    AS_THEY_ARE,
    ONE_LESS,
    ONE_BLACK,
    BLACK,
    CONSTANT,
    MASKED_WHITE,
    MASKED_NOISE
} content;

static void paint(content c, int test, size_t number, uint8_t *rgb) {
    if (c == BLACK || (c == ONE_BLACK && !test && number == 5)) memset(rgb, 0, 3 * PIXELS);
    for (size_t i = 0; c == CONSTANT && i < 3 * PIXELS; i++) rgb[i] = (uint8_t)(60 + 60 * (i % 3));
    if (test || (c != MASKED_WHITE && c != MASKED_NOISE)) return;
    for (size_t i = 0; i < 3 * PIXELS; i++)
        if (i / 3 % WIDTH >= 3 * WIDTH / 4)
            rgb[i] = c == MASKED_WHITE ? 255 : (uint8_t)(37 * i * i + 11 * number);
}

/* A copy of the simulated scene with such pictures; the masks leave out a quarter of each training picture.
 */
static sf_scene *changed(sf_context *ctx, const char *name, content c) {
    static float picture[3 * PIXELS], xyz[3 * 20000];
    static uint8_t rgb[3 * PIXELS], mask[PIXELS], colors[3 * 20000];
    sf_scene *from, *to;
    sf_scene_info info;
    size_t number = 0;
    assert_ok(ctx, sf_scene_load(ctx, name, NULL, &from));
    assert_ok(ctx, sf_scene_create(ctx, &to));
    sf_scene_get_info(from, &info);
    for (size_t i = 0; i < PIXELS; i++) mask[i] = i % WIDTH >= 3 * WIDTH / 4 ? 0 : 255;
    for (size_t v = 0; v < info.views; v++) {
        sf_view_info view;
        assert_ok(ctx, sf_scene_get_view(from, v, &view));
        assert_ok(ctx, sf_scene_get_pixels(from, view.id, picture, NULL));
        for (size_t i = 0; i < 3 * PIXELS; i++) rgb[i] = (uint8_t)(255 * picture[i] + 0.5f);
        int test = view.split == SF_SPLIT_TEST, masked = !test && c >= MASKED_WHITE;
        paint(c, test, number, rgb);
        number += !test;
        if (c == ONE_LESS && !test && number == 6) continue;
        sf_pixels pixels = {.rgb = rgb, .stride = 3 * WIDTH, .mask = masked ? mask : NULL};
        assert_ok(ctx, sf_scene_add_view(to, view.name, &view.camera, &pixels, view.split, NULL));
    }
    size_t points = sf_scene_get_points(from, 0, 20000, xyz, colors);
    assert_ok(ctx, sf_scene_add_points(to, points, xyz, colors));
    sf_scene_destroy(&from);
    return to;
}

static result try_content(sf_context *ctx, const stab_run *run, content c) {
    int emulated = run->effort == STAB_EMULATED;
    sf_scene *scene = changed(
        ctx, emulated ? "sim:studio?width=80&height=60&frames=6" : "sim:studio?width=80&height=60&frames=24",
        c);
    result r = fit(ctx, scene, (int64_t)stab_count(run, 400, 40, 3), SF_BACKGROUND_BLACK);
    sf_scene_destroy(&scene);
    return r;
}

/* What takes more than a few steps to learn. */
static uint64_t try_odd_ones(sf_context *ctx, stab_run *run) {
    double least = run->effort == STAB_WHOLE ? 30 : 15;
    result black = try_content(ctx, run, BLACK), constant = try_content(ctx, run, CONSTANT);
    result less = try_content(ctx, run, ONE_LESS), one = try_content(ctx, run, ONE_BLACK);
    stab_at_least(run, black.psnr, least, "dB", "all pictures black: PSNR");
    stab_shown(run, (double)black.gaussians, "", "all pictures black: Gaussians");
    stab_at_least(run, constant.psnr, least, "dB", "all pictures of one colour: PSNR");
    stab_shown(run, (double)constant.gaussians, "", "all pictures of one colour: Gaussians");
    stab_at_most(run, less.psnr - one.psnr, 0.5, "dB", "one black among 21: held-out PSNR lost against 20");
    return black.skipped + constant.skipped + one.skipped + less.skipped;
}

/* Nothing is to be seen before a background that is learned, and with time to charge for what is there
 * nothing is left. */
static void try_nothing(sf_context *ctx, stab_run *run) {
    static const content contents[] = {BLACK, CONSTANT};
    static const char *const names[] = {"all pictures black", "all pictures of one colour"};
    for (int i = 0; i < 2; i++) {
        sf_scene *scene = changed(ctx, "sim:studio?width=80&height=60&frames=12", contents[i]);
        result r = fit(ctx, scene, 3000, SF_BACKGROUND_AUTO);
        stab_at_most(run, (double)r.gaussians, 1, "", "%s, background learned: Gaussians", names[i]);
        stab_at_least(run, r.psnr, 40, "dB", "%s, background learned: PSNR", names[i]);
        sf_scene_destroy(&scene);
    }
}

static void pictures(stab_run *run) {
    sf_context *ctx = test_context();
    if (run->effort == STAB_WHOLE) try_nothing(ctx, run);
    uint64_t skipped = run->effort == STAB_EMULATED ? 0 : try_odd_ones(ctx, run);
    result white = try_content(ctx, run, MASKED_WHITE), noise = try_content(ctx, run, MASKED_NOISE);
    skipped += white.skipped + noise.skipped;
    stab_at_most(run, fabs(white.psnr - noise.psnr), 0, "dB", "held-out PSNR, by what lies under the masks");
    stab_at_most(run, (double)skipped, 0, "", "values that were not finite");
    sf_context_destroy(&ctx);
}

const stab_row stab_row_20 = {
    .id = "20",
    .failure = "Black, empty, transparent and constant pictures",
    .cure =
        "They are fitted like any others, by a small model; a pixel under a mask has no influence at all.",
    .quick = 1,
    .run = pictures,
};
