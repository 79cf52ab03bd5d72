/* densify_relocate.h - Gaussians as samples: relocation and noise (3DGS-MCMC). */
#ifndef SF_FIT_DENSIFY_RELOCATE_H
#define SF_FIT_DENSIFY_RELOCATE_H

#include "fitter.h"

/* Moves Gaussians that are too faint or not finite to live ones, and adds `more`; of several ranks each does
 * so among its own, which are a sample of all: each goes to a Gaussian drawn by opacity, takes its degree,
 * and the opacities and scales there are corrected so that the picture stays. Does nothing where no Gaussian
 * is live. SF_ERR_MEMORY: nothing has changed. */
sf_status sf_relocate(sf_fitter *fitter, size_t more);
/* Opacity of each of n Gaussians that replace one of `opacity`, 0 < opacity < 1; *shrink: the factor of their
 * scales with which a line through the centre has the same integral. */
double sf_relocated_opacity(double opacity, uint32_t n, double *shrink);
/* Adds noise to the means of the faint Gaussians of blocks first .. end-1; strength: world units, for a
 * covariance of 1. */
void sf_inject_noise(sf_fitter *fitter, double strength, size_t first, size_t end);

#endif
