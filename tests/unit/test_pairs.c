/* test_pairs.c - which pairs of photos are matched: all of a few; of many those that are alike, and
 * neighbours. */
#include "testing.h"

#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "sfm/pairs.h"

/* Photos along a path that comes back: photo i sees points i STEP .. i STEP + POINTS - 1 of a ring. */
enum { PHOTOS = 40, STEP = 10, POINTS = 50, RING = PHOTOS * STEP };

typedef struct walk {
    sf_features photos[PHOTOS];
    uint8_t ring[RING][SF_DESCRIPTOR];
} walk;

static void fill(sf_rng *rng, uint8_t *descriptor) {
    for (int k = 0; k < SF_DESCRIPTOR; k++) descriptor[k] = (uint8_t)sf_rng_below(rng, 78);
}

/* Half of a photo's features are of the ring, with large scales; the others are its own. `place` says where
 * on the ring a photo is. */
static walk *make_walk(const size_t *place) {
    walk *w = calloc(1, sizeof *w);
    sf_rng rng;
    assert_non_null(w);
    sf_rng_seed(&rng, 5);
    for (int i = 0; i < RING; i++) fill(&rng, w->ring[i]);
    for (size_t i = 0; i < PHOTOS; i++) {
        sf_features *f = &w->photos[i];
        f->count = 2 * POINTS;
        f->points = calloc(f->count, sizeof *f->points);
        f->descriptors = aligned_alloc(64, f->count * SF_DESCRIPTOR);
        assert_true(f->points && f->descriptors);
        for (size_t k = 0; k < f->count; k++) {
            uint8_t *d = f->descriptors + k * SF_DESCRIPTOR;
            int shared = k % 2 == 0;
            f->points[k].scale = shared ? 9.0f : 2.0f;
            if (shared)
                memcpy(d, w->ring[(place[i] * STEP + k / 2) % RING], SF_DESCRIPTOR);
            else
                fill(&rng, d);
        }
    }
    return w;
}

static void free_walk(walk *w) {
    for (int i = 0; i < PHOTOS; i++) {
        free(w->photos[i].points);
        free(w->photos[i].descriptors);
    }
    free(w);
}

static int holds(const sf_photo_pair *pairs, size_t count, size_t a, size_t b) {
    for (size_t i = 0; i < count; i++)
        if (pairs[i].first == (a < b ? a : b) && pairs[i].second == (a < b ? b : a)) return 1;
    return 0;
}

/* Steps between two places of the ring. */
static size_t steps(size_t a, size_t b) {
    size_t d = a > b ? a - b : b - a;
    return d < PHOTOS - d ? d : PHOTOS - d;
}

static void all_pairs_of_a_few(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_features none[4] = {{0}};
    sf_pair_options options = sf_pair_options_default();
    sf_photo_pair *pairs;
    size_t count;
    assert_ok(ctx, sf_pairs_choose(ctx, none, 4, &options, &pairs, &count));
    assert_int_equal(count, 6);
    for (size_t a = 0; a < 4; a++)
        for (size_t b = a + 1; b < 4; b++) assert_true(holds(pairs, count, a, b));
    sf_free(ctx, pairs);
    assert_ok(ctx, sf_pairs_choose(ctx, none, 0, &options, &pairs, &count));
    assert_int_equal(count, 0);
    sf_free(ctx, pairs);
    options.sequence = 2;
    assert_ok(ctx, sf_pairs_choose(ctx, none, 4, &options, &pairs, &count));
    assert_int_equal(count, 5);
    assert_false(holds(pairs, count, 0, 3));
    sf_free(ctx, pairs);
    options.sequence = 9; /* more than there are */
    assert_ok(ctx, sf_pairs_choose(ctx, none, 4, &options, &pairs, &count));
    assert_int_equal(count, 6);
    sf_free(ctx, pairs);
    options.sequence = 0;
    options.all = 0, options.neighbours = 2; /* without features, neighbours alone */
    assert_ok(ctx, sf_pairs_choose(ctx, none, 4, &options, &pairs, &count));
    assert_int_equal(count, 5);
    assert_false(holds(pairs, count, 0, 3));
    sf_free(ctx, pairs);
    sf_context_destroy(&ctx);
}

/* Photos are matched with those at most two steps away on the ring, however they are called: also the last
 * with the first. On 1 and 3 threads. */
static void photos_alike_are_partners(void **state) {
    (void)state;
    sf_pair_options options = {.all = 0, .few = POINTS, .partners = 4, .neighbours = 0};
    sf_photo_pair *pairs[2];
    size_t counts[2], place[PHOTOS];
    for (size_t i = 0; i < PHOTOS; i++) place[i] = i * 7 % PHOTOS; /* 7 and 40 share no factor */
    walk *w = make_walk(place);
    for (int t = 0; t < 2; t++) {
        sf_context *ctx;
        sf_context_options context_options = {.threads = t ? 3 : 1};
        assert_int_equal(sf_context_create(&ctx, &context_options), SF_OK);
        assert_ok(ctx, sf_pairs_choose(ctx, w->photos, PHOTOS, &options, &pairs[t], &counts[t]));
        sf_photo_pair *copy = malloc((counts[t] + 1) * sizeof *copy);
        assert_non_null(copy);
        memcpy(copy, pairs[t], counts[t] * sizeof *copy);
        sf_free(ctx, pairs[t]);
        pairs[t] = copy;
        sf_context_destroy(&ctx);
    }
    assert_int_equal(counts[0], counts[1]);
    assert_memory_equal(pairs[0], pairs[1], counts[0] * sizeof *pairs[0]);
    for (size_t a = 0; a < PHOTOS; a++)
        for (size_t b = a + 1; b < PHOTOS; b++)
            assert_int_equal(holds(pairs[0], counts[0], a, b), steps(place[a], place[b]) <= 2);
    for (size_t i = 1; i < counts[0]; i++)
        assert_true(
            pairs[0][i - 1].first < pairs[0][i].first ||
            (pairs[0][i - 1].first == pairs[0][i].first && pairs[0][i - 1].second < pairs[0][i].second));
    free(pairs[0]);
    free(pairs[1]);
    free_walk(w);
}

/* Against the rule itself: j is chosen where few others are better for i, or i for j. */
static void partners_are_the_best(void **state) {
    (void)state;
    enum { N = 23, PARTNERS = 5, NEIGHBOURS = 2 };
    uint16_t scores[N * N] = {0};
    uint8_t chosen[N * N];
    uint32_t order[N];
    sf_rng rng;
    sf_rng_seed(&rng, 3);
    for (size_t i = 0; i < N; i++)
        for (size_t j = i + 1; j < N; j++)
            scores[i * N + j] = scores[j * N + i] = (uint16_t)sf_rng_below(&rng, 12);
    sf_pairs_mark(scores, N, PARTNERS, NEIGHBOURS, order, chosen);
    for (size_t i = 0; i < N; i++)
        for (size_t j = 0; j < N; j++) {
            int wanted = 0;
            for (int side = 0; side < 2 && i != j; side++) {
                size_t of = side ? j : i, other = side ? i : j, better = 0, d = i > j ? i - j : j - i;
                for (size_t k = 0; k < N; k++) {
                    size_t e = k > of ? k - of : of - k;
                    int s = scores[of * N + k], t = scores[of * N + other];
                    if (k != of && k != other)
                        better += s > t || (s == t && (e < d || (e == d && k < other)));
                }
                wanted |= (scores[of * N + other] > 0 && better < PARTNERS) || d <= NEIGHBOURS;
            }
            assert_int_equal(chosen[i * N + j], wanted);
        }
}

static void features_of_large_scales_are_taken(void **state) {
    (void)state;
    enum { COUNT = 9, MOST = 4 };
    static const float scales[COUNT] = {2, 7, 3, 7, 1, 5, 2, 9, 3};
    static const uint8_t wanted[MOST] = {7, 1, 3, 5};
    sf_context *ctx = test_context();
    sf_keypoint points[COUNT] = {{0}};
    uint8_t descriptors[COUNT * SF_DESCRIPTOR] = {0};
    sf_features all = {COUNT, points, descriptors}, few;
    for (uint8_t i = 0; i < COUNT; i++) points[i].scale = scales[i], descriptors[i * SF_DESCRIPTOR] = i;
    assert_ok(ctx, sf_pairs_take_few(ctx, &all, MOST, &few));
    assert_int_equal(few.count, MOST);
    for (int i = 0; i < MOST; i++) assert_int_equal(few.descriptors[i * SF_DESCRIPTOR], wanted[i]);
    sf_features_free(ctx, &few);
    assert_ok(ctx, sf_pairs_take_few(ctx, &all, 100, &few));
    assert_int_equal(few.count, COUNT);
    sf_features_free(ctx, &few);
    sf_context_destroy(&ctx);
}

static int stop(void *user, size_t photos) {
    (void)photos;
    ++*(int *)user;
    return 1;
}

static void it_is_cancelled(void **state) {
    (void)state;
    size_t place[PHOTOS], count;
    int told = 0;
    sf_context *ctx = test_context();
    sf_photo_pair *pairs;
    sf_pair_options options = {.all = 0, .few = POINTS, .partners = 4, .neighbours = 0};
    options.done = stop, options.user = &told;
    for (size_t i = 0; i < PHOTOS; i++) place[i] = i;
    walk *w = make_walk(place);
    assert_int_equal(sf_pairs_choose(ctx, w->photos, PHOTOS, &options, &pairs, &count), SF_ERR_CANCELLED);
    assert_null(pairs);
    assert_true(told > 0);
    free_walk(w);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(all_pairs_of_a_few), cmocka_unit_test(photos_alike_are_partners),
        cmocka_unit_test(partners_are_the_best), cmocka_unit_test(features_of_large_scales_are_taken),
        cmocka_unit_test(it_is_cancelled)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
