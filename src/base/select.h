/* select.h - choices in loops that are to become vectors. */
#ifndef SF_BASE_SELECT_H
#define SF_BASE_SELECT_H

#include <stdint.h>
#include <string.h>

/* yes ? a : b, by bits: what compilers make branches of they do not make vectors of. */
static inline float sf_select(int yes, float a, float b) {
    uint32_t mask = 0u - (uint32_t)yes, bits, other;
    memcpy(&bits, &a, sizeof bits);
    memcpy(&other, &b, sizeof other);
    bits = (bits & mask) | (other & ~mask);
    memcpy(&a, &bits, sizeof a);
    return a;
}

#endif
