/* prune.h - a model taken down to what its scene needs. */
#ifndef SPLATFIT_PRUNE_H
#define SPLATFIT_PRUNE_H

#include "fitter.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Start from sf_prune_options_default(). */
typedef struct sf_prune_options {
    double loss;         /* dB, >= 0: by so much the PSNR of the training views may fall */
    size_t keep;         /* above 0: so many Gaussians are left, whatever it costs; SH bands stay */
    int random;          /* 1: Gaussians go at random, one order for all numbers; SH bands stay */
    int keep_sh;         /* 1: SH bands stay */
    uint64_t seed;       /* of what is random, and of refitting */
    int64_t refit_steps; /* optimisation steps after which what went too far may be good again; 0: none */
    sf_render_options render; /* background and near plane; all bands, as the model says */
} sf_prune_options;

/* loss 0.1, keep 0, nothing random, seed 1, no refitting; black, near plane 0: as a fit of the scene. */
SF_API sf_prune_options sf_prune_options_default(void);

/* Means over the training views of sf_quality's psnr, dB. */
typedef struct sf_prune_result {
    double psnr_before, psnr_after; /* dB, of the model that came and of the one that is left */
    size_t renders;                 /* of all training views */
} sf_prune_result;

/* Makes *pruned, the smallest model found whose PSNR over the training views of `scene` is at most
 * options->loss below that of `model`, which stays as it is: its least worthy Gaussians go, in rounds, as
 * many as true renders allow; then SH bands, which become 0. With refit_steps what is left is fitted on after
 * further cuts, and those kept that reach the same PSNR. Held-out views are not looked at. The same bytes for
 * any number of threads. options NULL: the defaults; result may be NULL.
 * SF_ERR_ARGUMENT: an option out of range (named), keep larger than the model; SF_ERR_EMPTY: no Gaussian, no
 * training view; SF_ERR_MEMORY. On failure *pruned is NULL. */
SF_API sf_status sf_prune(sf_context *context, sf_scene *scene, const sf_model *model,
                          const sf_prune_options *options, sf_model **pruned, sf_prune_result *result);

#ifdef __cplusplus
}
#endif
#endif
