/* features_fixture.c - pictures of blobs whose places and sizes are known, and the features found in them. */
#include "features_fixture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "reference/random.h"

static void add_blob(double *light, int width, int height, const test_blob *b) {
    double reach = 6 * b->deviation;
    int first_x = (int)fmax(0, b->x - reach), end_x = (int)fmin(width, b->x + reach + 1);
    int first_y = (int)fmax(0, b->y - reach), end_y = (int)fmin(height, b->y + reach + 1);
    for (int y = first_y; y < end_y; y++)
        for (int x = first_x; x < end_x; x++) {
            double dx = x + 0.5 - b->x, dy = y + 0.5 - b->y;
            light[(size_t)y * (size_t)width + (size_t)x] +=
                b->height * exp(-(dx * dx + dy * dy) / (2 * b->deviation * b->deviation));
        }
}

uint8_t *test_draw_blobs(int width, int height, const test_blob *blobs, size_t count) {
    size_t pixels = (size_t)width * (size_t)height;
    double *light = malloc(pixels * sizeof *light);
    uint8_t *grey = malloc(pixels);
    assert_true(light && grey);
    for (size_t i = 0; i < pixels; i++) light[i] = 128;
    for (size_t i = 0; i < count; i++) add_blob(light, width, height, &blobs[i]);
    for (size_t i = 0; i < pixels; i++) grey[i] = (uint8_t)fmin(fmax(light[i] + 0.5, 0), 255);
    free(light);
    return grey;
}

void test_scatter_blobs(uint64_t seed, int width, int height, test_blob *blobs, size_t count) {
    sf_rng rng;
    sf_rng_seed(&rng, seed);
    for (size_t i = 0; i < count; i++) {
        double sign = sf_rng_below(&rng, 2) ? 1 : -1;
        blobs[i] = (test_blob){test_random_between(&rng, 0, width), test_random_between(&rng, 0, height),
                               exp(test_random_between(&rng, log(1.5), log(12))),
                               sign * test_random_between(&rng, 15, 50)};
    }
}

sf_photo test_grey(const uint8_t *pixels, int width, int height) {
    return (sf_photo){.pixels = pixels, .stride = (size_t)width, .width = width, .height = height};
}

sf_features test_find_features(sf_context *ctx, const sf_photo *picture, const sf_features_options *options) {
    sf_features features;
    assert_ok(ctx, sf_features_find(ctx, picture, options, &features));
    return features;
}

int test_same_features(const sf_features *a, const sf_features *b) {
    if (a->count != b->count) return 0;
    return !a->count || (!memcmp(a->points, b->points, a->count * sizeof *a->points) &&
                         !memcmp(a->descriptors, b->descriptors, a->count * SF_DESCRIPTOR));
}
