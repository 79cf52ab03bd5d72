/* unpack.c - a row of 8-bit pixels, box-averaged and weighted, as floats: lanes = pixels of the result. */
#include "../scalar/scalar.h"
#include "kernels.h"

#include "vec.h"

/* Averages over `factor` columns, 1, 2 or 4. Sums are exact; divided by the sum of white, white is 1. */
VEC void average(const uint8_t *src, size_t stride, int factor, float *dst, int width) {
    vf white = vf_set((float)(255 * factor * factor));
    int i = 0;
    for (; i + VW <= width; i += VW) {
        vf sum = vf_set(0);
        for (int y = 0; y < factor; y++)
            sum = vf_add(sum, vf_byte_sums(src + (size_t)y * stride + (size_t)(i * factor), factor));
        vf_storeu(dst + i, vf_div(sum, white));
    }
    if (i < width) sf_unpack_scalar(src + i * factor, NULL, stride, factor, dst + i, width - i);
}

void SF_AT_LEVEL(sf_unpack)(const uint8_t *src, const uint8_t *weight, size_t src_stride, int factor,
                            float *dst, int width) {
    /* the mean weight is an average of bytes too */
    const uint8_t *bytes = !src ? weight : weight ? NULL : src;
    if (bytes && factor == 1)
        average(bytes, src_stride, 1, dst, width);
    else if (bytes && factor == 2)
        average(bytes, src_stride, 2, dst, width);
    else if (bytes && factor == 4)
        average(bytes, src_stride, 4, dst, width);
    else
        sf_unpack_scalar(src, weight, src_stride, factor, dst, width);
}
