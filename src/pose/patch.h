/* patch.h - small pieces of a picture, found again in another one (README, P.8). */
#ifndef SF_POSE_PATCH_H
#define SF_POSE_PATCH_H

#include <stdint.h>

#include "../base/context.h"

#include <splatfit/camera.h>

enum {
    SF_PYRAMID_LEVELS = 3, /* a picture, and so many halvings less one */
    SF_PATCH_REACH = 4,    /* px around its middle that a patch is compared in */
    SF_STORED_REACH = 10,  /* px that are kept of it, for it to be turned and made larger */
    SF_STORED_SIDE = 2 * SF_STORED_REACH + 1
};

/* The grey of a colour (BT.601). */
static inline float sf_grey(float red, float green, float blue) {
    return 0.299f * red + 0.587f * green + 0.114f * blue;
}

/* A picture's greys, 0..1, each level half the size of the one before. */
typedef struct sf_pyramid {
    struct {
        int width, height;
        float *grey; /* [height][width] */
        size_t capacity;
    } levels[SF_PYRAMID_LEVELS];
} sf_pyramid;

/* rgb: planes of height x stride floats, 0..1. */
sf_status sf_pyramid_make(sf_context *ctx, const sf_camera *camera, float *const rgb[3], size_t stride,
                          sf_pyramid *pyramid);
void sf_pyramid_free(sf_context *ctx, sf_pyramid *pyramid);

/* What is around a pixel, at each level, 0..255. */
typedef struct sf_patch {
    uint8_t grey[SF_PYRAMID_LEVELS][SF_STORED_SIDE * SF_STORED_SIDE];
} sf_patch;

/* 0 where too much of it lies outside of the picture. */
int sf_patch_cut(const sf_pyramid *pyramid, double u, double v, sf_patch *patch);

/* Looks for a patch near (*u, *v), px of the finest level, from level `coarsest` on, and moves them to where
 * it is, to parts of a pixel. `back` (2 x 2): displacements in this picture to those in the patch's. Returns
 * the correlation there, -1..1; -2 where it is not found. */
double sf_patch_find(const sf_pyramid *pyramid, const sf_patch *patch, const double back[4], int coarsest,
                     double *u, double *v);

/* cornerness[width]: how well the finest level tells where each pixel of row y is: the least eigenvalue of
 * the mean square slopes around it, greys a px; 0 where these would reach out of the picture. */
void sf_cornerness(const sf_pyramid *pyramid, int y, float *cornerness);

#endif
