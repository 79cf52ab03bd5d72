/* blur.c - rows of a picture made blurrier, in plain C. */
#include "scalar.h"

/* 1. Down the columns, the middle first, then outwards. */
static float blur_down(const sf_blur_args *a, int row, int x) {
    const float *const *middle = a->rows + a->radius + row;
    float sum = a->taps[0] * middle[0][x];
    for (int k = 1; k <= a->radius; k++) sum = sum + a->taps[k] * (middle[-k][x] + middle[k][x]);
    return sum;
}

void sf_blur_scalar(const sf_blur_args *args) {
    const sf_blur_args *a = args;
    float *s = a->scratch + SF_LANES;
    for (int row = 0; row < a->count; row++) {
        for (int x = 0; x < a->width; x++) s[x] = blur_down(a, row, x);
        /* 2. The ends go on. */
        for (int k = 1; k <= a->radius; k++) {
            s[-k] = s[0];
            s[a->width - 1 + k] = s[a->width - 1];
        }
        /* 3. Along the row. */
        for (int x = 0; x < a->width; x++) {
            float sum = a->taps[0] * s[x];
            for (int k = 1; k <= a->radius; k++) sum = sum + a->taps[k] * (s[x - k] + s[x + k]);
            a->out[row][x] = sum;
            if (a->difference[row]) a->difference[row][x] = sum - a->rows[a->radius + row][x];
        }
    }
}
