/* avx512.h - the vector vocabulary (arch/vector/vec.h) in AVX-512 F, BW, DQ and VL: 16 lanes, blocks of 4
 * x 4. */
#ifndef SF_ARCH_X86_AVX512_H
#define SF_ARCH_X86_AVX512_H

#include <immintrin.h>

enum { VW = 16, VB_COLUMNS = 4, VB_ROWS = 4 };
typedef __m512 vf;
typedef __mmask16 vm;
typedef __m512i vu;

VEC vf vf_set(float x) { return _mm512_set1_ps(x); }
VEC vf vf_load(const float *p) { return _mm512_load_ps(p); }
/* Every load that is not aligned takes two lines of the cache; a shift of what lies in registers takes a port
 * of the arithmetic. The two share the work. */
VEC vf vf_beside(const float *p, int k) {
#define SHIFTED(low, high, by)                                                                               \
    _mm512_castsi512_ps(_mm512_alignr_epi32(_mm512_castps_si512(_mm512_load_ps(high)),                       \
                                            _mm512_castps_si512(_mm512_load_ps(low)), by))
    switch (k) {
    case 1:
        return SHIFTED(p, p + 16, 1);
    case 3:
        return SHIFTED(p, p + 16, 3);
    case 5:
        return SHIFTED(p, p + 16, 5);
    case -1:
        return SHIFTED(p - 16, p, 15);
    case -3:
        return SHIFTED(p - 16, p, 13);
    case -5:
        return SHIFTED(p - 16, p, 11);
    default:
        return _mm512_loadu_ps(p + k);
    }
#undef SHIFTED
}
VEC vf vf_loadu(const float *p) { return _mm512_loadu_ps(p); }
VEC void vf_storeu(float *p, vf a) { _mm512_storeu_ps(p, a); }
VEC void vf_store(float *p, vf a) { _mm512_store_ps(p, a); }
VEC vf vf_add(vf a, vf b) { return _mm512_add_ps(a, b); }
VEC vf vf_sub(vf a, vf b) { return _mm512_sub_ps(a, b); }
VEC vf vf_mul(vf a, vf b) { return _mm512_mul_ps(a, b); }
VEC vf vf_neg(vf a) { return _mm512_sub_ps(_mm512_setzero_ps(), a); }
VEC vf vf_fma(vf a, vf b, vf c) { return _mm512_fmadd_ps(a, b, c); }
VEC vf vf_fnma(vf a, vf b, vf c) { return _mm512_fnmadd_ps(a, b, c); }
VEC vf vf_min(vf a, vf b) { return _mm512_min_ps(a, b); }
VEC vf vf_max(vf a, vf b) { return _mm512_max_ps(a, b); }
VEC vf vf_sqrt(vf a) { return _mm512_sqrt_ps(a); }
VEC vf vf_div(vf a, vf b) { return _mm512_div_ps(a, b); }
VEC vf vf_reciprocal(vf a) {
    vf r = _mm512_rcp14_ps(a);
    return _mm512_fmadd_ps(r, _mm512_fnmadd_ps(a, r, _mm512_set1_ps(1)), r);
}
VEC vf vf_root(vf a) { /* an estimate within 2^-14, and a step of Newton's */
    vf r = _mm512_rsqrt14_ps(_mm512_max_ps(a, _mm512_set1_ps(1e-30f))), root = _mm512_mul_ps(a, r);
    vf rest = _mm512_fnmadd_ps(_mm512_mul_ps(root, r), _mm512_set1_ps(0.5f), _mm512_set1_ps(1.5f + 0x1p-20f));
    return _mm512_mul_ps(root, rest);
}

VEC vm vf_ge(vf a, vf b) { return _mm512_cmp_ps_mask(a, b, _CMP_GE_OQ); }
VEC vm vf_le(vf a, vf b) { return _mm512_cmp_ps_mask(a, b, _CMP_LE_OQ); }
VEC vm vm_and(vm a, vm b) { return a & b; }
VEC unsigned vm_bits(vm m) { return m; }
VEC int vm_any(vm m) { return m != 0; }
VEC int vm_list(vm m, int first, uint8_t *out) {
    const __m512i lane = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    __m512i in = _mm512_maskz_compress_epi32(m, _mm512_add_epi32(lane, _mm512_set1_epi32(first)));
    _mm_storeu_si128((__m128i *)out, _mm512_cvtepi32_epi8(in));
    return __builtin_popcount(m);
}
enum { VM_BITS = 16 };
VEC int vm_list_bits(uint64_t bits, int first, uint8_t *out) { return vm_list((vm)bits, first, out); }
VEC vf vf_keep(vm m, vf a) { return _mm512_maskz_mov_ps(m, a); }
VEC vf vf_select(vm m, vf a, vf b) { return _mm512_mask_blend_ps(m, b, a); }

VEC vu vu_zero(void) { return _mm512_setzero_si512(); }
VEC vu vu_or_where(vu a, vm m, uint32_t bits) {
    return _mm512_mask_or_epi32(a, m, a, _mm512_set1_epi32((int)bits));
}
VEC vu vu_pairs(vf a, vf b) {
    return _mm512_or_si512(_mm512_cvtps_epi32(a), _mm512_slli_epi32(_mm512_cvtps_epi32(b), 16));
}
VEC vu vu_set(uint32_t x) { return _mm512_set1_epi32((int)x); }
VEC vu vu_load(const uint32_t *p) { return _mm512_load_si512(p); }
VEC vu vu_load_bytes(const uint8_t *p) { return _mm512_load_si512(p); }
VEC vu vu_add(vu a, vu b) { return _mm512_add_epi32(a, b); }
VEC vu vu_and(vu a, vu b) { return _mm512_and_si512(a, b); }
VEC vu vu_or(vu a, vu b) { return _mm512_or_si512(a, b); }
VEC vu vu_min(vu a, vu b) { return _mm512_min_epu32(a, b); }
VEC vu vu_max(vu a, vu b) { return _mm512_max_epu32(a, b); }
VEC vu vu_dot4(vu sum, vu a, vu b) {
#if defined(__AVX512VNNI__)
    return _mm512_dpbusd_epi32(sum, a, b);
#else
    __m512i pairs = _mm512_maddubs_epi16(a, b); /* 2 x 127 x 127 fit 16 bits */
    return _mm512_add_epi32(sum, _mm512_madd_epi16(pairs, _mm512_set1_epi16(1)));
#endif
}
#define vu_left(a, n)  _mm512_slli_epi32(a, n)
#define vu_right(a, n) _mm512_srli_epi32(a, n)
VEC vu vf_bits(vf a) { return _mm512_castps_si512(a); }
VEC vf vf_of_bits(vu a) { return _mm512_castsi512_ps(a); }
VEC void vu_store(uint32_t *p, vu a) { _mm512_store_si512(p, a); }

VEC vf vf_floor(vf x) { return _mm512_roundscale_ps(x, _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC); }
VEC vf vf_byte_sums(const uint8_t *p, int factor) {
    __m512i sums;
    if (factor == 1)
        sums = _mm512_cvtepu8_epi32(_mm_loadu_si128((const __m128i *)p));
    else if (factor == 2) /* pairs of bytes to 16 bits, these to 32 */
        sums = _mm512_cvtepu16_epi32(
            _mm256_maddubs_epi16(_mm256_loadu_si256((const __m256i *)p), _mm256_set1_epi8(1)));
    else
        sums = _mm512_madd_epi16(_mm512_maddubs_epi16(_mm512_loadu_si512(p), _mm512_set1_epi8(1)),
                                 _mm512_set1_epi16(1));
    return _mm512_cvtepi32_ps(sums);
}
VEC vf vf_bytes_twice(const uint8_t *p) {
    __m128i bytes = _mm_loadl_epi64((const __m128i *)p);
    return _mm512_cvtepi32_ps(_mm512_cvtepu8_epi32(_mm_unpacklo_epi8(bytes, bytes)));
}
VEC void vf_byte_triples(const uint8_t *p, vf out[3]) {
    /* 12 bytes to each quarter; of each, bytes 0, 3, 6 and 9 */
    const __m512i quarters = _mm512_setr_epi32(0, 1, 2, 0, 3, 4, 5, 0, 6, 7, 8, 0, 9, 10, 11, 0);
    __m512i bytes = _mm512_permutexvar_epi32(quarters, _mm512_maskz_loadu_epi32(0xfff, p));
    __m512i first =
        _mm512_broadcast_i32x4(_mm_setr_epi8(0, -1, -1, -1, 3, -1, -1, -1, 6, -1, -1, -1, 9, -1, -1, -1));
    __m512i one = _mm512_set1_epi32(1); /* the next byte; what is to be 0 stays so */
    for (int k = 0; k < 3; k++) {
        out[k] = _mm512_cvtepi32_ps(_mm512_shuffle_epi8(bytes, first));
        first = _mm512_add_epi32(first, one);
    }
}
VEC vu vu_of_pairs(const uint8_t *p) { return _mm512_cvtepu16_epi32(_mm256_loadu_si256((const __m256i *)p)); }
VEC vf vf_of_whole(vu a) { return _mm512_cvtepi32_ps(a); }
VEC vu vf_whole(vf a) { return _mm512_cvttps_epi32(a); }
VEC __m512d vf_pairs_at(const float *p, const uint32_t *at, int first) {
#define TWO(i, j)                                                                                            \
    _mm_loadh_pd(_mm_load_sd((const double *)(const void *)(p + at[first + i])),                             \
                 (const double *)(const void *)(p + at[first + j]))
    __m256d low = _mm256_insertf128_pd(_mm256_castpd128_pd256(TWO(0, 1)), TWO(2, 3), 1);
    __m256d high = _mm256_insertf128_pd(_mm256_castpd128_pd256(TWO(4, 5)), TWO(6, 7), 1);
#undef TWO
    return _mm512_insertf64x4(_mm512_castpd256_pd512(low), high, 1);
}
VEC void vf_gather2(const float *p, vu at, vf *first, vf *second) { /* loads are faster than gathers */
    const __m512i evens = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
    const __m512i odds = _mm512_setr_epi32(1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
    uint32_t n[16];
    _mm512_storeu_si512(n, at);
    __m512 low = _mm512_castpd_ps(vf_pairs_at(p, n, 0)), high = _mm512_castpd_ps(vf_pairs_at(p, n, 8));
    *first = _mm512_permutex2var_ps(low, evens, high);
    *second = _mm512_permutex2var_ps(low, odds, high);
}
VEC vf vf_evens(vf a) { return _mm512_moveldup_ps(a); }
VEC vf vf_odds(vf a) { return _mm512_movehdup_ps(a); }
VEC vf vf_nearest(vf x) { return _mm512_roundscale_ps(x, 0); }
VEC vf vf_times_exp2(vf p, vf n) { return _mm512_scalef_ps(p, n); }

VEC vf vf_load_block(const float *p, size_t stride) {
    vf r = _mm512_castps128_ps512(_mm_loadu_ps(p));
    r = _mm512_insertf32x4(r, _mm_loadu_ps(p + stride), 1);
    r = _mm512_insertf32x4(r, _mm_loadu_ps(p + 2 * stride), 2);
    return _mm512_insertf32x4(r, _mm_loadu_ps(p + 3 * stride), 3);
}
VEC void vf_store_block(float *p, size_t stride, vf a) {
    _mm_storeu_ps(p, _mm512_castps512_ps128(a));
    _mm_storeu_ps(p + stride, _mm512_extractf32x4_ps(a, 1));
    _mm_storeu_ps(p + 2 * stride, _mm512_extractf32x4_ps(a, 2));
    _mm_storeu_ps(p + 3 * stride, _mm512_extractf32x4_ps(a, 3));
}

VEC void vf_sums8(const vf a[8], float *out) {
    vf h[4], q[2];
    for (int i = 0; i < 4; i++) /* halves added: a[2i] below, a[2i+1] above */
        h[i] = _mm512_shuffle_f32x4(a[2 * i], a[2 * i + 1], 0x44) +
               _mm512_shuffle_f32x4(a[2 * i], a[2 * i + 1], 0xee);
    for (int i = 0; i < 2; i++) /* quarters: one of four vectors each */
        q[i] = _mm512_shuffle_f32x4(h[2 * i], h[2 * i + 1], 0x88) +
               _mm512_shuffle_f32x4(h[2 * i], h[2 * i + 1], 0xdd);
    vf z = _mm512_unpacklo_ps(q[0], q[1]) + _mm512_unpackhi_ps(q[0], q[1]);
    z = z + _mm512_shuffle_ps(z, z, 0x4e);
    z = _mm512_permutexvar_ps(_mm512_setr_epi32(0, 4, 8, 12, 1, 5, 9, 13, 0, 0, 0, 0, 0, 0, 0, 0), z);
    _mm256_storeu_ps(out, _mm512_castps512_ps256(z));
}
VEC float vf_sum(vf a) { return _mm512_reduce_add_ps(a); }

enum { VD1 = 8 };
typedef __m512d vd1;
typedef __mmask8 vdm1;

VEC vd1 vd1_set(double x) { return _mm512_set1_pd(x); }
VEC vd1 vd1_load(const double *p) { return _mm512_load_pd(p); }
VEC void vd1_store(double *p, vd1 a) { _mm512_store_pd(p, a); }
VEC vd1 vd1_widen(const float *p) { return _mm512_cvtps_pd(_mm256_loadu_ps(p)); }
VEC void vd1_narrow(float *p, vd1 a) { _mm256_store_ps(p, _mm512_cvtpd_ps(a)); }
VEC vd1 vd1_add(vd1 a, vd1 b) { return _mm512_add_pd(a, b); }
VEC vd1 vd1_sub(vd1 a, vd1 b) { return _mm512_sub_pd(a, b); }
VEC vd1 vd1_mul(vd1 a, vd1 b) { return _mm512_mul_pd(a, b); }
VEC vd1 vd1_fma(vd1 a, vd1 b, vd1 c) { return _mm512_fmadd_pd(a, b, c); }
VEC vd1 vd1_fnma(vd1 a, vd1 b, vd1 c) { return _mm512_fnmadd_pd(a, b, c); }
VEC vd1 vd1_reciprocal(vd1 a) { /* an estimate within 2^-14, and two steps of Newton's */
    vd1 r = _mm512_rcp14_pd(a), two = _mm512_set1_pd(2);
    r = _mm512_mul_pd(r, _mm512_fnmadd_pd(a, r, two));
    return _mm512_mul_pd(r, _mm512_fnmadd_pd(a, r, two));
}
VEC vd1 vd1_rsqrt(vd1 a) {
    vd1 r = _mm512_rsqrt14_pd(a), half = _mm512_set1_pd(0.5), more = _mm512_set1_pd(1.5);
    vd1 halved = _mm512_mul_pd(a, half);
    r = _mm512_mul_pd(r, _mm512_fnmadd_pd(halved, _mm512_mul_pd(r, r), more));
    return _mm512_mul_pd(r, _mm512_fnmadd_pd(halved, _mm512_mul_pd(r, r), more));
}
VEC vd1 vd1_min(vd1 a, vd1 b) { return _mm512_min_pd(a, b); }
VEC vd1 vd1_max(vd1 a, vd1 b) { return _mm512_max_pd(a, b); }
VEC vd1 vd1_floor(vd1 a) { return _mm512_roundscale_pd(a, _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC); }
VEC vdm1 vd1_le(vd1 a, vd1 b) { return _mm512_cmp_pd_mask(a, b, _CMP_LE_OQ); }
VEC vdm1 vd1_lt(vd1 a, vd1 b) { return _mm512_cmp_pd_mask(a, b, _CMP_LT_OQ); }
VEC vdm1 vdm1_and(vdm1 a, vdm1 b) { return a & b; }
VEC unsigned vdm1_bits(vdm1 m) { return m; }
VEC vdm1 vdm1_of(unsigned bits) { return (vdm1)bits; }
VEC vd1 vd1_keep(vdm1 m, vd1 a) { return _mm512_maskz_mov_pd(m, a); }
VEC vd1 vd1_select(vdm1 m, vd1 a, vd1 b) { return _mm512_mask_blend_pd(m, b, a); }
VEC vd1 vd1_nearest(vd1 x) { return _mm512_roundscale_pd(x, 0); }
VEC vd1 vd1_times_exp2(vd1 p, vd1 n) { return _mm512_scalef_pd(p, n); }
VEC vd1 vd1_split(vd1 x, vd1 *exponent) {
    *exponent = _mm512_getexp_pd(x);
    return _mm512_getmant_pd(x, _MM_MANT_NORM_1_2, _MM_MANT_SIGN_src);
}

/* r[j] lane i = rows[i][j] of 16 rows of 16 floats. */
VEC void vf_transpose(const float *const rows[VW], vf r[16]) {
    vf t[16];
    for (int i = 0; i < 16; i++) r[i] = _mm512_load_ps(rows[i]);
    for (int i = 0; i < 8; i++) {
        t[2 * i] = _mm512_unpacklo_ps(r[2 * i], r[2 * i + 1]);
        t[2 * i + 1] = _mm512_unpackhi_ps(r[2 * i], r[2 * i + 1]);
    }
    for (int i = 0; i < 4; i++) {
        __m512d a = _mm512_castps_pd(t[4 * i]), b = _mm512_castps_pd(t[4 * i + 1]);
        __m512d c = _mm512_castps_pd(t[4 * i + 2]), d = _mm512_castps_pd(t[4 * i + 3]);
        r[4 * i] = _mm512_castpd_ps(_mm512_unpacklo_pd(a, c));
        r[4 * i + 1] = _mm512_castpd_ps(_mm512_unpackhi_pd(a, c));
        r[4 * i + 2] = _mm512_castpd_ps(_mm512_unpacklo_pd(b, d));
        r[4 * i + 3] = _mm512_castpd_ps(_mm512_unpackhi_pd(b, d));
    }
    for (int i = 0; i < 4; i++) {
        t[i] = _mm512_shuffle_f32x4(r[i], r[4 + i], 0x88);
        t[4 + i] = _mm512_shuffle_f32x4(r[i], r[4 + i], 0xdd);
        t[8 + i] = _mm512_shuffle_f32x4(r[8 + i], r[12 + i], 0x88);
        t[12 + i] = _mm512_shuffle_f32x4(r[8 + i], r[12 + i], 0xdd);
    }
    for (int i = 0; i < 4; i++) {
        r[i] = _mm512_shuffle_f32x4(t[i], t[8 + i], 0x88);
        r[8 + i] = _mm512_shuffle_f32x4(t[i], t[8 + i], 0xdd);
        r[4 + i] = _mm512_shuffle_f32x4(t[4 + i], t[12 + i], 0x88);
        r[12 + i] = _mm512_shuffle_f32x4(t[4 + i], t[12 + i], 0xdd);
    }
}
#endif
