/* row_accuracy.c - rows A1 to A6: how far picture, gradients and loss are from float64, at each kernel level.
 */
#include <stdio.h>
#include <stdlib.h>

#include "lab.h"

/* Promised for scenes as these, at every level: see README.md. */
#define PICTURE_BOUND  1e-5
#define GRADIENT_BOUND 1e-5

enum { POINTS = 12 };

/* An experiment over one quantity. */
typedef struct sweep {
    const char *what;      /* "aspect" */
    stab_axis axis;        /* of the quantity */
    double values[POINTS]; /* ended by 0; emulated: every third */
    int modes;             /* 2: the anti-aliased mode too */
    test_ref_scene (*make)(sf_rng *rng, double value);
} sweep;

typedef struct found {
    double rgb, gradient;
} found;

/* `count` Gaussians of all directions, sizes and colours, over a square picture; sizes and places grow with
 * `depth`, at which they stand. */
static test_ref_scene crowd(sf_rng *rng, size_t count, int side, double depth) {
    test_ref_scene scene = stab_scene(count, side, side, 0.9 * side);
    for (size_t i = 0; i < count; i++) {
        double z = depth * stab_between(rng, 1, 3);
        test_random_place(
            &scene, i,
            (const double[]){0.5 * z * stab_between(rng, -1, 1), 0.5 * z * stab_between(rng, -1, 1), z});
        for (size_t k = 0; k < 4; k++) scene.gaussians.quats[4 * i + k] = (float)sf_rng_normal(rng);
        for (size_t k = 0; k < 3; k++) {
            scene.gaussians.log_scales[3 * i + k] = (float)(log(0.1 * z) + 0.5 * sf_rng_normal(rng));
            scene.gaussians.sh[3 * i + k] = (float)(1.2 * stab_between(rng, -1, 1));
        }
        stab_set_opacity(&scene, i, stab_between(rng, 0.1, 0.9));
    }
    return scene;
}

static test_ref_scene of_aspect(sf_rng *rng, double aspect) {
    test_ref_scene scene = crowd(rng, 40, 48, 1);
    for (size_t i = 0; i < scene.count; i++)
        for (size_t k = 1; k < 3; k++)
            scene.gaussians.log_scales[3 * i + k] =
                (float)(scene.gaussians.log_scales[3 * i] - log(aspect) * (k == 1 ? 0.5 : 1));
    return scene;
}

static test_ref_scene at_distance(sf_rng *rng, double distance) { return crowd(rng, 40, 48, distance); }

static test_ref_scene of_opacity(sf_rng *rng, double opacity) {
    test_ref_scene scene = crowd(rng, 40, 48, 1);
    for (size_t i = 0; i < scene.count; i++) stab_set_opacity(&scene, i, opacity);
    return scene;
}

static test_ref_scene of_layers(sf_rng *rng, double count) {
    test_ref_scene scene = crowd(rng, (size_t)count, 16, 1);
    for (size_t i = 0; i < scene.count; i++) {
        double z = scene.gaussians.means[3 * i + 2];
        for (size_t k = 0; k < 3; k++) scene.gaussians.log_scales[3 * i + k] = (float)log(z);
        stab_set_opacity(&scene, i, 0.02);
    }
    return scene;
}

static test_ref_scene of_side(sf_rng *rng, double side) { return crowd(rng, 12, (int)side, 1); }

static found try_scene(const stab_lab *lab, const stab_truth *truth) {
    stab_errors e = stab_compare(lab, truth);
    return (found){e.rgb, e.worst_gradient};
}

typedef struct levels {
    const char *names[STAB_LEVELS];
    stab_lab labs[STAB_LEVELS];
    size_t count;
} levels;

static levels open_levels(void) {
    levels l = {0};
    l.count = stab_levels(l.names);
    for (size_t k = 0; k < l.count; k++) l.labs[k] = stab_lab_open(l.names[k]);
    return l;
}

static void close_levels(levels *l) {
    for (size_t k = 0; k < l->count; k++) stab_lab_close(&l->labs[k]);
}

static size_t points_of(const sweep *s) {
    size_t n = 0;
    while (n < POINTS && s->values[n] > 0) n++;
    return n;
}

/* All levels at one value: the largest errors of its scenes. */
static void try_value(const stab_run *run, const sweep *s, size_t point, int antialiased, const levels *l,
                      found at[STAB_LEVELS][POINTS]) {
    sf_rng rng;
    sf_rng_seed(&rng, 100 + point);
    for (size_t i = 0; i < stab_count(run, 8, 1, 1); i++) {
        test_ref_scene scene = s->make(&rng, s->values[point]);
        scene.antialiased = antialiased;
        stab_truth truth = stab_truth_of(&scene);
        for (size_t k = 0; k < l->count; k++) {
            found one = try_scene(&l->labs[k], &truth);
            at[k][point].rgb = fmax(at[k][point].rgb, one.rgb);
            at[k][point].gradient = fmax(at[k][point].gradient, one.gradient);
        }
        stab_truth_free(&truth);
        test_ref_gaussians_free(&scene.gaussians);
    }
}

static void chart(stab_run *run, const sweep *s, int antialiased, int gradient, const levels *l,
                  found at[STAB_LEVELS][POINTS]) {
    char title[STAB_TEXT];
    snprintf(title, sizeof title, "Error of the %s over %s%s", gradient ? "gradients" : "picture", s->what,
             antialiased ? ", anti-aliased mode" : "");
    stab_chart_begin(run, title, s->axis,
                     (stab_axis){gradient ? "largest error, relative (1)" : "largest error (colour)", 1});
    for (size_t k = 0; k < l->count; k++) {
        stab_series_begin(run, STAB_OURS, "%s", l->names[k]);
        for (size_t i = 0; i < points_of(s); i++)
            if (at[k][i].rgb > 0) stab_point(run, s->values[i], gradient ? at[k][i].gradient : at[k][i].rgb);
    }
    stab_bound_line(run, gradient ? GRADIENT_BOUND : PICTURE_BOUND, "promised");
}

static void run_sweep(stab_run *run, const sweep *s) {
    levels l = open_levels();
    for (int antialiased = 0; antialiased < s->modes; antialiased++) {
        found at[STAB_LEVELS][POINTS] = {{{0}}};
        for (size_t i = 0; i < points_of(s); i += stab_count(run, 1, 2, 4))
            try_value(run, s, i, antialiased, &l, at);
        for (size_t k = 0; k < l.count; k++) {
            found most = {0};
            for (size_t i = 0; i < points_of(s); i++) {
                most.rgb = fmax(most.rgb, at[k][i].rgb);
                most.gradient = fmax(most.gradient, at[k][i].gradient);
            }
            const char *mode = antialiased ? ", anti-aliased" : "";
            stab_at_most(run, most.rgb, PICTURE_BOUND, "colour", "%s%s: picture", l.names[k], mode);
            stab_at_most(run, most.gradient, GRADIENT_BOUND, "", "%s%s: gradients, relative", l.names[k],
                         mode);
        }
        for (int gradient = 0; gradient < 2; gradient++) chart(run, s, antialiased, gradient, &l, at);
    }
    close_levels(&l);
}

static void over_aspect(stab_run *run) {
    static const sweep s = {.what = "aspect",
                            .axis = {"longest axis over the shortest (1)", 1},
                            .values = {1, 3, 10, 30, 100, 300, 1000, 3000, 10000},
                            .modes = 2,
                            .make = of_aspect};
    run_sweep(run, &s);
}

static void over_distance(stab_run *run) {
    static const sweep s = {.what = "distance",
                            .axis = {"depth of the nearest (world units)", 1},
                            .values = {0.25, 1, 4, 16, 64, 256, 1024, 4096},
                            .modes = 1,
                            .make = at_distance};
    run_sweep(run, &s);
}

static void over_opacity(stab_run *run) {
    static const sweep s = {.what = "opacity",
                            .axis = {"opacity of all Gaussians (1)", 1},
                            .values = {0.005, 0.01, 0.03, 0.1, 0.3, 0.5, 0.7, 0.9, 0.98, 0.999},
                            .modes = 2,
                            .make = of_opacity};
    run_sweep(run, &s);
}

static void over_layers(stab_run *run) {
    static const sweep s = {.what = "the number of layers",
                            .axis = {"Gaussians that cover the picture (1)", 1},
                            .values = {1, 3, 10, 30, 100, 300, 1000, 3000},
                            .modes = 1,
                            .make = of_layers};
    run_sweep(run, &s);
}

static void over_side(stab_run *run) {
    static const sweep s = {.what = "the size of the picture",
                            .axis = {"side of the picture (px)", 1},
                            .values = {16, 24, 32, 48, 64, 128, 256, 512},
                            .modes = 1,
                            .make = of_side};
    run_sweep(run, &s);
}

#define ACCURACY_ROW(name, number, over, function)                                                           \
    const stab_row stab_row_##name = {                                                                       \
        .id = number,                                                                                        \
        .failure = "Accuracy of picture and gradients over " over,                                           \
        .cure = "Every level against float64; what is promised is in tests/stability/README.md. Gradients "  \
                "are relative to the largest of their array.",                                               \
        .quick = 1,                                                                                          \
        .run = function,                                                                                     \
    }

ACCURACY_ROW(A1, "A1", "aspect", over_aspect);
ACCURACY_ROW(A2, "A2", "distance", over_distance);
ACCURACY_ROW(A3, "A3", "opacity", over_opacity);
ACCURACY_ROW(A4, "A4", "the number of layers", over_layers);
ACCURACY_ROW(A5, "A5", "the size of the picture", over_side);

/* ---- the loss -------------------------------------------------------------------------------------------
 */

/* A smooth picture with noise, and one that differs from it. */
typedef struct pair {
    float *rgb, *target;
    double *rgb64, *target64, *d_rgb64;
} pair;

static pair make_pair(size_t values) {
    pair p = {calloc(values, sizeof(float)), calloc(values, sizeof(float)), test_ref_numbers(values),
              test_ref_numbers(values), test_ref_numbers(values)};
    sf_rng rng;
    assert_true(p.rgb && p.target);
    sf_rng_seed(&rng, values);
    for (size_t i = 0; i < values; i++) {
        p.target[i] = (float)(0.5 + 0.3 * sin(0.02 * (double)i) + 0.1 * sf_rng_normal(&rng));
        p.rgb[i] = p.target[i] + (float)(0.1 * sf_rng_normal(&rng));
        p.rgb64[i] = (double)p.rgb[i], p.target64[i] = (double)p.target[i];
    }
    return p;
}

static void free_pair(pair *p) {
    free(p->rgb);
    free(p->target);
    free(p->rgb64);
    free(p->target64);
    free(p->d_rgb64);
}

static found try_loss(const stab_lab *lab, const pair *p, int side, test_ref_loss expected) {
    size_t values = 3 * (size_t)side * (size_t)side;
    float *d_rgb = calloc(values, sizeof *d_rgb);
    sf_loss_value value;
    assert_non_null(d_rgb);
    assert_ok(lab->ctx, sf_loss(lab->renderer, &(sf_image_pair){side, side, p->rgb, p->target, NULL}, 0.2,
                                &value, d_rgb));
    found f = {fabs(value.loss - expected.loss),
               test_relative(test_worst_of(d_rgb, p->d_rgb64, values), p->d_rgb64, values)};
    free(d_rgb);
    return f;
}

static void over_loss(stab_run *run) {
    static const int sides[] = {8, 11, 16, 32, 64, 128, 256};
    enum { SIDES = sizeof sides / sizeof *sides };
    levels l = open_levels();
    found at[STAB_LEVELS][SIDES] = {{{0}}};
    size_t by = stab_count(run, 1, 2, 3), count = stab_count(run, SIDES, 6, 5);
    for (size_t i = 0; i < count; i += by) {
        pair p = make_pair(3 * (size_t)sides[i] * (size_t)sides[i]);
        test_ref_pair both = {sides[i], sides[i], p.rgb64, p.target64, NULL, 0.2, 0};
        test_ref_loss expected = test_ref_compare(&both, p.d_rgb64);
        for (size_t k = 0; k < l.count; k++) at[k][i] = try_loss(&l.labs[k], &p, sides[i], expected);
        free_pair(&p);
    }
    stab_chart_begin(run, "Error of the loss's gradient over the size of the picture",
                     (stab_axis){"side of the picture (px)", 1},
                     (stab_axis){"largest error, relative (1)", 1});
    for (size_t k = 0; k < l.count; k++) {
        found most = {0};
        stab_series_begin(run, STAB_OURS, "%s", l.names[k]);
        for (size_t i = 0; i < count; i += by) {
            stab_point(run, sides[i], at[k][i].gradient);
            most.rgb = fmax(most.rgb, at[k][i].rgb), most.gradient = fmax(most.gradient, at[k][i].gradient);
        }
        stab_at_most(run, most.rgb, 1e-6, "", "%s: loss", l.names[k]);
        stab_at_most(run, most.gradient, GRADIENT_BOUND, "", "%s: its gradient, relative", l.names[k]);
    }
    stab_bound_line(run, GRADIENT_BOUND, "promised");
    close_levels(&l);
}

const stab_row stab_row_A6 = {
    .id = "A6",
    .failure = "Accuracy of the loss and its gradient over the size of the picture",
    .cure = "Every level against float64, L1 and SSIM with lambda 0.2.",
    .quick = 1,
    .run = over_loss,
};
