/* vec.h - the small vocabulary in which the vector kernels are written, once for all levels.
 *
 * A file of arch/vector is compiled once a level, with the level's flags and SF_LEVEL its name; the
 * vocabulary is defined a level in arch/x86 and arch/arm:
 *
 *   vf, vm, vu      VW floats; a mask of VW lanes; VW 32-bit integers
 *   vf_fma(a,b,c)   a b + c, fused where the level can; vf_fnma: c - a b
 *   vf_load, vf_store  at VW floats' alignment; vf_loadu anywhere
 *   vf_keep(m,a)    a where m, else 0;  vf_select(m,a,b)  a where m, else b
 *   vf_reciprocal   1 / a within 2^-22;  vf_root  no less than sqrt(a), by at most 1/1000; a >= 0
 *   vm_list(m,f,p)  the numbers f + lane of the lanes in m to p[0 ..], a byte each, and how many; writes VW
 * bytes vf_nearest      the nearest integer, for |x| < 2^22;  vf_times_exp2(p,n)  p 2^n for an integer n,
 * normal results; elsewhere of no meaning vf_sums8        the sums over the lanes of eight vectors;  vf_sum
 * of one vf_transpose    VW rows of 16 floats to 16 vectors block           VB_COLUMNS x VB_ROWS = VW pixels,
 * row by row
 */
#ifndef SF_ARCH_VECTOR_VEC_H
#define SF_ARCH_VECTOR_VEC_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define VEC static inline __attribute__((always_inline, unused))

#define SF_JOIN_(a, b) a##_##b
#define SF_JOIN(a, b)  SF_JOIN_(a, b)
/* The name of a kernel at this level: sf_blend_avx2. */
#define SF_AT_LEVEL(name) SF_JOIN(name, SF_LEVEL)

/* vm_list of four lanes, for the levels that cannot compress a vector: four bytes by a table. */
VEC int vm_list4(unsigned bits, int first, uint8_t *out) {
    static const uint8_t lanes[16][4] = {{0, 0, 0, 0}, {0, 0, 0, 0}, {1, 0, 0, 0}, {0, 1, 0, 0},
                                         {2, 0, 0, 0}, {0, 2, 0, 0}, {1, 2, 0, 0}, {0, 1, 2, 0},
                                         {3, 0, 0, 0}, {0, 3, 0, 0}, {1, 3, 0, 0}, {0, 1, 3, 0},
                                         {2, 3, 0, 0}, {0, 2, 3, 0}, {1, 2, 3, 0}, {0, 1, 2, 3}};
    static const uint8_t counts[16] = {0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4};
    uint32_t four;
    memcpy(&four, lanes[bits], sizeof four);
    four += 0x01010101u * (uint32_t)first;
    memcpy(out, &four, sizeof four);
    return counts[bits];
}

#if defined(SF_LEVEL_avx512)
#include "../x86/avx512.h"
#elif defined(SF_LEVEL_avx2)
#include "../x86/avx2.h"
#elif defined(SF_LEVEL_sse4)
#include "../x86/sse4.h"
#elif defined(SF_LEVEL_neon)
#include "../arm/neon.h"
#endif

/* Degree of the polynomial of exp2: 5, and others for the bench alone. */
#if !defined(SF_EXP_DEGREE)
#define SF_EXP_DEGREE 5
#endif

/* 2^f on [-1/2, 1/2] by the polynomial of arch/scalar/exp2.h, highest power first. */
static const float vf_exp2_terms[] = {1.327647217e-03f, 9.675541331e-03f, 5.550713273e-02f,
                                      2.402211972e-01f, 6.931469671e-01f, 1.000000072e+00f};

/* 2^x of `steps` vectors side by side, for x in [-126, 127]; elsewhere of no meaning. */
VEC void vf_exp2(const vf *x, vf *out, int steps) {
    vf n[8], f[8];
    for (int k = 0; k < steps; k++) n[k] = vf_nearest(x[k]);
    for (int k = 0; k < steps; k++) f[k] = vf_sub(x[k], n[k]);
    for (int k = 0; k < steps; k++) out[k] = vf_set(vf_exp2_terms[0]);
    for (int i = 1; i <= SF_EXP_DEGREE; i++)
        for (int k = 0; k < steps; k++) out[k] = vf_fma(out[k], f[k], vf_set(vf_exp2_terms[i]));
    for (int k = 0; k < steps; k++) out[k] = vf_times_exp2(out[k], n[k]);
}

#endif
