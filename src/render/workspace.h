/* workspace.h - the buffers of one step, and its stages: project, bin, blend, loss, and their backward
 * passes.
 *
 * Each stage is one function: it reads what earlier stages left in the workspace and writes one result. Where
 * the order of a sum depends on the division into tasks, that does not depend on the number of threads, and
 * tasks are summed in order: the same bytes for any number of threads.
 */
#ifndef SF_RENDER_WORKSPACE_H
#define SF_RENDER_WORKSPACE_H

#include "../base/context.h"
#include "../kernels/kernels.h"
#include "../scene/gaussians.h"

#include <splatfit/camera.h>
#include <splatfit/render.h>

enum {
    SF_PROJECT_BLOCKS = 16, /* blocks of SF_LANES Gaussians a task */
    SF_GRAD_BLOCKS = 4,     /* blocks whose gradients are passed on together: 15 KB, a part of the L1 cache */
    SF_CHANNELS = 3
};

/* A Gaussian's part in a row of tiles. */
typedef struct sf_strip {
    uint32_t depth; /* bits of the float */
    uint32_t gaussian, slot;
    sf_span span;
} sf_strip;

typedef struct sf_workspace {
    sf_context *ctx;
    struct sf_cluster
        *cluster; /* of the ranks that draw together, and what is shared: shard.h. NULL: alone */
    struct sf_shard *shard;
    int band_only; /* of a shared picture each rank has its band alone, and what the loss reads around it */

    /* the picture: planes of plane_rows x stride floats, both multiples of SF_TILE */
    sf_eye eye;
    int unit; /* the eye's lengths and all depths are in units of 2^unit: the model's (gaussians.h) */
    size_t stride, plane_rows, plane_capacity;
    float *rgb[SF_CHANNELS], *transmittance, *depth;
    float *d_rgb[SF_CHANNELS];
    uint32_t *last; /* [tiles][SF_TILE_PIXELS] */
    float background[3];

    /* Gaussians, [n] padded to SF_LANES */
    size_t count, gaussian_capacity;
    size_t banded[SF_BANDS]; /* as the model's */
    int sh_degree, antialiased;
    sf_params params;
    sf_splat *splats;
    uint8_t *state;
    uint8_t *in_view; /* [tasks of SF_PROJECT_BLOCKS] 0: all of them are known to be out of view */
    uint16_t *first_row, *rows;
    uint32_t *span_offset; /* [n] first span of each Gaussian */
    float *depth_of;       /* [n] */
    uint32_t *slot;        /* [n + 1] first slot of each Gaussian: its tiles in row-major order */
    float *screen;         /* [n] */
    float *grads;          /* SF_GRAD_BLOCKS blocks of all fields, one set a thread */
    size_t grads_capacity;
    uint64_t not_finite; /* Gaussians left out by the last project and project_bwd */

    /* tile lists */
    size_t strip_capacity, entry_capacity, tile_capacity;
    sf_span *spans;                  /* [strips] by Gaussian */
    sf_strip *strips, *strips_swap;  /* [strips] by row of tiles, in the memory of sums */
    uint32_t *tile_begin;            /* [tiles + 1] */
    uint32_t *entries, *entry_slots; /* [entries], by tile, near to far */
    uint32_t *bin_counts;            /* scratch */
    size_t bin_counts_capacity;
    uint64_t *entry_parts; /* [entries] what blend leaves for blend_bwd */
    float *sums;           /* [entries][SF_SUMS] by slot; bin's strips before */
    size_t sums_capacity;

    /* the loss: target and weight of the picture */
    float *target[SF_CHANNELS]; /* already times the weight */
    float *weight;              /* in use where has_weight */
    int has_weight;
    size_t loss_capacity;
    float *scratch; /* sf_loss_scratch, one a thread */
    size_t scratch_capacity;
    double *partial; /* sums of a stage, by task */
    size_t partial_capacity;
    unsigned *partial_count;
    size_t partial_count_capacity;
} sf_workspace;

void sf_workspace_init(sf_workspace *ws, sf_context *ctx);
void sf_workspace_free(sf_workspace *ws);

/* Chooses the camera and makes room for its picture. */
sf_status sf_workspace_look(sf_workspace *ws, const sf_camera *camera, float near_plane);
/* The camera's picture is compared with one of `factor` times its size, box-averaged by `factor`: adapts the
 * low-pass so that Gaussians look as they do after averaging. */
void sf_workspace_reduced(sf_workspace *ws, int factor);
/* Makes room for the loss's planes of the present picture. */
sf_status sf_workspace_loss_room(sf_workspace *ws);

/* The stages, in order. Those that return a status make room when the picture or the model has grown. */
/* sh_degree: the highest band to use, at most the model's. The model's arrays must stay until the backward
 * pass is done. */
sf_status sf_stage_project(sf_workspace *ws, const sf_model *model, int sh_degree, int antialiased);
sf_status sf_stage_bin(sf_workspace *ws);
void sf_stage_blend(sf_workspace *ws, const float background[3], int with_depth);

/* The loss of ws->rgb against ws->target (with ws->weight where has_weight) and, if with_gradient, ws->d_rgb.
 * lambda 0 leaves SSIM out (and value->ssim 0) unless with_ssim. delta: of Huber's loss, which replaces L1;
 * 0: L1. weight_sum: of the weights of all pixels. */
void sf_stage_loss(sf_workspace *ws, double lambda, double delta, double weight_sum, int with_ssim,
                   int with_gradient, sf_loss_value *value);

sf_status sf_stage_blend_bwd(sf_workspace *ws);
/* Runs blend_importance: its sums go to the slots; it reads ws->d_rgb and ws->weight, which is 0 outside the
 * picture. filled: called when the slots are filled, while those of several ranks are of the band that this
 * one draws; NULL: nothing. */
sf_status sf_stage_blend_importance(sf_workspace *ws, sf_status (*filled)(void *user), void *user);
/* Receives the gradients of blocks first .. end-1 while they are in the cache: at the start of the arrays of
 * grads. The array of a band is NULL if none of these blocks has it; lanes that lack a band have 0. grads is
 * NULL, and the blocks are all SF_PROJECT_BLOCKS of a task, if none of their Gaussians can be in the picture.
 * Called on the pool's threads, once for each block. */
typedef void (*sf_grads_fn)(void *user, const sf_params *grads, size_t first, size_t end);
/* camera: NULL or [SF_CAMERA_SUMS], overwritten. On failure `take` has not been called. */
sf_status sf_stage_project_bwd(sf_workspace *ws, double *camera, sf_grads_fn take, void *user);
/* dL/dbackground = sum T dL/dgamma, [3]. */
sf_status sf_stage_background_bwd(sf_workspace *ws, double *d_background);

/* quality.c: PSNR of a mean squared error, which is at least 1e-10. */
double sf_psnr_of(double mse);
/* The quality of ws->rgb, which it clamps to 0..1, against ws->target (with ws->weight where has_weight).
 * weight_sum: of the weights of all pixels, above 0. */
void sf_stage_quality(sf_workspace *ws, double weight_sum, sf_quality *quality);

/* Copies the planes to the caller's [H][W] and [H][W][3], and back (zeros beyond the picture). */
void sf_copy_out(const sf_workspace *ws, const sf_image_out *out);
void sf_copy_in(const sf_workspace *ws, const float *rgb, const float *weight, float *const plane[3]);

/* The whole forward pass: look, project, bin, blend. */
sf_status sf_forward(sf_workspace *ws, const sf_model *model, const sf_camera *camera,
                     const sf_render_options *options, int with_depth);

#endif
