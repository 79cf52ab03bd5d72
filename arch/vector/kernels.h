/* kernels.h - the vector kernels, by level; the contracts are in src/kernels/kernels.h. */
#ifndef SF_ARCH_VECTOR_KERNELS_H
#define SF_ARCH_VECTOR_KERNELS_H

#include "../../src/kernels/kernels.h"

/* Every kernel has its vector form, with the scalar one's name and arguments. */
#define SF_VECTOR_KERNELS(level)                                                                             \
    void sf_convert_##level(const sf_convert_args *args);                                                    \
    void sf_project_##level(const sf_project_args *args, size_t first, size_t end);                          \
    void sf_spans_##level(const sf_splat *splats, const uint16_t *first_row, const uint16_t *rows,           \
                          const uint32_t *offset, size_t first, size_t end, int tiles_x, sf_span *spans,     \
                          uint32_t *tiles, float *depth);                                                    \
    void sf_blend_##level(const sf_blend_args *args);                                                        \
    void sf_unpack_##level(const uint8_t *src, const uint8_t *weight, size_t src_stride, int factor,         \
                           float *dst, int width);                                                           \
    void sf_loss_##level(const sf_loss_args *args);                                                          \
    void sf_blend_bwd_##level(const sf_blend_args *args);                                                    \
    void sf_blend_importance_##level(const sf_blend_args *args);                                             \
    void sf_project_bwd_##level(const sf_project_bwd_args *args, size_t first, size_t end);                  \
    void sf_adam_##level(float *p, const float *g, float *m, float *v, size_t n, const sf_adam *step);       \
    void sf_adam_half_##level(float *p, const float *g, uint32_t *moments, size_t n, const sf_adam *step,    \
                              uint32_t number);                                                              \
    void sf_rmsprop_##level(float *p, const float *g, float *v, size_t n, const sf_adam *step);              \
    void sf_blur_##level(const sf_blur_args *args);                                                          \
    size_t sf_extrema_##level(const sf_extrema_args *args);                                                  \
    void sf_orient_##level(const sf_patch_args *args);                                                       \
    void sf_describe_##level(const sf_patch_args *args);                                                     \
    void sf_match_##level(const sf_match_args *args);                                                        \
    void sf_schur_##level(const sf_schur_args *args);

SF_VECTOR_KERNELS(sse4)
SF_VECTOR_KERNELS(avx2)
SF_VECTOR_KERNELS(avx512)
SF_VECTOR_KERNELS(neon)

/* With instructions that not all processors of the level have. */
void sf_match_avx512_vnni(const sf_match_args *args);
void sf_match_neon_dot(const sf_match_args *args);

#endif
