/* adam.c - one step of Adam (Kingma and Ba 2015, algorithm 1), in plain C. */
#include "scalar.h"

#include <math.h>

void sf_adam_scalar(float *p, const float *g, float *m, float *v, size_t n, const sf_adam *step) {
    for (size_t i = 0; i < n; i++) {
        /* 1. moments */
        m[i] = step->beta1 * m[i] + (1.0f - step->beta1) * g[i];
        v[i] = step->beta2 * v[i] + (1.0f - step->beta2) * (g[i] * g[i]);
        /* 2. the step */
        p[i] -= step->rate * m[i] / (sqrtf(v[i] * step->v_scale) + step->epsilon);
    }
}
