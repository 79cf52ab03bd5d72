/* blur.c - rows of a picture made blurrier: lanes = columns. The operations of arch/scalar/blur.c in their
 * order, none of them fused, so that the floats are the same. */
#include "kernels.h"

#include "vec.h"

enum { SIDE = 4 }; /* vectors side by side: each sum is a chain */

/* 1. Down the columns, `n` vectors from column x on. */
VEC void blur_down(const sf_blur_args *a, int row, float *s, int x, int n) {
    const float *const *middle = a->rows + a->radius + row;
    vf sum[SIDE], tap = vf_set(a->taps[0]);
    for (int i = 0; i < n; i++) sum[i] = vf_mul(tap, vf_load(middle[0] + x + i * VW));
    for (int k = 1; k <= a->radius; k++) {
        const float *above = middle[-k] + x, *below = middle[k] + x;
        tap = vf_set(a->taps[k]);
        for (int i = 0; i < n; i++) {
            vf both = vf_add(vf_load(above + i * VW), vf_load(below + i * VW));
            sum[i] = vf_add(sum[i], vf_mul(tap, both));
        }
    }
    for (int i = 0; i < n; i++) vf_store(s + x + i * VW, sum[i]);
}

/* 3. Along the row. */
VEC void blur_along(const sf_blur_args *a, int row, const float *s, int x, int n) {
    const float *was = a->rows[a->radius + row] + x;
    float *out = a->out[row] + x, *difference = a->difference[row];
    vf sum[SIDE], tap = vf_set(a->taps[0]);
    s += x;
    for (int i = 0; i < n; i++) sum[i] = vf_mul(tap, vf_load(s + i * VW));
    for (int k = 1; k <= a->radius; k++) {
        tap = vf_set(a->taps[k]);
        for (int i = 0; i < n; i++) {
            vf both = vf_add(vf_loadu(s + i * VW - k), vf_loadu(s + i * VW + k));
            sum[i] = vf_add(sum[i], vf_mul(tap, both));
        }
    }
    for (int i = 0; i < n; i++) vf_store(out + i * VW, sum[i]);
    if (difference)
        for (int i = 0; i < n; i++) vf_store(difference + x + i * VW, vf_sub(sum[i], vf_load(was + i * VW)));
}

void SF_AT_LEVEL(sf_blur)(const sf_blur_args *args) {
    const sf_blur_args own = *args; /* which no store can change: it stays in registers */
    int whole = (own.width + SF_LANES - 1) / SF_LANES * SF_LANES, x = 0;
    float *first = own.scratch + SF_LANES;
    size_t stride = sf_blur_stride(own.width);
    /* All rows of some columns, which stay in the first cache. */
    for (; x + SIDE * VW <= whole; x += SIDE * VW)
        for (int row = 0; row < own.count; row++) blur_down(&own, row, first + (size_t)row * stride, x, SIDE);
    for (; x < whole; x += VW)
        for (int row = 0; row < own.count; row++) blur_down(&own, row, first + (size_t)row * stride, x, 1);
    for (int row = 0; row < own.count; row++) {
        float *s = first + (size_t)row * stride;
        /* 2. The ends go on, as far as whole vectors see. */
        for (int k = 1; k <= own.radius; k++) s[-k] = s[0];
        for (int k = own.width; k < whole + own.radius; k++) s[k] = s[own.width - 1];
        for (x = 0; x + SIDE * VW <= whole; x += SIDE * VW) blur_along(&own, row, s, x, SIDE);
        for (; x < whole; x += VW) blur_along(&own, row, s, x, 1);
    }
}
