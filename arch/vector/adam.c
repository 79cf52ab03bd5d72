/* adam.c - one step of Adam (Kingma and Ba 2015, algorithm 1), in vectors of parameters. */
#include "kernels.h"

#include "vec.h"

void SF_AT_LEVEL(sf_adam)(float *p, const float *g, float *m, float *v, size_t n, const sf_adam *step) {
    vf beta1 = vf_set(step->beta1), rest1 = vf_set(1.0f - step->beta1);
    vf beta2 = vf_set(step->beta2), rest2 = vf_set(1.0f - step->beta2);
    vf rate = vf_set(step->rate), v_scale = vf_set(step->v_scale), epsilon = vf_set(step->epsilon);
    for (size_t i = 0; i < n; i += VW) {
        /* 1. moments */
        vf gradient = vf_load(g + i);
        vf first = vf_fma(beta1, vf_load(m + i), vf_mul(rest1, gradient));
        vf second = vf_fma(beta2, vf_load(v + i), vf_mul(rest2, vf_mul(gradient, gradient)));
        vf_store(m + i, first);
        vf_store(v + i, second);
        /* 2. the step */
        vf down = vf_add(vf_sqrt(vf_mul(second, v_scale)), epsilon);
        vf_store(p + i, vf_sub(vf_load(p + i), vf_div(vf_mul(rate, first), down)));
    }
}
