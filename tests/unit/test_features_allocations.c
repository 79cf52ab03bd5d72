/* test_features_allocations.c - each allocation of finding and matching features gives nothing in turn. */
#include "features_fixture.h"

#include <stdlib.h>

#include "sfm/match.h"

enum { WIDTH = 96, HEIGHT = 80, BLOBS = 120, PHOTOS = 3 };

typedef struct world {
    sf_context *ctx;
    test_allocations memory;
    sf_photo pictures[PHOTOS];
} world;

/* Features of all pictures, with as few kept as that the list of them is sorted on the way, and matches. */
static sf_status attempt(world *w, size_t most, size_t *features, size_t *matches) {
    static const sf_photo_pair pairs[] = {{0, 1}, {1, 2}};
    sf_features_options options = sf_features_options_default();
    sf_match_options match_options = sf_match_options_default();
    sf_features f[PHOTOS];
    sf_matches m[2];
    options.most = most;
    options.upsampling = SF_UPSAMPLE_NEVER;
    *features = *matches = 0;
    sf_status status = sf_features_find_all(w->ctx, w->pictures, PHOTOS, &options, f);
    if (status) {
        for (int i = 0; i < PHOTOS; i++) assert_true(!f[i].count && !f[i].points && !f[i].descriptors);
        return status;
    }
    status = sf_match_all(w->ctx, f, pairs, 2, &match_options, m);
    for (int i = 0; i < PHOTOS; i++) {
        *features += f[i].count;
        sf_features_free(w->ctx, &f[i]);
    }
    for (int i = 0; i < 2; i++) {
        if (status) assert_true(!m[i].count && !m[i].items);
        *matches += m[i].count;
        sf_matches_free(w->ctx, &m[i]);
    }
    return status;
}

static void walk(world *w, size_t most) {
    size_t features, matches, f, m;
    assert_ok(w->ctx, attempt(w, most, &features, &matches));
    long live = w->memory.live, calls = w->memory.calls;
    assert_ok(w->ctx, attempt(w, most, &f, &m));
    calls = w->memory.calls - calls;
    assert_true(features > 10 && matches > 0 && f == features && m == matches);
    for (long at = 1; at <= calls; at++) {
        w->memory.fail_at = w->memory.calls + at;
        sf_status status = attempt(w, most, &f, &m);
        w->memory.fail_at = 0;
        if (status != SF_ERR_MEMORY) fail_msg("allocation %ld: %s", at, sf_status_text(status));
        assert_error_names(w->ctx, "out of memory");
        assert_int_equal(w->memory.live, live);
    }
    assert_ok(w->ctx, attempt(w, most, &f, &m));
    assert_true(f == features && m == matches);
    print_message("%zu features, %zu matches, %ld allocations\n", features, matches, calls);
}

static void any_allocation_may_fail(void **state) {
    (void)state;
    world w = {0};
    sf_allocator allocator = {test_count_alloc, test_count_free, &w.memory};
    sf_context_options options = {.threads = 1, .allocator = &allocator};
    uint8_t *pixels[PHOTOS];
    assert_int_equal(sf_context_create(&w.ctx, &options), SF_OK);
    for (int i = 0; i < PHOTOS; i++) {
        test_blob blobs[BLOBS];
        test_scatter_blobs(6, WIDTH, HEIGHT, blobs, BLOBS);
        for (int k = 0; k < BLOBS; k++) blobs[k].x += 3 * i;
        pixels[i] = test_draw_blobs(WIDTH, HEIGHT, blobs, BLOBS);
        w.pictures[i] = test_grey(pixels[i], WIDTH, HEIGHT);
    }
    walk(&w, 5000);
    walk(&w, 6);
    sf_context_destroy(&w.ctx);
    assert_int_equal(w.memory.live, 0);
    for (int i = 0; i < PHOTOS; i++) free(pixels[i]);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(any_allocation_may_fail)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
