/* init.h - the initialisation of a fit's Gaussians. */
#ifndef SF_SCENE_INIT_H
#define SF_SCENE_INIT_H

#include "../base/rng.h"
#include "gaussians.h"
#include "scene.h"

#include <splatfit/fitter.h>

typedef struct sf_init_options {
    sf_init from;
    size_t max_gaussians; /* a random choice of the points where there are more */
    size_t random_count;  /* of those at random */
    int sh_degree;
    double opacity;
    double scale;   /* standard deviation, in mean distances to the 3 nearest */
    int unit;       /* of the model's lengths: 2^unit world units */
    double extent;  /* of the scene, world units */
    double nearest; /* camera z from which on a sweep looks for surfaces, world units */
} sf_init_options;

/* Makes a model from points, as options->from says: the scene's sparse ones, those that a sweep finds
 * (sweep.h), or random ones along the rays of the training views. Colour from the point, scale from the mean
 * distance to its 3 nearest neighbours, identity rotation. SF_INIT_AUTO takes the first of these that has
 * enough points, and sparse points only if they lie on the surfaces that the pictures show. Random points
 * (random.h) replace a sweep that finds too few, and join a sweep's and, with SF_INIT_AUTO, the sparse ones.
 * SF_ERR_EMPTY: no training view, or SF_INIT_POINTS in a scene without points. */
sf_status sf_init_gaussians(sf_scene *scene, const sf_init_options *options, sf_rng *rng, sf_model **model);

/* Gaussian i of a model becomes that of a point: a ball of standard deviation `scale`, world units,
 * of the point's colour; neutral bands stay so. */
void sf_point_gaussian(const sf_params *params, size_t i, const float xyz[3], const uint8_t rgb[3],
                       double scale, double opacity);

#endif
