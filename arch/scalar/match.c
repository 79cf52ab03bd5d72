/* match.c - products of descriptors, the best two of each row and of each column, in plain C. */
#include "scalar.h"

static uint32_t product_of(const sf_match_args *args, size_t row, size_t column) {
    const uint8_t *a = args->a + row * SF_DESCRIPTOR;
    const uint8_t *b = args->b + column / SF_LANES * SF_LANES * SF_DESCRIPTOR + column % SF_LANES * 4;
    uint32_t sum = 0;
    for (size_t k = 0; k < SF_DESCRIPTOR; k++) sum += (uint32_t)a[k] * b[k / 4 * 4 * SF_LANES + k % 4];
    return sum;
}

static void take(uint32_t key, uint32_t *best, uint32_t *second) {
    uint32_t lower = key < *best ? key : *best;
    if (lower > *second) *second = lower;
    if (key > *best) *best = key;
}

void sf_match_scalar(const sf_match_args *args) {
    for (size_t i = 0; i < args->rows; i++) args->row_best[i] = args->row_second[i] = 0;
    for (size_t j = 0; j < args->columns; j++) args->column_best[j] = args->column_second[j] = 0;
    for (size_t i = 0; i < args->rows; i++)
        for (size_t j = 0; j < args->columns; j++) {
            uint32_t product = product_of(args, i, j);
            take(sf_match_key(product, (uint32_t)j), &args->row_best[i], &args->row_second[i]);
            take(sf_match_key(product, (uint32_t)i), &args->column_best[j], &args->column_second[j]);
        }
}
