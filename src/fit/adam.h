/* adam.h - Adam in float64 for the few learned values that are not of Gaussians. */
#ifndef SF_FIT_ADAM_H
#define SF_FIT_ADAM_H

#include <math.h>
#include <stdint.h>

#include <splatfit/fitter.h>

/* Moments of n values. */
typedef struct sf_small_moments {
    double *m, *v;
} sf_small_moments;

/* Step t (from 1) of n values: step[0..n-1] is to be subtracted from them. A value whose gradient is not
 * finite keeps its value and moments. Returns how many gradients were finite. */
static inline int sf_adam_small(const sf_fit_options *o, double rate, int64_t t, int n,
                                const double *gradient, sf_small_moments moments, double *step) {
    double *m = moments.m, *v = moments.v;
    double start1 = 1 - pow(o->adam_beta1, (double)t), start2 = 1 - pow(o->adam_beta2, (double)t);
    int finite = 0;
    for (int k = 0; k < n; k++) {
        step[k] = 0;
        if (!isfinite(gradient[k])) continue;
        m[k] = o->adam_beta1 * m[k] + (1 - o->adam_beta1) * gradient[k];
        v[k] = o->adam_beta2 * v[k] + (1 - o->adam_beta2) * gradient[k] * gradient[k];
        step[k] = rate / start1 * m[k] / (sqrt(v[k] / start2) + o->adam_epsilon);
        finite++;
    }
    return finite;
}

#endif
