/* select_importance.h - what each Gaussian is worth to the training views. */
#ifndef SF_FIT_WORTH_H
#define SF_FIT_WORTH_H

#include "fitter.h"

/* What happened in the tiles where one that stands for others on trial is seen, shared out among all such
 * there by their parts of the pixels. */
typedef struct sf_attributed_error {
    float now, before; /* squared error */
    float values;      /* weights of pixels, times the channels */
} sf_attributed_error;

/* Sums over views, their pixels (by weight) and channels, values 0..1. */
typedef struct sf_errors {
    double squares; /* squared errors */
    double toned; /* what is left of them where each view has the gain and bias, a channel, that suit it best:
                     no Gaussian has a part in the rest */
    double clumps; /* of those left: squares of the errors' sums over tiles of 16 by 16 pixels */
    double values; /* weights of the pixels, times the channels */
} sf_errors;

/* So many neighbouring values err together as if they were one, each view's gain and bias apart: 1 where each
 * errs by itself, SF_TILE^2 at most. */
double sf_correlation_area(const sf_errors *errors);

/* Squared errors are sums over the views, their pixels (by weight) and channels, values 0..1. Where only some
 * views are looked at, all sums but those of tiles are for as many as there are. */
typedef struct sf_importance {
    size_t count;
    size_t views; /* looked at */
    int whole;    /* all that are trained on were */
    sf_errors errors;
    float *removal; /* [count] what taking the Gaussian out adds to the squared error, all else as it is; may
                       be below 0 */
    float *effect;  /* [count] what that does to the pictures, squared: the removal where the residual is
                       noise */
    float *share;   /* [count] its part of the squared error: sum of w r^2 */
    float *mass;    /* [count] its part of the pixels: sum of w */
    float (*bands)[SF_MAX_SH_DEGREE]; /* [count] effect of leaving out the bands above 0, 1, 2 */
    sf_attributed_error *blame;                  /* [count] while pairs are on trial, else NULL */
    float *tiles;                     /* squared error of each tile of each view, as drawn */
    size_t tile_count, tile_capacity;
} sf_importance;

/* Weighs all Gaussians by `views` of the views that are trained on (0: all), evenly spread and the same each
 * time, at full resolution, with the degree and the background of the moment. The arrays are the caller's to
 * free with sf_importance_free, also on failure. SF_ERR_MEMORY. */
sf_status sf_measure_importance(sf_fitter *fitter, size_t views, sf_importance *worth);
/* Whether Gaussian i may be judged: what only views see that were not looked at may not. */
int sf_importance_is_known(const sf_importance *worth, size_t i);
void sf_importance_free(sf_context *ctx, sf_importance *worth);

/* The errors alone of `views` of them (0: all), after `level` halvings but counted as at full resolution.
 * SF_ERR_MEMORY. */
sf_status sf_measure_errors(sf_fitter *fitter, int level, size_t views, sf_errors *errors);

#endif
