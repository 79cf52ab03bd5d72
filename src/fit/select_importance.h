/* select_importance.h - importance: how much each Gaussian lowers the squared error of the training views. */
#ifndef SF_FIT_SELECT_IMPORTANCE_H
#define SF_FIT_SELECT_IMPORTANCE_H

#include "fitter.h"

/* Squared error of the tiles in which a tentatively merged Gaussian is visible, attributed by blend weight to
 * the merged Gaussians there. */
typedef struct sf_attributed_error {
    float now, before; /* squared error after and before the merges */
    float values;      /* pixel weights, times the channels */
} sf_attributed_error;

/* Sums over views, pixels (by weight) and channels; values in 0..1. */
typedef struct sf_errors {
    double squares;     /* squared error */
    double corrected;   /* squared error after the least-squares gain and bias of each view and channel, which
                           no Gaussian could correct */
    double tile_energy; /* of the corrected errors: squares of their sums over tiles of 16 by 16 pixels */
    double values;      /* pixel weights, times the channels */
} sf_errors;

/* Correlation area of the corrected residuals, in values: 1 where they are independent, SF_TILE^2 at most. */
double sf_correlation_area(const sf_errors *errors);

/* Sums as in sf_errors. Where only some of the views are measured, all sums but those of tiles are scaled up
 * to all views. Arrays are [count], of each Gaussian. */
typedef struct sf_importance {
    size_t count;
    size_t views; /* measured */
    int whole;    /* every view that is trained on was measured */
    sf_errors errors;
    float *sse_change;   /* change of the squared error if the Gaussian alone is removed; may be below 0 */
    float *score;        /* squared change of the pictures: sse_change where the residual is noise */
    float *error_share;  /* sum of w r^2, w: blend weight, r: residual */
    float *blend_weight; /* sum of w */
    float (*bands)[SF_MAX_SH_DEGREE]; /* score of the bands above 0, 1, 2 */
    sf_attributed_error *attributed;  /* during tentative merges, else NULL */
    float *tiles;                     /* squared error of each tile of each view, as rendered */
    size_t tile_count, tile_capacity;
} sf_importance;

/* Measures the importance of all Gaussians in `views` of the views that are trained on (0: all), evenly
 * spread and the same each time, at full resolution, with the present degree and background. The arrays are
 * the caller's to free with sf_importance_free, also on failure. SF_ERR_MEMORY. */
sf_status sf_measure_importance(sf_fitter *fitter, size_t views, sf_importance *importance);
/* Whether the importance of Gaussian i is known: not if only views that were not measured see it. */
int sf_importance_is_known(const sf_importance *importance, size_t i);
void sf_importance_free(sf_context *ctx, sf_importance *importance);

/* The errors alone of `views` views (0: all), after `level` halvings but counted as at full resolution.
 * SF_ERR_MEMORY. */
sf_status sf_measure_errors(sf_fitter *fitter, int level, size_t views, sf_errors *errors);

#endif
