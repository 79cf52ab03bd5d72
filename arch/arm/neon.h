/* neon.h - the vector vocabulary (arch/vector/vec.h) in NEON with fused multiply-add: 4 lanes, blocks of 2
 * x 2. */
#ifndef SF_ARCH_ARM_NEON_H
#define SF_ARCH_ARM_NEON_H

#include <arm_neon.h>

enum { VW = 4, VB_COLUMNS = 2, VB_ROWS = 2 };
typedef float32x4_t vf;
typedef uint32x4_t vm;
typedef uint32x4_t vu;

VEC vf vf_set(float x) { return vdupq_n_f32(x); }
VEC vf vf_load(const float *p) { return vld1q_f32(p); }
VEC vf vf_beside(const float *p, int k) { return vld1q_f32(p + k); }
VEC vf vf_loadu(const float *p) { return vld1q_f32(p); }
VEC void vf_storeu(float *p, vf a) { vst1q_f32(p, a); }
VEC void vf_store(float *p, vf a) { vst1q_f32(p, a); }
VEC vf vf_add(vf a, vf b) { return vaddq_f32(a, b); }
VEC vf vf_sub(vf a, vf b) { return vsubq_f32(a, b); }
VEC vf vf_mul(vf a, vf b) { return vmulq_f32(a, b); }
VEC vf vf_neg(vf a) { return vnegq_f32(a); }
VEC vf vf_fma(vf a, vf b, vf c) { return vfmaq_f32(c, a, b); }
VEC vf vf_fnma(vf a, vf b, vf c) { return vfmsq_f32(c, a, b); }
VEC vf vf_min(vf a, vf b) { return vminq_f32(a, b); }
VEC vf vf_max(vf a, vf b) { return vmaxq_f32(a, b); }
#if defined(__aarch64__)
VEC vf vf_sqrt(vf a) { return vsqrtq_f32(a); }
VEC vf vf_div(vf a, vf b) { return vdivq_f32(a, b); }
VEC float vf_sum(vf a) { return vaddvq_f32(a); }
#else
/* armv7 has estimates alone: two steps of Newton's bring them to float32; zero and
 * infinity stay what they are. */
VEC vf vf_sqrt(vf a) {
    vf r = vrsqrteq_f32(a);
    r = vmulq_f32(r, vrsqrtsq_f32(vmulq_f32(a, r), r));
    r = vmulq_f32(r, vrsqrtsq_f32(vmulq_f32(a, r), r));
    vf root = vmulq_f32(a, r);
    root = vreinterpretq_f32_u32(vandq_u32(vreinterpretq_u32_f32(root), vcgtq_f32(a, vdupq_n_f32(0))));
    return vbslq_f32(vceqq_f32(a, vdupq_n_f32(__builtin_inff())), a, root);
}
VEC vf vf_div(vf a, vf b) {
    vf r = vrecpeq_f32(b);
    r = vmulq_f32(r, vrecpsq_f32(b, r));
    r = vmulq_f32(r, vrecpsq_f32(b, r));
    vf q = vmulq_f32(a, r); /* and once more for the quotient: b / b is 1 */
    return vfmaq_f32(q, r, vfmsq_f32(a, b, q));
}
VEC float vf_sum(vf a) {
    float32x2_t half = vadd_f32(vget_low_f32(a), vget_high_f32(a));
    return vget_lane_f32(vpadd_f32(half, half), 0);
}
#endif

VEC vf vf_reciprocal(vf a) {
    vf r = vrecpeq_f32(a);
    r = vmulq_f32(r, vrecpsq_f32(a, r));
    return vmulq_f32(r, vrecpsq_f32(a, r));
}
VEC vf vf_root(vf a) { /* an estimate within 2^-8, and two steps of Newton's */
    vf r = vrsqrteq_f32(vmaxq_f32(a, vdupq_n_f32(1e-30f)));
    r = vmulq_f32(r, vrsqrtsq_f32(vmulq_f32(a, r), r));
    r = vmulq_f32(r, vrsqrtsq_f32(vmulq_f32(a, r), r));
    return vmulq_f32(vmulq_f32(a, r), vdupq_n_f32(1 + 0x1p-20f));
}

VEC vm vf_ge(vf a, vf b) { return vcgeq_f32(a, b); }
VEC vm vf_le(vf a, vf b) { return vcleq_f32(a, b); }
VEC vm vm_and(vm a, vm b) { return vandq_u32(a, b); }
VEC unsigned vm_bits(vm m) {
    static const uint32_t lane[4] = {1, 2, 4, 8};
    uint32x4_t bits = vandq_u32(m, vld1q_u32(lane));
    uint32x2_t half = vorr_u32(vget_low_u32(bits), vget_high_u32(bits));
    return vget_lane_u32(half, 0) | vget_lane_u32(half, 1);
}
VEC int vm_any(vm m) {
    uint32x2_t half = vorr_u32(vget_low_u32(m), vget_high_u32(m));
    return (vget_lane_u32(half, 0) | vget_lane_u32(half, 1)) != 0;
}
VEC int vm_list(vm m, int first, uint8_t *out) { return vm_list4(vm_bits(m), first, out); }
enum { VM_BITS = 4 };
VEC int vm_list_bits(uint64_t bits, int first, uint8_t *out) { return vm_list4((unsigned)bits, first, out); }
VEC vf vf_keep(vm m, vf a) { return vreinterpretq_f32_u32(vandq_u32(m, vreinterpretq_u32_f32(a))); }
VEC vf vf_select(vm m, vf a, vf b) { return vbslq_f32(m, a, b); }
VEC vu vu_zero(void) { return vdupq_n_u32(0); }
VEC vu vu_or_where(vu a, vm m, uint32_t bits) { return vorrq_u32(a, vandq_u32(m, vdupq_n_u32(bits))); }
VEC vu vu_pairs(vf a, vf b) { return vorrq_u32(vcvtq_u32_f32(a), vshlq_n_u32(vcvtq_u32_f32(b), 16)); }
VEC vu vu_set(uint32_t x) { return vdupq_n_u32(x); }
VEC vu vu_load(const uint32_t *p) { return vld1q_u32(p); }
VEC vu vu_load_bytes(const uint8_t *p) { return vreinterpretq_u32_u8(vld1q_u8(p)); }
VEC vu vu_add(vu a, vu b) { return vaddq_u32(a, b); }
VEC vu vu_and(vu a, vu b) { return vandq_u32(a, b); }
VEC vu vu_or(vu a, vu b) { return vorrq_u32(a, b); }
VEC vu vu_min(vu a, vu b) { return vminq_u32(a, b); }
VEC vu vu_max(vu a, vu b) { return vmaxq_u32(a, b); }
VEC vu vu_dot4(vu sum, vu a, vu b) {
    uint8x16_t x = vreinterpretq_u8_u32(a), y = vreinterpretq_u8_u32(b);
#if defined(__ARM_FEATURE_DOTPROD)
    return vdotq_u32(sum, x, y);
#else
    uint16x8_t low = vmull_u8(vget_low_u8(x), vget_low_u8(y));
    uint16x8_t high = vmull_u8(vget_high_u8(x), vget_high_u8(y));
    uint16x4_t p = vpadd_u16(vget_low_u16(low), vget_high_u16(low)); /* 2 x 127 x 127 fit 16 bits */
    uint16x4_t q = vpadd_u16(vget_low_u16(high), vget_high_u16(high));
    return vpadalq_u16(sum, vcombine_u16(p, q));
#endif
}
#define vu_left(a, n)  vshlq_n_u32(a, n)
#define vu_right(a, n) vshrq_n_u32(a, n)
VEC vu vf_bits(vf a) { return vreinterpretq_u32_f32(a); }
VEC vf vf_of_bits(vu a) { return vreinterpretq_f32_u32(a); }
VEC void vu_store(uint32_t *p, vu a) { vst1q_u32(p, a); }

VEC vf vf_nearest(vf x) {
    vf magic = vdupq_n_f32(12582912.0f); /* 1.5 x 2^23: adding it rounds to an integer */
    return vsubq_f32(vaddq_f32(x, magic), magic);
}
VEC vf vf_floor(vf x) { return vcvtq_f32_u32(vcvtq_u32_f32(x)); } /* what is not below 0 is cut down */
VEC vf vf_byte_sums(const uint8_t *p, int factor) {
    uint32x4_t sums;
    if (factor == 1) {
        uint32_t four;
        memcpy(&four, p, sizeof four);
        sums = vmovl_u16(vget_low_u16(vmovl_u8(vreinterpret_u8_u32(vdup_n_u32(four)))));
    } else if (factor == 2) {
        sums = vmovl_u16(vpaddl_u8(vld1_u8(p)));
    } else {
        sums = vpaddlq_u16(vpaddlq_u8(vld1q_u8(p)));
    }
    return vcvtq_f32_u32(sums);
}
VEC vf vf_bytes_twice(const uint8_t *p) {
    uint16_t two;
    memcpy(&two, p, sizeof two);
    uint8x8_t bytes = vreinterpret_u8_u16(vdup_n_u16(two));
    return vcvtq_f32_u32(vmovl_u16(vget_low_u16(vmovl_u8(vzip_u8(bytes, bytes).val[0]))));
}
VEC void vf_byte_triples(const uint8_t *p, vf out[3]) {
    static const uint8_t first[16] = {0, 255, 255, 255, 3, 255, 255, 255, 6, 255, 255, 255, 9, 255, 255, 255};
    uint32_t last;
    memcpy(&last, p + 8, sizeof last);
    uint8x8x2_t bytes = {{vld1_u8(p), vreinterpret_u8_u32(vdup_n_u32(last))}};
    for (uint32_t k = 0; k < 3; k++) { /* the k-th byte; what is not in the table is 0 */
        uint8x16_t at =
            vreinterpretq_u8_u32(vaddq_u32(vreinterpretq_u32_u8(vld1q_u8(first)), vdupq_n_u32(k)));
        uint8x8_t low = vtbl2_u8(bytes, vget_low_u8(at)), high = vtbl2_u8(bytes, vget_high_u8(at));
        out[k] = vcvtq_f32_u32(vreinterpretq_u32_u8(vcombine_u8(low, high)));
    }
}
VEC vu vu_of_pairs(const uint8_t *p) { return vmovl_u16(vreinterpret_u16_u8(vld1_u8(p))); }
VEC vf vf_of_whole(vu a) { return vcvtq_f32_u32(a); }
VEC vu vf_whole(vf a) { return vcvtq_u32_f32(a); }
VEC void vf_gather2(const float *p, vu at, vf *first, vf *second) {
    float32x4_t a = vcombine_f32(vld1_f32(p + vgetq_lane_u32(at, 0)), vld1_f32(p + vgetq_lane_u32(at, 1)));
    float32x4_t b = vcombine_f32(vld1_f32(p + vgetq_lane_u32(at, 2)), vld1_f32(p + vgetq_lane_u32(at, 3)));
    float32x4x2_t parted = vuzpq_f32(a, b);
    *first = parted.val[0];
    *second = parted.val[1];
}
VEC vf vf_evens(vf a) { return vtrnq_f32(a, a).val[0]; }
VEC vf vf_odds(vf a) { return vtrnq_f32(a, a).val[1]; }
VEC vf vf_times_exp2(vf p, vf n) {
    return vreinterpretq_f32_s32(vaddq_s32(vreinterpretq_s32_f32(p), vshlq_n_s32(vcvtq_s32_f32(n), 23)));
}

VEC vf vf_load_block(const float *p, size_t stride) {
    return vcombine_f32(vld1_f32(p), vld1_f32(p + stride));
}
VEC void vf_store_block(float *p, size_t stride, vf a) {
    vst1_f32(p, vget_low_f32(a));
    vst1_f32(p + stride, vget_high_f32(a));
}

VEC void vf_sums8(const vf a[8], float *out) {
    for (int i = 0; i < 8; i += 4) {
        float32x2_t h[4];
        for (int k = 0; k < 4; k++) h[k] = vadd_f32(vget_low_f32(a[i + k]), vget_high_f32(a[i + k]));
        vst1q_f32(out + i, vcombine_f32(vpadd_f32(h[0], h[1]), vpadd_f32(h[2], h[3])));
    }
}

#if defined(__aarch64__)
enum { VD1 = 2 };
typedef float64x2_t vd1;
typedef uint64x2_t vdm1;

VEC vd1 vd1_set(double x) { return vdupq_n_f64(x); }
VEC vd1 vd1_load(const double *p) { return vld1q_f64(p); }
VEC void vd1_store(double *p, vd1 a) { vst1q_f64(p, a); }
VEC vd1 vd1_widen(const float *p) { return vcvt_f64_f32(vld1_f32(p)); }
VEC void vd1_narrow(float *p, vd1 a) { vst1_f32(p, vcvt_f32_f64(a)); }
VEC vd1 vd1_add(vd1 a, vd1 b) { return vaddq_f64(a, b); }
VEC vd1 vd1_sub(vd1 a, vd1 b) { return vsubq_f64(a, b); }
VEC vd1 vd1_mul(vd1 a, vd1 b) { return vmulq_f64(a, b); }
VEC vd1 vd1_fma(vd1 a, vd1 b, vd1 c) { return vfmaq_f64(c, a, b); }
VEC vd1 vd1_fnma(vd1 a, vd1 b, vd1 c) { return vfmsq_f64(c, a, b); }
VEC vd1 vd1_reciprocal(vd1 a) { return vdivq_f64(vdupq_n_f64(1), a); }
VEC vd1 vd1_rsqrt(vd1 a) { return vdivq_f64(vdupq_n_f64(1), vsqrtq_f64(a)); }
VEC vd1 vd1_min(vd1 a, vd1 b) { return vminq_f64(a, b); }
VEC vd1 vd1_max(vd1 a, vd1 b) { return vmaxq_f64(a, b); }
VEC vd1 vd1_floor(vd1 a) { return vrndmq_f64(a); }
VEC vdm1 vd1_le(vd1 a, vd1 b) { return vcleq_f64(a, b); }
VEC vdm1 vd1_lt(vd1 a, vd1 b) { return vcltq_f64(a, b); }
VEC vdm1 vdm1_and(vdm1 a, vdm1 b) { return vandq_u64(a, b); }
VEC unsigned vdm1_bits(vdm1 m) { return (unsigned)((vgetq_lane_u64(m, 0) & 1) | (vgetq_lane_u64(m, 1) & 2)); }
VEC vdm1 vdm1_of(unsigned bits) {
    return vcombine_u64(vcreate_u64(-(uint64_t)(bits & 1)), vcreate_u64(-(uint64_t)(bits >> 1 & 1)));
}
VEC vd1 vd1_keep(vdm1 m, vd1 a) { return vreinterpretq_f64_u64(vandq_u64(m, vreinterpretq_u64_f64(a))); }
VEC vd1 vd1_select(vdm1 m, vd1 a, vd1 b) { return vbslq_f64(m, a, b); }
VEC vd1 vd1_nearest(vd1 x) { return vrndnq_f64(x); }
VEC vd1 vd1_times_exp2(vd1 p, vd1 n) {
    return vreinterpretq_f64_s64(vaddq_s64(vreinterpretq_s64_f64(p), vshlq_n_s64(vcvtq_s64_f64(n), 52)));
}
VEC vd1 vd1_split(vd1 x, vd1 *exponent) {
    uint64x2_t bits = vreinterpretq_u64_f64(x);
    *exponent = vsubq_f64(vcvtq_f64_u64(vshrq_n_u64(bits, 52)), vdupq_n_f64(1023));
    uint64x2_t fraction = vandq_u64(bits, vdupq_n_u64(0xfffffffffffff));
    return vreinterpretq_f64_u64(vorrq_u64(fraction, vreinterpretq_u64_f64(vdupq_n_f64(1))));
}
#else
/* armv7 has no vectors of doubles. */
enum { VD1 = 1 };
typedef double vd1;
typedef unsigned vdm1;

VEC vd1 vd1_set(double x) { return x; }
VEC vd1 vd1_load(const double *p) { return *p; }
VEC void vd1_store(double *p, vd1 a) { *p = a; }
VEC vd1 vd1_widen(const float *p) { return (double)*p; }
VEC void vd1_narrow(float *p, vd1 a) { *p = (float)a; }
VEC vd1 vd1_add(vd1 a, vd1 b) { return a + b; }
VEC vd1 vd1_sub(vd1 a, vd1 b) { return a - b; }
VEC vd1 vd1_mul(vd1 a, vd1 b) { return a * b; }
VEC vd1 vd1_fma(vd1 a, vd1 b, vd1 c) { return a * b + c; }
VEC vd1 vd1_fnma(vd1 a, vd1 b, vd1 c) { return c - a * b; }
VEC vd1 vd1_reciprocal(vd1 a) { return 1 / a; }
VEC vd1 vd1_rsqrt(vd1 a) { return 1 / __builtin_sqrt(a); }
VEC vd1 vd1_min(vd1 a, vd1 b) { return a < b ? a : b; }
VEC vd1 vd1_max(vd1 a, vd1 b) { return a > b ? a : b; }
VEC vd1 vd1_floor(vd1 a) { return __builtin_floor(a); }
VEC vdm1 vd1_le(vd1 a, vd1 b) { return a <= b; }
VEC vdm1 vd1_lt(vd1 a, vd1 b) { return a < b; }
VEC vdm1 vdm1_and(vdm1 a, vdm1 b) { return a & b; }
VEC unsigned vdm1_bits(vdm1 m) { return m; }
VEC vdm1 vdm1_of(unsigned bits) { return bits & 1; }
VEC vd1 vd1_keep(vdm1 m, vd1 a) { return m ? a : 0; }
VEC vd1 vd1_select(vdm1 m, vd1 a, vd1 b) { return m ? a : b; }
VEC vd1 vd1_nearest(vd1 x) { return x + 0x1.8p52 - 0x1.8p52; }
VEC vd1 vd1_times_exp2(vd1 p, vd1 n) {
    uint64_t bits;
    memcpy(&bits, &p, sizeof bits);
    bits += (uint64_t)(int64_t)n << 52;
    memcpy(&p, &bits, sizeof p);
    return p;
}
VEC vd1 vd1_split(vd1 x, vd1 *exponent) {
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    *exponent = (double)(int)(bits >> 52) - 1023;
    bits = (bits & 0xfffffffffffff) | (uint64_t)1023 << 52;
    memcpy(&x, &bits, sizeof x);
    return x;
}
#endif

/* r[j] lane i = rows[i][j], of 4 rows of 16 floats. */
VEC void vf_transpose(const float *const rows[VW], vf r[16]) {
    for (int quarter = 0; quarter < 4; quarter++) {
        vf *q = r + 4 * quarter;
        float32x4x2_t a = vtrnq_f32(vld1q_f32(rows[0] + 4 * quarter), vld1q_f32(rows[1] + 4 * quarter));
        float32x4x2_t b = vtrnq_f32(vld1q_f32(rows[2] + 4 * quarter), vld1q_f32(rows[3] + 4 * quarter));
        q[0] = vcombine_f32(vget_low_f32(a.val[0]), vget_low_f32(b.val[0]));
        q[1] = vcombine_f32(vget_low_f32(a.val[1]), vget_low_f32(b.val[1]));
        q[2] = vcombine_f32(vget_high_f32(a.val[0]), vget_high_f32(b.val[0]));
        q[3] = vcombine_f32(vget_high_f32(a.val[1]), vget_high_f32(b.val[1]));
    }
}
#endif
