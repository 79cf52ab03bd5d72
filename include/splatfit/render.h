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

/* The workspace of rendering: tile lists and picture planes, reused from call to call. */
typedef struct sf_renderer sf_renderer;

/* How a model is rendered. Start from sf_render_options_default(). */
typedef struct sf_render_options {
    float background[3]; /* added as T_final * background */
    float near_plane;    /* world units: Gaussians with camera z <= near_plane are culled; 0: a tenth of the
                            depth that 2 % of the Gaussians in the picture are nearer than */
    int sh_degree;       /* bands used, 0..the model's; -1: all */
    int antialiased;     /* 1: with opacity compensation (M.3); 0: without; -1: as sf_model_antialiased */
} sf_render_options;

/* Black background, near plane 0.2, sh_degree -1, antialiased -1. */
SF_API sf_render_options sf_render_options_default(void);

/* Output arrays of the caller, row-major, H x W as the camera's picture. NULL: not wanted. */
typedef struct sf_image_out {
    float *rgb;           /* [H][W][3], with the background, not clamped */
    float *transmittance; /* [H][W], T after the last Gaussian */
    float *depth;         /* [H][W], sum of w z, world units; divide by 1 - T for the mean depth */
} sf_image_out;

/* Creates a renderer. One thread at a time may use it. */
SF_API sf_status sf_renderer_create(sf_context *context, sf_renderer **renderer);
SF_API void sf_renderer_destroy(sf_renderer **renderer);

/* Renders `model` as `camera` sees it (M.1). options NULL: the defaults. */
SF_API sf_status sf_render(sf_renderer *renderer, const sf_model *model, const sf_camera *camera,
                           const sf_render_options *options, const sf_image_out *out);

/* Output arrays of the caller for gradients. `gaussians` has the arrays of sf_gaussians for the model's count
 * and degree (bands above the rendered degree get 0); any pointer may be NULL. */
typedef struct sf_render_grads {
    sf_gaussians gaussians;
    double *pose;       /* [6]: rho, phi of the left twist p_c' = p_c + rho + phi x p_c (M.6) */
    double *background; /* [3] */
    double *focal;      /* [2]: of log fx, log fy */
} sf_render_grads;

/* From d_rgb = dL/dimage ([H][W][3]) of the picture of the last sf_render, computes the gradients of the raw
 * parameters and of the camera (M.2, M.3, M.4, M.6). Culled Gaussians get 0. SF_ERR_ARGUMENT: there was no
 * sf_render before, it rendered another model object, or the model was changed since. */
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

/* Image quality of a picture against a target. */
typedef struct sf_quality {
    double psnr; /* dB, values clamped to 0..1, not rounded; MSE floored at 1e-10 */
    double ssim; /* as in sf_loss_value, of the clamped picture */
    /* PSNR without the effect of exposure: psnr of the right half of the picture after a gain and a bias per
     * channel, fitted to the left half by least squares. The fit clamps the picture at 2, not at 1, since a
     * darker exposure shows detail above white, and leaves out pixels where the target is white. Equal to
     * psnr where a half has no weight or is white. */
    double psnr_corrected;
} sf_quality;

/* PSNR and SSIM of `rgb` against `target`; `weight` as in sf_image_pair. */
SF_API sf_status sf_compare(sf_renderer *renderer, int width, int height, const float *rgb,
                            const float *target, const float *weight, sf_quality *quality);

#ifdef __cplusplus
}
#endif
#endif
