/* roof.c - a level's multiply-adds, and its loads and stores, with nothing else to wait for. */
#include "roof.h"

#include "vec.h"

/* Enough to fill two units of a latency of five or six cycles; with the factors they fit in 16 registers. */
enum { CHAINS = 12, STREAMS = 4 };

static double multiply_add(size_t rounds) {
    volatile float factor_source = 0.999f, rest_source = 1e-3f; /* unknown to the compiler */
    vf chain[CHAINS], factor = vf_set(factor_source), rest = vf_set(rest_source);
    for (int k = 0; k < CHAINS; k++) chain[k] = vf_set((float)k);
    for (size_t round = 0; round < rounds; round++)
        for (int k = 0; k < CHAINS; k++) chain[k] = vf_fma(chain[k], factor, rest);
    for (int k = 1; k < CHAINS; k++) chain[0] = chain[0] + chain[k];
    volatile float sink = vf_sum(chain[0]);
    (void)sink;
    return 2.0 * CHAINS * VW * (double)rounds;
}

static float read_all(const float *array, size_t n) {
    vf sum[STREAMS];
    for (int k = 0; k < STREAMS; k++) sum[k] = vf_set(0);
    for (size_t i = 0; i < n; i += STREAMS * VW)
        for (int k = 0; k < STREAMS; k++) sum[k] = sum[k] + vf_load(array + i + k * VW);
    return vf_sum((sum[0] + sum[1]) + (sum[2] + sum[3]));
}

static void write_all(float *array, size_t n, float value) {
    vf x = vf_set(value);
    for (size_t i = 0; i < n; i += STREAMS * VW)
        for (int k = 0; k < STREAMS; k++) vf_store(array + i + k * VW, x);
}

static void update_all(float *array, size_t n, float value) {
    vf x = vf_set(value);
    for (size_t i = 0; i < n; i += STREAMS * VW)
        for (int k = 0; k < STREAMS; k++) vf_store(array + i + k * VW, vf_load(array + i + k * VW) + x);
}

void SF_AT_LEVEL(sf_roof)(sf_roof *roof) {
    *roof = (sf_roof){.lanes = VW,
                      .block_columns = VB_COLUMNS,
                      .block_rows = VB_ROWS,
                      .multiply_add = multiply_add,
                      .read = read_all,
                      .write = write_all,
                      .update = update_all};
}
