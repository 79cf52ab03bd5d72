/* kernels.c - fills in a table of kernels, scalar first, then upward. */
#include "kernels.h"

void sf_kernels_init(sf_kernels *kernels, unsigned mask) {
    sf_kernels_init_scalar(kernels);
#if defined(__x86_64__) || defined(__i386__)
    sf_kernels_init_x86(kernels, mask);
#elif defined(__arm__) || defined(__aarch64__)
    sf_kernels_init_arm(kernels, mask);
#else
    (void)mask;
#endif
}
