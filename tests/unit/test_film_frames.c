/* test_film_frames.c - how far a picture moves, how sharp it is, and which frames are chosen for it. */
#include "features_fixture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "sfm/frame_choice.h"

enum { WIDTH = 320, HEIGHT = 240, BLOBS = 900 };

/* Blobs that have moved by dx, dy px. */
static uint8_t *draw(double dx, double dy) {
    static test_blob blobs[BLOBS];
    test_scatter_blobs(9, 2 * WIDTH, 2 * HEIGHT, blobs, BLOBS);
    for (int i = 0; i < BLOBS; i++) blobs[i].x += dx - 200, blobs[i].y += dy - 100;
    return test_draw_blobs(WIDTH, HEIGHT, blobs, BLOBS);
}

static void add_noise(uint8_t *pixels, uint64_t seed) {
    sf_rng rng;
    sf_rng_seed(&rng, seed);
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        double value = pixels[i] + 3 * sf_rng_normal(&rng);
        pixels[i] = (uint8_t)fmin(fmax(value, 0), 255);
    }
}

/* The mean of 3 x 3 pixels. */
static void blur(uint8_t *pixels) {
    static uint8_t from[WIDTH * HEIGHT];
    memcpy(from, pixels, sizeof from);
    for (int y = 1; y + 1 < HEIGHT; y++)
        for (int x = 1; x + 1 < WIDTH; x++) {
            int sum = 0;
            for (int k = 0; k < 9; k++) sum += from[(y + k / 3 - 1) * WIDTH + x + k % 3 - 1];
            pixels[y * WIDTH + x] = (uint8_t)(sum / 9);
        }
}

static void test_displacement(void **state) {
    (void)state;
    static const int moves[][2] = {{0, 0}, {3, 0}, {0, -5}, {-6, 8}, {10, 10}};
    uint8_t *still = draw(0, 0), *flat = calloc(WIDTH, HEIGHT);
    assert_non_null(flat);
    for (size_t i = 0; i < sizeof moves / sizeof *moves; i++) {
        uint8_t *moved = draw(moves[i][0], moves[i][1]);
        add_noise(moved, i + 1);
        double way = sf_frame_displacement(still, moved, WIDTH, HEIGHT);
        assert_true(fabs(way - hypot(moves[i][0], moves[i][1])) < 0.6);
        free(moved);
    }
    assert_true(sf_frame_displacement(flat, still, WIDTH, HEIGHT) == 0); /* nothing to be seen */
    assert_true(sf_frame_displacement(still, flat, WIDTH, HEIGHT) == SF_FRAME_REACH);
    free(still);
    free(flat);
}

static void test_sharpness(void **state) {
    (void)state;
    uint8_t *pixels = draw(0, 0);
    add_noise(pixels, 1);
    double sharp = sf_frame_sharpness(pixels, WIDTH, HEIGHT);
    uint8_t *darker = draw(0, 0);
    add_noise(darker, 1);
    for (int i = 0; i < WIDTH * HEIGHT; i++) darker[i] = (uint8_t)(darker[i] / 2);
    assert_true(fabs(sf_frame_sharpness(darker, WIDTH, HEIGHT) / sharp - 1) < 0.1);
    free(darker);
    blur(pixels);
    double blurred = sf_frame_sharpness(pixels, WIDTH, HEIGHT);
    assert_true(sharp > 1.5 * blurred && blurred > 0);
    memset(pixels, 7, WIDTH * HEIGHT);
    assert_true(sf_frame_sharpness(pixels, WIDTH, HEIGHT) == 0);
    assert_true(sf_frame_sharpness(pixels, 7, 7) == 0);
    free(pixels);
}

/* Frames that move by a quarter of a pixel of the small picture each are not taken for a still picture; those
 * that do not move are, whatever their noise. */
static void test_way(void **state) {
    (void)state;
    enum { FRAMES = 60 };
    sf_context *ctx = test_context();
    for (int still = 0; still < 2; still++) {
        sf_frame_judge judge;
        sf_frame_judged judged = {0};
        double before = 0;
        sf_frame_judge_begin(&judge, ctx);
        for (int i = 0; i < FRAMES; i++) {
            uint8_t *pixels = draw(still ? 0 : 0.5 * i, 0);
            add_noise(pixels, (uint64_t)i + 1);
            assert_ok(ctx, sf_frame_judge_next(&judge, pixels, WIDTH, HEIGHT, &judged));
            assert_true(judged.path >= before);
            before = judged.path;
            free(pixels);
        }
        double moved = still ? 0 : 0.5 * (FRAMES - 1) / WIDTH;
        assert_true(fabs(judged.path - moved) < 0.012);
        sf_frame_judge_end(&judge);
    }
    sf_context_destroy(&ctx);
}

static void test_wanted(void **state) {
    (void)state;
    static const struct {
        double path;
        size_t wanted;
    } cases[] = {{0, 2}, {0.5, 50}, {2, 100}, {5, 100}, {12, 200}, {100, 300}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        assert_in_range(sf_frames_wanted(cases[i].path), cases[i].wanted - 1, cases[i].wanted + 1);
}

/* Of frames that move on steadily and then rest, every third sharp, one sharp frame of each part is taken. */
static void test_choice(void **state) {
    (void)state;
    enum { FRAMES = 300, MOVING = 200, WANTED = 20 };
    sf_frame_judged frames[FRAMES];
    size_t chosen[WANTED];
    for (int i = 0; i < FRAMES; i++)
        frames[i] = (sf_frame_judged){.sharpness = i % 3 ? 0.1 : 1, .path = 0.01 * (i < MOVING ? i : MOVING)};
    assert_int_equal(sf_frames_choose(frames, FRAMES, WANTED, chosen), WANTED);
    for (size_t i = 0; i < WANTED; i++) {
        assert_int_equal(chosen[i] % 3, 0);
        assert_in_range(chosen[i], i * MOVING / WANTED,
                        i + 1 < WANTED ? (i + 1) * MOVING / WANTED : FRAMES - 1);
    }
    for (int i = 100; i < FRAMES; i++) frames[i].path += 1; /* a jump: parts without frames */
    size_t taken = sf_frames_choose(frames, FRAMES, WANTED, chosen);
    assert_in_range(taken, WANTED / 2, WANTED - 5);
    for (size_t i = 1; i < taken; i++) assert_true(chosen[i] > chosen[i - 1]);
    assert_int_equal(sf_frames_choose(frames, 1, WANTED, chosen), 1);
    assert_int_equal(sf_frames_choose(frames, 0, WANTED, chosen), 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_displacement), cmocka_unit_test(test_sharpness),
                                       cmocka_unit_test(test_way), cmocka_unit_test(test_wanted),
                                       cmocka_unit_test(test_choice)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
