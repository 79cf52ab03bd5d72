/* ransac.h - locally optimised random sample consensus (GEOMETRY.md, S.19). */
#ifndef SF_SFM_RANSAC_H
#define SF_SFM_RANSAC_H

#include <stddef.h>
#include <stdint.h>

/* Of doubles in a model; of items in a sample; of models from one sample. */
enum { SF_MODEL_MOST = 18, SF_SAMPLE_MOST = 8, SF_MODELS_MOST = 10 };

/* A kind of model, of `count` items. */
typedef struct sf_ransac_problem {
    const void *user;
    size_t count;
    int sample_size; /* items that a model is made from */
    int model_size;  /* doubles of a model */

    /* Models [most SF_MODELS_MOST][model_size] that the items of a sample agree with. Returns how many. */
    int (*solve)(const void *user, const uint32_t *sample, double *models);
    /* Moves the model to where it agrees best with all items whose weight [count] is not 0; the weights may
     * be overwritten. 0: it cannot, and the model does not matter any more. */
    int (*refit)(const void *user, double *weights, double *model);
    /* squared [end - begin]: the squares of the errors of items begin..end-1. */
    void (*errors)(const void *user, const double *model, size_t begin, size_t end, double *squared);
} sf_ransac_problem;

typedef struct sf_ransac_options {
    double threshold;   /* the greatest error of an inlier, in the units of the errors */
    double confidence;  /* that a sample of inliers alone was drawn, 0..1 */
    int least, most;    /* samples */
    size_t least_count; /* inliers: a model with fewer is of no use */
    uint64_t seed;
} sf_ransac_options;

typedef struct sf_ransac_result {
    double model[SF_MODEL_MOST];
    double cost;  /* sum of min(squared error / threshold^2, 1) */
    size_t count; /* inliers; 0: there is no model */
    int samples;  /* drawn */
} sf_ransac_result;

/* Looks for the model of least cost (MSAC). Each new best model is refitted to its inliers (LO-RANSAC).
 * scratch [2 count]; inliers [count] (may be NULL): flags. The same seed gives the same result. */
void sf_ransac(const sf_ransac_problem *problem, const sf_ransac_options *options, double *scratch,
               uint8_t *inliers, sf_ransac_result *result);

#endif
