/* hash.h - a 64-bit hash that finds accidents in files and pictures; it does not withstand a forger. */
#ifndef SF_BASE_HASH_H
#define SF_BASE_HASH_H

#include <stddef.h>
#include <stdint.h>

#define SF_HASH_SEED 0x51ed270b9f9e1f4bu

/* The hash of what `seed` stands for and then `size` bytes. How data is cut into calls is part of what is
 * hashed. Every step is one to one in the hash so far and in its 8 bytes: two inputs that differ within 8
 * aligned bytes never have the same hash. */
static inline uint64_t sf_hash(uint64_t seed, const void *data, size_t size) {
    const uint64_t odd = 0x9e3779b97f4a7c15u;
    const uint8_t *p = data;
    uint64_t h = (seed ^ size) * odd;
    for (size_t left = size; left;) {
        uint64_t word = 0;
        size_t n = left < 8 ? left : 8;
        if (n == 8) /* a single load where bytes stand in this order */
            word = (uint64_t)p[0] | (uint64_t)p[1] << 8 | (uint64_t)p[2] << 16 | (uint64_t)p[3] << 24 |
                   (uint64_t)p[4] << 32 | (uint64_t)p[5] << 40 | (uint64_t)p[6] << 48 | (uint64_t)p[7] << 56;
        for (size_t i = 0; n < 8 && i < n; i++) word |= (uint64_t)p[i] << (8 * i);
        h = (h ^ word) * odd;
        h ^= h >> 32;
        p += n;
        left -= n;
    }
    return h;
}

#endif
