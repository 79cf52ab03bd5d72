/* init.c - the levels of ARM, upward. */
#include "../vector/kernels.h"

static void enter_neon(sf_kernels *kernels) {
    kernels->isa = "neon";
#define ENTER(name) SF_KERNEL_ENTER(kernels, name, neon);
    SF_KERNELS(ENTER)
#undef ENTER
}

void sf_kernels_init_arm(sf_kernels *kernels, unsigned mask) {
    if (mask & SF_CPU_NEON) enter_neon(kernels);
#if defined(__aarch64__)
    if (mask & SF_CPU_DOT) kernels->match = sf_match_neon_dot;
#endif
}
