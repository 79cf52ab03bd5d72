/* features_fixture.h - pictures of blobs whose places and sizes are known, and the features found in them. */
#ifndef TESTS_UNIT_FEATURES_FIXTURE_H
#define TESTS_UNIT_FEATURES_FIXTURE_H

#include "testing.h"

#include "sfm/features.h"

/* A Gaussian of light or shade; x, y px as keypoints have them. */
typedef struct test_blob {
    double x, y, deviation, height; /* height of 0..255 */
} test_blob;

/* The blobs on a grey of 128; free()d by the caller. */
uint8_t *test_draw_blobs(int width, int height, const test_blob *blobs, size_t count);

/* Blobs all over a picture, of deviations 1.5 to 12 px, the same for a seed. */
void test_scatter_blobs(uint64_t seed, int width, int height, test_blob *blobs, size_t count);

sf_photo test_grey(const uint8_t *pixels, int width, int height);

/* Finds the features; the test fails if it cannot. */
sf_features test_find_features(sf_context *ctx, const sf_photo *picture, const sf_features_options *options);

/* Whether two sets are the same to the last bit. */
int test_same_features(const sf_features *a, const sf_features *b);

#endif
