/* match.c - products of descriptors, the best two of each row and of each column: lanes = columns. */
#include "kernels.h"

#include "vec.h"

/* A tile is ROWS x 2 vectors of sums. */
enum { ROWS = VW == 16 ? SF_MATCH_ROWS : SF_MATCH_ROWS / 2, STEP = 4 * SF_LANES };

typedef struct two_best {
    vu best, second;
} two_best;

VEC void take(two_best *t, vu key) {
    t->second = vu_max(t->second, vu_min(t->best, key));
    t->best = vu_max(t->best, key);
}

/* 1. Products of ROWS rows from `row` on and of 2 VW columns. */
VEC void multiply(const sf_match_args *m, size_t row, size_t column, vu sums[ROWS][2]) {
    const uint8_t *a = m->a + row * SF_DESCRIPTOR, *b[2];
    for (size_t v = 0; v < 2; v++) {
        size_t c = column + v * VW;
        b[v] = m->b + c / SF_LANES * SF_LANES * SF_DESCRIPTOR + c % SF_LANES * 4;
    }
    for (int r = 0; r < ROWS; r++) sums[r][0] = sums[r][1] = vu_zero();
    for (int k = 0; k < SF_DESCRIPTOR / 4; k++) {
        vu left = vu_load_bytes(b[0] + k * STEP), right = vu_load_bytes(b[1] + k * STEP);
        for (int r = 0; r < ROWS; r++) {
            uint32_t four;
            memcpy(&four, a + r * SF_DESCRIPTOR + 4 * k, sizeof four);
            vu same = vu_set(four);
            sums[r][0] = vu_dot4(sums[r][0], same, left);
            sums[r][1] = vu_dot4(sums[r][1], same, right);
        }
    }
}

/* 2. Keys of the products: 11 bits are the index's, from above. */
#define WITH_INDEX(products, indices) vu_add(vu_left(products, 11), indices)
_Static_assert(SF_MATCH_BLOCK == 1 << 11, "11 bits of index");

VEC void take_columns(const sf_match_args *m, size_t row, size_t column, vu sums[ROWS]) {
    uint32_t *best = m->column_best + column, *second = m->column_second + column;
    two_best t = {vu_load(best), vu_load(second)};
    for (size_t r = 0; r < ROWS; r++)
        take(&t, WITH_INDEX(sums[r], vu_set((uint32_t)(SF_MATCH_BLOCK - 1 - row - r))));
    vu_store(best, t.best);
    vu_store(second, t.second);
}

/* 3. The best two of a row among the lanes' best. */
VEC void gather_row(const two_best *t, uint32_t *best, uint32_t *second) {
    _Alignas(64) uint32_t keys[2 * VW];
    vu_store(keys, t->best);
    vu_store(keys + VW, t->second);
    *best = *second = 0;
    for (int i = 0; i < 2 * VW; i++) {
        uint32_t lower = keys[i] < *best ? keys[i] : *best;
        if (lower > *second) *second = lower;
        if (keys[i] > *best) *best = keys[i];
    }
}

void SF_AT_LEVEL(sf_match)(const sf_match_args *args) {
    static const _Alignas(64)
        uint32_t from_15[SF_LANES] = {15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0};
    const sf_match_args m = *args; /* which no store can change: it stays in registers */
    for (size_t c = 0; c < m.columns; c++) m.column_best[c] = m.column_second[c] = 0;
    for (size_t row = 0; row < m.rows; row += ROWS) {
        two_best rows[ROWS];
        for (int r = 0; r < ROWS; r++) rows[r] = (two_best){vu_zero(), vu_zero()};
        for (size_t column = 0; column < m.columns; column += 2 * VW) {
            vu sums[ROWS][2];
            multiply(&m, row, column, sums);
            for (size_t v = 0; v < 2; v++) {
                size_t c = column + v * VW;
                vu part[ROWS],
                    index = vu_add(vu_load(from_15), vu_set((uint32_t)(SF_MATCH_BLOCK - SF_LANES - c)));
                for (int r = 0; r < ROWS; r++) part[r] = sums[r][v];
                for (int r = 0; r < ROWS; r++) take(&rows[r], WITH_INDEX(part[r], index));
                take_columns(&m, row, c, part);
            }
        }
        for (size_t r = 0; r < ROWS; r++) gather_row(&rows[r], &m.row_best[row + r], &m.row_second[row + r]);
    }
}
