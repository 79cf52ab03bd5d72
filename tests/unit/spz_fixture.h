/* spz_fixture.h - models to be written as .spz, and how far what comes back may differ. */
#ifndef TESTS_UNIT_SPZ_FIXTURE_H
#define TESTS_UNIT_SPZ_FIXTURE_H

#include "testing.h"

enum { MAX_COUNT = 64, MAX_K = 16, HEADER = 16, MAX_FILE = 1 << 16 };

typedef struct values {
    float means[3 * MAX_COUNT], quats[4 * MAX_COUNT], log_scales[3 * MAX_COUNT], logit_opacities[MAX_COUNT];
    float sh[3 * MAX_K * MAX_COUNT];
} values;

/* Points at the arrays of `v`, for sf_model_set and sf_model_get. */
sf_gaussians spz_arrays_of(values *v);

/* A model of the first `count` Gaussians of `v`, at most MAX_COUNT; the caller destroys it. */
sf_model *spz_model_of(sf_context *ctx, values *v, size_t count, int degree);

/* What the format can hold; x rises with the number, by which the tests find a Gaussian again. */
void spz_make_values(values *v, int count, int coefficients, uint64_t seed);

/* A file as it is before gzip. */
typedef struct file {
    size_t size;
    uint8_t data[MAX_FILE];
} file;

void spz_assert_near(const char *what, double got, double expected, double bound);

/* 1 - |q.p| of unit quaternions bounds how far two rotations are apart. */
void spz_assert_same_rotation(const float *a, const float *b, double bound);

#endif
