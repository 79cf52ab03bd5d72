/* match.h - depths of a view, by plane-sweep stereo with its neighbours. */
#ifndef SF_SCENE_MATCH_H
#define SF_SCENE_MATCH_H

#include "scene.h"

enum { SF_MATCH_NEIGHBOURS = 4 };

/* A view's picture in grey, box-averaged. */
typedef struct sf_grey {
    sf_camera camera; /* of this picture */
    int factor;       /* pixels of the view in one pixel of the picture, in each direction */
    size_t stride;    /* floats a row */
    float
        *values; /* [height][stride], -0.5..0.5; NaN where a pixel is masked, and in a margin on both sides */
} sf_grey;

/* Allocates the picture; sf_grey_fill makes it, of several views in parallel (errors as sf_view_open). */
sf_status sf_grey_create(sf_context *ctx, const sf_view *view, int factor, sf_grey *grey);
sf_status sf_grey_fill(const sf_context *ctx, const sf_view *view, sf_grey *grey);
void sf_grey_destroy(sf_context *ctx, sf_grey *grey);

/* The parameters of a sweep. */
typedef struct sf_match_range {
    double first, last; /* inverse depths (1 / camera z, 1 / world units), 0 <= first < last */
    int planes;         /* evenly spaced, >= 3 */
} sf_match_range;

/* Number of planes so that a pixel moves at most one pixel in a neighbour from one plane to the next, 8 ..
 * most. */
int sf_match_planes(const sf_grey *reference, const sf_grey *const *neighbours, size_t count, double first,
                    double last, int most);

/* Floats of scratch memory, 64-byte aligned, that sf_match needs for a picture of this size. */
size_t sf_match_scratch(const sf_camera *camera);

/* The inverse depth of every pixel of `reference` whose surroundings look like those at its place in one of
 * 1..SF_MATCH_NEIGHBOURS neighbours (in two of them where there are two), by normalised cross-correlation:
 * inverse_depth [height][width], 0: not found, for too little texture, too low a correlation, or another
 * depth that is nearly as good. score [height][width]: the correlation, 0..1. */
void sf_match(const sf_grey *reference, const sf_grey *const *neighbours, size_t count,
              const sf_match_range *range, float *scratch, float *inverse_depth, float *score);

#endif
