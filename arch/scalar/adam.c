/* adam.c - one step of Adam (Kingma and Ba 2015, algorithm 1), and of RMSProp, in plain C. */
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

void sf_adam_half_scalar(float *p, const float *g, uint32_t *moments, size_t n, const sf_adam *step,
                         uint32_t number) {
    for (size_t i = 0; i < n; i++) {
        float gradient = g[i] < -SF_MOMENT_MOST ? -SF_MOMENT_MOST : g[i];
        gradient = gradient > SF_MOMENT_MOST ? SF_MOMENT_MOST : gradient;
        float m = sf_float_of(moments[i] & 0xffff0000u), v = sf_float_of((moments[i] & 0xffffu) << 15);
        /* 1. moments */
        m = step->beta1 * m + (1.0f - step->beta1) * gradient;
        v = step->beta2 * v + (1.0f - step->beta2) * (gradient * gradient);
        /* 2. the step */
        p[i] -= step->rate * m / (sqrtf(v * step->v_scale) + step->epsilon);
        /* 3. rounding */
        uint32_t noise = sf_noise(number + (uint32_t)i);
        uint32_t high = sf_bits_of(m) + (noise >> 16), low = sf_bits_of(v) + (noise >> 17);
        moments[i] = (high & 0xffff0000u) | low >> 15;
    }
}

void sf_rmsprop_scalar(float *p, const float *g, float *v, size_t n, const sf_adam *step) {
    for (size_t i = 0; i < n; i++) {
        size_t red = sf_at(i, 3, 0), green = sf_at(i, 3, 1), blue = sf_at(i, 3, 2);
        /* 1. the second moment, of all channels */
        float square = (g[red] * g[red] + g[green] * g[green] + g[blue] * g[blue]) * (1.0f / 3);
        if (square > 0) v[i] = step->beta2 * v[i] + (1.0f - step->beta2) * square;
        /* 2. the step */
        float rate = step->rate / (sqrtf(v[i] * step->v_scale) + step->epsilon);
        p[red] -= rate * g[red];
        p[green] -= rate * g[green];
        p[blue] -= rate * g[blue];
    }
}
