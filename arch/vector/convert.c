/* convert.c - a row of a camera's picture as floats: lanes = pixels. The operations of arch/scalar/convert.c
 * in their order, none of them fused, so that the floats are the same. */
#include "../scalar/scalar.h"
#include "kernels.h"

#include "vec.h"

#include <splatfit/source.h>

/* sf_yuv, each number in all lanes. */
typedef struct matrix {
    vf y_zero, y_scale, r_v, g_u, g_v, b_u;
} matrix;

typedef struct pixels {
    vf y, u, v; /* u and v about 0 */
} pixels;

VEC matrix matrix_of(const sf_yuv *m) {
    return (matrix){vf_set(m->y_zero), vf_set(m->y_scale), vf_set(m->r_v),
                    vf_set(m->g_u),    vf_set(m->g_v),     vf_set(m->b_u)};
}

VEC vf clamped(vf x) { return vf_min(vf_max(x, vf_set(0)), vf_set(1)); }

VEC vf luma(const matrix *m, vf y) { return vf_mul(vf_sub(y, m->y_zero), m->y_scale); }

/* From bytes of luma, and of chroma that alternates: u of the first pixel of two, v of the second. */
VEC pixels alternating(vf y, vf chroma) {
    vf c = vf_sub(chroma, vf_set(128));
    return (pixels){y, vf_evens(c), vf_odds(c)};
}

VEC pixels separate(vf y, vf u, vf v) { return (pixels){y, vf_sub(u, vf_set(128)), vf_sub(v, vf_set(128))}; }

/* Pixels i .. i+VW-1, i a multiple of VW. */
VEC pixels take_pixels(const sf_convert_args *a, int format, int i) {
    const uint8_t *const *p = a->plane;
    if (format == SF_PIXEL_YUYV || format == SF_PIXEL_UYVY) {
        vu pair = vu_of_pairs(p[0] + 2 * i);
        vf low = vf_of_whole(vu_and(pair, vu_set(255))), high = vf_of_whole(vu_right(pair, 8));
        return format == SF_PIXEL_YUYV ? alternating(low, high) : alternating(high, low);
    }
    vf y = vf_byte_sums(p[0] + i, 1);
    if (format == SF_PIXEL_NV12) return alternating(y, vf_byte_sums(p[1] + i, 1));
    if (format == SF_PIXEL_444P) return separate(y, vf_byte_sums(p[1] + i, 1), vf_byte_sums(p[2] + i, 1));
    return separate(y, vf_bytes_twice(p[1] + i / 2), vf_bytes_twice(p[2] + i / 2));
}

VEC int convert_yuv(const sf_convert_args *a, int format) {
    matrix m = matrix_of(a->yuv);
    float *red = a->rgb[0], *green = a->rgb[1], *blue = a->rgb[2];
    int i = 0;
    for (; i + VW <= a->width; i += VW) {
        pixels p = take_pixels(a, format, i);
        vf y = luma(&m, p.y);
        vf g = vf_add(vf_mul(m.g_u, p.u), vf_mul(m.g_v, p.v));
        vf_storeu(red + i, clamped(vf_add(y, vf_mul(m.r_v, p.v))));
        vf_storeu(green + i, clamped(vf_sub(y, g)));
        vf_storeu(blue + i, clamped(vf_add(y, vf_mul(m.b_u, p.u))));
    }
    return i;
}

VEC int convert_grey(const sf_convert_args *a) {
    matrix m = matrix_of(a->yuv);
    int i = 0;
    for (; i + VW <= a->width; i += VW) {
        vf grey = clamped(luma(&m, vf_byte_sums(a->plane[0] + i, 1)));
        for (int c = 0; c < 3; c++) vf_storeu(a->rgb[c] + i, grey);
    }
    return i;
}

VEC int convert_bytes(const sf_convert_args *a, int red, int blue) {
    float *first = a->rgb[red], *second = a->rgb[1], *third = a->rgb[blue];
    vf scale = vf_set(1 / 255.0f);
    int i = 0;
    for (; i + VW <= a->width; i += VW) {
        vf parts[3];
        vf_byte_triples(a->plane[0] + 3 * i, parts);
        vf_storeu(first + i, vf_mul(parts[0], scale));
        vf_storeu(second + i, vf_mul(parts[1], scale));
        vf_storeu(third + i, vf_mul(parts[2], scale));
    }
    return i;
}

/* Pixels done: all but the last few. */
VEC int convert_most(const sf_convert_args *a) {
    switch (a->format) {
    case SF_PIXEL_RGB24:
        return convert_bytes(a, 0, 2);
    case SF_PIXEL_BGR24:
        return convert_bytes(a, 2, 0);
    case SF_PIXEL_GREY:
        return convert_grey(a);
    case SF_PIXEL_YUYV:
        return convert_yuv(a, SF_PIXEL_YUYV);
    case SF_PIXEL_UYVY:
        return convert_yuv(a, SF_PIXEL_UYVY);
    case SF_PIXEL_NV12:
        return convert_yuv(a, SF_PIXEL_NV12);
    case SF_PIXEL_444P:
        return convert_yuv(a, SF_PIXEL_444P);
    default:
        return convert_yuv(a, SF_PIXEL_YU12); /* whose rows 422P has too */
    }
}

/* Bytes of plane p that i pixels take, i even. */
VEC int bytes_of(int format, int p, int i) {
    switch (format) {
    case SF_PIXEL_RGB24:
    case SF_PIXEL_BGR24:
        return 3 * i;
    case SF_PIXEL_YUYV:
    case SF_PIXEL_UYVY:
        return 2 * i;
    case SF_PIXEL_YU12:
    case SF_PIXEL_422P:
        return p ? i / 2 : i;
    default:
        return i;
    }
}

void SF_AT_LEVEL(sf_convert)(const sf_convert_args *args) {
    const sf_convert_args own = *args; /* which no store can change: it stays in registers */
    int done = convert_most(&own);
    if (done == own.width) return;
    sf_convert_args rest = own;
    rest.width -= done;
    for (int p = 0; p < 3; p++) {
        if (rest.plane[p]) rest.plane[p] += bytes_of(own.format, p, done);
        rest.rgb[p] += done;
    }
    sf_convert_scalar(&rest);
}
