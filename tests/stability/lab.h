/* lab.h - what the experiments share: a renderer, scenes of few Gaussians before a plain camera, and how far
 * the library is from float64 on them. */
#ifndef TESTS_STABILITY_LAB_H
#define TESTS_STABILITY_LAB_H

#include "../reference/outcome.h"
#include "stability.h"

typedef struct stab_lab {
    sf_context *ctx;
    sf_renderer *renderer;
} stab_lab;

/* isa: a kernel level; NULL: as the environment says. */
stab_lab stab_lab_open(const char *isa);
void stab_lab_close(stab_lab *lab);

/* The levels that this machine has, lowest first; how many. Where SPLATFIT_ISA names one, that alone: make
 * check runs the program once a level. */
enum { STAB_LEVELS = 8 };
size_t stab_levels(const char *names[STAB_LEVELS]);

/* The worse of two errors; one that is not finite is infinite, where fmax() leaves NaN out. */
static inline double stab_worse(double a, double b) { return isfinite(b) ? fmax(a, b) : INFINITY; }

/* The largest magnitude of n values. */
double stab_most_of(const double *values, size_t n);

/* Uniform, rounded to a float: what library and reference both take as it is. */
double stab_between(sf_rng *rng, double least, double most);

/* One of three counts, by effort. */
size_t stab_count(const stab_run *run, size_t whole, size_t quick, size_t emulated);

/* `count` Gaussians over black, before a camera at the origin that looks along +z, with the given focal
 * length (px) and its centre in the middle: round, of scale 1, 1 before it, SH degree 0, colour 0.9, opacity
 * 0.9. The caller frees scene.gaussians. */
test_ref_scene stab_scene(size_t count, int width, int height, double focal);
void stab_set_opacity(test_ref_scene *scene, size_t i, double opacity);

/* What float64 makes of a scene, and dL/dimage: test_d_rgb, but 0 at pixels where some Gaussian's opacity is
 * within 1 % of the least that counts, or T within 0.1 % of its end. There float32 may fall on the other
 * side, and the picture is not compared. */
typedef struct stab_truth {
    const test_ref_scene *scene;
    test_ref_frame frame;
    test_ref_grads grads;
    uint8_t *left_out; /* [pixels] */
    float *d_rgb;      /* [pixels][3] */
    double units[TEST_REF_ARRAYS];
} stab_truth;

stab_truth stab_truth_of(const test_ref_scene *scene);
void stab_truth_free(stab_truth *truth);

/* Errors against it. Those of gradients are relative to the truth's units: the largest of the array; of means
 * and quaternions, at least what it would be if all pixels pulled one way across the Gaussian's narrow side,
 * since rounding counts against that, and the pulls of both sides may cancel. */
typedef struct stab_errors {
    double rgb, transmittance; /* absolute, the largest of all pixels */
    double gradient[TEST_REF_ARRAYS];
    double worst_gradient; /* of these */
} stab_errors;

stab_errors stab_errors_of(const stab_truth *truth, const test_outcome *o);
/* The library's. */
stab_errors stab_compare(const stab_lab *lab, const stab_truth *truth);
/* Of gradients alone: the largest. */
double stab_gradient_error(const stab_truth *truth, const test_ref_gaussians *got);

/* The loss sum d_rgb rgb of the reference, whose gradient test_outcome_of gives. */
double stab_ref_loss(const test_ref_scene *scene);
/* Its derivative by a value of the scene, by central differences with a step of h; the value is as it was. */
double stab_difference(const test_ref_scene *scene, double *at, double h);

#endif
