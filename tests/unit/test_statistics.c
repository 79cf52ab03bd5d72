/* test_statistics.c - selection against sorting, means of boxes, lines through known points. */
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

static void test_box_means(void **state) {
    (void)state;
    uint8_t interleaved[4 * 12], white[64 * 64];
    for (size_t i = 0; i < sizeof interleaved; i++) interleaved[i] = (uint8_t)(i * i % 251);
    for (size_t at = 0; at < 3; at++) { /* the channels of 2 x 2 pixels in 4 rows of 4 */
        const uint8_t *corner = interleaved + 12 + 3 + at;
        int sum = corner[0] + corner[3] + corner[12] + corner[15];
        assert_int_equal(sf_box_mean(corner, 2, 3, 12), (sum + 2) / 4);
    }
    assert_int_equal(sf_box_mean((const uint8_t[]){1, 0, 0, 1}, 2, 1, 2), 1); /* a half goes up */
    assert_int_equal(sf_box_mean((const uint8_t[]){1, 0, 0, 0}, 2, 1, 2), 0);
    assert_int_equal(sf_box_mean((const uint8_t[]){7}, 1, 1, 1), 7);
    memset(white, 255, sizeof white);
    assert_int_equal(sf_box_mean(white, 64, 1, 64), 255);
}

static sf_line_sums sums_of(const double (*pairs)[3], size_t n) {
    sf_line_sums s = {0};
    for (size_t i = 0; i < n; i++) {
        double w = pairs[i][0], x = pairs[i][1], y = pairs[i][2];
        s.w += w, s.x += w * x, s.y += w * y, s.xx += w * x * x, s.xy += w * x * y;
    }
    return s;
}

static void test_lines(void **state) {
    (void)state;
    static const double on_line[][3] = {{1, 0, 3}, {2, 1, 5}, {0.5, -2, -1}}; /* y = 2 x + 3 */
    static const double off_line[][3] = {
        {1, 0, 0}, {1, 1, 1}, {1, 2, 0}, {3, 1, 3}}; /* gain 0, at the mean */
    static const double flat[][3] = {{1, 2, 5}, {3, 2, 7}};
    double gain, bias;
    sf_line_sums s = sums_of(on_line, 3);
    sf_line_fit(&s, 0, &gain, &bias);
    assert_float_equal(gain, 2, 1e-12);
    assert_float_equal(bias, 3, 1e-12);
    sf_line_fit(&s, 1e9, &gain, &bias); /* told that this spread is none */
    assert_true(gain == 1);
    assert_float_equal(bias, (s.y - s.x) / s.w, 1e-12);
    s = sums_of(off_line, 4);
    sf_line_fit(&s, 0, &gain, &bias);
    assert_float_equal(gain, 0, 1e-12);
    assert_float_equal(bias, 10 / 6.0, 1e-12);
    s = sums_of(flat, 2);
    sf_line_fit(&s, 0, &gain, &bias);
    assert_true(gain == 1);
    assert_float_equal(bias, 4.5, 1e-12);
    sf_line_fit(&(sf_line_sums){0}, 0, &gain, &bias);
    assert_true(gain == 1 && bias == 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_ranks),     cmocka_unit_test(test_medians), cmocka_unit_test(test_order),
        cmocka_unit_test(test_box_means), cmocka_unit_test(test_lines),
    };
    return cmocka_run_group_tests_name("statistics", tests, NULL, NULL);
}
