/* interval.h - where Gaussians are visible within a band of rows, in vectors of Gaussians: sf_interval of
 * arch/scalar/interval.h, with lanes. */
#ifndef SF_ARCH_VECTOR_INTERVAL_H
#define SF_ARCH_VECTOR_INTERVAL_H

#include "vec.h"

/* Fields of sf_splat; u and v, and what comes of them, from an origin of the caller's. */
typedef struct ellipses {
    vf u, v, slope, reach, squeeze, lean;
} ellipses;

/* The x range in which o g >= 1/255 for some dy of [top, bottom] (offsets from the means), and a hundredth of
 * a pixel more. */
VEC void interval(const ellipses *g, vf top, vf bottom, vf *left, vf *right) {
    vf zero = vf_set(0), pad = vf_set(0.01f);
    vf at_right = vf_min(vf_max(g->lean, top), bottom);
    vf at_left = vf_min(vf_max(vf_neg(g->lean), top), bottom);
    vf half_right = vf_root(vf_max(vf_fnma(g->squeeze, vf_mul(at_right, at_right), g->reach), zero));
    vf half_left = vf_root(vf_max(vf_fnma(g->squeeze, vf_mul(at_left, at_left), g->reach), zero));
    *right = vf_add(vf_fma(g->slope, at_right, g->u), vf_add(half_right, pad));
    *left = vf_sub(vf_fma(g->slope, at_left, g->u), vf_add(half_left, pad));
}

#endif
