/* kernels.c - fills in a table of kernels. */
#include "kernels.h"

void sf_kernels_init(sf_kernels *kernels, unsigned mask) {
    (void)mask;
    sf_kernels_init_scalar(kernels);
}

unsigned sf_cpu_detect(void) { return SF_CPU_SCALAR; }
