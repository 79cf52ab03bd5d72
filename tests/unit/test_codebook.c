/* test_codebook.c - levels for values, a palette for vectors: against what each must be at best. */
#include "testing.h"

#include <math.h>

#include "io/codebook.h"

enum { MANY = 5000, DIMS = 5, VECTORS = 400 };

/* Nearly normal, of a fixed sequence. */
static float bell(unsigned i) {
    double sum = 0;
    for (unsigned k = 0; k < 6; k++) {
        i = i * 1664525u + 1013904223u;
        sum += (double)(i >> 8) / (1 << 24) - 0.5;
    }
    return (float)sum;
}

static double squares(const float *values, size_t n, const float levels[SF_CODEBOOK]) {
    double sum = 0;
    for (size_t i = 0; i < n; i++)
        sum += pow((double)values[i] - (double)levels[sf_codebook_nearest(levels, values[i])], 2);
    return sum;
}

static void test_few_values_are_kept(void **state) {
    sf_context *ctx = test_context();
    float values[1000], levels[SF_CODEBOOK];
    (void)state;
    for (int distinct = 1; distinct <= 200; distinct = 2 * distinct + 1) {
        for (int i = 0; i < 1000; i++) values[i] = 0.37f * (float)(i % distinct) - 5;
        assert_ok(ctx, sf_codebook_make(ctx, values, 1000, levels));
        for (int i = 0; i < 1000; i++)
            assert_float_equal(levels[sf_codebook_nearest(levels, values[i])], values[i], 1e-5);
    }
    sf_context_destroy(&ctx);
}

static void test_levels(void **state) {
    sf_context *ctx = test_context();
    static float values[MANY];
    float levels[SF_CODEBOOK], even[SF_CODEBOOK], least = 0, most = 0;
    (void)state;
    for (unsigned i = 0; i < MANY; i++) {
        values[i] = powf(bell(i), 3); /* most near 0, few far away */
        least = fminf(least, values[i]);
        most = fmaxf(most, values[i]);
    }
    assert_ok(ctx, sf_codebook_make(ctx, values, MANY, levels));
    for (int k = 0; k < SF_CODEBOOK; k++) even[k] = least + (most - least) * ((float)k + 0.5f) / SF_CODEBOOK;
    for (int k = 1; k < SF_CODEBOOK; k++) assert_true(levels[k] >= levels[k - 1]);
    assert_true(squares(values, MANY, levels) < 0.3 * squares(values, MANY, even));
    for (int i = 0; i < MANY; i++) {
        float nearest = levels[sf_codebook_nearest(levels, values[i])];
        for (int k = 0; k < SF_CODEBOOK; k++)
            assert_true(fabsf(values[i] - levels[k]) >= fabsf(values[i] - nearest));
    }
    assert_int_equal(sf_codebook_nearest(levels, -1e9f), 0);
    assert_int_equal(sf_codebook_nearest(levels, 1e9f), SF_CODEBOOK - 1);
    sf_context_destroy(&ctx);
}

static double make(sf_context *ctx, const float *vectors, size_t most, float *centroids, uint32_t *labels,
                   size_t *made) {
    double sum = 0;
    assert_ok(ctx,
              sf_palette_make(ctx, &(sf_vectors){vectors, VECTORS, DIMS}, most, centroids, labels, made));
    assert_between(*made, 1, most);
    for (size_t i = 0; i < VECTORS; i++) {
        assert_true(labels[i] < *made);
        for (size_t d = 0; d < DIMS; d++)
            sum += pow((double)vectors[DIMS * i + d] - (double)centroids[DIMS * labels[i] + d], 2);
    }
    return sum;
}

static void assert_means(const float *vectors, const float *centroids, const uint32_t *labels, size_t made) {
    for (size_t k = 0; k < made; k++)
        for (size_t d = 0; d < DIMS; d++) {
            double sum = 0, n = 0;
            for (size_t i = 0; i < VECTORS; i++) {
                if (labels[i] != k) continue;
                sum += (double)vectors[DIMS * i + d];
                n++;
            }
            assert_true(n > 0);
            assert_float_equal(centroids[DIMS * k + d], sum / n, 1e-5);
        }
}

static void test_palette(void **state) {
    sf_context *ctx = test_context();
    static float vectors[VECTORS * DIMS], centroids[VECTORS * DIMS];
    static uint32_t labels[VECTORS];
    size_t made;
    double before = INFINITY;
    (void)state;
    for (unsigned i = 0; i < VECTORS * DIMS; i++) vectors[i] = bell(i);
    for (size_t most = 1; most <= 256; most *= 4) {
        double sum = make(ctx, vectors, most, centroids, labels, &made);
        assert_int_equal(made, most);
        assert_means(vectors, centroids, labels, made);
        assert_true(sum < 0.8 * before);
        before = sum;
    }
    assert_true(make(ctx, vectors, VECTORS, centroids, labels, &made) < 1e-9);
    assert_int_equal(made, VECTORS);
    sf_context_destroy(&ctx);
}

/* Clusters far apart are found, each by one vector; of vectors that are all alike one is enough. */
static void test_palette_of_clusters(void **state) {
    sf_context *ctx = test_context();
    static float vectors[VECTORS * DIMS], centroids[VECTORS * DIMS];
    static uint32_t labels[VECTORS];
    size_t made;
    (void)state;
    for (size_t i = 0; i < VECTORS * DIMS; i++) vectors[i] = 0.1f * (float)(i % DIMS);
    make(ctx, vectors, 8, centroids, labels, &made);
    assert_int_equal(made, 1);
    for (size_t i = 0; i < VECTORS * DIMS; i++)
        vectors[i] = (i / DIMS % 7 == i % DIMS ? 100.0f : 0) + 0.01f * bell((unsigned)i);
    make(ctx, vectors, 6, centroids, labels, &made);
    for (size_t i = 0; i < VECTORS; i++)
        for (size_t d = 0; d < DIMS; d++)
            assert_float_equal(centroids[DIMS * labels[i] + d], (i % 7 == d ? 100 : 0), 0.05);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_few_values_are_kept),
        cmocka_unit_test(test_levels),
        cmocka_unit_test(test_palette),
        cmocka_unit_test(test_palette_of_clusters),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
