/* test_features.c - features are where blobs are, turn with the picture, and are the same at every level. */
#include "features_fixture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define TURN 6.28318530717958647692

/* ---- places and scales ----------------------------------------------------------------------------------
 */

/* The scale at which a difference of Gaussians, its scales 2^(1/3) apart, is greatest in the middle of a
 * Gaussian of that deviation, which has the picture's blur of 0.5 px in it. */
static double expected_scale(double deviation) {
    return sqrt((deviation * deviation - 0.25) / 1.2599210498948732);
}

static size_t nearest(const sf_features *f, double x, double y) {
    size_t best = 0;
    for (size_t i = 1; i < f->count; i++)
        if (hypot((double)f->points[i].x - x, (double)f->points[i].y - y) <
            hypot((double)f->points[best].x - x, (double)f->points[best].y - y))
            best = i;
    return best;
}

static void blobs_are_found_where_they_are(void **state) {
    (void)state;
    enum { BLOBS = 8, WIDTH = 700, HEIGHT = 330 };
    sf_context *ctx = test_context();
    sf_features_options options = sf_features_options_default();
    test_blob blobs[BLOBS];
    for (int i = 0; i < BLOBS; i++) /* between pixels, of all sizes, far from each other */
        blobs[i] = (test_blob){80 + 170 * (i % 4) + 0.13 * i, 80 + 170 * (i / 4) + 0.31 * i, 3 * pow(1.3, i),
                               i % 2 ? 90 : -90};
    uint8_t *pixels = test_draw_blobs(WIDTH, HEIGHT, blobs, BLOBS);
    sf_photo picture = test_grey(pixels, WIDTH, HEIGHT);
    for (int upsampling = SF_UPSAMPLE_NEVER; upsampling <= SF_UPSAMPLE_ALWAYS; upsampling++) {
        options.upsampling = (sf_upsampling)upsampling;
        sf_features f = test_find_features(ctx, &picture, &options);
        assert_true(f.count >= BLOBS);
        for (int i = 0; i < BLOBS; i++) {
            const sf_keypoint *p = &f.points[nearest(&f, blobs[i].x, blobs[i].y)];
            double off = hypot((double)p->x - blobs[i].x, (double)p->y - blobs[i].y);
            double scale = (double)p->scale / expected_scale(blobs[i].deviation);
            print_message("deviation %.2f: %.3f px off, scale %.3f of what it is\n", blobs[i].deviation, off,
                          scale);
            assert_true(off < 0.1);
            assert_true(fabs(scale - 1) < 0.05);
        }
        sf_features_free(ctx, &f);
    }
    free(pixels);
    sf_context_destroy(&ctx);
}

/* ---- a quarter turn -------------------------------------------------------------------------------------
 */

static uint8_t *turned(const uint8_t *pixels, int width, int height) {
    uint8_t *out = malloc((size_t)width * (size_t)height);
    assert_non_null(out);
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++)
            out[(size_t)x * (size_t)height + (size_t)(height - 1 - y)] =
                pixels[(size_t)y * (size_t)width + (size_t)x];
    return out;
}

static double between_angles(double a, double b) { return fabs(remainder(a - b, TURN)); }

static double likeness(const uint8_t *a, const uint8_t *b) {
    double ab = 0, aa = 0, bb = 0;
    for (int k = 0; k < SF_DESCRIPTOR; k++) {
        ab += a[k] * b[k];
        aa += a[k] * a[k];
        bb += b[k] * b[k];
    }
    return ab / sqrt(aa * bb);
}

/* Whether `f` has the feature `i` of `g`, turned by a quarter. */
static int has_turned(const sf_features *f, const sf_features *g, size_t i, int height) {
    const sf_keypoint *was = &g->points[i];
    for (size_t k = 0; k < f->count; k++) {
        const sf_keypoint *is = &f->points[k];
        if (hypot((double)is->x - (height - (double)was->y), (double)is->y - (double)was->x) < 0.05 &&
            fabs((double)is->scale / (double)was->scale - 1) < 0.01 &&
            between_angles((double)is->angle, (double)was->angle + TURN / 4) < 0.02 &&
            likeness(f->descriptors + k * SF_DESCRIPTOR, g->descriptors + i * SF_DESCRIPTOR) > 0.995)
            return 1;
    }
    return 0;
}

/* A side is a multiple of 64 and 1, so that each octave has the same pixels from either end. */
static void a_quarter_turn_turns_features(void **state) {
    (void)state;
    enum { WIDTH = 257, HEIGHT = 193, BLOBS = 400 };
    sf_context *ctx = test_context();
    sf_features_options options = sf_features_options_default();
    options.upsampling = SF_UPSAMPLE_NEVER;
    test_blob blobs[BLOBS];
    test_scatter_blobs(3, WIDTH, HEIGHT, blobs, BLOBS);
    uint8_t *pixels = test_draw_blobs(WIDTH, HEIGHT, blobs, BLOBS), *other = turned(pixels, WIDTH, HEIGHT);
    sf_photo upright = test_grey(pixels, WIDTH, HEIGHT), lying = test_grey(other, HEIGHT, WIDTH);
    sf_features f = test_find_features(ctx, &upright, &options);
    sf_features g = test_find_features(ctx, &lying, &options);
    size_t found = 0;
    for (size_t i = 0; i < f.count; i++) found += (size_t)has_turned(&g, &f, i, HEIGHT);
    print_message("%zu features, %zu of them turned\n", f.count, found);
    assert_true(f.count > 150 && found >= f.count * 98 / 100);
    assert_between(g.count, f.count * 98 / 100, f.count * 102 / 100);
    sf_features_free(ctx, &f);
    sf_features_free(ctx, &g);
    free(pixels);
    free(other);
    sf_context_destroy(&ctx);
}

/* ---- the same everywhere --------------------------------------------------------------------------------
 */

enum { PICTURES = 5 };

typedef struct album {
    uint8_t *pixels[PICTURES];
    sf_photo pictures[PICTURES];
} album;

static void make_album(album *a) {
    static const int sizes[PICTURES][2] = {{160, 120}, {97, 203}, {640, 23}, {16, 16}, {41, 300}};
    for (int i = 0; i < PICTURES; i++) {
        enum { BLOBS = 250 };
        test_blob blobs[BLOBS];
        int width = sizes[i][0], height = sizes[i][1];
        test_scatter_blobs((uint64_t)i, width, height, blobs, BLOBS);
        a->pixels[i] = test_draw_blobs(width, height, blobs, BLOBS);
        a->pictures[i] = test_grey(a->pixels[i], width, height);
    }
}

static void free_album(album *a) {
    for (int i = 0; i < PICTURES; i++) free(a->pixels[i]);
}

static void find_album(const char *isa, int threads, const sf_features_options *options,
                       sf_features features[PICTURES]) {
    sf_context *ctx;
    sf_context_options context_options = {.threads = threads, .isa = isa};
    album a;
    sf_features own[PICTURES];
    assert_int_equal(sf_context_create(&ctx, &context_options), SF_OK);
    make_album(&a);
    assert_ok(ctx, sf_features_find_all(ctx, a.pictures, PICTURES, options, own));
    for (int i = 0; i < PICTURES; i++) { /* to outlive the context */
        size_t n = own[i].count;
        features[i] = (sf_features){n, calloc(n + 1, sizeof *own[i].points), calloc(n + 1, SF_DESCRIPTOR)};
        assert_true(features[i].points && features[i].descriptors);
        if (n) memcpy(features[i].points, own[i].points, n * sizeof *own[i].points);
        if (n) memcpy(features[i].descriptors, own[i].descriptors, n * SF_DESCRIPTOR);
        sf_features_free(ctx, &own[i]);
    }
    free_album(&a);
    sf_context_destroy(&ctx);
}

static void free_found(sf_features features[PICTURES]) {
    for (int i = 0; i < PICTURES; i++) free(features[i].points), free(features[i].descriptors);
}

static void levels_and_threads_find_the_same_bytes(void **state) {
    (void)state;
    sf_features_options options = sf_features_options_default();
    for (int upsampling = SF_UPSAMPLE_NEVER; upsampling <= SF_UPSAMPLE_ALWAYS; upsampling++) {
        sf_features expected[PICTURES], found[PICTURES];
        sf_isa_info info;
        options.upsampling = (sf_upsampling)upsampling;
        find_album("scalar", 1, &options, expected);
        assert_true(expected[0].count > 60 && expected[1].count > 60 && expected[4].count > 30);
        for (size_t level = 0; !sf_isa_describe(level, &info); level++) {
            if (!info.usable) continue;
            find_album(info.name, 1 + (int)level % 3, &options, found);
            for (int i = 0; i < PICTURES; i++) assert_true(test_same_features(&expected[i], &found[i]));
            free_found(found);
        }
        free_found(expected);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(blobs_are_found_where_they_are),
                                       cmocka_unit_test(a_quarter_turn_turns_features),
                                       cmocka_unit_test(levels_and_threads_find_the_same_bytes)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
