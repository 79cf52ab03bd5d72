/* robust.h - robust scales and weights of residuals (README, P.3). */
#ifndef SF_POSE_ROBUST_H
#define SF_POSE_ROBUST_H

#include <math.h>
#include <stddef.h>

#include "../base/statistics.h"

/* Scale of Cauchy's weights, in standard deviations: 95 % efficient (README, P.3). */
#define SF_CAUCHY 2.385

/* Cauchy's cost, c^2/2 log(1 + r^2/c^2), and the weight of the residual, 1 / (1 + r^2/c^2), from r^2 and c^2
 * > 0. */
static inline double sf_cauchy_cost(double r2, double c2) { return c2 * log1p(r2 / c2) / 2; }
static inline double sf_cauchy_weight(double r2, double c2) { return c2 / (c2 + r2); }

/* The standard deviation (px, a coordinate) of which `count` distances, reordered, have their median; 0
 * without. The median of Rayleigh's distribution is sigma sqrt(2 ln 2). */
static inline double sf_spread(double *distances, size_t count) {
    return sf_median(distances, count) / sqrt(2 * log(2));
}

#endif
