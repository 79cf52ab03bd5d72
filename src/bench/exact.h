/* exact.h - blending in float64, straight from M.1 and M.2 of src/render/README.md. */
#ifndef BENCH_EXACT_H
#define BENCH_EXACT_H

#include "../render/workspace.h"

enum { EXACT_SUMS = 9 }; /* as blend_bwd's */

/* A Gaussian at a pixel. */
typedef struct exact_pair {
    double t, s;  /* whitened offsets */
    double alpha; /* clamped */
    int visible, clamped;
    int on_edge; /* so near to a threshold that float32 may fall on the other side */
} exact_pair;

exact_pair exact_evaluate(const sf_splat *s, int x, int y);

/* The x range, px, in which a Gaussian is visible at some dy of dy0 .. dy1. 0: in none. */
int exact_interval(const sf_splat *s, double dy0, double dy1, double *left, double *right);

typedef struct exact {
    size_t pixels, gaussians;
    double *rgb;       /* [3][pixels], pixels in the planes' order */
    uint8_t *left_out; /* [pixels] where a threshold is too near to be compared */
    double *sums;      /* [gaussians][EXACT_SUMS] */
} exact;

/* Blends a workspace's lists over its background; then sets ws->d_rgb to 0 where left_out, and takes that
 * gradient back to the Gaussians. */
sf_status exact_create(sf_workspace *ws, exact *ex);
void exact_destroy(sf_context *ctx, exact *ex);

#endif
