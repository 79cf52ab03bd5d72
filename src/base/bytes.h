/* bytes.h - little-endian values from a buffer, never past its end. */
#ifndef SF_BASE_BYTES_H
#define SF_BASE_BYTES_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

/* A cursor. Reading past the end gives zeros and sets `failed`, so that a caller may check once a record. */
typedef struct sf_bytes {
    const uint8_t *data;
    size_t size, at;
    int failed;
} sf_bytes;

static inline size_t sf_bytes_left(const sf_bytes *b) { return b->size - b->at; }

static inline const uint8_t *sf_bytes_take(sf_bytes *b, size_t n) {
    if (b->failed || n > sf_bytes_left(b)) {
        b->failed = 1;
        return NULL;
    }
    b->at += n;
    return b->data + b->at - n;
}

static inline uint64_t sf_bytes_uint(sf_bytes *b, int n) {
    const uint8_t *p = sf_bytes_take(b, (size_t)n);
    uint64_t v = 0;
    for (int i = 0; p && i < n; i++) v |= (uint64_t)p[i] << (8 * i);
    return v;
}

static inline uint8_t sf_bytes_u8(sf_bytes *b) { return (uint8_t)sf_bytes_uint(b, 1); }
static inline uint32_t sf_bytes_u32(sf_bytes *b) { return (uint32_t)sf_bytes_uint(b, 4); }
static inline uint64_t sf_bytes_u64(sf_bytes *b) { return sf_bytes_uint(b, 8); }

static inline double sf_bytes_f64(sf_bytes *b) {
    uint64_t u = sf_bytes_u64(b);
    double v;
    memcpy(&v, &u, sizeof v);
    return v;
}

static inline float sf_bytes_f32(sf_bytes *b) {
    uint32_t u = sf_bytes_u32(b);
    float v;
    memcpy(&v, &u, sizeof v);
    return v;
}

#endif
