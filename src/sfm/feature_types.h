/* feature_types.h - pictures, features, and what is wanted of them. */
#ifndef SF_SFM_FEATURE_TYPES_H
#define SF_SFM_FEATURE_TYPES_H

#include "../base/context.h"
#include "../kernels/kernels.h"

/* A grey picture, and which of its pixels count. */
typedef struct sf_photo {
    const uint8_t *pixels; /* rows of `stride` bytes */
    const uint8_t *mask;   /* the same for a mask, 0: no features there; NULL: all count */
    size_t stride;
    int width, height; /* px, 1..SF_FEATURES_SIDE */
} sf_photo;

enum { SF_FEATURES_SIDE = 28000 };

typedef struct sf_keypoint {
    float x, y;     /* px; pixel (0, 0) has its middle at (0.5, 0.5) */
    float scale;    /* px: the deviation of the Gaussian at which the point stands out */
    float angle;    /* radians from x towards y, in [0, 2 pi) */
    float response; /* how much it stands out: the absolute difference of Gaussians, of 0..1 */
} sf_keypoint;

/* Sorted by response, the greatest first. Free with sf_features_free. */
typedef struct sf_features {
    size_t count;
    sf_keypoint *points;
    uint8_t *descriptors; /* [count][SF_DESCRIPTOR], 0..SF_MATCH_MOST; their norms are nearly 512 */
} sf_features;

/* SF_UPSAMPLE_SMALL: pictures of up to SF_FEATURES_SMALL pixels. */
typedef enum sf_upsampling { SF_UPSAMPLE_NEVER, SF_UPSAMPLE_ALWAYS, SF_UPSAMPLE_SMALL } sf_upsampling;
enum { SF_FEATURES_SMALL = 3 << 19 };

typedef struct sf_features_options {
    size_t most;              /* features, the best by response; at least 1 */
    sf_upsampling upsampling; /* whether the scale space begins at twice the picture's size */
    double contrast;          /* least response, above 0 */
    double edge;              /* greatest ratio of the principal curvatures, above 1 */
    int directions;           /* 1 or 2: features a point may have, where two directions are as strong */
} sf_features_options;

#endif
