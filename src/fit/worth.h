/* worth.h - what each Gaussian, and each band of its spherical harmonics, is worth to the training views. */
#ifndef SF_FIT_WORTH_H
#define SF_FIT_WORTH_H

#include "fitter.h"

/* Squared errors are sums over the views, their pixels (by weight) and channels, values 0..1. */
typedef struct sf_worth {
    size_t count;
    double squares;  /* squared error of the views */
    double values;   /* weights of their pixels, times the channels */
    double clumping; /* values that go together: (sum of r over a tile)^2 by sum of r^2, of all tiles */
    float *removal;  /* [count] what taking the Gaussian out adds to the squared error (may be below 0); exact
                        for one alone */
    float *share;    /* [count] its part of the squared error: sum of w r^2 */
    float *weight;   /* [count] sum of w, px */
    uint16_t *views; /* [count] views that show it */
} sf_worth;

/* Looks at every training view that is trained on, at the level, degree and background of the moment.
 * The arrays are the caller's to free with sf_worth_free, also on failure. SF_ERR_MEMORY. */
sf_status sf_weigh(sf_fitter *fitter, sf_worth *worth);
void sf_worth_free(sf_context *ctx, sf_worth *worth);

#endif
