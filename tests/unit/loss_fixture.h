/* loss_fixture.h - pictures to compare. */
#ifndef TESTS_UNIT_LOSS_FIXTURE_H
#define TESTS_UNIT_LOSS_FIXTURE_H

#include "testing.h"

#include "reference/random.h"

/* float32 against float64, as for the golden cases: values absolute, the gradient relative to its largest. */
extern const double loss_VALUE_BOUND, loss_GRADIENT_BOUND;

enum weighting {
    WEIGHT_NONE,     /* NULL */
    WEIGHT_ONE,      /* an array of 1 */
    WEIGHT_FRACTION, /* anything in 0..1 */
    WEIGHT_REGION,   /* a part of the picture does not count, with a soft edge */
    WEIGHTINGS
};

typedef struct pair {
    int width, height;
    size_t pixels;
    float *rgb, *target, *weight; /* weight NULL: 1 */
} pair;

float *loss_floats(size_t n);

/* Smooth pictures with noise, alike but for a tenth; a few values lie beyond 0..1. */
pair loss_pair_create(uint64_t seed, int width, int height, enum weighting how);
void loss_pair_free(pair *p);

/* A context and a renderer for a test. */
typedef struct bench {
    sf_context *ctx;
    sf_renderer *renderer;
} bench;

bench loss_bench_create(int threads);
void loss_bench_free(bench *b);
double *loss_to_double(const float *from, size_t n);

#endif
