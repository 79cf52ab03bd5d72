/* vec.h - the small vocabulary in which the vector kernels are written, once for all levels.
 *
 * A file of arch/vector is compiled once a level, with the level's flags and SF_LEVEL its name; the
 * vocabulary is defined a level in arch/x86 and arch/arm:
 *
 *   vf, vm, vu      VW floats; a mask of VW lanes; VW 32-bit integers. + - * on vf are the compiler's.
 *   vf_fma(a,b,c)   a b + c, fused where the level can; vf_fnma: c - a b
 *   vf_load, vf_store  at VW floats' alignment; vf_loadu anywhere
 *   vf_keep(m,a)    a where m, else 0;  vf_select(m,a,b)  a where m, else b
 *   vm_bits(m)      lane i in bit i
 *   vf_exp2_parts   x = n + fraction, n the nearest integer;  vf_times_exp2(p,n)  p 2^n
 *   vf_sums8        the sums over the lanes of eight vectors;  vf_sum  of one
 *   vf_transpose    VW rows of 16 floats to 16 vectors
 *   block           VB_COLUMNS x VB_ROWS = VW pixels, row by row
 */
#ifndef SF_ARCH_VECTOR_VEC_H
#define SF_ARCH_VECTOR_VEC_H

#include <stddef.h>
#include <stdint.h>

#define VEC static inline __attribute__((always_inline, unused))

#define SF_JOIN_(a, b) a##_##b
#define SF_JOIN(a, b)  SF_JOIN_(a, b)
/* The name of a kernel at this level: sf_blend_avx2. */
#define SF_AT_LEVEL(name) SF_JOIN(name, SF_LEVEL)

#if defined(SF_LEVEL_avx512)
#include "../x86/avx512.h"
#elif defined(SF_LEVEL_avx2)
#include "../x86/avx2.h"
#elif defined(SF_LEVEL_sse4)
#include "../x86/sse4.h"
#elif defined(SF_LEVEL_neon)
#include "../arm/neon.h"
#endif

/* 2^x for x in [-126, 127]: the polynomial of arch/scalar/exp2.h. */
VEC vf vf_exp2(vf x) {
    vf n, f = vf_exp2_parts(x, &n);
    vf p = vf_fma(f, vf_set(1.327647217e-03f), vf_set(9.675541331e-03f));
    p = vf_fma(p, f, vf_set(5.550713273e-02f));
    p = vf_fma(p, f, vf_set(2.402211972e-01f));
    p = vf_fma(p, f, vf_set(6.931469671e-01f));
    p = vf_fma(p, f, vf_set(1.000000072e+00f));
    return vf_times_exp2(p, n);
}

#endif
