/* row_scale.c - row 12: a model seen from nearer and farther than its pictures. */
#include <stdio.h>
#include <stdlib.h>

#include "lab.h"

enum { WIDTH = 320, HEIGHT = 240 };

static sf_scene *load(sf_context *ctx, double scale) {
    char name[64];
    sf_scene *scene;
    snprintf(name, sizeof name, "sim:studio?width=%d&height=%d", (int)(WIDTH * scale), (int)(HEIGHT * scale));
    assert_ok(ctx, sf_scene_load(ctx, name, NULL, &scene));
    return scene;
}

static sf_fitter *fit(sf_context *ctx, sf_scene *scene, int antialiased, int64_t steps) {
    sf_fitter *fitter;
    sf_fit_options options = sf_fit_options_default();
    options.steps = steps, options.max_gaussians = 20000, options.antialiased = antialiased;
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &fitter));
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    return fitter;
}

/* PSNR over the held-out views of a scene of other pictures than the fit's. */
static double psnr_on(const stab_lab *lab, sf_scene *scene, sf_fitter *fitter) {
    sf_scene_info info;
    double sum = 0;
    sf_scene_get_info(scene, &info);
    for (size_t i = 0; i < info.views; i++) {
        sf_view_info view;
        sf_quality quality;
        assert_ok(lab->ctx, sf_scene_get_view(scene, i, &view));
        if (view.split != SF_SPLIT_TEST) continue;
        size_t values = 3 * (size_t)view.camera.width * (size_t)view.camera.height;
        float *truth = malloc(values * sizeof *truth), *drawn = malloc(values * sizeof *drawn);
        assert_true(truth && drawn);
        assert_ok(lab->ctx, sf_scene_get_pixels(scene, view.id, truth, NULL));
        assert_ok(lab->ctx, sf_fitter_render(fitter, &view.camera, &(sf_image_out){.rgb = drawn}));
        assert_ok(lab->ctx, sf_compare(lab->renderer, view.camera.width, view.camera.height, drawn, truth,
                                       NULL, &quality));
        sum += quality.psnr / (double)info.test_views;
        free(truth);
        free(drawn);
    }
    return sum;
}

static void scales(stab_run *run) {
    static const double sizes[] = {0.25, 0.5, 1, 2};
    enum { SIZES = sizeof sizes / sizeof *sizes };
    double psnr[2][SIZES];
    stab_lab lab = stab_lab_open(NULL);
    sf_context *ctx = lab.ctx;
    sf_scene *scene = load(ctx, 1), *other[SIZES];
    for (int s = 0; s < SIZES; s++) other[s] = load(ctx, sizes[s]);
    for (int mode = 0; mode < 2; mode++) {
        sf_fitter *fitter = fit(ctx, scene, mode, 1000);
        for (int s = 0; s < SIZES; s++) psnr[mode][s] = psnr_on(&lab, other[s], fitter);
        sf_fitter_destroy(&fitter);
    }
    stab_chart_begin(run, "Held-out views of sim:studio drawn at other sizes than it was fitted at",
                     (stab_axis){"size of the picture over that of the training (1)", 1},
                     (stab_axis){"PSNR (dB)", 0});
    for (int mode = 1; mode >= 0; mode--) {
        stab_series_begin(run, mode ? STAB_OURS : STAB_TEXTBOOK,
                          mode ? "anti-aliased mode" : "textbook: the low-pass alone");
        for (int s = 0; s < SIZES; s++) stab_point(run, sizes[s], psnr[mode][s]);
    }
    stab_at_least(run, psnr[1][1] - psnr[0][1], 2, "dB", "anti-aliased mode's gain at half the size");
    for (int s = 0; s < SIZES; s++) {
        stab_shown(run, psnr[1][s], "dB", "anti-aliased mode at %g of the size", sizes[s]);
        stab_textbook(run, psnr[0][s]);
    }
    for (int s = 0; s < SIZES; s++) sf_scene_destroy(&other[s]);
    sf_scene_destroy(&scene);
    stab_lab_close(&lab);
}

const stab_row stab_row_12 = {
    .id = "12",
    .failure = "Aliasing when the scale changes",
    .cure = "Anti-aliased mode: the opacity pays for what the low-pass adds to the area (M.3).",
    .run = scales,
};
