/* vec.h - the small vocabulary in which the vector kernels are written, once for all levels.
 *
 * A file of arch/vector is compiled once a level, with the level's flags and SF_LEVEL its name; the
 * vocabulary is defined a level in arch/x86 and arch/arm:
 *
 *   vf, vm, vu          VW floats; a mask of VW lanes; VW 32-bit integers
 *   vf_add ... vf_div   one operation each: operators on vectors are no vectors on armv7
 *   vf_fma(a,b,c)       a b + c, fused where the level can; vf_fnma: c - a b
 *   vf_load, vf_store   at VW floats' alignment; vf_loadu, vf_storeu anywhere
 *   vf_beside(p,k)      p[k ..] of an aligned p, |k| < 6
 *   vf_keep(m,a)        a where m, else 0;  vf_select(m,a,b)  a where m, else b
 *   vf_reciprocal       1 / a within 2^-22;  vf_root  no less than sqrt(a), within 2^-19; a >= 0
 *   vf_floor            for 0 <= x < 2^22;  vf_nearest  the nearest integer, for |x| < 2^22
 *   vf_times_exp2(p,n)  p 2^n for an integer n and normal results; elsewhere of no meaning
 *   vf_byte_sums(p,f)   the sums of f bytes each, f = 1, 2 or 4, from p on
 *   vf_bytes_twice(p)   VW / 2 bytes, each in two lanes that are neighbours
 *   vf_byte_triples(p,q) 3 VW bytes p[3 lane + k] to q[k]
 *   vu_of_pairs(p)      VW pairs of bytes, p[2 lane] + 256 p[2 lane + 1]
 *   vf_of_whole         integers below 2^24 as floats;  vf_whole  whole floats, 0 <= x < 2^24, as integers
 *   vf_gather2(p,u,a,b) p[u] and p[u + 1] of each lane's own place u below 2^31
 *   vf_evens, vf_odds   of each two neighbours the first, the second, in both lanes
 *   vf_sums8, vf_sum    the sums over the lanes of eight vectors, and of one
 *   vf_transpose        VW rows of 16 floats to 16 vectors
 *   vm_list(m,f,p)      the numbers f + lane of the lanes in m to p[0 ..], a byte each, and how many;
 *                       writes VW bytes
 *   vm_list_bits(b,f,p) the same of the lowest VM_BITS bits of an integer
 *   vu_pairs(a,b)       a + 65536 b of whole numbers below 65536
 *   vu_or_where(a,m,b)  a | b where m, else a
 *   vu_load_bytes       4 VW bytes at their alignment;  vu_dot4(s,a,b)  s and the products of each lane's
 * four bytes, none of which is above 127 vu_add, vu_and ...  one operation each, modulo 2^32; vu_left(a,n),
 * vu_right(a,n): by a constant vf_bits, vf_of_bits floats as their bits, and back block VB_COLUMNS x VB_ROWS
 * = VW pixels, row by row; vf_load_block, vf_store_block vd1, vdm1           VD1 doubles and a mask of them;
 * vd, vdm: two vectors of them, VD doubles vd_widen, vd_narrow from and to VD floats, aligned to the size of
 * one vector of them vd_reciprocal       1 / a, and vd_rsqrt  1 / sqrt(a), within 1e-15 vd_split            x
 * = m 2^exponent, 1 <= m < 2, for normal x > 0
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

/* 2^f on [-1/2, 1/2], highest power first: the polynomial of arch/scalar/exp2.h, of degree 5. The others, of
 * the least greatest relative error for their degree, are for the bench alone: 1.7e-3 at degree 2, 7.5e-5 at
 * 3, 2.6e-6 at 4, 1.9e-9 at 6, where float32 ends at 9e-8. */
#if !defined(SF_EXP_DEGREE)
#define SF_EXP_DEGREE 5
#endif
static const float vf_exp2_terms[] = {
#if SF_EXP_DEGREE == 2
    2.384289354e-01f, 7.034479976e-01f, 1.000443101e+00f
#elif SF_EXP_DEGREE == 3
    5.517166853e-02f, 2.426111251e-01f, 6.932609677e-01f, 9.999280572e-01f
#elif SF_EXP_DEGREE == 4
    9.570102207e-03f, 5.591785908e-02f, 2.402474433e-01f, 6.931217909e-01f, 9.999992847e-01f
#elif SF_EXP_DEGREE == 5
    1.327647217e-03f, 9.675541331e-03f, 5.550713273e-02f, 2.402211972e-01f,
    6.931469671e-01f, 1.000000072e+00f
#else
    1.534581243e-04f, 1.339993090e-03f, 9.618489072e-03f, 5.550328642e-02f,
    2.402264625e-01f, 6.931471825e-01f, 1.000000000e+00f
#endif
};

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

/* The projection's doubles come as pairs of vectors: its chains of dependent operations are long, and a
 * second one beside the first costs no time. */
enum { VD = 2 * VD1 };
typedef struct vd {
    vd1 a, b;
} vd;
typedef struct vdm {
    vdm1 a, b;
} vdm;

#define VD_OF_1(name)                                                                                        \
    VEC vd vd_##name(vd x) { return (vd){vd1_##name(x.a), vd1_##name(x.b)}; }
#define VD_OF_2(name)                                                                                        \
    VEC vd vd_##name(vd x, vd y) { return (vd){vd1_##name(x.a, y.a), vd1_##name(x.b, y.b)}; }
#define VD_OF_3(name)                                                                                        \
    VEC vd vd_##name(vd x, vd y, vd z) { return (vd){vd1_##name(x.a, y.a, z.a), vd1_##name(x.b, y.b, z.b)}; }
#define VDM_OF_2(name)                                                                                       \
    VEC vdm vd_##name(vd x, vd y) { return (vdm){vd1_##name(x.a, y.a), vd1_##name(x.b, y.b)}; }
VD_OF_1(reciprocal)
VD_OF_1(rsqrt)
VD_OF_1(floor)
VD_OF_1(nearest)
VD_OF_2(add)
VD_OF_2(sub)
VD_OF_2(mul)
VD_OF_2(min)
VD_OF_2(max)
VD_OF_2(times_exp2)
VD_OF_3(fma)
VD_OF_3(fnma)
VDM_OF_2(le)
VDM_OF_2(lt)

VEC vd vd_set(double x) { return (vd){vd1_set(x), vd1_set(x)}; }
VEC vd vd_load(const double *p) { return (vd){vd1_load(p), vd1_load(p + VD1)}; }
VEC void vd_store(double *p, vd x) { vd1_store(p, x.a), vd1_store(p + VD1, x.b); }
VEC vd vd_widen(const float *p) { return (vd){vd1_widen(p), vd1_widen(p + VD1)}; }
VEC void vd_narrow(float *p, vd x) { vd1_narrow(p, x.a), vd1_narrow(p + VD1, x.b); }
VEC vdm vdm_and(vdm x, vdm y) { return (vdm){vdm1_and(x.a, y.a), vdm1_and(x.b, y.b)}; }
VEC unsigned vdm_bits(vdm m) { return vdm1_bits(m.a) | vdm1_bits(m.b) << VD1; }
VEC vdm vdm_of(unsigned bits) { return (vdm){vdm1_of(bits & ((1u << VD1) - 1)), vdm1_of(bits >> VD1)}; }
VEC vd vd_keep(vdm m, vd x) { return (vd){vd1_keep(m.a, x.a), vd1_keep(m.b, x.b)}; }
VEC vd vd_select(vdm m, vd x, vd y) { return (vd){vd1_select(m.a, x.a, y.a), vd1_select(m.b, x.b, y.b)}; }
VEC vd vd_split(vd x, vd *exponent) {
    return (vd){vd1_split(x.a, &exponent->a), vd1_split(x.b, &exponent->b)};
}

/* 2^x, relative error below 1e-13; x is taken to [-1000, 1000] first. */
VEC vd vd_exp2(vd x) {
    /* ln(2)^k / k! */
    static const double terms[] = {4.4455382718708e-10, 7.0549116208011e-9, 1.0178086009239e-7,
                                   1.3215486790144e-6,  1.5252733804060e-5, 1.5403530393382e-4,
                                   1.3333558146428e-3,  9.6181291076285e-3, 5.5504108664822e-2,
                                   2.4022650695910e-1,  6.9314718055995e-1, 1};
    x = vd_max(vd_min(x, vd_set(1000)), vd_set(-1000));
    vd n = vd_nearest(x), f = vd_sub(x, n), p = vd_set(terms[0]);
    for (int i = 1; i < 12; i++) p = vd_fma(p, f, vd_set(terms[i]));
    return vd_times_exp2(p, n);
}

/* log2(x) for normal x > 0, absolute error below 1e-12: 2 atanh(z) / ln 2, z = (m - 1) / (m + 1). */
VEC vd vd_log2(vd x) {
    vd exponent, m = vd_split(x, &exponent), one = vd_set(1);
    vdm upper = vd_lt(vd_set(1.4142135623730951), m);
    m = vd_select(upper, vd_mul(m, vd_set(0.5)), m);
    exponent = vd_add(exponent, vd_keep(upper, one));
    vd z = vd_mul(vd_sub(m, one), vd_reciprocal(vd_add(m, one))), zz = vd_mul(z, z), p = vd_set(1.0 / 15);
    for (int k = 13; k > 0; k -= 2) p = vd_fma(p, zz, vd_set(1.0 / k));
    return vd_fma(vd_mul(vd_set(2.8853900817779268), z), p, exponent);
}

#endif
