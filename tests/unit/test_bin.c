/* test_bin.c - the tile lists: near to far, every pair once, the same for any number of threads. */
#include "testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "reference/random.h"
#include "render/workspace.h"
#include "scene/gaussians.h"

/* A scene through the first two stages. */
typedef struct binned {
    sf_context *ctx;
    sf_model *model;
    sf_workspace ws;
} binned;

static void bin(const test_ref_scene *scene, int threads, binned *b) {
    b->ctx = test_context_threads(threads);
    b->model = test_model_of(b->ctx, scene);
    sf_workspace_init(&b->ws, b->ctx);
    assert_ok(b->ctx, sf_workspace_look(&b->ws, &scene->camera, (float)scene->near_plane));
    assert_ok(b->ctx, sf_stage_project(&b->ws, b->model, scene->sh_degree, 0));
    assert_ok(b->ctx, sf_stage_bin(&b->ws));
}

static void unbin(binned *b) {
    sf_workspace_free(&b->ws);
    sf_model_destroy(&b->model);
    sf_context_destroy(&b->ctx);
}

static size_t tiles_in(const sf_workspace *ws) { return (size_t)ws->eye.tiles_x * (size_t)ws->eye.tiles_y; }

static void assert_near_to_far(const sf_workspace *ws) {
    for (size_t tile = 0; tile < tiles_in(ws); tile++)
        for (uint32_t e = ws->tile_begin[tile]; e + 1 < ws->tile_begin[tile + 1]; e++) {
            uint32_t a = ws->entries[e], b = ws->entries[e + 1];
            float z = ws->splats[a].depth, next = ws->splats[b].depth;
            assert_true(z < next || (z == next && a < b));
        }
}

/* The tile lists hold, of every Gaussian that is seen, the tiles of its spans and no others, under the slots
 * slot[i] .. slot[i + 1] - 1 in row-major order. */
static void assert_slots(const sf_workspace *ws) {
    size_t entries = ws->slot[ws->count], spanned = 0;
    uint32_t *tile_of_slot = calloc(entries + 1, sizeof *tile_of_slot);
    uint8_t *used = calloc(entries + 1, 1);
    assert_non_null(tile_of_slot);
    assert_non_null(used);
    assert_int_equal(ws->tile_begin[0], 0);
    assert_int_equal(ws->tile_begin[tiles_in(ws)], entries);
    for (size_t tile = 0; tile < tiles_in(ws); tile++) {
        assert_true(ws->tile_begin[tile] <= ws->tile_begin[tile + 1]);
        for (uint32_t e = ws->tile_begin[tile]; e < ws->tile_begin[tile + 1]; e++) {
            uint32_t i = ws->entries[e], slot = ws->entry_slots[e];
            assert_true(i < ws->count);
            assert_true(slot >= ws->slot[i] && slot < ws->slot[i + 1]);
            assert_false(used[slot]);
            used[slot] = 1;
            tile_of_slot[slot] = (uint32_t)tile;
        }
    }
    for (size_t i = 0; i < ws->count; i++) {
        uint32_t slot = ws->slot[i];
        if (ws->state[i] != SF_SEEN) assert_int_equal(ws->rows[i], 0);
        for (uint32_t r = 0; r < ws->rows[i]; r++) {
            sf_span span = ws->spans[ws->span_offset[i] + r];
            uint32_t first = (uint32_t)(ws->first_row[i] + r) * (uint32_t)ws->eye.tiles_x;
            for (uint32_t x = span.x0; x < span.x1; x++, spanned++)
                assert_int_equal(tile_of_slot[slot++], first + x);
        }
        assert_int_equal(slot, ws->slot[i + 1]);
    }
    assert_int_equal(spanned, entries);
    free(tile_of_slot);
    free(used);
}

static void assert_binned(const sf_workspace *ws) {
    assert_near_to_far(ws);
    assert_slots(ws);
}

/* Bins the scene, checks it, and returns the number of entries. */
static size_t check(const test_ref_scene *scene, int threads) {
    binned b;
    bin(scene, threads, &b);
    assert_binned(&b.ws);
    size_t entries = b.ws.slot[scene->count];
    unbin(&b);
    return entries;
}

static void lists_are_sorted_and_slots_dealt(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= 5; seed++) {
        test_ref_scene scene = test_random_scene(seed, 1500, 0, 203, 117);
        assert_true(check(&scene, 2) > scene.count);
        test_ref_gaussians_free(&scene.gaussians);
    }
}

/* Many Gaussians at few depths. */
static test_ref_scene scene_with_ties(void) {
    test_ref_scene scene = test_random_scene(9, 3000, 0, 90, 61);
    memset(scene.camera.R_cw, 0, sizeof scene.camera.R_cw);
    memset(scene.camera.t_cw, 0, sizeof scene.camera.t_cw);
    for (size_t k = 0; k < 3; k++) scene.camera.R_cw[4 * k] = 1;
    for (size_t i = 0; i < scene.count; i++) {
        double spread = 0.1 * (double)(i % 31) - 1.5, z = 3 + 0.25 * (double)(i * 7 % 5);
        test_random_place(&scene, i, (const double[]){spread, 0.4 * spread, z});
        scene.gaussians.logit_opacities[i] = 1;
    }
    return scene;
}

static void ties_keep_the_order_of_the_model(void **state) {
    (void)state;
    test_ref_scene scene = scene_with_ties();
    binned b;
    bin(&scene, 2, &b);
    assert_binned(&b.ws);
    size_t ties = 0, lists = 0;
    for (size_t tile = 0; tile < tiles_in(&b.ws); tile++) {
        lists += b.ws.tile_begin[tile] < b.ws.tile_begin[tile + 1];
        for (uint32_t e = b.ws.tile_begin[tile]; e + 1 < b.ws.tile_begin[tile + 1]; e++)
            ties += b.ws.splats[b.ws.entries[e]].depth == b.ws.splats[b.ws.entries[e + 1]].depth;
    }
    assert_true(ties >= b.ws.slot[b.ws.count] - 5 * lists); /* five depths a list, at most */
    assert_true(ties > 10 * lists);
    unbin(&b);
    test_ref_gaussians_free(&scene.gaussians);
}

static void depths_sort_over_their_whole_range(void **state) {
    (void)state;
    test_ref_scene scene = test_random_scene(12, 400, 0, 64, 64);
    scene.near_plane = 1e-30;
    memset(scene.camera.t_cw, 0, sizeof scene.camera.t_cw);
    for (size_t i = 0; i < scene.count; i++) {
        double z = pow(10, (double)(i * 37 % 400) / 8 - 25);
        test_random_place(&scene, i, (const double[]){0, 0, z});
        for (size_t k = 0; k < 3; k++) scene.gaussians.log_scales[3 * i + k] = log(0.05 * z);
        scene.gaussians.logit_opacities[i] = 0;
    }
    binned b;
    bin(&scene, 1, &b);
    for (size_t i = 0; i < scene.count; i++) assert_int_equal(b.ws.state[i], SF_SEEN);
    assert_binned(&b.ws);
    unbin(&b);
    test_ref_gaussians_free(&scene.gaussians);
}

static void assert_same_lists(const sf_workspace *a, const sf_workspace *b) {
    size_t tiles = tiles_in(a), entries = a->slot[a->count];
    assert_memory_equal(a->slot, b->slot, (a->count + 1) * sizeof *a->slot);
    assert_memory_equal(a->tile_begin, b->tile_begin, (tiles + 1) * sizeof *a->tile_begin);
    assert_memory_equal(a->entries, b->entries, entries * sizeof *a->entries);
    assert_memory_equal(a->entry_slots, b->entry_slots, entries * sizeof *a->entry_slots);
    for (size_t i = 0; i < a->count; i++)
        if (a->state[i] == SF_SEEN) assert_memory_equal(&a->splats[i], &b->splats[i], sizeof *a->splats);
}

static void threads_do_not_matter(void **state) {
    (void)state;
    static const int threads[] = {2, 3, 4, 8};
    test_ref_scene scene = test_random_scene(21, 5000, 1, 331, 87);
    binned one, many;
    bin(&scene, 1, &one);
    assert_binned(&one.ws);
    for (size_t t = 0; t < sizeof threads / sizeof *threads; t++) {
        bin(&scene, threads[t], &many);
        assert_same_lists(&one.ws, &many.ws);
        unbin(&many);
    }
    unbin(&one);
    test_ref_gaussians_free(&scene.gaussians);
}

static void nothing_to_see_gives_empty_lists(void **state) {
    (void)state;
    test_ref_scene empty = test_random_scene(2, 0, 0, 50, 40), behind = test_random_scene(2, 100, 0, 50, 40);
    for (size_t i = 0; i < behind.count; i++) test_random_place(&behind, i, (const double[]){0, 0, -3});
    assert_int_equal(check(&empty, 2), 0);
    assert_int_equal(check(&behind, 2), 0);
    for (size_t i = 0; i < behind.count; i++) {
        test_random_place(&behind, i, (const double[]){0, 0, 3});
        behind.gaussians.logit_opacities[i] = -20;
    }
    assert_int_equal(check(&behind, 2), 0);
    test_ref_gaussians_free(&empty.gaussians);
    test_ref_gaussians_free(&behind.gaussians);
}

static void pictures_of_any_size_are_tiled(void **state) {
    (void)state;
    static const int sizes[][2] = {{1, 1}, {16, 16}, {17, 1}, {1, 17}, {300, 5}, {5, 300}};
    for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++)
        for (size_t count = 1; count < 200; count += 15) {
            test_ref_scene scene = test_random_scene(30 + count, count, 0, sizes[s][0], sizes[s][1]);
            scene.gaussians.logit_opacities[0] = 3; /* one is in the middle of the picture */
            test_random_place(&scene, 0, (const double[]){0, 0, 1});
            assert_true(check(&scene, 2) > 0);
            test_ref_gaussians_free(&scene.gaussians);
        }
}

/* What an earlier, larger picture or model has left in the workspace does not show. */
static void workspace_can_be_used_again(void **state) {
    (void)state;
    test_ref_scene scenes[] = {test_random_scene(51, 900, 0, 200, 150), test_random_scene(52, 40, 0, 33, 20),
                               test_random_scene(53, 900, 0, 150, 200)};
    enum { SCENES = sizeof scenes / sizeof *scenes };
    binned again;
    bin(&scenes[0], 2, &again);
    for (size_t s = 1; s <= SCENES; s++) {
        const test_ref_scene *scene = &scenes[s % SCENES];
        binned fresh;
        bin(scene, 2, &fresh);
        assert_ok(again.ctx, sf_workspace_look(&again.ws, &scene->camera, (float)scene->near_plane));
        assert_ok(again.ctx, sf_stage_project(&again.ws, fresh.model, 0, 0));
        assert_ok(again.ctx, sf_stage_bin(&again.ws));
        assert_same_lists(&again.ws, &fresh.ws);
        unbin(&fresh);
    }
    unbin(&again);
    for (size_t s = 0; s < SCENES; s++) test_ref_gaussians_free(&scenes[s].gaussians);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lists_are_sorted_and_slots_dealt),
        cmocka_unit_test(ties_keep_the_order_of_the_model),
        cmocka_unit_test(depths_sort_over_their_whole_range),
        cmocka_unit_test(threads_do_not_matter),
        cmocka_unit_test(nothing_to_see_gives_empty_lists),
        cmocka_unit_test(pictures_of_any_size_are_tiled),
        cmocka_unit_test(workspace_can_be_used_again),
    };
    return cmocka_run_group_tests_name("bin", tests, NULL, NULL);
}
