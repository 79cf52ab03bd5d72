/* test_match.c - matches are those of all distances, and those of a picture and its likeness are right. */
#include "features_fixture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "sfm/match.h"

/* ---- against all distances ------------------------------------------------------------------------------
 */

static sf_features make_set(size_t count) {
    sf_features f = {count, NULL, aligned_alloc(64, (count + 1) * SF_DESCRIPTOR)};
    assert_non_null(f.descriptors);
    memset(f.descriptors, 0, (count + 1) * SF_DESCRIPTOR);
    return f;
}

/* Descriptors of length 512 or so; each third is one of `model`, a little changed or not at all. */
static void fill_set(sf_rng *rng, sf_features *f, const sf_features *model) {
    for (size_t i = 0; i < f->count; i++) {
        uint8_t *d = f->descriptors + i * SF_DESCRIPTOR;
        if (model && model->count && sf_rng_below(rng, 3) == 0) {
            size_t from = (size_t)sf_rng_below(rng, model->count), change = (size_t)sf_rng_below(rng, 25);
            memcpy(d, model->descriptors + from * SF_DESCRIPTOR, SF_DESCRIPTOR);
            for (size_t k = 0; k < change; k++)
                d[sf_rng_below(rng, SF_DESCRIPTOR)] = (uint8_t)sf_rng_below(rng, 90);
        } else {
            for (int k = 0; k < SF_DESCRIPTOR; k++) d[k] = (uint8_t)sf_rng_below(rng, 78);
        }
    }
}

static uint32_t product(const uint8_t *a, const uint8_t *b) {
    uint32_t sum = 0;
    for (int k = 0; k < SF_DESCRIPTOR; k++) sum += (uint32_t)a[k] * b[k];
    return sum;
}

static double distance2(const uint8_t *a, const uint8_t *b) {
    double sum = 0;
    for (int k = 0; k < SF_DESCRIPTOR; k++) sum += (a[k] - b[k]) * (a[k] - b[k]);
    return sum / (512.0 * 512.0);
}

/* The first of those of `set` with the greatest product, `but` left out; set->count: there is none. */
static size_t best_of(const uint8_t *d, const sf_features *set, size_t but) {
    size_t best = set->count;
    for (size_t i = 0; i < set->count; i++) {
        const uint8_t *other = set->descriptors + i * SF_DESCRIPTOR;
        if (i == but) continue;
        if (best == set->count || product(d, other) > product(d, set->descriptors + best * SF_DESCRIPTOR))
            best = i;
    }
    return best;
}

/* By distances alone, which `options` holds of 0..2. */
static int is_clear(const uint8_t *d, const sf_features *set, size_t best, const sf_match_options *options) {
    size_t second = best_of(d, set, best);
    double near = distance2(d, set->descriptors + best * SF_DESCRIPTOR);
    if (near > options->distance * options->distance) return 0;
    return second == set->count ||
           near < options->ratio * options->ratio * distance2(d, set->descriptors + second * SF_DESCRIPTOR);
}

static size_t check_sets(sf_context *ctx, const sf_features *a, const sf_features *b,
                         const sf_match_options *options) {
    sf_matches got;
    size_t n = 0;
    assert_ok(ctx, sf_match_pair(ctx, a, b, options, &got));
    for (size_t i = 0; i < a->count && b->count; i++) {
        const uint8_t *d = a->descriptors + i * SF_DESCRIPTOR;
        size_t j = best_of(d, b, b->count);
        const uint8_t *other = b->descriptors + j * SF_DESCRIPTOR;
        if (best_of(other, a, a->count) != i) continue;
        if (!is_clear(d, b, j, options) || !is_clear(other, a, i, options)) continue;
        assert_true(n < got.count && got.items[n].a == i && got.items[n].b == j);
        n++;
    }
    assert_int_equal(n, got.count);
    sf_matches_free(ctx, &got);
    return n;
}

static void matches_are_those_of_all_distances(void **state) {
    (void)state;
    static const size_t counts[] = {0, 1, 2, 3, 7, 8, 9, 31, 33, 100};
    enum { COUNTS = sizeof counts / sizeof *counts };
    sf_isa_info info;
    size_t matches = 0;
    for (size_t level = 0; !sf_isa_describe(level, &info); level++) {
        sf_context *ctx;
        sf_context_options context_options = {.threads = 1, .isa = info.name};
        sf_rng rng;
        if (!info.usable) continue;
        assert_int_equal(sf_context_create(&ctx, &context_options), SF_OK);
        sf_rng_seed(&rng, 4);
        for (size_t i = 0; i < COUNTS * COUNTS; i++) {
            sf_features a = make_set(counts[i / COUNTS]), b = make_set(counts[i % COUNTS]);
            sf_match_options options = sf_match_options_default();
            if (i % 3 == 1) options.ratio = 1;
            if (i % 4 == 1) options.distance = 2;
            fill_set(&rng, &a, NULL);
            fill_set(&rng, &b, &a);
            matches += check_sets(ctx, &a, &b, &options);
            free(a.descriptors);
            free(b.descriptors);
        }
        sf_context_destroy(&ctx);
    }
    assert_true(matches > 300);
}

/* All of one length, so that none is nearer to another than to itself. */
static void fill_evenly(sf_rng *rng, sf_features *f) {
    memset(f->descriptors, 0, f->count * SF_DESCRIPTOR);
    for (size_t k = 0; k < f->count * SF_DESCRIPTOR; k += 2)
        f->descriptors[k + (size_t)sf_rng_below(rng, 2)] = 64;
}

/* More than a block on either side: places of matches are known. */
static void blocks_are_put_together(void **state) {
    (void)state;
    enum { A = SF_MATCH_BLOCK + 13, B = 2 * SF_MATCH_BLOCK + 5 };
    sf_context *ctx = test_context();
    sf_features a = make_set(A), b = make_set(B);
    sf_match_options options = sf_match_options_default();
    sf_matches got;
    sf_rng rng;
    sf_rng_seed(&rng, 8);
    fill_evenly(&rng, &a);
    fill_evenly(&rng, &b);
    size_t n = 0;
    for (size_t i = 0; i < A; i += 31, n++) /* all over b */
        memcpy(b.descriptors + (i * 2) * SF_DESCRIPTOR, a.descriptors + i * SF_DESCRIPTOR, SF_DESCRIPTOR);
    memcpy(b.descriptors + (B - 1) * SF_DESCRIPTOR, a.descriptors + (A - 1) * SF_DESCRIPTOR, SF_DESCRIPTOR);
    /* twice in b: no match is clear */
    memcpy(b.descriptors + 1 * SF_DESCRIPTOR, a.descriptors + 31 * SF_DESCRIPTOR, SF_DESCRIPTOR);
    assert_ok(ctx, sf_match_pair(ctx, &a, &b, &options, &got));
    assert_int_equal(got.count, n);
    for (size_t i = 0, k = 0; i < A; i += 31) {
        if (i == 31) continue;
        assert_int_equal(got.items[k].a, i);
        assert_int_equal(got.items[k++].b, i * 2);
    }
    assert_int_equal(got.items[n - 1].a, A - 1);
    assert_int_equal(got.items[n - 1].b, B - 1);
    sf_matches_free(ctx, &got);
    free(a.descriptors);
    free(b.descriptors);
    sf_context_destroy(&ctx);
}

/* ---- a picture and its likeness -------------------------------------------------------------------------
 */

typedef struct likeness {
    double scale, angle, x, y; /* of the middle, px */
} likeness;

enum { WIDTH = 320, HEIGHT = 240, BLOBS = 500 };

static void move(const likeness *l, double x, double y, double *to_x, double *to_y) {
    double dx = x - WIDTH / 2.0, dy = y - HEIGHT / 2.0;
    *to_x = l->scale * (cos(l->angle) * dx - sin(l->angle) * dy) + WIDTH / 2.0 + l->x;
    *to_y = l->scale * (sin(l->angle) * dx + cos(l->angle) * dy) + HEIGHT / 2.0 + l->y;
}

static sf_features features_of(sf_context *ctx, const test_blob *blobs) {
    sf_features_options options = sf_features_options_default();
    uint8_t *pixels = test_draw_blobs(WIDTH, HEIGHT, blobs, BLOBS);
    sf_photo picture = test_grey(pixels, WIDTH, HEIGHT);
    sf_features f = test_find_features(ctx, &picture, &options);
    free(pixels);
    return f;
}

/* The matches of a picture with one that is drawn anew, moved, turned and of another size: how many, and how
 * many of them within 1.5 px. */
static void match_likeness(sf_context *ctx, const likeness *l, size_t *count, size_t *right) {
    test_blob blobs[BLOBS], moved[BLOBS];
    sf_match_options options = sf_match_options_default();
    sf_matches m;
    test_scatter_blobs(21, WIDTH, HEIGHT, blobs, BLOBS);
    for (int i = 0; i < BLOBS; i++) {
        moved[i] = blobs[i];
        move(l, blobs[i].x, blobs[i].y, &moved[i].x, &moved[i].y);
        moved[i].deviation *= l->scale;
    }
    sf_features a = features_of(ctx, blobs), b = features_of(ctx, moved);
    assert_ok(ctx, sf_match_pair(ctx, &a, &b, &options, &m));
    *count = m.count, *right = 0;
    for (size_t i = 0; i < m.count; i++) {
        const sf_keypoint *p = &a.points[m.items[i].a], *q = &b.points[m.items[i].b];
        double x, y;
        move(l, (double)p->x, (double)p->y, &x, &y);
        *right += hypot((double)q->x - x, (double)q->y - y) < 1.5 &&
                  fabs((double)(q->scale / p->scale) / l->scale - 1) < 0.25 &&
                  fabs(remainder((double)(q->angle - p->angle) - l->angle, 6.283185307)) < 0.2;
    }
    sf_matches_free(ctx, &m);
    sf_features_free(ctx, &a);
    sf_features_free(ctx, &b);
}

static void a_likeness_is_matched(void **state) {
    (void)state;
    static const struct {
        likeness how;
        size_t least;
    } cases[] = {{{1, 0, 3.4, -7.7}, 150},  {{1, 0.6, 0, 0}, 120},   {{1.3, 0, 5, 5}, 60},
                 {{0.7, -0.4, 0, 0.5}, 60}, {{1.3, 2.5, -9, 4}, 50}, {{1.9, 1, 0, 0}, 20}};
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const likeness *l = &cases[i].how;
        size_t count, right;
        match_likeness(ctx, l, &count, &right);
        print_message("scale %.1f, turned by %.1f: %zu matches, %zu right\n", l->scale, l->angle, count,
                      right);
        assert_true(right >= cases[i].least);
        assert_true(right >= count * 93 / 100);
    }
    sf_context_destroy(&ctx);
}

/* Pairs of an album on two threads are those of one. */
static void pairs_are_matched_on_all_threads(void **state) {
    (void)state;
    enum { PHOTOS = 4, PAIRS = 6 };
    static const sf_photo_pair pairs[PAIRS] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {3, 2}};
    sf_context *ctx = test_context();
    sf_features photos[PHOTOS];
    sf_match_options options = sf_match_options_default();
    sf_matches all[PAIRS], one;
    sf_rng rng;
    sf_rng_seed(&rng, 2);
    for (int i = 0; i < PHOTOS; i++) {
        photos[i] = make_set(60 * (size_t)i);
        fill_set(&rng, &photos[i], i ? &photos[i - 1] : NULL);
    }
    assert_ok(ctx, sf_match_all(ctx, photos, pairs, PAIRS, &options, all));
    for (int i = 0; i < PAIRS; i++) {
        assert_ok(ctx, sf_match_pair(ctx, &photos[pairs[i].first], &photos[pairs[i].second], &options, &one));
        assert_int_equal(one.count, all[i].count);
        assert_true(!one.count || !memcmp(one.items, all[i].items, one.count * sizeof *one.items));
        sf_matches_free(ctx, &one);
        sf_matches_free(ctx, &all[i]);
    }
    assert_ok(ctx, sf_match_all(ctx, photos, NULL, 0, &options, NULL));
    for (int i = 0; i < PHOTOS; i++) free(photos[i].descriptors);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(matches_are_those_of_all_distances), cmocka_unit_test(blocks_are_put_together),
        cmocka_unit_test(a_likeness_is_matched), cmocka_unit_test(pairs_are_matched_on_all_threads)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
