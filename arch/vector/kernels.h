/* kernels.h - the vector kernels, by level; the contracts are in src/kernels/kernels.h. */
#ifndef SF_ARCH_VECTOR_KERNELS_H
#define SF_ARCH_VECTOR_KERNELS_H

#include "../../src/kernels/kernels.h"

#define SF_VECTOR_KERNELS(level)                                                                             \
    void sf_project_##level(const sf_project_args *args, size_t first, size_t end);                          \
    void sf_project_bwd_##level(const sf_project_bwd_args *args, size_t first, size_t end);                  \
    void sf_blend_##level(const sf_blend_args *args);                                                        \
    void sf_loss_##level(const sf_loss_args *args);                                                          \
    void sf_blend_bwd_##level(const sf_blend_args *args);                                                    \
    void sf_adam_##level(float *p, const float *g, float *m, float *v, size_t n, const sf_adam *step);

SF_VECTOR_KERNELS(sse4)
SF_VECTOR_KERNELS(avx2)
SF_VECTOR_KERNELS(avx512)
SF_VECTOR_KERNELS(neon)

/* Enters a level's kernels into a table. */
#define SF_VECTOR_ENTER(kernels, at_level)                                                                   \
    do {                                                                                                     \
        (kernels)->isa = #at_level;                                                                          \
        SF_KERNEL_ENTER(kernels, project, at_level);                                                         \
        SF_KERNEL_ENTER(kernels, project_bwd, at_level);                                                     \
        SF_KERNEL_ENTER(kernels, blend, at_level);                                                           \
        SF_KERNEL_ENTER(kernels, loss, at_level);                                                            \
        SF_KERNEL_ENTER(kernels, blend_bwd, at_level);                                                       \
        SF_KERNEL_ENTER(kernels, adam, at_level);                                                            \
    } while (0)

#endif
