/* init.c - the level of ARM. */
#include "../vector/kernels.h"

void sf_kernels_init_arm(sf_kernels *kernels, unsigned mask) {
    if (mask & SF_CPU_NEON) SF_VECTOR_ENTER(kernels, neon);
}
