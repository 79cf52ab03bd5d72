/* row_layers.c - rows 6 and 7: opacities at their clamp, and many layers behind each other. */
#include <stdlib.h>

#include "lab.h"
#include "textbook.h"

enum { SIDE = 16 };

/* `count` Gaussians so broad that g is 1 in all of the picture, nearest first, of one opacity; their colours
 * differ. */
static test_ref_scene layers(size_t count, double opacity) {
    test_ref_scene scene = stab_scene(count, SIDE, SIDE, SIDE);
    for (size_t i = 0; i < count; i++) {
        scene.gaussians.means[3 * i + 2] = (float)(2 + 4 * (double)i / (double)count);
        stab_set_opacity(&scene, i, opacity);
        for (size_t k = 0; k < 3; k++) {
            scene.gaussians.log_scales[3 * i + k] = 8;
            scene.gaussians.sh[3 * i + k] = (float)(1.2 * sin(0.7 * (double)i + (double)k));
        }
    }
    return scene;
}

/* dL/do of each layer by the textbook: the sum over pixels and channels; free() it. */
static double *textbook_layers(const test_ref_scene *scene, size_t *used) {
    size_t n = scene->count;
    double *d = test_ref_numbers(n);
    float *opacity = calloc(n, sizeof *opacity), *color = calloc(n, sizeof *color),
          *each = calloc(n, sizeof *each);
    assert_true(opacity && color && each);
    for (size_t i = 0; i < n; i++) opacity[i] = (float)(1 / (1 + exp(-scene->gaussians.logit_opacities[i])));
    for (size_t k = 0; k < 3; k++) {
        double weight = 0;
        for (size_t i = k; i < 3 * SIDE * SIDE; i += 3) weight += (double)test_d_rgb_at(i);
        for (size_t i = 0; i < n; i++)
            color[i] = (float)fmax(0, 0.5 + 0.28209479177387814 * scene->gaussians.sh[3 * i + k]);
        *used = stab_textbook_layers(n, opacity, color, each);
        for (size_t i = 0; i < n; i++) d[i] += weight * (double)each[i];
    }
    free(opacity);
    free(color);
    free(each);
    return d;
}

static double slope_of(const test_ref_scene *scene, size_t i) {
    double o = 1 / (1 + exp(-scene->gaussians.logit_opacities[i]));
    return o * (1 - o);
}

/* Errors of dL/do of layer i in units of the whole picture's dL/dcolour. */
static double unit(void) {
    double sum = 0;
    for (size_t i = 0; i < 3 * SIDE * SIDE; i++) sum += (double)test_d_rgb_at(i);
    return sum;
}

/* ---- row 6 ----------------------------------------------------------------------------------------------
 */

/* dL/do of layer i in float64, by central differences of its logit. */
static double difference(const test_ref_scene *scene, size_t i) {
    return stab_difference(scene, &scene->gaussians.logit_opacities[i], 1e-5) / slope_of(scene, i);
}

static void saturated(stab_run *run) {
    static const double opacities[] = {0.91, 0.95, 0.98, 0.988, 0.9899, 0.9901, 0.992, 0.995, 0.999, 0.9999};
    enum { COUNT = sizeof opacities / sizeof *opacities, LAYERS = 20 };
    double ours[COUNT] = {0}, textbook[COUNT] = {0}, most = 0, textbook_most = 0;
    stab_lab lab = stab_lab_open(NULL);
    size_t by = stab_count(run, 1, 1, 3), used;
    for (size_t k = 0; k < COUNT; k += by) {
        test_ref_scene scene = layers(LAYERS, opacities[k]);
        test_outcome o = test_outcome_of(lab.ctx, lab.renderer, &scene);
        double *d = textbook_layers(&scene, &used);
        for (size_t i = 0; i < 4; i++) {
            double expected = difference(&scene, i);
            double got = (double)o.gradient.logit_opacities[i] / slope_of(&scene, i);
            ours[k] = stab_worse(ours[k], fabs(got - expected) / unit());
            textbook[k] = fmax(textbook[k], fabs(d[i] - expected) / unit());
        }
        most = stab_worse(most, ours[k]), textbook_most = fmax(textbook_most, textbook[k]);
        free(d);
        test_outcome_free(&o);
        test_ref_gaussians_free(&scene.gaussians);
    }
    stab_chart_begin(run, "Gradient by the opacity of 20 opaque Gaussians in line",
                     (stab_axis){"1 - opacity (1); the clamp is at 0.01", 1},
                     (stab_axis){"error against central differences (1)", 1});
    for (int line = STAB_OURS; line <= STAB_TEXTBOOK; line++) {
        stab_series_begin(run, (stab_line)line,
                          line == STAB_OURS ? "ours" : "textbook: float32, back to front, through the clamp");
        for (size_t k = 0; k < COUNT; k += by)
            stab_point(run, 1 - opacities[k], fmax(line == STAB_OURS ? ours[k] : textbook[k], 1e-9));
    }
    stab_bound_line(run, 1e-5, "bound");
    stab_at_most(run, most, 1e-5, "", "central differences on both sides of 0.99, error of dL/do");
    stab_textbook(run, textbook_most);
    stab_lab_close(&lab);
}

const stab_row stab_row_6 = {
    .id = "6",
    .failure = "Saturated opacity: forward and backward disagree about the clamp",
    .cure = "One constant for both passes; beyond the clamp nothing passes to opacity and shape.",
    .quick = 1,
    .run = saturated,
};

/* ---- row 7 ----------------------------------------------------------------------------------------------
 */

/* Layers that a gradient reaches, and those by which T came to what it is: all pixels are alike. */
static void count_layers(const test_outcome *o, double opacity, size_t *forward, size_t *backward) {
    *backward = 0;
    for (size_t i = 0; i < o->count; i++)
        if (o->gradient.sh[3 * i] != 0 || o->gradient.logit_opacities[i] != 0) *backward = i + 1;
    *forward = (size_t)llround(log((double)o->transmittance[0]) / log(1 - fmin(opacity, 0.99)));
}

/* Errors of dL/do by layer, ours or the textbook's, as a series; returns the largest. */
static double draw_errors(stab_run *run, const test_ref_scene *scene, const stab_truth *truth, size_t used,
                          const test_outcome *o, const double *textbook) {
    double most = 0;
    for (size_t i = 0; i < used; i++) {
        double slope = slope_of(scene, i),
               got = o ? (double)o->gradient.logit_opacities[i] / slope : textbook[i];
        double error = fabs(got - truth->grads.gaussians.logit_opacities[i] / slope) / unit();
        most = o ? stab_worse(most, error) : fmax(most, error);
        if (i % (used / 40 + 1) == 0) stab_point(run, (double)i + 1, fmax(error, 1e-9));
    }
    return most;
}

static void compare_layers(stab_run *run, const stab_lab *lab, size_t count, double opacity, int exact) {
    test_ref_scene scene = layers(count, opacity);
    test_outcome o = test_outcome_of(lab->ctx, lab->renderer, &scene);
    size_t forward, backward, used;
    count_layers(&o, opacity, &forward, &backward);
    stab_at_most(run, fabs((double)forward - (double)backward), 0, "layers",
                 "%zu layers of %g: the passes' last ones differ", count, opacity);
    if (exact) {
        stab_truth truth = stab_truth_of(&scene);
        double *d = textbook_layers(&scene, &used);
        stab_series_begin(run, STAB_OURS, "ours, %zu layers of %g", count, opacity);
        double ours = draw_errors(run, &scene, &truth, backward, &o, NULL);
        stab_series_begin(run, STAB_TEXTBOOK, "textbook, the same: T by division, back to front");
        double textbook = draw_errors(run, &scene, &truth, backward, NULL, d);
        stab_at_most(run, stab_errors_of(&truth, &o).rgb, 1e-5, "colour",
                     "%zu layers of %g: error of the picture", count, opacity);
        stab_at_most(run, ours, 1e-5, "", "%zu layers of %g: error of dL/do", count, opacity);
        stab_textbook(run, textbook);
        free(d);
        stab_truth_free(&truth);
    }
    test_outcome_free(&o);
    test_ref_gaussians_free(&scene.gaussians);
}

static void transmittance(stab_run *run) {
    stab_lab lab = stab_lab_open(NULL);
    stab_chart_begin(run, "Gradient by the opacity of each of many layers",
                     (stab_axis){"layer, from the nearest (1)", 1},
                     (stab_axis){"error against float64 (1)", 1});
    compare_layers(run, &lab, stab_count(run, 10000, 10000, 1500), 0.01, 1);
    compare_layers(run, &lab, 100, 0.98, 1);
    compare_layers(run, &lab, 100, 0.99, 0); /* T falls on its least but for a last bit */
    stab_lab_close(&lab);
}

const stab_row stab_row_7 = {
    .id = "7",
    .failure = "Transmittance: underflow, or a stop rule that differs between the passes",
    .cure = "Both passes go front to back by one rule, and none recovers a transmittance by division.",
    .quick = 1,
    .run = transmittance,
};
