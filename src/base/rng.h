/* rng.h - xoshiro256** (Blackman and Vigna 2018), seeded by splitmix64: the same numbers on every machine. */
#ifndef SF_BASE_RNG_H
#define SF_BASE_RNG_H

#include <math.h>
#include <stdint.h>

typedef struct sf_rng {
    uint64_t s[4];
} sf_rng;

static inline void sf_rng_seed(sf_rng *rng, uint64_t seed) {
    for (int i = 0; i < 4; i++) {
        uint64_t z = (seed += 0x9e3779b97f4a7c15u);
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
        z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
        rng->s[i] = z ^ (z >> 31);
    }
}

static inline uint64_t sf_rng_next(sf_rng *rng) {
    uint64_t *s = rng->s, x = s[1] * 5, t = s[1] << 17;
    x = ((x << 7) | (x >> 57)) * 9;
    s[2] ^= s[0];
    s[3] ^= s[1];
    s[1] ^= s[2];
    s[0] ^= s[3];
    s[2] ^= t;
    s[3] = (s[3] << 45) | (s[3] >> 19);
    return x;
}

/* Uniform in [0, 1). */
static inline double sf_rng_uniform(sf_rng *rng) { return (double)(sf_rng_next(rng) >> 11) * 0x1p-53; }

/* Uniform in 0..n-1; n > 0. The bias, below n/2^64, does not matter here. */
static inline uint64_t sf_rng_below(sf_rng *rng, uint64_t n) {
    return (uint64_t)(sf_rng_uniform(rng) * (double)n);
}

/* Standard normal (Box and Muller). */
static inline double sf_rng_normal(sf_rng *rng) {
    double u = 1.0 - sf_rng_uniform(rng), v = sf_rng_uniform(rng);
    return sqrt(-2.0 * log(u)) * cos(6.283185307179586 * v);
}

#endif
