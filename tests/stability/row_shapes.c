/* row_shapes.c - row 3: needles and giants, and views off the path. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fits.h"
#include "scene/neighbours.h"
#include "scene/scene.h"

#define STUDIO "sim:studio?width=120&height=90&frames=24"
/* Twice the limit: the depth is not the same in all views, of which the last ones count most. */
#define GIANT 6
enum { STEPS = 800, GAUSSIANS = 6000, NEARER = 8 /* views */ };

typedef struct shapes {
    double needles,
        giants;  /* shares, %: longest axis over 100 times the middle one; larger than GIANT half pictures */
    double most; /* longest axis, in half pictures */
} shapes;

/* Half the size of a picture at the place of a mean: the harmonic mean over the training views that have it
 * in their pictures; INFINITY: none has. */
static double half_picture_at(sf_scene *scene, const float mean[3]) {
    double p[3] = {(double)mean[0], (double)mean[1], (double)mean[2]}, u, v, z, sum = 0, views = 0;
    for (size_t i = 0; i < scene->view_count; i++) {
        const sf_camera *c = &scene->views[i]->camera;
        if (scene->views[i]->split != SF_SPLIT_TRAIN || !sf_camera_sees(c, p, &u, &v, &z)) continue;
        sum += 2 * sqrt(c->fx * c->fy / ((double)c->width * c->height)) / z;
        views++;
    }
    return views / sum;
}

static shapes shapes_of(sf_context *ctx, const sf_fitter *fitter, sf_scene *scene) {
    shapes s = {0};
    sf_model *model;
    assert_ok(ctx, sf_fitter_snapshot(fitter, &model));
    size_t n = sf_model_count(model);
    float *log_scales = malloc((n + 1) * 6 * sizeof *log_scales), *means = log_scales + 3 * n;
    assert_non_null(log_scales);
    assert_ok(ctx, sf_model_get(model, 0, n, &(sf_gaussians){.log_scales = log_scales, .means = means}));
    for (size_t i = 0; i < n; i++) {
        const float *l = log_scales + 3 * i;
        float most = fmaxf(fmaxf(l[0], l[1]), l[2]), least = fminf(fminf(l[0], l[1]), l[2]);
        double longest = exp((double)most), middle = exp((double)(l[0] + l[1] + l[2] - most - least));
        s.needles += 100.0 * (longest > 100 * middle) / (double)n;
        double half = half_picture_at(scene, means + 3 * i);
        if (!isfinite(half)) continue;
        s.giants += 100.0 * (longest > GIANT * half) / (double)n;
        s.most = fmax(s.most, longest / half);
    }
    free(log_scales);
    sf_model_destroy(&model);
    return s;
}

/* Mean PSNR of views a third of the way from the path to the middle, against the ray caster. */
static double psnr_off_path(const sf_sim *sim, sf_context *ctx, sf_fitter *fitter) {
    size_t values = 3 * (size_t)sim->width * (size_t)sim->height;
    float *truth = malloc(values * sizeof *truth), *drawn = malloc(values * sizeof *drawn);
    uint8_t *bytes = malloc(values);
    sf_renderer *renderer;
    double sum = 0;
    assert_true(truth && drawn && bytes);
    assert_ok(ctx, sf_renderer_create(ctx, &renderer));
    for (uint64_t view = 0; view < NEARER; view++) {
        sf_camera camera;
        sf_quality quality;
        sf_sim_camera(sim, view * sim->frames / NEARER, &camera);
        camera.t_cw[2] *= 2.0 / 3;
        stab_draw_studio(ctx, sim, &camera, bytes);
        for (size_t i = 0; i < values; i++) truth[i] = (float)bytes[i] / 255;
        assert_ok(ctx, sf_fitter_render(fitter, &camera, &(sf_image_out){.rgb = drawn}));
        assert_ok(ctx, sf_compare(renderer, camera.width, camera.height, drawn, truth, NULL, &quality));
        sum += quality.psnr / NEARER;
    }
    sf_renderer_destroy(&renderer);
    free(truth);
    free(drawn);
    free(bytes);
    return sum;
}

/* Without limits, as published, and with ours. sim NULL: there is no truth to compare with. */
static void compare(stab_run *run, const char *name, sf_context *ctx, sf_scene *scene,
                    const sf_fit_options *base, const sf_sim *sim) {
    shapes s[2];
    double psnr[2], off_path[2] = {0};
    for (int limited = 0; limited < 2; limited++) {
        sf_fit_options options = *base;
        sf_fitter *fitter;
        if (!limited) options.max_aspect = options.max_scale = 0;
        psnr[limited] = stab_fit_scene(ctx, scene, &options, 0, &fitter).quality.psnr;
        s[limited] = shapes_of(ctx, fitter, scene);
        if (sim) off_path[limited] = psnr_off_path(sim, ctx, fitter);
        sf_fitter_destroy(&fitter);
    }
    stab_at_most(run, s[1].needles, 2, "%", "%s: longer than 100 times their middle axis", name);
    stab_textbook(run, s[0].needles);
    stab_at_most(run, s[1].giants, 0, "%", "%s: larger than 6 half pictures", name);
    stab_textbook(run, s[0].giants);
    stab_shown(run, s[1].most, "half pictures", "%s: the longest axis", name);
    stab_textbook(run, s[0].most);
    stab_shown(run, psnr[1], "dB", "%s: held-out PSNR", name);
    stab_textbook(run, psnr[0]);
    if (!sim) return;
    stab_shown(run, off_path[1], "dB", "%s: PSNR a third of the way to the middle, off the path", name);
    stab_textbook(run, off_path[0]);
}

static void needles(stab_run *run) {
    sf_sim sim;
    sf_context *ctx = test_context();
    sf_scene *studio = stab_load(ctx, STUDIO, 8, 1), *fox = stab_load_real(ctx, STAB_FOX, 8, 2);
    sf_fit_options options = stab_fit_options(STEPS, GAUSSIANS);
    assert_ok(ctx, sf_sim_init(ctx, STUDIO, &sim));
    compare(run, "studio", ctx, studio, &options, &sim);
    options = stab_fit_options(300, 10000);
    if (fox) compare(run, "fox", ctx, fox, &options, NULL);
    stab_chart_begin(run, "The longest axis in a fit, with our limits and without",
                     (stab_axis){"scene (1: studio, 2: fox)", 0},
                     (stab_axis){"longest axis (half pictures)", 1});
    for (int limited = 1; limited >= 0; limited--) {
        stab_series_begin(run, limited ? STAB_OURS : STAB_TEXTBOOK,
                          limited ? "limited" : "textbook: no limit");
        double scene = 1;
        for (size_t i = 0; i < run->figure_count; i++)
            if (!strcmp(run->figures[i].unit, "half pictures"))
                stab_point(run, scene++, limited ? run->figures[i].value : run->figures[i].textbook);
    }
    if (fox) sf_scene_destroy(&fox);
    sf_scene_destroy(&studio);
    sf_context_destroy(&ctx);
}

const stab_row stab_row_3 = {
    .id = "3",
    .failure = "Needles and giants",
    .cure = "No axis grows beyond 30 times the middle one, nor beyond 3 half pictures at its depth.",
    .run = needles,
};
