/* test_features_limits.c - masks, numbers of features, small and empty pictures, memory. */
#include "features_fixture.h"

#include <stdlib.h>
#include <string.h>

#include "base/rng.h"

enum { WIDTH = 240, HEIGHT = 170, BLOBS = 400 };

static uint8_t *draw(void) {
    test_blob blobs[BLOBS];
    test_scatter_blobs(11, WIDTH, HEIGHT, blobs, BLOBS);
    return test_draw_blobs(WIDTH, HEIGHT, blobs, BLOBS);
}

/* Features in the mask are left out, the others are what they were. */
static void masks_are_honoured(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_features_options options = sf_features_options_default();
    uint8_t *pixels = draw(), *mask = malloc(WIDTH * HEIGHT);
    assert_non_null(mask);
    for (int i = 0; i < WIDTH * HEIGHT; i++) mask[i] = i % WIDTH < WIDTH / 2 || i / WIDTH > 120 ? 255 : 0;
    sf_photo picture = test_grey(pixels, WIDTH, HEIGHT);
    sf_features all = test_find_features(ctx, &picture, &options);
    picture.mask = mask;
    sf_features some = test_find_features(ctx, &picture, &options);
    size_t n = 0;
    for (size_t i = 0; i < all.count; i++) {
        if (!mask[(int)all.points[i].y * WIDTH + (int)all.points[i].x]) continue;
        assert_true(n < some.count);
        assert_memory_equal(&all.points[i], &some.points[n], sizeof *some.points);
        assert_memory_equal(all.descriptors + i * SF_DESCRIPTOR, some.descriptors + n * SF_DESCRIPTOR,
                            SF_DESCRIPTOR);
        n++;
    }
    assert_int_equal(n, some.count);
    assert_true(n > 50 && all.count - n > 50);
    sf_features_free(ctx, &all);
    sf_features_free(ctx, &some);
    memset(mask, 0, WIDTH * HEIGHT);
    some = test_find_features(ctx, &picture, &options);
    assert_true(some.count == 0 && !some.points && !some.descriptors);
    free(pixels);
    free(mask);
    sf_context_destroy(&ctx);
}

/* Of more than wanted the best stay, whenever they are found. */
static void the_best_stay(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_features_options options = sf_features_options_default();
    uint8_t *pixels = draw();
    sf_photo picture = test_grey(pixels, WIDTH, HEIGHT);
    sf_features all = test_find_features(ctx, &picture, &options);
    static const size_t wanted[] = {1, 2, 7, 50, 100};
    assert_true(all.count > 100);
    for (size_t i = 1; i < all.count; i++) assert_true(all.points[i - 1].response >= all.points[i].response);
    for (size_t i = 0; i < sizeof wanted / sizeof *wanted; i++) {
        options.most = wanted[i];
        sf_features best = test_find_features(ctx, &picture, &options);
        sf_features first = {wanted[i], all.points, all.descriptors};
        assert_true(test_same_features(&best, &first));
        sf_features_free(ctx, &best);
    }
    sf_features_free(ctx, &all);
    free(pixels);
    sf_context_destroy(&ctx);
}

/* One direction a point leaves each place once. */
static void directions_can_be_one(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_features_options options = sf_features_options_default();
    uint8_t *pixels = draw();
    sf_photo picture = test_grey(pixels, WIDTH, HEIGHT);
    sf_features two = test_find_features(ctx, &picture, &options);
    options.directions = 1;
    sf_features one = test_find_features(ctx, &picture, &options);
    size_t twice = 0;
    for (size_t i = 1; i < two.count; i++)
        twice += two.points[i].x == two.points[i - 1].x && two.points[i].y == two.points[i - 1].y;
    for (size_t i = 1; i < one.count; i++)
        assert_true(one.points[i].x != one.points[i - 1].x || one.points[i].y != one.points[i - 1].y);
    assert_true(twice > 0);
    assert_int_equal(one.count, two.count - twice);
    sf_features_free(ctx, &one);
    sf_features_free(ctx, &two);
    free(pixels);
    sf_context_destroy(&ctx);
}

static void small_and_even_pictures_have_none(void **state) {
    (void)state;
    static const int sizes[][2] = {{1, 1}, {7, 8}, {15, 300}, {300, 15}, {16, 16}, {17, 33}, {640, 480}};
    sf_context *ctx = test_context();
    sf_features_options options = sf_features_options_default();
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++)
        for (int grey = 0; grey <= 255; grey += 85) {
            size_t count = (size_t)sizes[i][0] * (size_t)sizes[i][1];
            uint8_t *pixels = malloc(count);
            assert_non_null(pixels);
            memset(pixels, grey, count);
            sf_photo picture = test_grey(pixels, sizes[i][0], sizes[i][1]);
            sf_features f = test_find_features(ctx, &picture, &options);
            assert_true(f.count == 0 && !f.points && !f.descriptors);
            free(pixels);
        }
    sf_context_destroy(&ctx);
}

/* What lies between rows does not matter, nor on which thread a picture is. */
static void rows_may_lie_apart(void **state) {
    (void)state;
    enum { STRIDE = WIDTH + 37 };
    sf_context *ctx = test_context();
    sf_features_options options = sf_features_options_default();
    uint8_t *pixels = draw(), *apart = malloc(STRIDE * HEIGHT);
    assert_non_null(apart);
    for (int i = 0; i < STRIDE * HEIGHT; i++) apart[i] = (uint8_t)(i * 77);
    for (int y = 0; y < HEIGHT; y++) memcpy(apart + y * STRIDE, pixels + y * WIDTH, WIDTH);
    sf_photo picture = test_grey(pixels, WIDTH, HEIGHT), other = picture;
    other.pixels = apart, other.stride = STRIDE;
    sf_features a = test_find_features(ctx, &picture, &options);
    sf_features b = test_find_features(ctx, &other, &options);
    assert_true(a.count > 100 && test_same_features(&a, &b));
    sf_features_free(ctx, &a);
    sf_features_free(ctx, &b);
    free(pixels);
    free(apart);
    sf_context_destroy(&ctx);
}

static void what_cannot_be_is_refused(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_features_options options = sf_features_options_default();
    uint8_t pixel = 0;
    sf_photo picture = test_grey(&pixel, 1, 1);
    sf_features f;
    picture.width = SF_FEATURES_SIDE + 1;
    assert_status(ctx, sf_features_find(ctx, &picture, &options, &f), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "28001x1 px");
    picture.width = 0;
    assert_status(ctx, sf_features_find(ctx, &picture, &options, &f), SF_ERR_ARGUMENT);
    picture.width = 1;
    options.most = 0;
    assert_status(ctx, sf_features_find(ctx, &picture, &options, &f), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "0 at most");
    assert_ok(ctx, sf_features_find_all(ctx, NULL, 0, &options, NULL));
    options = sf_features_options_default();
    sf_photo both[2] = {picture, picture};
    both[1].height = 0;
    sf_features found[2];
    assert_status(ctx, sf_features_find_all(ctx, both, 2, &options, found), SF_ERR_ARGUMENT);
    assert_true(!found[0].points && !found[1].points);
    sf_context_destroy(&ctx);
}

/* ---- memory ---------------------------------------------------------------------------------------------
 */

typedef struct meter {
    size_t now, most;
} meter;

enum { HEADER = 64 };

static void *take(void *meter_pointer, size_t size) {
    meter *m = meter_pointer;
    uint8_t *block = aligned_alloc(64, (size + HEADER + 63) / 64 * 64);
    if (!block) return NULL;
    memcpy(block, &size, sizeof size);
    m->now += size;
    if (m->now > m->most) m->most = m->now;
    return block + HEADER;
}

static void give(void *meter_pointer, void *block) {
    meter *m = meter_pointer;
    size_t size;
    if (!block) return;
    memcpy(&size, (uint8_t *)block - HEADER, sizeof size);
    m->now -= size;
    free((uint8_t *)block - HEADER);
}

/* No more than announced, and no more for a higher picture. */
static void memory_is_as_announced(void **state) {
    (void)state;
    enum { WIDE = 1024, HIGH = 512, PIXELS = WIDE * HIGH };
    meter m = {0, 0};
    sf_context *ctx;
    sf_allocator allocator = {.alloc = take, .free = give, .user = &m};
    sf_context_options context_options = {.threads = 1, .allocator = &allocator};
    sf_features_options options = sf_features_options_default();
    uint8_t *pixels = malloc(PIXELS);
    assert_non_null(pixels);
    sf_rng rng;
    sf_rng_seed(&rng, 1);
    for (int i = 0; i < PIXELS; i++) pixels[i] = (uint8_t)sf_rng_below(&rng, 256);
    assert_int_equal(sf_context_create(&ctx, &context_options), SF_OK);
    for (int upsampling = SF_UPSAMPLE_NEVER; upsampling <= SF_UPSAMPLE_ALWAYS; upsampling++) {
        options.upsampling = (sf_upsampling)upsampling;
        size_t before = m.now;
        for (int height = HIGH; height >= HIGH / 4; height /= 2) {
            sf_photo picture = test_grey(pixels, WIDE, height);
            uint64_t announced = sf_features_memory(WIDE, height, &options);
            m.most = m.now;
            sf_features f = test_find_features(ctx, &picture, &options);
            size_t took = m.most - before;
            print_message("%dx%d: %zu bytes, %llu announced, %zu features\n", WIDE, height, took,
                          (unsigned long long)announced, f.count);
            assert_true(took <= announced && announced <= 2 * took);
            sf_features_free(ctx, &f);
            assert_int_equal(m.now, before);
        }
    }
    sf_context_destroy(&ctx);
    free(pixels);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(masks_are_honoured),     cmocka_unit_test(the_best_stay),
        cmocka_unit_test(directions_can_be_one),  cmocka_unit_test(small_and_even_pictures_have_none),
        cmocka_unit_test(rows_may_lie_apart),     cmocka_unit_test(what_cannot_be_is_refused),
        cmocka_unit_test(memory_is_as_announced),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
