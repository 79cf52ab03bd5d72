/* render.h - the differentiable renderer on its own, the loss, and the figures of merit.
 *
 * M.1 to M.6 are the equations of src/render/README.md.
 */
#ifndef SPLATFIT_RENDER_H
#define SPLATFIT_RENDER_H

#include "camera.h"
#include "model.h"

#ifdef __cplusplus
extern "C" {
#endif

/* What rendering needs beside the model: lists and planes, kept for the next picture. */
typedef struct sf_renderer sf_renderer;

/* How a model is rendered. Start from sf_render_options_default(). */
typedef struct sf_render_options {
    float background[3]; /* added as T_final * background */
    float near_plane;    /* world units, > 0: Gaussians with camera z <= near_plane are culled */
    int sh_degree;       /* bands used, 0..the model's; -1: all */
    int antialiased;     /* 1: opacity compensation (M.3); 0: not; -1: as the model says */
} sf_render_options;

/* Black background, near plane 0.2, all bands, as the model says. */
SF_API sf_render_options sf_render_options_default(void);

/* Pictures of the caller's, row-major, H x W of the camera. NULL where not wanted. */
typedef struct sf_image_out {
    float *rgb;           /* [H][W][3], with the background, not clamped */
    float *transmittance; /* [H][W], T after the last Gaussian */
    float *depth;         /* [H][W], sum of w z, world units; divide by 1 - T for the mean depth */
} sf_image_out;

/* A renderer keeps its workspace from call to call. One thread at a time may use it. */
SF_API sf_status sf_renderer_create(sf_context *context, sf_renderer **renderer);
SF_API void sf_renderer_destroy(sf_renderer **renderer);

/* Renders `model` as `camera` sees it (M.1). options NULL: the defaults. */
SF_API sf_status sf_render(sf_renderer *renderer, const sf_model *model, const sf_camera *camera,
                           const sf_render_options *options, const sf_image_out *out);

/* Gradients of the caller's. Arrays of `gaussians` as sf_gaussians says, with the model's count and degree
 * (bands above the degree rendered get 0); any pointer may be NULL. */
typedef struct sf_render_grads {
    sf_gaussians gaussians;
    double *pose;       /* [6]: rho, phi of the left twist p_c' = p_c + rho + phi x p_c (M.6) */
    double *background; /* [3] */
    double *focal;      /* [2]: of log fx, log fy */
} sf_render_grads;

/* Takes dL/dimage ([H][W][3]) of the last sf_render back to the raw parameters and the camera (M.2, M.3, M.4,
 * M.6). Gaussians that were culled get 0. SF_ERR_ARGUMENT: no sf_render came before, it rendered another
 * model (of equal values, too, or one that is destroyed by now), or the model was changed since. */
SF_API sf_status sf_render_backward(sf_renderer *renderer, const sf_model *model, const float *d_rgb,
                                    const sf_render_grads *grads);

/* A loss and its parts, means over the weighted pixels. */
typedef struct sf_loss_value {
    double loss; /* (1 - lambda) l1 + lambda (1 - ssim) */
    double l1;   /* mean absolute difference */
    double ssim; /* 11 x 11 Gaussian window, sigma 1.5, zero padding */
} sf_loss_value;

/* Two pictures that are compared. */
typedef struct sf_image_pair {
    int width, height;         /* px */
    const float *rgb, *target; /* [H][W][3] */
    const float *weight;       /* of each pixel, [H][W], 0..1; NULL: 1 */
} sf_image_pair;

/* The training loss of M.5 between a pair, with lambda in 0..1. d_rgb ([H][W][3], may be NULL) receives
 * dL/drgb. SF_ERR_ARGUMENT: a size, lambda or weight is out of its range; SF_ERR_EMPTY: the weights sum to
 * 0. */
SF_API sf_status sf_loss(sf_renderer *renderer, const sf_image_pair *pair, double lambda,
                         sf_loss_value *value, float *d_rgb);

/* How near a picture is to another. */
typedef struct sf_quality {
    double psnr; /* dB, values clamped to 0..1, not rounded; MSE floored at 1e-10 */
    double ssim; /* as in sf_loss_value, of the clamped picture */
    /* As psnr, of the right half of the picture, with a gain and a bias per channel that were fitted to the
     * left half by least squares: what is left when exposure does not count. They are those of values up to
     * 2, since less light shows what is brighter than white, and where the target is white nothing is fitted.
     * Of no meaning (psnr is given) where a half has no weight, or is white. */
    double psnr_corrected;
} sf_quality;

/* PSNR and SSIM of `rgb` against `target`; `weight` as in sf_image_pair. */
SF_API sf_status sf_compare(sf_renderer *renderer, int width, int height, const float *rgb,
                            const float *target, const float *weight, sf_quality *quality);

#ifdef __cplusplus
}
#endif
#endif
