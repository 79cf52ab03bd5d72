/* prune.h - removes the Gaussians and SH bands of a model that its scene needs least. */
#ifndef SPLATFIT_PRUNE_H
#define SPLATFIT_PRUNE_H

#include "fitter.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Start from sf_prune_options_default(). */
typedef struct sf_prune_options {
    double loss;         /* dB, >= 0: the PSNR of the training views may fall by this much */
    size_t keep;         /* above 0: exactly this many Gaussians are left, whatever the PSNR; SH bands stay */
    int random;          /* 1: Gaussians are removed in a random order that the seed fixes; SH bands stay */
    int keep_sh;         /* 1: SH bands stay */
    uint64_t seed;       /* of the random order, and of refitting */
    int64_t refit_steps; /* after deeper cuts, fit for this many steps to recover the PSNR; 0: no refitting */
    sf_render_options
        render; /* background and near plane; all bands are rendered, antialiased as the model */
} sf_prune_options;

/* loss 0.1, keep 0, random 0, keep_sh 0, seed 1, no refitting; background black; near plane 0, which stands
 * for that of a fit of the scene. */
SF_API sf_prune_options sf_prune_options_default(void);

/* What pruning did. PSNRs are means of sf_quality's psnr over the training views. */
typedef struct sf_prune_result {
    double psnr_before, psnr_after; /* dB, of the given model and of the pruned one */
    size_t renders;                 /* how often all training views were rendered */
} sf_prune_result;

/* Makes *pruned, the smallest model found whose PSNR over the training views of `scene` is at most
 * options->loss below that of `model`, which is not changed. In rounds, the Gaussians of least importance are
 * removed, as many as the measured PSNR allows; then SH bands, which become 0. With refit_steps, larger cuts
 * are tried, each followed by a fit, and kept if the fit reaches the same PSNR. Held-out views are not used.
 * The result has the same bytes for any number of threads. options NULL: the defaults; result may be NULL.
 * SF_ERR_ARGUMENT: an option out of range (named), keep larger than the model; SF_ERR_EMPTY: no Gaussian, no
 * training view; SF_ERR_MEMORY. On failure *pruned is NULL. */
SF_API sf_status sf_prune(sf_context *context, sf_scene *scene, const sf_model *model,
                          const sf_prune_options *options, sf_model **pruned, sf_prune_result *result);

#ifdef __cplusplus
}
#endif
#endif
