/* spz_fixture.c - makes models and compares values. */
#include "spz_fixture.h"

#include <math.h>

#include "base/rng.h"

sf_gaussians spz_arrays_of(values *v) {
    return (sf_gaussians){v->means, v->quats, v->log_scales, v->logit_opacities, v->sh};
}

sf_model *spz_model_of(sf_context *ctx, values *v, size_t count, int degree) {
    sf_model *model;
    sf_gaussians g = spz_arrays_of(v);
    assert_ok(ctx, sf_model_create(ctx, count, degree, &model));
    assert_ok(ctx, sf_model_set(model, 0, count, &g));
    return model;
}

static float within(sf_rng *rng, double least, double most) {
    return (float)(least + (most - least) * sf_rng_uniform(rng));
}

void spz_make_values(values *v, int count, int coefficients, uint64_t seed) {
    sf_rng rng;
    sf_rng_seed(&rng, seed);
    for (int i = 0; i < count; i++) {
        for (int k = 0; k < 3; k++) v->means[3 * i + k] = within(&rng, -4, 4);
        v->means[3 * i] = (float)i / 8;
        for (int k = 0; k < 4; k++) v->quats[4 * i + k] = (float)sf_rng_normal(&rng);
        for (int k = 0; k < 3; k++) v->log_scales[3 * i + k] = within(&rng, -9.9, 5.9);
        v->logit_opacities[i] = within(&rng, -5, 5);
        for (int k = 0; k < 3 * coefficients; k++)
            v->sh[3 * coefficients * i + k] = within(&rng, -0.96, 0.96);
    }
}

void spz_assert_near(const char *what, double got, double expected, double bound) {
    if (!(fabs(got - expected) <= bound)) fail_msg("%s is %g, not %g within %g", what, got, expected, bound);
}

void spz_assert_same_rotation(const float *a, const float *b, double bound) {
    double dot = 0, aa = 0, bb = 0;
    for (int k = 0; k < 4; k++) {
        dot += (double)a[k] * (double)b[k];
        aa += (double)a[k] * (double)a[k];
        bb += (double)b[k] * (double)b[k];
    }
    spz_assert_near("the rotation's cosine", fabs(dot) / sqrt(aa * bb), 1, bound);
}
