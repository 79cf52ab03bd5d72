/* exp2.h - the one exp2 of all levels: 2^n with n the nearest integer, times a polynomial of degree 5 on
 * [-1/2, 1/2]. For x in [-126, 127]; relative error below 2.4e-7 (measured over all floats of [-9, 1] by
 * tests/unit/test_kernels.c). */
#ifndef SF_ARCH_SCALAR_EXP2_H
#define SF_ARCH_SCALAR_EXP2_H

#include <stdint.h>
#include <string.h>

static inline float sf_exp2(float x) {
    const float magic = 12582912.0f; /* 1.5 x 2^23: adding it rounds to an integer, held in the low bits */
    float shifted = x + magic;
    float f = x - (shifted - magic);
    float p = 1.327647217e-03f;
    p = p * f + 9.675541331e-03f;
    p = p * f + 5.550713273e-02f;
    p = p * f + 2.402211972e-01f;
    p = p * f + 6.931469671e-01f;
    p = p * f + 1.000000072e+00f;
    uint32_t n, bits;
    memcpy(&n, &shifted, sizeof n);
    memcpy(&bits, &p, sizeof bits);
    bits += n << 23;
    memcpy(&p, &bits, sizeof p);
    return p;
}

#endif
