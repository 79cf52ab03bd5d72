/* sse4.h - the vector vocabulary (arch/vector/vec.h) in SSE4.1: 4 lanes, blocks of 2 x 2. */
#ifndef SF_ARCH_X86_SSE4_H
#define SF_ARCH_X86_SSE4_H

#include <smmintrin.h>

enum { VW = 4, VB_COLUMNS = 2, VB_ROWS = 2 };
typedef __m128 vf;
typedef __m128 vm;
typedef __m128i vu;

VEC vf vf_set(float x) { return _mm_set1_ps(x); }
VEC vf vf_load(const float *p) { return _mm_load_ps(p); }
VEC vf vf_beside(const float *p, int k) { return _mm_loadu_ps(p + k); }
VEC vf vf_loadu(const float *p) { return _mm_loadu_ps(p); }
VEC void vf_storeu(float *p, vf a) { _mm_storeu_ps(p, a); }
VEC void vf_store(float *p, vf a) { _mm_store_ps(p, a); }
VEC vf vf_add(vf a, vf b) { return _mm_add_ps(a, b); }
VEC vf vf_sub(vf a, vf b) { return _mm_sub_ps(a, b); }
VEC vf vf_mul(vf a, vf b) { return _mm_mul_ps(a, b); }
VEC vf vf_neg(vf a) { return _mm_sub_ps(_mm_setzero_ps(), a); }
VEC vf vf_fma(vf a, vf b, vf c) { return vf_add(vf_mul(a, b), c); }
VEC vf vf_fnma(vf a, vf b, vf c) { return vf_sub(c, vf_mul(a, b)); }
VEC vf vf_min(vf a, vf b) { return _mm_min_ps(a, b); }
VEC vf vf_max(vf a, vf b) { return _mm_max_ps(a, b); }
VEC vf vf_sqrt(vf a) { return _mm_sqrt_ps(a); }
VEC vf vf_div(vf a, vf b) { return _mm_div_ps(a, b); }
VEC vf vf_reciprocal(vf a) { /* an estimate within 1.5 x 2^-12, and a step of Newton's */
    vf r = _mm_rcp_ps(a);
    return vf_fma(r, vf_fnma(a, r, _mm_set1_ps(1)), r);
}
VEC vf vf_root(vf a) {
    vf r = _mm_rsqrt_ps(_mm_max_ps(a, _mm_set1_ps(1e-30f))), root = _mm_mul_ps(a, r);
    vf rest = vf_fnma(_mm_mul_ps(root, r), _mm_set1_ps(0.5f), _mm_set1_ps(1.5f + 0x1p-20f));
    return _mm_mul_ps(root, rest);
}

VEC vm vf_ge(vf a, vf b) { return _mm_cmpge_ps(a, b); }
VEC vm vf_le(vf a, vf b) { return _mm_cmple_ps(a, b); }
VEC vm vm_and(vm a, vm b) { return _mm_and_ps(a, b); }
VEC unsigned vm_bits(vm m) { return (unsigned)_mm_movemask_ps(m); }
VEC int vm_any(vm m) { return _mm_movemask_ps(m) != 0; }
VEC int vm_list(vm m, int first, uint8_t *out) { return vm_list4((unsigned)_mm_movemask_ps(m), first, out); }
enum { VM_BITS = 4 };
VEC int vm_list_bits(uint64_t bits, int first, uint8_t *out) { return vm_list4((unsigned)bits, first, out); }
VEC vf vf_keep(vm m, vf a) { return _mm_and_ps(m, a); }
VEC vf vf_select(vm m, vf a, vf b) { return _mm_blendv_ps(b, a, m); }
VEC vu vu_zero(void) { return _mm_setzero_si128(); }
VEC vu vu_or_where(vu a, vm m, uint32_t bits) {
    return _mm_or_si128(a, _mm_and_si128(_mm_castps_si128(m), _mm_set1_epi32((int)bits)));
}
VEC vu vu_pairs(vf a, vf b) {
    return _mm_or_si128(_mm_cvtps_epi32(a), _mm_slli_epi32(_mm_cvtps_epi32(b), 16));
}
VEC vu vu_set(uint32_t x) { return _mm_set1_epi32((int)x); }
VEC vu vu_load(const uint32_t *p) { return _mm_load_si128((const __m128i *)p); }
VEC vu vu_load_bytes(const uint8_t *p) { return _mm_load_si128((const __m128i *)p); }
VEC vu vu_add(vu a, vu b) { return _mm_add_epi32(a, b); }
VEC vu vu_and(vu a, vu b) { return _mm_and_si128(a, b); }
VEC vu vu_or(vu a, vu b) { return _mm_or_si128(a, b); }
VEC vu vu_min(vu a, vu b) { return _mm_min_epu32(a, b); }
VEC vu vu_max(vu a, vu b) { return _mm_max_epu32(a, b); }
VEC vu vu_dot4(vu sum, vu a, vu b) {
    __m128i pairs = _mm_maddubs_epi16(a, b); /* 2 x 127 x 127 fit 16 bits */
    return _mm_add_epi32(sum, _mm_madd_epi16(pairs, _mm_set1_epi16(1)));
}
#define vu_left(a, n)  _mm_slli_epi32(a, n)
#define vu_right(a, n) _mm_srli_epi32(a, n)
VEC vu vf_bits(vf a) { return _mm_castps_si128(a); }
VEC vf vf_of_bits(vu a) { return _mm_castsi128_ps(a); }
VEC void vu_store(uint32_t *p, vu a) { _mm_store_si128((__m128i *)p, a); }

VEC vf vf_floor(vf x) { return _mm_floor_ps(x); }
VEC vf vf_byte_sums(const uint8_t *p, int factor) {
    __m128i sums;
    if (factor == 1) {
        int four;
        memcpy(&four, p, sizeof four);
        sums = _mm_cvtepu8_epi32(_mm_cvtsi32_si128(four));
    } else if (factor == 2) { /* pairs of bytes to 16 bits, these to 32 */
        sums = _mm_cvtepu16_epi32(_mm_maddubs_epi16(_mm_loadl_epi64((const __m128i *)p), _mm_set1_epi8(1)));
    } else {
        sums = _mm_madd_epi16(_mm_maddubs_epi16(_mm_loadu_si128((const __m128i *)p), _mm_set1_epi8(1)),
                              _mm_set1_epi16(1));
    }
    return _mm_cvtepi32_ps(sums);
}
VEC vf vf_bytes_twice(const uint8_t *p) {
    uint16_t two;
    memcpy(&two, p, sizeof two);
    __m128i bytes = _mm_cvtsi32_si128(two);
    return _mm_cvtepi32_ps(_mm_cvtepu8_epi32(_mm_unpacklo_epi8(bytes, bytes)));
}
VEC void vf_byte_triples(const uint8_t *p, vf out[3]) {
    int last;
    memcpy(&last, p + 8, sizeof last);
    __m128i bytes = _mm_insert_epi32(_mm_loadl_epi64((const __m128i *)p), last, 2);
    __m128i first = _mm_setr_epi8(0, -1, -1, -1, 3, -1, -1, -1, 6, -1, -1, -1, 9, -1, -1, -1);
    __m128i one = _mm_set1_epi32(1); /* the next byte; what is to be 0 stays so */
    for (int k = 0; k < 3; k++) {
        out[k] = _mm_cvtepi32_ps(_mm_shuffle_epi8(bytes, first));
        first = _mm_add_epi32(first, one);
    }
}
VEC vu vu_of_pairs(const uint8_t *p) { return _mm_cvtepu16_epi32(_mm_loadl_epi64((const __m128i *)p)); }
VEC vf vf_of_whole(vu a) { return _mm_cvtepi32_ps(a); }
VEC vu vf_whole(vf a) { return _mm_cvttps_epi32(a); }
VEC void vf_gather2(const float *p, vu at, vf *first, vf *second) {
    uint32_t n[4];
    _mm_storeu_si128((__m128i *)(void *)n, at);
    vf a = _mm_loadl_pi(_mm_setzero_ps(), (const __m64 *)(const void *)(p + n[0]));
    vf b = _mm_loadl_pi(_mm_setzero_ps(), (const __m64 *)(const void *)(p + n[2]));
    a = _mm_loadh_pi(a, (const __m64 *)(const void *)(p + n[1]));
    b = _mm_loadh_pi(b, (const __m64 *)(const void *)(p + n[3]));
    *first = _mm_shuffle_ps(a, b, 0x88);
    *second = _mm_shuffle_ps(a, b, 0xdd);
}
VEC vf vf_evens(vf a) { return _mm_moveldup_ps(a); }
VEC vf vf_odds(vf a) { return _mm_movehdup_ps(a); }
VEC vf vf_nearest(vf x) { return _mm_round_ps(x, _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC); }
VEC vf vf_times_exp2(vf p, vf n) {
    return _mm_castsi128_ps(_mm_add_epi32(_mm_castps_si128(p), _mm_slli_epi32(_mm_cvtps_epi32(n), 23)));
}

VEC vf vf_load_block(const float *p, size_t stride) {
    return _mm_loadh_pi(_mm_castpd_ps(_mm_load_sd((const double *)(const void *)p)),
                        (const __m64 *)(const void *)(p + stride));
}
VEC void vf_store_block(float *p, size_t stride, vf a) {
    _mm_storel_pi((__m64 *)(void *)p, a);
    _mm_storeh_pi((__m64 *)(void *)(p + stride), a);
}

VEC void vf_sums8(const vf a[8], float *out) {
    _mm_storeu_ps(out, _mm_hadd_ps(_mm_hadd_ps(a[0], a[1]), _mm_hadd_ps(a[2], a[3])));
    _mm_storeu_ps(out + 4, _mm_hadd_ps(_mm_hadd_ps(a[4], a[5]), _mm_hadd_ps(a[6], a[7])));
}
VEC float vf_sum(vf a) {
    a = _mm_add_ps(a, _mm_movehl_ps(a, a));
    return _mm_cvtss_f32(_mm_add_ss(a, _mm_shuffle_ps(a, a, 1)));
}

enum { VD1 = 2 };
typedef __m128d vd1;
typedef __m128d vdm1;

VEC vd1 vd1_set(double x) { return _mm_set1_pd(x); }
VEC vd1 vd1_load(const double *p) { return _mm_load_pd(p); }
VEC void vd1_store(double *p, vd1 a) { _mm_store_pd(p, a); }
VEC vd1 vd1_widen(const float *p) {
    return _mm_cvtps_pd(_mm_castpd_ps(_mm_load_sd((const double *)(const void *)p)));
}
VEC void vd1_narrow(float *p, vd1 a) { _mm_storel_pi((__m64 *)(void *)p, _mm_cvtpd_ps(a)); }
VEC vd1 vd1_add(vd1 a, vd1 b) { return _mm_add_pd(a, b); }
VEC vd1 vd1_sub(vd1 a, vd1 b) { return _mm_sub_pd(a, b); }
VEC vd1 vd1_mul(vd1 a, vd1 b) { return _mm_mul_pd(a, b); }
VEC vd1 vd1_fma(vd1 a, vd1 b, vd1 c) { return _mm_add_pd(_mm_mul_pd(a, b), c); }
VEC vd1 vd1_fnma(vd1 a, vd1 b, vd1 c) { return _mm_sub_pd(c, _mm_mul_pd(a, b)); }
VEC vd1 vd1_reciprocal(vd1 a) { return _mm_div_pd(_mm_set1_pd(1), a); }
VEC vd1 vd1_rsqrt(vd1 a) { return _mm_div_pd(_mm_set1_pd(1), _mm_sqrt_pd(a)); }
VEC vd1 vd1_min(vd1 a, vd1 b) { return _mm_min_pd(a, b); }
VEC vd1 vd1_max(vd1 a, vd1 b) { return _mm_max_pd(a, b); }
VEC vd1 vd1_floor(vd1 a) { return _mm_floor_pd(a); }
VEC vdm1 vd1_le(vd1 a, vd1 b) { return _mm_cmple_pd(a, b); }
VEC vdm1 vd1_lt(vd1 a, vd1 b) { return _mm_cmplt_pd(a, b); }
VEC vdm1 vdm1_and(vdm1 a, vdm1 b) { return _mm_and_pd(a, b); }
VEC unsigned vdm1_bits(vdm1 m) { return (unsigned)_mm_movemask_pd(m); }
VEC vdm1 vdm1_of(unsigned bits) {
    __m128i lane = _mm_set_epi64x(2, 1), all = _mm_set1_epi64x((long long)bits);
    return _mm_castsi128_pd(_mm_cmpeq_epi64(_mm_and_si128(all, lane), lane));
}
VEC vd1 vd1_keep(vdm1 m, vd1 a) { return _mm_and_pd(m, a); }
VEC vd1 vd1_select(vdm1 m, vd1 a, vd1 b) { return _mm_blendv_pd(b, a, m); }
VEC vd1 vd1_nearest(vd1 x) { return _mm_round_pd(x, _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC); }
VEC vd1 vd1_times_exp2(vd1 p, vd1 n) { /* 1.5 x 2^52 brings n into the low bits */
    __m128i bits = _mm_castpd_si128(_mm_add_pd(n, _mm_set1_pd(0x1.8p52)));
    return _mm_castsi128_pd(_mm_add_epi64(_mm_castpd_si128(p), _mm_slli_epi64(bits, 52)));
}
VEC vd1 vd1_split(vd1 x, vd1 *exponent) {
    __m128i bits = _mm_castpd_si128(x), one = _mm_castpd_si128(_mm_set1_pd(1));
    __m128i e = _mm_or_si128(_mm_srli_epi64(bits, 52), _mm_castpd_si128(_mm_set1_pd(0x1p52)));
    *exponent = _mm_sub_pd(_mm_castsi128_pd(e), _mm_set1_pd(0x1p52 + 1023));
    __m128i fraction = _mm_and_si128(bits, _mm_set1_epi64x(0xfffffffffffff));
    return _mm_castsi128_pd(_mm_or_si128(fraction, one));
}

/* r[j] lane i = rows[i][j], of 4 rows of 16 floats. */
VEC void vf_transpose(const float *const rows[VW], vf r[16]) {
    for (int quarter = 0; quarter < 4; quarter++) {
        vf *q = r + 4 * quarter;
        for (int i = 0; i < 4; i++) q[i] = _mm_load_ps(rows[i] + 4 * quarter);
        _MM_TRANSPOSE4_PS(q[0], q[1], q[2], q[3]);
    }
}
#endif
