/* schur.c - points taken out of the normal equations of a bundle: lanes = columns of a block's row, six, as
 * four and two. Compilers split four doubles where a level has vectors of two. Masked vectors of eight were
 * tried on AVX-512: a load right after a masked store to the same row waits for it, and the whole takes four
 * times as long. */
#include "kernels.h"

#include "vec.h"

typedef double four __attribute__((vector_size(32), aligned(8), may_alias));
typedef double two __attribute__((vector_size(16), aligned(8), may_alias));

/* block -= Y^T Z, none of its operations fused. */
VEC void take(const double *Y, const double *Z, double *block) {
    const four a = *(const four *)Z, b = *(const four *)(Z + 6), c = *(const four *)(Z + 12);
    const two d = *(const two *)(Z + 4), e = *(const two *)(Z + 10), f = *(const two *)(Z + 16);
    for (int k = 0; k < 6; k++, block += 6) {
        const double x = Y[k], y = Y[6 + k], z = Y[12 + k];
        *(four *)block -= x * a + y * b + z * c;
        *(two *)(block + 4) -= x * d + y * e + z * f;
    }
}

void SF_AT_LEVEL(sf_schur)(const sf_schur_args *args) {
    const double *Z = args->Z;
    for (size_t i = 0; i < args->count; i++, Z += 18)
        if (args->rank[i] <= args->last)
            take(args->Y, Z, args->blocks + 36 * (size_t)args->table[args->rank[i]]);
}
