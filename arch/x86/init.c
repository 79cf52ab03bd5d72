/* init.c - the levels of x86, upward. */
#include "../vector/kernels.h"

void sf_kernels_init_x86(sf_kernels *kernels, unsigned mask) {
    if (mask & SF_CPU_SSE4) SF_VECTOR_ENTER(kernels, sse4);
    if (mask & SF_CPU_AVX2) SF_VECTOR_ENTER(kernels, avx2);
    if (mask & SF_CPU_AVX512) SF_VECTOR_ENTER(kernels, avx512);
}
