/* fits.h - what experiments share that are whole fits: a scene, a fit of it that is looked at on the way, and
 * its curve. */
#ifndef TESTS_STABILITY_FITS_H
#define TESTS_STABILITY_FITS_H

#include "sim/sim.h"
#include "stability.h"

enum { STAB_LOOKS = 256 };

/* A fit, and what its held-out views said. */
typedef struct stab_fit {
    sf_quality quality; /* at the end */
    sf_fit_progress progress;
    size_t looks;
    double steps[STAB_LOOKS], psnr[STAB_LOOKS], gaussians[STAB_LOOKS];
    double best; /* dB, of all looks */
    size_t most; /* Gaussians after any step */
} stab_fit;

/* The defaults with `steps` and a cap of Gaussians that is filled: small pictures, few steps. */
sf_fit_options stab_fit_options(int64_t steps, int64_t max_gaussians);

/* Fits the scene; looks at the held-out views after every `every` steps and at
 * the end, 0: at the end alone. `fitter` (may be NULL) is given the fitter, the caller's to destroy. */
stab_fit stab_fit_scene(sf_context *ctx, sf_scene *scene, const sf_fit_options *options, int64_t every,
                        sf_fitter **fitter);

/* The held-out PSNR over the steps, as a series of the last chart. */
void stab_draw_fit(stab_run *run, stab_line line, const stab_fit *fit, const char *name);

/* Loads a scene whose every n-th view is held out, its pictures reduced by `downscale`. */
sf_scene *stab_load(sf_context *ctx, const char *path, int hold_out, int downscale);

/* What a camera sees of the simulated studio, as a picture holds it: rgb [height][width][3], sRGB bytes. */
void stab_draw_studio(sf_context *ctx, const sf_sim *sim, const sf_camera *camera, uint8_t *rgb);

/* A project in the folder that SPLATFIT_DATA names; NULL: the variable is not set. */
sf_scene *stab_load_real(sf_context *ctx, const char *name, int hold_out, int downscale);

/* The name of the real scene of these experiments. */
#define STAB_FOX "fox-centred-270"

#endif
