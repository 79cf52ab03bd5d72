/* roof.h - what a level could do at best: its arithmetic, and its way to memory. */
#ifndef SF_ARCH_VECTOR_ROOF_H
#define SF_ARCH_VECTOR_ROOF_H

#include <stddef.h>

typedef struct sf_roof {
    int lanes;                     /* floats a vector */
    int block_columns, block_rows; /* px that the blending's vectors cover */
    /* Multiply-adds in 12 chains of vectors, independent of each other; returns how many operations of one
     * float that was, two a multiply-add. */
    double (*multiply_add)(size_t rounds);
    /* n floats, a multiple of 64, aligned to 64 bytes. The sum is returned so that it is made. */
    float (*read)(const float *array, size_t n);
    void (*write)(float *array, size_t n, float value);
    void (*update)(float *array, size_t n, float value);
} sf_roof;

void sf_roof_sse4(sf_roof *roof);
void sf_roof_avx2(sf_roof *roof);
void sf_roof_avx512(sf_roof *roof);
void sf_roof_neon(sf_roof *roof);

#endif
