/* outcome.h - what the library makes of a scene of the reference: picture and gradients, to be compared. */
#ifndef TESTS_OUTCOME_H
#define TESTS_OUTCOME_H

#include <math.h>

#include "random.h"

typedef struct test_outcome {
    size_t pixels, count;
    int sh_degree;
    float *rgb, *transmittance, *depth; /* [pixels][3], [pixels], [pixels] */
    sf_gaussians gradient;
    double pose[6], background[3], focal[2];
} test_outcome;

/* All 0; free it with test_outcome_free. */
test_outcome test_outcome_create(const test_ref_scene *scene);
void test_outcome_free(test_outcome *o);

/* dL/dimage of no particular loss: waves about 1, so that no sum is small by cancellation alone. */
static inline float test_d_rgb_at(size_t i) { return (float)(1 + 0.7 * sin(0.37 * (double)i)); }
/* The same as an array [pixels][3]; free() it. */
float *test_d_rgb(size_t pixels);

/* Rendered with test_d_rgb taken back; a call that fails fails the test in progress. */
test_outcome test_outcome_of(sf_context *ctx, sf_renderer *renderer, const test_ref_scene *scene);
/* The same with another dL/dimage, [pixels][3]. */
test_outcome test_outcome_with(sf_context *ctx, sf_renderer *renderer, const test_ref_scene *scene,
                               const float *d_rgb);
/* As test_outcome_of, with a new context. */
test_outcome test_outcome_alone(const test_ref_scene *scene, int threads);

/* The same of the reference. */
void test_ref_outcome(const test_ref_scene *scene, test_ref_frame *frame, test_ref_grads *grads);

/* The largest |got - expected|; NaN counts as infinite. */
double test_worst_of(const float *got, const double *expected, size_t n);
double test_worst_of_doubles(const double *got, const double *expected, size_t n);
/* `worst` in units of the largest of `expected`, unless that is 0. */
double test_relative(double worst, const double *expected, size_t n);

/* What two outcomes of scenes of one shape differ in by any bit, by its name; NULL: in nothing. */
const char *test_outcome_apart(const test_outcome *a, const test_outcome *b);

/* Whether all values of an outcome are finite. */
int test_outcome_is_finite(const test_outcome *o);

#endif
