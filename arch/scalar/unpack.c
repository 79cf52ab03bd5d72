/* unpack.c - a row of 8-bit pixels, box-averaged and weighted, as floats, in plain C. */
#include "scalar.h"

void sf_unpack_scalar(const uint8_t *src, const uint8_t *weight, size_t src_stride, int factor, float *dst,
                      int width) {
    /* The sums are exact integers: at most 64 x 64 x 255 x 255 < 2^28 each. Divided by the sum of white,
     * white is 1 and nothing above it. */
    float white = (float)(factor * factor * (src && weight ? 255 * 255 : 255));
    for (int i = 0; i < width; i++) {
        uint32_t sum = 0;
        for (int y = 0; y < factor; y++)
            for (int x = 0; x < factor; x++) {
                size_t at = (size_t)y * src_stride + (size_t)(i * factor + x);
                sum += !src ? weight[at] : weight ? (uint32_t)src[at] * weight[at] : src[at];
            }
        dst[i] = (float)sum / white;
    }
}
