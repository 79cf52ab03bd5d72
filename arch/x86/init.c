/* init.c - the levels of x86, upward. */
#include "../vector/kernels.h"

static void enter_sse4(sf_kernels *kernels) {
    kernels->isa = "sse4";
#define ENTER(name) SF_KERNEL_ENTER(kernels, name, sse4);
    SF_KERNELS(ENTER)
#undef ENTER
}

static void enter_avx2(sf_kernels *kernels) {
    kernels->isa = "avx2";
#define ENTER(name) SF_KERNEL_ENTER(kernels, name, avx2);
    SF_KERNELS(ENTER)
#undef ENTER
}

static void enter_avx512(sf_kernels *kernels) {
    kernels->isa = "avx512";
#define ENTER(name) SF_KERNEL_ENTER(kernels, name, avx512);
    SF_KERNELS(ENTER)
#undef ENTER
}

void sf_kernels_init_x86(sf_kernels *kernels, unsigned mask) {
    if (mask & SF_CPU_SSE4) enter_sse4(kernels);
    if (mask & SF_CPU_AVX2) enter_avx2(kernels);
    if (mask & SF_CPU_AVX512) enter_avx512(kernels);
    if (mask & SF_CPU_VNNI) kernels->match = sf_match_avx512_vnni;
}
