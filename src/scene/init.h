/* init.h - initialisation: the first Gaussians of a fit. */
#ifndef SF_SCENE_INIT_H
#define SF_SCENE_INIT_H

#include "../base/rng.h"
#include "gaussians.h"
#include "scene.h"

#include <splatfit/fitter.h>

typedef struct sf_init_options {
    sf_init from;
    size_t max_gaussians; /* at most this many points are used, evenly chosen */
    size_t random_count;  /* number of random points */
    int sh_degree;
    double opacity;
    double scale;   /* standard deviation, in mean distances to the 3 nearest */
    double extent;  /* of the scene, world units */
    double nearest; /* least depth at which a sweep looks for surfaces, camera z, world units */
} sf_init_options;

/* Makes a model from points, as options->from says: the scene's sparse points, points from plane-sweep stereo
 * (sweep.h), or random ones along the rays of the training views. Colour from the point, scale from the mean
 * distance to its 3 nearest neighbours, identity rotation. SF_INIT_AUTO takes the first kind in that order
 * of which there are enough; sparse points only if they agree with the pictures. A sweep that finds too few
 * is replaced by random points. SF_ERR_EMPTY: no training view, or SF_INIT_POINTS in a scene without points.
 */
sf_status sf_init_gaussians(sf_scene *scene, const sf_init_options *options, sf_rng *rng, sf_model **model);

/* Sets Gaussian i of a model from a point: a sphere of standard deviation `scale`, world units, of the
 * point's colour; other bands are not changed. */
void sf_point_gaussian(const sf_params *params, size_t i, const float xyz[3], const uint8_t rgb[3],
                       double scale, double opacity);

#endif
