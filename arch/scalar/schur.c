/* schur.c - points taken out of the normal equations of a bundle, in plain C. */
#include "scalar.h"

void sf_schur_scalar(const sf_schur_args *args) {
    const double *Y = args->Y, *Z = args->Z;
    for (size_t i = 0; i < args->count; i++, Z += 18) {
        if (args->rank[i] > args->last) continue;
        double *block = args->blocks + 36 * (size_t)args->table[args->rank[i]];
        for (int k = 0; k < 6; k++)
            for (int l = 0; l < 6; l++)
                block[6 * k + l] -= Y[k] * Z[l] + Y[6 + k] * Z[6 + l] + Y[12 + k] * Z[12 + l];
    }
}
