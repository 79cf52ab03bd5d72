/* avx2.h - the vector vocabulary (arch/vector/vec.h) in AVX2 and FMA: 8 lanes, blocks of 4 x 2. */
#ifndef SF_ARCH_X86_AVX2_H
#define SF_ARCH_X86_AVX2_H

#include <immintrin.h>

enum { VW = 8, VB_COLUMNS = 4, VB_ROWS = 2 };
typedef __m256 vf;
typedef __m256 vm;
typedef __m256i vu;

VEC vf vf_set(float x) { return _mm256_set1_ps(x); }
VEC vf vf_load(const float *p) { return _mm256_load_ps(p); }
VEC vf vf_beside(const float *p, int k) { return _mm256_loadu_ps(p + k); }
VEC vf vf_loadu(const float *p) { return _mm256_loadu_ps(p); }
VEC void vf_storeu(float *p, vf a) { _mm256_storeu_ps(p, a); }
VEC void vf_store(float *p, vf a) { _mm256_store_ps(p, a); }
VEC vf vf_add(vf a, vf b) { return _mm256_add_ps(a, b); }
VEC vf vf_sub(vf a, vf b) { return _mm256_sub_ps(a, b); }
VEC vf vf_mul(vf a, vf b) { return _mm256_mul_ps(a, b); }
VEC vf vf_neg(vf a) { return _mm256_sub_ps(_mm256_setzero_ps(), a); }
VEC vf vf_fma(vf a, vf b, vf c) { return _mm256_fmadd_ps(a, b, c); }
VEC vf vf_fnma(vf a, vf b, vf c) { return _mm256_fnmadd_ps(a, b, c); }
VEC vf vf_min(vf a, vf b) { return _mm256_min_ps(a, b); }
VEC vf vf_max(vf a, vf b) { return _mm256_max_ps(a, b); }
VEC vf vf_sqrt(vf a) { return _mm256_sqrt_ps(a); }
VEC vf vf_div(vf a, vf b) { return _mm256_div_ps(a, b); }
VEC vf vf_reciprocal(vf a) { /* an estimate within 1.5 x 2^-12, and a step of Newton's */
    vf r = _mm256_rcp_ps(a);
    return vf_fma(r, vf_fnma(a, r, _mm256_set1_ps(1)), r);
}
VEC vf vf_root(vf a) {
    vf r = _mm256_rsqrt_ps(_mm256_max_ps(a, _mm256_set1_ps(1e-30f))), root = _mm256_mul_ps(a, r);
    vf rest = vf_fnma(_mm256_mul_ps(root, r), _mm256_set1_ps(0.5f), _mm256_set1_ps(1.5f + 0x1p-20f));
    return _mm256_mul_ps(root, rest);
}

VEC vm vf_ge(vf a, vf b) { return _mm256_cmp_ps(a, b, _CMP_GE_OQ); }
VEC vm vf_le(vf a, vf b) { return _mm256_cmp_ps(a, b, _CMP_LE_OQ); }
VEC vm vm_and(vm a, vm b) { return _mm256_and_ps(a, b); }
VEC unsigned vm_bits(vm m) { return (unsigned)_mm256_movemask_ps(m); }
VEC int vm_any(vm m) { return !_mm256_testz_ps(m, m); }
VEC int vm_list(vm m, int first, uint8_t *out) {
    unsigned bits = (unsigned)_mm256_movemask_ps(m);
    int low = vm_list4(bits & 15, first, out);
    return low + vm_list4(bits >> 4, first + 4, out + low);
}
enum { VM_BITS = 4 };
VEC int vm_list_bits(uint64_t bits, int first, uint8_t *out) { return vm_list4((unsigned)bits, first, out); }
VEC vf vf_keep(vm m, vf a) { return _mm256_and_ps(m, a); }
VEC vf vf_select(vm m, vf a, vf b) { return _mm256_blendv_ps(b, a, m); }
VEC vu vu_zero(void) { return _mm256_setzero_si256(); }
VEC vu vu_or_where(vu a, vm m, uint32_t bits) {
    return _mm256_or_si256(a, _mm256_and_si256(_mm256_castps_si256(m), _mm256_set1_epi32((int)bits)));
}
VEC vu vu_pairs(vf a, vf b) {
    return _mm256_or_si256(_mm256_cvtps_epi32(a), _mm256_slli_epi32(_mm256_cvtps_epi32(b), 16));
}
VEC vu vu_set(uint32_t x) { return _mm256_set1_epi32((int)x); }
VEC vu vu_load(const uint32_t *p) { return _mm256_load_si256((const __m256i *)p); }
VEC vu vu_load_bytes(const uint8_t *p) { return _mm256_load_si256((const __m256i *)p); }
VEC vu vu_add(vu a, vu b) { return _mm256_add_epi32(a, b); }
VEC vu vu_and(vu a, vu b) { return _mm256_and_si256(a, b); }
VEC vu vu_or(vu a, vu b) { return _mm256_or_si256(a, b); }
VEC vu vu_min(vu a, vu b) { return _mm256_min_epu32(a, b); }
VEC vu vu_max(vu a, vu b) { return _mm256_max_epu32(a, b); }
VEC vu vu_dot4(vu sum, vu a, vu b) {
    __m256i pairs = _mm256_maddubs_epi16(a, b); /* 2 x 127 x 127 fit 16 bits */
    return _mm256_add_epi32(sum, _mm256_madd_epi16(pairs, _mm256_set1_epi16(1)));
}
#define vu_left(a, n)  _mm256_slli_epi32(a, n)
#define vu_right(a, n) _mm256_srli_epi32(a, n)
VEC vu vf_bits(vf a) { return _mm256_castps_si256(a); }
VEC vf vf_of_bits(vu a) { return _mm256_castsi256_ps(a); }
VEC void vu_store(uint32_t *p, vu a) { _mm256_store_si256((__m256i *)p, a); }

VEC vf vf_floor(vf x) { return _mm256_floor_ps(x); }
VEC vf vf_byte_sums(const uint8_t *p, int factor) {
    __m256i sums;
    if (factor == 1)
        sums = _mm256_cvtepu8_epi32(_mm_loadl_epi64((const __m128i *)p));
    else if (factor == 2) /* pairs of bytes to 16 bits, these to 32 */
        sums =
            _mm256_cvtepu16_epi32(_mm_maddubs_epi16(_mm_loadu_si128((const __m128i *)p), _mm_set1_epi8(1)));
    else
        sums = _mm256_madd_epi16(
            _mm256_maddubs_epi16(_mm256_loadu_si256((const __m256i *)p), _mm256_set1_epi8(1)),
            _mm256_set1_epi16(1));
    return _mm256_cvtepi32_ps(sums);
}
VEC vf vf_bytes_twice(const uint8_t *p) {
    int four;
    memcpy(&four, p, sizeof four);
    __m128i bytes = _mm_cvtsi32_si128(four);
    return _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(_mm_unpacklo_epi8(bytes, bytes)));
}
VEC void vf_byte_triples(const uint8_t *p, vf out[3]) { /* bytes 0 .. 15, and 8 .. 23 */
    __m256i bytes = _mm256_inserti128_si256(_mm256_castsi128_si256(_mm_loadu_si128((const __m128i *)p)),
                                            _mm_loadu_si128((const __m128i *)(p + 8)), 1);
    __m256i first = _mm256_setr_epi8(0, -1, -1, -1, 3, -1, -1, -1, 6, -1, -1, -1, 9, -1, -1, -1, 4, -1, -1,
                                     -1, 7, -1, -1, -1, 10, -1, -1, -1, 13, -1, -1, -1);
    __m256i one = _mm256_set1_epi32(1); /* the next byte; what is to be 0 stays so */
    for (int k = 0; k < 3; k++) {
        out[k] = _mm256_cvtepi32_ps(_mm256_shuffle_epi8(bytes, first));
        first = _mm256_add_epi32(first, one);
    }
}
VEC vu vu_of_pairs(const uint8_t *p) { return _mm256_cvtepu16_epi32(_mm_loadu_si128((const __m128i *)p)); }
VEC vf vf_of_whole(vu a) { return _mm256_cvtepi32_ps(a); }
VEC vu vf_whole(vf a) { return _mm256_cvttps_epi32(a); }
VEC void vf_gather2(const float *p, vu at, vf *first, vf *second) { /* loads are faster than gathers */
    uint32_t n[8];
    _mm256_storeu_si256((__m256i *)(void *)n, at);
#define TWO(i, j)                                                                                            \
    _mm_loadh_pi(_mm_castpd_ps(_mm_load_sd((const double *)(const void *)(p + n[i]))),                       \
                 (const __m64 *)(const void *)(p + n[j]))
    vf a = _mm256_insertf128_ps(_mm256_castps128_ps256(TWO(0, 1)), TWO(4, 5), 1);
    vf b = _mm256_insertf128_ps(_mm256_castps128_ps256(TWO(2, 3)), TWO(6, 7), 1);
#undef TWO
    *first = _mm256_shuffle_ps(a, b, 0x88);
    *second = _mm256_shuffle_ps(a, b, 0xdd);
}
VEC vf vf_evens(vf a) { return _mm256_moveldup_ps(a); }
VEC vf vf_odds(vf a) { return _mm256_movehdup_ps(a); }
VEC vf vf_nearest(vf x) { return _mm256_round_ps(x, _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC); }
VEC vf vf_times_exp2(vf p, vf n) {
    return _mm256_castsi256_ps(
        _mm256_add_epi32(_mm256_castps_si256(p), _mm256_slli_epi32(_mm256_cvtps_epi32(n), 23)));
}

VEC vf vf_load_block(const float *p, size_t stride) {
    return _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_load_ps(p)), _mm_load_ps(p + stride), 1);
}
VEC void vf_store_block(float *p, size_t stride, vf a) {
    _mm_store_ps(p, _mm256_castps256_ps128(a));
    _mm_store_ps(p + stride, _mm256_extractf128_ps(a, 1));
}

VEC void vf_sums8(const vf a[8], float *out) {
    vf x = _mm256_hadd_ps(_mm256_hadd_ps(a[0], a[1]), _mm256_hadd_ps(a[2], a[3]));
    vf y = _mm256_hadd_ps(_mm256_hadd_ps(a[4], a[5]), _mm256_hadd_ps(a[6], a[7]));
    _mm256_storeu_ps(out, _mm256_permute2f128_ps(x, y, 0x20) + _mm256_permute2f128_ps(x, y, 0x31));
}
VEC float vf_sum(vf a) {
    __m128 x = _mm_add_ps(_mm256_castps256_ps128(a), _mm256_extractf128_ps(a, 1));
    x = _mm_add_ps(x, _mm_movehl_ps(x, x));
    return _mm_cvtss_f32(_mm_add_ss(x, _mm_movehdup_ps(x)));
}

enum { VD1 = 4 };
typedef __m256d vd1;
typedef __m256d vdm1;

VEC vd1 vd1_set(double x) { return _mm256_set1_pd(x); }
VEC vd1 vd1_load(const double *p) { return _mm256_load_pd(p); }
VEC void vd1_store(double *p, vd1 a) { _mm256_store_pd(p, a); }
VEC vd1 vd1_widen(const float *p) { return _mm256_cvtps_pd(_mm_loadu_ps(p)); }
VEC void vd1_narrow(float *p, vd1 a) { _mm_store_ps(p, _mm256_cvtpd_ps(a)); }
VEC vd1 vd1_add(vd1 a, vd1 b) { return _mm256_add_pd(a, b); }
VEC vd1 vd1_sub(vd1 a, vd1 b) { return _mm256_sub_pd(a, b); }
VEC vd1 vd1_mul(vd1 a, vd1 b) { return _mm256_mul_pd(a, b); }
VEC vd1 vd1_fma(vd1 a, vd1 b, vd1 c) { return _mm256_fmadd_pd(a, b, c); }
VEC vd1 vd1_fnma(vd1 a, vd1 b, vd1 c) { return _mm256_fnmadd_pd(a, b, c); }
VEC vd1 vd1_reciprocal(vd1 a) { return _mm256_div_pd(_mm256_set1_pd(1), a); }
VEC vd1 vd1_rsqrt(vd1 a) { return _mm256_div_pd(_mm256_set1_pd(1), _mm256_sqrt_pd(a)); }
VEC vd1 vd1_min(vd1 a, vd1 b) { return _mm256_min_pd(a, b); }
VEC vd1 vd1_max(vd1 a, vd1 b) { return _mm256_max_pd(a, b); }
VEC vd1 vd1_floor(vd1 a) { return _mm256_floor_pd(a); }
VEC vdm1 vd1_le(vd1 a, vd1 b) { return _mm256_cmp_pd(a, b, _CMP_LE_OQ); }
VEC vdm1 vd1_lt(vd1 a, vd1 b) { return _mm256_cmp_pd(a, b, _CMP_LT_OQ); }
VEC vdm1 vdm1_and(vdm1 a, vdm1 b) { return _mm256_and_pd(a, b); }
VEC unsigned vdm1_bits(vdm1 m) { return (unsigned)_mm256_movemask_pd(m); }
VEC vdm1 vdm1_of(unsigned bits) {
    __m256i lane = _mm256_setr_epi64x(1, 2, 4, 8), all = _mm256_set1_epi64x((long long)bits);
    return _mm256_castsi256_pd(_mm256_cmpeq_epi64(_mm256_and_si256(all, lane), lane));
}
VEC vd1 vd1_keep(vdm1 m, vd1 a) { return _mm256_and_pd(m, a); }
VEC vd1 vd1_select(vdm1 m, vd1 a, vd1 b) { return _mm256_blendv_pd(b, a, m); }
VEC vd1 vd1_nearest(vd1 x) { return _mm256_round_pd(x, _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC); }
VEC vd1 vd1_times_exp2(vd1 p, vd1 n) { /* 1.5 x 2^52 brings n into the low bits */
    __m256i bits = _mm256_castpd_si256(_mm256_add_pd(n, _mm256_set1_pd(0x1.8p52)));
    return _mm256_castsi256_pd(_mm256_add_epi64(_mm256_castpd_si256(p), _mm256_slli_epi64(bits, 52)));
}
VEC vd1 vd1_split(vd1 x, vd1 *exponent) {
    __m256i bits = _mm256_castpd_si256(x), one = _mm256_castpd_si256(_mm256_set1_pd(1));
    __m256i e = _mm256_or_si256(_mm256_srli_epi64(bits, 52), _mm256_castpd_si256(_mm256_set1_pd(0x1p52)));
    *exponent = _mm256_sub_pd(_mm256_castsi256_pd(e), _mm256_set1_pd(0x1p52 + 1023));
    __m256i fraction = _mm256_and_si256(bits, _mm256_set1_epi64x(0xfffffffffffff));
    return _mm256_castsi256_pd(_mm256_or_si256(fraction, one));
}

/* r[j] lane i = rows[i][j], of 8 rows of 16 floats. */
VEC void vf_transpose(const float *const rows[VW], vf r[16]) {
    for (int half = 0; half < 2; half++) {
        vf t[8], *q = r + 8 * half;
        for (int i = 0; i < 8; i++) q[i] = _mm256_load_ps(rows[i] + 8 * half);
        for (int i = 0; i < 4; i++) {
            t[2 * i] = _mm256_unpacklo_ps(q[2 * i], q[2 * i + 1]);
            t[2 * i + 1] = _mm256_unpackhi_ps(q[2 * i], q[2 * i + 1]);
        }
        for (int i = 0; i < 2; i++)
            for (int j = 0; j < 2; j++) {
                __m256d a = _mm256_castps_pd(t[4 * i + j]), b = _mm256_castps_pd(t[4 * i + j + 2]);
                q[4 * i + 2 * j] = _mm256_castpd_ps(_mm256_unpacklo_pd(a, b));
                q[4 * i + 2 * j + 1] = _mm256_castpd_ps(_mm256_unpackhi_pd(a, b));
            }
        for (int i = 0; i < 4; i++) {
            vf low = q[i], high = q[4 + i];
            t[i] = _mm256_permute2f128_ps(low, high, 0x20);
            t[4 + i] = _mm256_permute2f128_ps(low, high, 0x31);
        }
        for (int i = 0; i < 8; i++) q[i] = t[i];
    }
}
#endif
