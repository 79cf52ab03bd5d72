/* float24.h - floats of 3 bytes, for what ranks send: sign, exponent and 15 bits of the fraction.
 *
 * Rounded to the nearest, so right to 2^-16 of the value. Infinities and NaN stay what they are.
 */
#ifndef SF_RENDER_FLOAT24_H
#define SF_RENDER_FLOAT24_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

enum { SF_FLOAT24_BYTES = 3 };

static inline void sf_put_float24(float value, uint8_t *to) {
    const uint32_t exponent = 0x7f800000;
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    if ((bits & exponent) != exponent)
        bits += 0x7f + (bits >> 8 & 1);
    else if (bits & 0xff)
        bits |= 0x100; /* a NaN whose upper bits were all zero */
    to[0] = (uint8_t)(bits >> 8), to[1] = (uint8_t)(bits >> 16), to[2] = (uint8_t)(bits >> 24);
}

static inline float sf_float24(const uint8_t *from) {
    uint32_t bits = (uint32_t)from[0] << 8 | (uint32_t)from[1] << 16 | (uint32_t)from[2] << 24;
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

#endif
