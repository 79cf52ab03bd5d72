/* test_statistics.c - selection against sorting. */
#include "testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "base/statistics.h"

enum { MOST = 65, ROUNDS = 40 };

/* Few levels: many values are equal. */
static void draw(sf_rng *rng, double levels, size_t n, double *values, float *floats) {
    for (size_t i = 0; i < n; i++) {
        values[i] = floor(sf_rng_normal(rng) * levels) / levels;
        floats[i] = (float)values[i];
    }
}

/* Every rank, and the rest parted by it. */
static void check_ranks(const double *values, const float *floats, size_t n) {
    double sorted[MOST], mine[MOST];
    float minef[MOST];
    memcpy(sorted, values, n * sizeof *sorted);
    qsort(sorted, n, sizeof *sorted, sf_compare_doubles);
    for (size_t rank = 0; rank < n; rank++) {
        memcpy(mine, values, n * sizeof *mine);
        memcpy(minef, floats, n * sizeof *minef);
        assert_true(sf_ranked(mine, n, rank) == sorted[rank]);
        assert_true(sf_rankedf(minef, n, rank) == (float)sorted[rank]);
        for (size_t i = 0; i < n; i++) assert_true(i < rank ? mine[i] <= mine[rank] : mine[i] >= mine[rank]);
        qsort(mine, n, sizeof *mine, sf_compare_doubles);
        assert_memory_equal(mine, sorted, n * sizeof *mine);
    }
}

static void test_ranks(void **state) {
    (void)state;
    sf_rng rng;
    double values[MOST];
    float floats[MOST];
    sf_rng_seed(&rng, 1);
    for (int round = 0; round < ROUNDS; round++)
        for (size_t n = 1; n <= MOST; n += 1 + n / 4) {
            draw(&rng, round % 2 ? 2 : 1024, n, values, floats);
            check_ranks(values, floats, n);
        }
}

static void test_medians(void **state) {
    (void)state;
    double odd[] = {5, -1, 3}, even[] = {4, 1, 3, 2}, infinite[] = {INFINITY, 1, INFINITY, 0, 2};
    float oddf[] = {5, -1, 3}, evenf[] = {4, 1, 3, 2};
    assert_true(sf_median(odd, 3) == 3 && sf_medianf(oddf, 3) == 3);
    assert_true(sf_median(even, 4) == 3 && sf_medianf(evenf, 4) == 3); /* the upper of two */
    assert_true(sf_median(infinite, 5) == 2);
    assert_true(sf_median(odd, 0) == 0 && sf_medianf(oddf, 0) == 0 && sf_ranked(odd, 0, 0) == 0);
}

static void test_order(void **state) {
    (void)state;
    double values[] = {2, -3, 0.5, -3};
    float floats[] = {2, -3, 0.5, -3};
    qsort(values, 4, sizeof *values, sf_compare_doubles);
    qsort(floats, 4, sizeof *floats, sf_compare_floats);
    assert_memory_equal(values, ((double[]){-3, -3, 0.5, 2}), sizeof values);
    assert_memory_equal(floats, ((float[]){-3, -3, 0.5, 2}), sizeof floats);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_ranks),
        cmocka_unit_test(test_medians),
        cmocka_unit_test(test_order),
    };
    return cmocka_run_group_tests_name("statistics", tests, NULL, NULL);
}
