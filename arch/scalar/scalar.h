/* scalar.h - the specification of every kernel in plain C; the contracts are in src/kernels/kernels.h. */
#ifndef SF_ARCH_SCALAR_SCALAR_H
#define SF_ARCH_SCALAR_SCALAR_H

#include "../../src/kernels/kernels.h"

void sf_convert_scalar(const sf_convert_args *args);
void sf_project_scalar(const sf_project_args *args, size_t first, size_t end);
void sf_project_bwd_scalar(const sf_project_bwd_args *args, size_t first, size_t end);
void sf_spans_scalar(const sf_splat *splats, const uint16_t *first_row, const uint16_t *rows,
                     const uint32_t *offset, size_t first, size_t end, int tiles_x, sf_span *spans,
                     uint32_t *tiles, float *depth);
void sf_blend_scalar(const sf_blend_args *args);
void sf_blend_bwd_scalar(const sf_blend_args *args);
void sf_blend_importance_scalar(const sf_blend_args *args);
void sf_loss_scalar(const sf_loss_args *args);
void sf_adam_scalar(float *p, const float *g, float *m, float *v, size_t n, const sf_adam *step);
void sf_adam_half_scalar(float *p, const float *g, uint32_t *moments, size_t n, const sf_adam *step,
                         uint32_t number);
void sf_rmsprop_scalar(float *p, const float *g, float *v, size_t n, const sf_adam *step);
void sf_unpack_scalar(const uint8_t *src, const uint8_t *weight, size_t src_stride, int factor, float *dst,
                      int width);
void sf_blur_scalar(const sf_blur_args *args);
size_t sf_extrema_scalar(const sf_extrema_args *args);
void sf_orient_scalar(const sf_patch_args *args);
void sf_describe_scalar(const sf_patch_args *args);
void sf_match_scalar(const sf_match_args *args);
void sf_schur_scalar(const sf_schur_args *args);

#endif
