/* quantise.h - values as bytes, and back. */
#ifndef SF_IO_QUANTISE_H
#define SF_IO_QUANTISE_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>

#include "../scene/gaussian_math.h"

/* The nearest of 0..255; counts in *clipped (may be NULL) a value that is beyond by more than rounding. */
static inline uint8_t sf_byte_of(double value, size_t *clipped) {
    double nearest = round(value);
    if (nearest >= 0 && nearest <= 255) return (uint8_t)nearest;
    if (clipped) ++*clipped;
    return nearest > 255 ? 255 : 0;
}

/* The logit of an opacity stored as 255 times itself. The ends stand for the half step that rounds to them: a
 * quarter of a step inside, they come back finite, and as the same byte. */
static inline float sf_logit_of_byte(uint8_t byte) {
    double opacity = byte == 0 ? 0.25 / 255 : byte == 255 ? 254.75 / 255 : byte / 255.0;
    return (float)sf_logit(opacity);
}

#endif
