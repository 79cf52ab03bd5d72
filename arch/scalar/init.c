/* init.c - the scalar table. */
#include "scalar.h"

void sf_kernels_init_scalar(sf_kernels *kernels) {
    kernels->isa = "scalar";
#define ENTER(name) SF_KERNEL_ENTER(kernels, name, scalar);
    SF_KERNELS(ENTER)
#undef ENTER
}
