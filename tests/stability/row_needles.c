/* row_needles.c - row 1: thin Gaussians, whose covariance on the screen is nearly singular. */
#include <stdlib.h>

#include "lab.h"
#include "textbook.h"

/* The low-pass is 0.3 px^2 in the library. A picture `scale` times as large shows a Gaussian as one of a
 * low-pass of 0.3 / scale^2 px^2 would be: 17.3 for 1e-3. */
typedef struct setting {
    const char *name;
    int width; /* px */
    double scale;
    size_t samples;
} setting;

typedef struct worst {
    double g, gradient, textbook_g, textbook_gradient;
} worst;

/* A quarter of the picture long, in any direction. */
static test_ref_scene draw_needle(sf_rng *rng, const setting *s, double aspect) {
    test_ref_scene scene = stab_scene(1, s->width, s->width, 600 * s->scale);
    double z = stab_between(rng, 1.5, 4), middle = 0.05 * s->width * z / scene.camera.fx;
    test_random_place(
        &scene, 0, (const double[]){middle * stab_between(rng, -1, 1), middle * stab_between(rng, -1, 1), z});
    double longest = log(0.25 * s->width * z / scene.camera.fx);
    for (size_t k = 0; k < 3; k++)
        scene.gaussians.log_scales[k] = (float)(k == 0 ? longest : longest - log(aspect));
    for (size_t k = 0; k < 4; k++) scene.gaussians.quats[k] = (float)sf_rng_normal(rng);
    return scene;
}

static void try_textbook(const stab_truth *truth, worst *w) {
    size_t pixels = (size_t)truth->scene->camera.width * (size_t)truth->scene->camera.height;
    double *T = test_ref_numbers(pixels);
    test_ref_gaussians d = test_ref_gaussians_create(1, 0);
    stab_textbook_single(truth->scene, truth->d_rgb, T, &d);
    for (size_t i = 0; i < pixels; i++)
        if (!truth->left_out[i])
            w->textbook_g = stab_worse(w->textbook_g, fabs(T[i] - truth->frame.transmittance[i]) / 0.9);
    w->textbook_gradient = stab_worse(w->textbook_gradient, stab_gradient_error(truth, &d));
    test_ref_gaussians_free(&d);
    free(T);
}

static void try_needle(const stab_lab *lab, const test_ref_scene *scene, worst *w) {
    stab_truth truth = stab_truth_of(scene);
    stab_errors e = stab_compare(lab, &truth);
    w->g = stab_worse(w->g, e.transmittance / 0.9);
    w->gradient = stab_worse(w->gradient, e.worst_gradient);
    try_textbook(&truth, w);
    stab_truth_free(&truth);
}

enum { ASPECTS = 7 };

static void try_aspects(const stab_run *run, const setting *s, worst found[ASPECTS]) {
    stab_lab lab = stab_lab_open(NULL);
    sf_rng rng;
    sf_rng_seed(&rng, 1);
    for (int k = 0; k < ASPECTS; k++) {
        found[k] = (worst){0};
        if (run->effort == STAB_EMULATED && k % 3) continue;
        for (size_t i = 0; i < s->samples; i++) {
            test_ref_scene scene = draw_needle(&rng, s, pow(10, k));
            try_needle(&lab, &scene, &found[k]);
            test_ref_gaussians_free(&scene.gaussians);
        }
    }
    stab_lab_close(&lab);
}

static void draw_points(stab_run *run, stab_line line, const worst found[ASPECTS], int gradient) {
    for (int k = 0; k < ASPECTS; k++) {
        double ours = gradient ? found[k].gradient : found[k].g;
        double textbook = gradient ? found[k].textbook_gradient : found[k].textbook_g;
        if (found[k].g > 0) stab_point(run, pow(10, k), line == STAB_OURS ? ours : textbook);
    }
}

enum { SETTINGS = 2 };

/* A pixel's offset in units of the least width, sqrt(0.3) px, is rounded: to half a last bit of the picture's
 * diagonal. */
static double bound_of(const setting *s) { return s->width * sqrt(2) / sqrt(0.3) * 0x1p-24; }

static void report(stab_run *run, const setting *s, const worst found[ASPECTS]) {
    worst all = {0};
    for (int k = 0; k < ASPECTS; k++) {
        all.g = fmax(all.g, found[k].g), all.gradient = fmax(all.gradient, found[k].gradient);
        all.textbook_g = fmax(all.textbook_g, found[k].textbook_g);
        all.textbook_gradient = fmax(all.textbook_gradient, found[k].textbook_gradient);
    }
    stab_at_most(run, all.g, bound_of(s), "", "error of g, aspect 1 to 1e6, %s", s->name);
    stab_textbook(run, all.textbook_g);
    stab_at_most(run, all.gradient, bound_of(s), "", "error of a gradient, aspect 1 to 1e6, %s", s->name);
    stab_textbook(run, all.textbook_gradient);
}

static void draw_chart(stab_run *run, const setting *settings, worst found[SETTINGS][ASPECTS], int gradient) {
    stab_chart_begin(
        run, gradient ? "Largest error of a gradient, over aspect" : "Largest error of g, over aspect",
        (stab_axis){"longest axis over the others (1)", 1},
        (stab_axis){gradient ? "error, relative (1)" : "error (1)", 1});
    for (int s = 0; s < SETTINGS; s++)
        for (int line = STAB_OURS; line <= STAB_TEXTBOOK; line++) {
            stab_series_begin(run, (stab_line)line, "%s, %s", line == STAB_OURS ? "ours" : "textbook",
                              settings[s].name);
            draw_points(run, (stab_line)line, found[s], gradient);
        }
}

static void needles(stab_run *run) {
    const setting settings[SETTINGS] = {
        {.name = "low-pass 0.3 px^2", .width = 64, .scale = 1, .samples = stab_count(run, 200, 24, 2)},
        {.name = "low-pass 1e-3 px^2",
         .width = (int)stab_count(run, 512, 256, 64),
         .scale = sqrt(300),
         .samples = stab_count(run, 12, 3, 1)}};
    worst found[SETTINGS][ASPECTS];
    for (int s = 0; s < SETTINGS; s++) {
        try_aspects(run, &settings[s], found[s]);
        report(run, &settings[s], found[s]);
    }
    for (int gradient = 0; gradient < 2; gradient++) draw_chart(run, settings, found, gradient);
}

const stab_row stab_row_1 = {
    .id = "1",
    .failure = "A 2D covariance that is nearly singular: ac - b^2 cancels",
    .cure =
        "The determinant is a sum of squares, the exponent is factored (M.1): both keep their digits at any "
        "aspect. The textbook's inverse and its gradient divide by ac - b^2 and its square.",
    .quick = 1,
    .run = needles,
};
