/* row_frames.c - rows 15 and 18: exposures that wander, and frames that are blurred. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "disturb.h"
#include "fits.h"

#define STUDIO "sim:studio?width=80&height=60&frames=24"

static stab_fit fit_changed(sf_context *ctx, test_change change, void *user, const sf_fit_options *options,
                            int64_t every) {
    sf_scene *scene = test_changed_scene(ctx, STUDIO, change, user);
    stab_fit fit = stab_fit_scene(ctx, scene, options, every, NULL);
    sf_scene_destroy(&scene);
    return fit;
}

/* ---- row 15
 * ------------------------------------------------------------------------------------------------
 */

static void exposures(stab_run *run) {
    enum { STEPS = 1500, LOOK = 100 };
    sf_context *ctx = test_context();
    sf_fit_options options = stab_fit_options(STEPS, 3000);
    options.validate = 0;
    stab_fit steady = fit_changed(ctx, test_dim, NULL, &options, LOOK);
    stab_fit textbook = fit_changed(ctx, test_wander, NULL, &options, LOOK);
    options.exposure = 1;
    stab_fit ours = fit_changed(ctx, test_wander, NULL, &options, LOOK);
    stab_fit idle = fit_changed(ctx, test_dim, NULL, &options, LOOK);
    stab_at_most(run, steady.quality.psnr_corrected - ours.quality.psnr_corrected, 0.3, "dB",
                 "gains .7 and 1.4, white balance 15 %%: corrected PSNR lost");
    stab_textbook(run, steady.quality.psnr_corrected - textbook.quality.psnr_corrected);
    stab_shown(run, ours.quality.psnr, "dB", "the same, held-out PSNR as it is");
    stab_textbook(run, textbook.quality.psnr);
    stab_shown(run, ours.quality.psnr_corrected, "dB", "the same, corrected");
    stab_textbook(run, textbook.quality.psnr_corrected);
    stab_at_most(run, steady.quality.psnr_corrected - idle.quality.psnr_corrected, 0.3, "dB",
                 "steady exposure: corrected PSNR lost by learning it");
    stab_chart_begin(run, "The studio under wandering exposure: as it is, not corrected",
                     (stab_axis){"steps (1)", 0}, (stab_axis){"held-out PSNR (dB)", 0});
    stab_draw_fit(run, STAB_OURS, &ours, "wandering, a gain and a bias of each picture learned");
    stab_draw_fit(run, STAB_TEXTBOOK, &textbook, "textbook: wandering, nothing learned of it");
    stab_draw_fit(run, STAB_OURS, &steady, "steady");
    sf_context_destroy(&ctx);
}

const stab_row stab_row_15 = {
    .id = "15",
    .failure = "Exposure and white balance wander",
    .cure = "A gain and a bias per channel of each training picture, their mean held; held-out views are "
            "scored as they are, and beside that corrected by what one half says of the other.",
    .run = exposures,
};

/* ---- row 18
 * ------------------------------------------------------------------------------------------------
 */

/* Every third training view goes. */
static void remove_a_third(sf_context *ctx, sf_scene *scene) {
    sf_view_info view;
    size_t number = 0;
    for (size_t i = 0; !sf_scene_get_view(scene, i, &view);) {
        if (view.split == SF_SPLIT_TRAIN && number++ % 3 == 1)
            assert_ok(ctx, sf_scene_remove_view(scene, view.id));
        else
            i++;
    }
}

static void blurred_frames(stab_run *run) {
    enum { STEPS = 800, LOOK = 50 };
    test_smear blurs[] = {{2, 0}, {4, 0}};
    sf_context *ctx = test_context();
    sf_fit_options options = stab_fit_options(STEPS, 3000);
    options.validate = 0;
    sf_scene *scene = test_changed_scene(ctx, STUDIO, NULL, NULL);
    remove_a_third(ctx, scene);
    stab_fit without = stab_fit_scene(ctx, scene, &options, LOOK, NULL);
    sf_scene_destroy(&scene);
    stab_chart_begin(run, "The studio, a third of its frames blurred by motion", (stab_axis){"steps (1)", 0},
                     (stab_axis){"held-out PSNR (dB)", 0});
    stab_draw_fit(run, STAB_OURS, &without, "without these frames");
    for (int i = 0; i < 2; i++) {
        char name[STAB_TEXT];
        stab_fit with = fit_changed(ctx, test_blur_a_third, &blurs[i], &options, LOOK);
        options.blur = 0;
        stab_fit textbook = fit_changed(ctx, test_blur_a_third, &blurs[i], &options, LOOK);
        options.blur = sf_fit_options_default().blur;
        snprintf(name, sizeof name, "textbook: with them as they are, blurred over %d px",
                 2 * blurs[i].across + 1);
        stab_draw_fit(run, STAB_TEXTBOOK, &textbook, name);
        snprintf(name, sizeof name, "with them, blurred over %d px", 2 * blurs[i].across + 1);
        stab_draw_fit(run, STAB_OURS, &with, name);
        stab_at_most(run, without.quality.psnr - with.quality.psnr, 0.5, "dB",
                     "a third blurred over %d px: held-out PSNR under that without them",
                     2 * blurs[i].across + 1);
        stab_textbook(run, without.quality.psnr - textbook.quality.psnr);
    }
    sf_context_destroy(&ctx);
}

const stab_row stab_row_18 = {
    .id = "18",
    .failure = "Blurred frames",
    .cure = "A recording keeps the sharpest of every few frames (capture --sharpest); views that have less "
            "detail "
            "than the model has there are found in the fit, named, and trained on in every fourth pass.",
    .run = blurred_frames,
};
