/* interval.h - where a Gaussian is visible within a band of rows, in plain C. */
#ifndef SF_ARCH_SCALAR_INTERVAL_H
#define SF_ARCH_SCALAR_INTERVAL_H

#include "scalar.h"

#include <math.h>

/* Unlike fminf and fmaxf these compile to one instruction; arguments are numbers. */
static inline float sf_least(float a, float b) { return a < b ? a : b; }
static inline float sf_greatest(float a, float b) { return a > b ? a : b; }

/* The x range, px, in which o g >= 1/255 for some dy of [dy0, dy1] (offsets from the mean). The right
 * boundary slope dy + sqrt(reach - squeeze dy^2) is concave with its peak at dy = lean, the left one mirrors
 * it: the extremes lie at the clamped +-lean. A hundredth of a pixel is added, so that a rounding error loses
 * nothing. */
static inline void sf_interval(const sf_splat *s, float dy0, float dy1, float *left, float *right) {
    float at_right = sf_least(sf_greatest(s->lean, dy0), dy1),
          at_left = sf_least(sf_greatest(-s->lean, dy0), dy1);
    float half_right = sqrtf(sf_greatest(s->reach - s->squeeze * at_right * at_right, 0.0f));
    float half_left = sqrtf(sf_greatest(s->reach - s->squeeze * at_left * at_left, 0.0f));
    *right = s->u + s->slope * at_right + half_right + 0.01f;
    *left = s->u + s->slope * at_left - half_left - 0.01f;
}

#endif
