/* test_sfm_mapper.c - tracks, and whole maps of simulated pictures against the truth. */
#include "../testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "sfm/repetition.h"
#include "sfm_scene_fixture.h"

static const double degree = 57.29577951308232;

/* Three pictures: a chain, a match that would put two keypoints of a picture into a track, a pair alone. */
static void tracks_are_joined(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    static uint32_t ab[] = {0, 0, 1, 1}, bc[] = {0, 2, 1, 1, 2, 0}, ac[] = {0, 2, 1, 0};
    const sf_matched_pair pairs[] = {{.first = 0, .second = 1, .matches = ab, .count = 2},
                                     {.first = 1, .second = 2, .matches = bc, .count = 3},
                                     {.first = 0, .second = 2, .matches = ac, .count = 2}};
    static const size_t counts[] = {2, 3, 3};
    sf_tracks t;
    assert_ok(ctx, sf_tracks_make(ctx, pairs, 3, counts, 3, &t));
    assert_int_equal(t.count, 3);
    assert_int_equal(t.matches, 7);
    assert_int_equal(t.contradictions, 1);
    static const sf_track_observation expected[] = {{0, 0}, {1, 0}, {2, 2}, {0, 1},
                                                    {1, 1}, {2, 1}, {1, 2}, {2, 0}};
    assert_int_equal(t.first[3], 8);
    assert_memory_equal(t.observations, expected, sizeof expected);
    sf_tracks_free(ctx, &t);
    assert_ok(ctx, sf_tracks_make(ctx, NULL, 0, counts, 3, &t));
    assert_int_equal(t.count, 0);
    sf_tracks_free(ctx, &t);
    sf_context_destroy(&ctx);
}

typedef struct repetition_log {
    int warnings;
    char text[600];
} repetition_log;

static void count_repetition(void *user, sf_log_level level, const char *message) {
    repetition_log *log = user;
    if (level != SF_LOG_WARNING || !strstr(message, "contradict")) return;
    log->warnings++;
    snprintf(log->text, sizeof log->text, "%s", message);
}

/* Every third match of pairs of next neighbours goes to the point beside the right one, as from one window to
 * the next. */
/* A third of the matches of a pair are with the keypoint beside the right one: as of windows that look the
 * same. */
static void repeat_things(sf_matched_pair *pair) {
    for (size_t k = 0; k + 3 < pair->count; k += 3) pair->matches[2 * k + 1] = pair->matches[2 * k + 3];
}

/* Pictures of a ring that follow one another, and their true matches. */
static size_t pairs_in_order(const sfm_scene *s, sf_matched_pair *pairs) {
    size_t count = 0;
    for (size_t i = 0; i < s->pair_count; i++)
        if (s->pairs[i].second == s->pairs[i].first + 1) pairs[count++] = s->pairs[i];
    return count;
}

static void what_repeats_is_told(void **state) {
    (void)state;
    repetition_log log = {0};
    const sf_context_options context_options = {.log = count_repetition, .log_user = &log};
    const sfm_scene_options o = {24, 2000, 1, 0.5, 0.1, 4, 1, SFM_GENERAL, 0};
    sf_map_options options = sf_map_options_default();
    sf_context *ctx;
    sfm_scene s;
    assert_int_equal(sf_context_create(&ctx, &context_options), SF_OK);
    sfm_scene_make(ctx, &o, &s);
    sfm_scene_verify(&s);
    for (int repeats = 0; repeats < 2; repeats++) {
        sf_map *map;
        const sf_map_input input = sfm_scene_input(&s);
        const sf_order order = {NULL, 0, 1};
        assert_ok(ctx, sf_map_photos(ctx, &input, &order, &options, NULL, NULL, &map));
        assert_int_equal(log.warnings, repeats);
        sf_map_destroy(&map);
        for (size_t i = 0; i < s.pair_count; i += 2) repeat_things(&s.pairs[i]);
    }
    assert_non_null(strstr(log.text, " % of the matches contradict others"));
    sfm_scene_free(&s);
    sf_context_destroy(&ctx);
}

static double contradicting(const sf_map *map) {
    return (double)map->tracks.contradictions / (double)map->tracks.matches;
}

/* Where only pictures far apart are mistaken for one another, those that follow one another make the map;
 * where these are too, or too few follow, the first map stays. */
static void what_repeats_is_mapped_in_order(void **state) {
    (void)state;
    const sfm_scene_options o = {24, 2000, 1, 0.5, 0.1, 4, 1, SFM_GENERAL, 0};
    sf_map_options options = sf_map_options_default();
    sf_context *ctx = test_context();
    sf_matched_pair pairs[24];
    sfm_scene s;
    sfm_scene_make(ctx, &o, &s);
    sfm_scene_verify(&s);
    sf_order order = {.pairs = pairs, .count = pairs_in_order(&s, pairs)};
    assert_int_equal(order.count, 23);
    for (size_t i = 0; i < s.pair_count; i++)
        if (s.pairs[i].second != s.pairs[i].first + 1) repeat_things(&s.pairs[i]);
    const sf_map_input input = sfm_scene_input(&s);
    for (int enough = 0; enough < 2; enough++) {
        sf_map *map;
        order.count = enough ? 23 : 12;
        assert_ok(ctx, sf_map_photos(ctx, &input, &order, &options, NULL, NULL, &map));
        print_message("%zu in order: %zu placed, %.3f contradict\n", order.count, map->placed_count,
                      contradicting(map));
        assert_true(enough ? contradicting(map) < 0.03 : contradicting(map) > 0.1);
        if (enough) assert_int_equal(map->placed_count, 24);
        sf_map_destroy(&map);
    }
    for (size_t i = 0; i < order.count; i++) repeat_things(&pairs[i]);
    sf_map *map;
    assert_ok(ctx, sf_map_photos(ctx, &input, &order, &options, NULL, NULL, &map));
    assert_true(contradicting(map) > 0.1);
    sf_map_destroy(&map);
    sfm_scene_free(&s);
    sf_context_destroy(&ctx);
}

/* Nothing is told of the lenses. */
static void make_map(const sfm_scene_options *o, double most_rotation, double most_center) {
    sf_context *ctx = test_context();
    sf_map_options options = sf_map_options_default();
    sfm_scene s;
    sf_map *map;
    size_t observations;
    sfm_scene_make(ctx, o, &s);
    sfm_scene_verify(&s);
    for (size_t c = 0; c < s.cameras; c++) {
        print_message("camera %zu: focal length %.0f by its pairs, true %.0f\n", c, s.known[c].lens.fx,
                      s.lenses[c].fx);
        assert_true(fabs(s.known[c].lens.fx / s.lenses[c].fx - 1) < 0.1);
    }
    const sf_map_input input = sfm_scene_input(&s);
    assert_ok(ctx, sf_mapper_run(ctx, &input, &options, NULL, NULL, &map));
    sfm_map_errors e = sfm_scene_compare(&s, map);
    size_t points = sf_map_count_points(map, &observations);
    print_message(
        "%zu of %zu placed, %zu points, %zu observations, spread %.2f px, f %.2f for %.0f; rotations %.4f "
        "(%.4f) degrees, centers %.4f (%.4f) %%\n",
        map->placed_count, s.views, points, observations, map->spread, map->cameras[0].lens.fx,
        s.lenses[0].fx, e.rotation * degree, e.rotation_most * degree, 100 * e.center, 100 * e.center_most);
    assert_int_equal(map->placed_count, s.views);
    assert_true(e.rotation < most_rotation / degree && e.center < most_center);
    assert_true(e.rotation_most < 4 * most_rotation / degree && e.center_most < 4 * most_center);
    for (size_t c = 0; c < s.cameras; c++)
        assert_true(fabs(map->cameras[c].lens.fx / s.lenses[c].fx - 1) < 0.005);
    sf_map_destroy(&map);
    sfm_scene_free(&s);
    sf_context_destroy(&ctx);
}

static void a_ring_is_mapped(void **state) {
    (void)state;
    make_map(&(sfm_scene_options){24, 2000, 1, 0.5, 0.2, 4, 1, SFM_GENERAL, 0}, 0.1, 0.003);
}

static void cameras_may_be_mixed(void **state) {
    (void)state;
    make_map(&(sfm_scene_options){24, 2000, 2, 0.5, 0.1, 4, 2, SFM_GENERAL, 0}, 0.15, 0.004);
}

/* Each lens has the radial parameters that its own pictures ask for. */
static void lenses_may_be_mixed(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_map_options options = sf_map_options_default();
    sfm_scene s;
    sf_map *map;
    sfm_scene_make(ctx, &(sfm_scene_options){24, 2000, 2, 0.5, 0.1, 4, 2, SFM_GENERAL, .plain = 1}, &s);
    sfm_scene_verify(&s);
    const sf_map_input input = sfm_scene_input(&s);
    assert_ok(ctx, sf_mapper_run(ctx, &input, &options, NULL, NULL, &map));
    for (int c = 0; c < 2; c++)
        print_message("camera %d: k1 %.4f, k2 %.4f\n", c, map->cameras[c].lens.k1, map->cameras[c].lens.k2);
    assert_true(fabs(map->cameras[0].lens.k1 + 0.12) < 0.02);
    assert_true(map->cameras[1].lens.k1 == 0 && map->cameras[1].lens.k2 == 0);
    sf_map_destroy(&map);
    sfm_scene_free(&s);
    sf_context_destroy(&ctx);
}

/* Features of a photo that was reduced to a fourth are as far off as a fourth of its pixels tells. */
static void errors_are_in_the_unit_of_features(void **state) {
    (void)state;
    size_t observations[2], placed[2];
    for (int i = 0; i < 2; i++) {
        sf_context *ctx = test_context();
        sf_map_options options = sf_map_options_default();
        sfm_scene s;
        sf_map *map = NULL;
        sfm_scene_make(ctx, &(sfm_scene_options){16, 1500, 1, 3, 0.1, 4, 1, SFM_GENERAL, 0}, &s);
        s.known[0].unit = i ? 4 : 0;
        sfm_scene_verify(&s);
        const sf_map_input input = sfm_scene_input(&s);
        sf_status status = sf_mapper_run(ctx, &input, &options, NULL, NULL, &map);
        assert_true(!status || (i == 0 && status == SF_ERR_EMPTY));
        placed[i] = status ? 0 : map->placed_count, observations[i] = 0;
        if (!status) sf_map_count_points(map, &observations[i]);
        print_message("unit %g: %zu placed, %zu observations\n", s.known[0].unit, placed[i], observations[i]);
        assert_true(i == 0 || placed[i] == s.views);
        sf_map_destroy(&map);
        sfm_scene_free(&s);
        sf_context_destroy(&ctx);
    }
    assert_true(observations[0] < observations[1] / 2);
}

static void threads_do_not_matter(void **state) {
    (void)state;
    const sfm_scene_options o = {18, 1200, 1, 0.5, 0.1, 3, 3, SFM_GENERAL, 0};
    const sf_map_options options = sf_map_options_default();
    sf_map *maps[2];
    sf_context *ctx[2];
    sfm_scene s[2];
    for (int i = 0; i < 2; i++) {
        ctx[i] = test_context_threads(1 + 3 * i);
        sfm_scene_make(ctx[i], &o, &s[i]);
        sfm_scene_verify(&s[i]);
        const sf_map_input input = sfm_scene_input(&s[i]);
        assert_ok(ctx[i], sf_mapper_run(ctx[i], &input, &options, NULL, NULL, &maps[i]));
    }
    for (size_t i = 0; i < s[0].pair_count; i++) {
        assert_memory_equal(&s[0].pairs[i].geometry, &s[1].pairs[i].geometry, sizeof(sf_two_view));
        assert_int_equal(s[0].pairs[i].count, s[1].pairs[i].count);
        assert_memory_equal(s[0].pairs[i].matches, s[1].pairs[i].matches,
                            2 * s[0].pairs[i].count * sizeof(uint32_t));
    }
    assert_int_equal(maps[0]->placed_count, s[0].views);
    assert_memory_equal(&maps[0]->cameras[0], &maps[1]->cameras[0], sizeof(sf_map_camera));
    for (size_t v = 0; v < s[0].views; v++)
        assert_memory_equal(&maps[0]->pictures[v].pose, &maps[1]->pictures[v].pose, sizeof(sf_rigid));
    assert_memory_equal(maps[0]->has_point, maps[1]->has_point, maps[0]->tracks.count);
    for (size_t i = 0; i < maps[0]->tracks.count; i++)
        if (maps[0]->has_point[i]) assert_memory_equal(maps[0]->at[i], maps[1]->at[i], sizeof maps[0]->at[i]);
    for (int i = 0; i < 2; i++) {
        sf_map_destroy(&maps[i]);
        sfm_scene_free(&s[i]);
        sf_context_destroy(&ctx[i]);
    }
}

static int stop_at_four(void *user, size_t placed, size_t pictures) {
    *(size_t *)user = placed;
    return placed >= 4 && pictures > 4;
}

/* Cancelled; no pairs; pairs without a pose; a picture that is left out, and one that nothing matches. */
static void maps_that_end_early(void **state) {
    (void)state;
    const sfm_scene_options o = {18, 1200, 1, 0.5, 0.1, 3, 3, SFM_GENERAL, 0};
    const sf_map_options options = sf_map_options_default();
    sf_context *ctx = test_context();
    sf_map *map;
    sfm_scene s;
    size_t placed = 0;
    sfm_scene_make(ctx, &o, &s);
    sfm_scene_verify(&s);
    sf_map_input input = sfm_scene_input(&s);
    assert_status(ctx, sf_mapper_run(ctx, &input, &options, stop_at_four, &placed, &map), SF_ERR_CANCELLED);
    assert_true(placed == 4 && !map);
    s.pictures[3].is_left_out = 1;
    for (size_t i = 0; i < s.pair_count; i++)
        if (s.pairs[i].first == 7 || s.pairs[i].second == 7) s.pairs[i].count = 0;
    assert_ok(ctx, sf_mapper_run(ctx, &input, &options, NULL, NULL, &map));
    assert_int_equal(map->placed_count, 16);
    assert_false(map->pictures[3].is_placed || map->pictures[7].is_placed);
    sf_map_destroy(&map);
    for (size_t i = 0; i < s.pair_count; i++) s.pairs[i].geometry.has_pose = 0;
    assert_status(ctx, sf_mapper_run(ctx, &input, &options, NULL, NULL, &map), SF_ERR_EMPTY);
    input.pair_count = 0;
    assert_status(ctx, sf_mapper_run(ctx, &input, &options, NULL, NULL, &map), SF_ERR_EMPTY);
    assert_error_names(ctx, "overlap");
    sfm_scene_free(&s);
    sf_context_destroy(&ctx);
}

/* A wall, through a lens whose focal length is told (a wall does not tell it). */
static void a_wall_is_mapped(void **state) {
    (void)state;
    const sfm_scene_options o = {12, 800, 1, 0.5, 0.1, 4, 5, SFM_PLANE, 0};
    const sf_map_options options = sf_map_options_default();
    sf_context *ctx = test_context();
    sf_map *map;
    sfm_scene s;
    sfm_scene_make(ctx, &o, &s);
    s.known[0].lens = s.lenses[0], s.known[0].is_fixed = 1;
    sfm_scene_verify(&s);
    for (size_t i = 0; i < s.pair_count; i++)
        assert_true(s.pairs[i].geometry.kind == SF_PAIR_PLANE || s.pairs[i].geometry.kind == SF_PAIR_GENERAL);
    const sf_map_input input = sfm_scene_input(&s);
    assert_ok(ctx, sf_mapper_run(ctx, &input, &options, NULL, NULL, &map));
    sfm_map_errors e = sfm_scene_compare(&s, map);
    print_message("wall: %zu placed, rotations %.4f (%.4f) degrees\n", map->placed_count, e.rotation * degree,
                  e.rotation_most * degree);
    assert_int_equal(map->placed_count, s.views);
    assert_true(e.rotation_most < 0.5 / degree);
    sf_map_destroy(&map);
    sfm_scene_free(&s);
    sf_context_destroy(&ctx);
}

/* A camera that only turned. */
static void a_turning_camera_is_refused(void **state) {
    (void)state;
    const sfm_scene_options o = {16, 4000, 1, 0.5, 0.1, 1, 6, SFM_ROTATION, 0};
    const sf_map_options options = sf_map_options_default();
    sf_context *ctx = test_context();
    sf_map *map;
    sfm_scene s;
    size_t turned = 0;
    sfm_scene_make(ctx, &o, &s);
    s.known[0].lens = s.lenses[0], s.known[0].is_fixed = 1;
    sfm_scene_verify(&s);
    for (size_t i = 0; i < s.pair_count; i++) { /* what wrong matches make of a rotation has no parallax */
        const sf_two_view *g = &s.pairs[i].geometry;
        turned += g->kind == SF_PAIR_ROTATION;
        assert_true(g->kind == SF_PAIR_ROTATION || g->kind == SF_PAIR_NONE || g->angle < 1 / degree);
    }
    assert_true(turned > s.pair_count / 2);
    const sf_map_input input = sfm_scene_input(&s);
    assert_status(ctx, sf_mapper_run(ctx, &input, &options, NULL, NULL, &map), SF_ERR_EMPTY);
    assert_error_names(ctx, "move the camera");
    sfm_scene_free(&s);
    sf_context_destroy(&ctx);
}

/* Pictures 0..8 and 9..17 of a ring, without pairs between them, and some of the second place are unmatched:
 * the larger map is the result, whichever is found first. */
static void the_largest_place_is_mapped(void **state) {
    (void)state;
    const sfm_scene_options o = {18, 1200, 1, 0.5, 0.1, 3, 3, SFM_GENERAL, 0};
    const sf_map_options options = sf_map_options_default();
    sf_context *ctx = test_context();
    sfm_scene s;
    sfm_scene_make(ctx, &o, &s);
    sfm_scene_verify(&s);
    for (uint32_t few = 0; few < 2; few++) { /* the first place is the smaller one, or the second */
        sf_map *map;
        size_t kept = 0;
        sf_matched_pair *pairs = malloc(s.pair_count * sizeof *pairs);
        assert_non_null(pairs);
        for (size_t i = 0; i < s.pair_count; i++) {
            uint32_t a = s.pairs[i].first, b = s.pairs[i].second;
            if ((a < 9) == (b < 9) && (a < 9 ? (few || b < 6) : (!few || b < 15))) pairs[kept++] = s.pairs[i];
        }
        sf_map_input input = sfm_scene_input(&s);
        input.pairs = pairs, input.pair_count = kept;
        assert_ok(ctx, sf_mapper_run(ctx, &input, &options, NULL, NULL, &map));
        assert_true(map->placed_count > 6); /* those at the ends of an arc see little */
        for (size_t v = 0; v < 18; v++) assert_true(!map->pictures[v].is_placed || (few ? v < 9 : v >= 9));
        print_message("%zu other maps, of %zu pictures\n", map->other_maps, map->other_pictures);
        assert_true(map->other_maps <= 2 && map->placed_count + map->other_pictures <= 18);
        sf_map_destroy(&map);
        free(pairs);
    }
    sfm_scene_free(&s);
    sf_context_destroy(&ctx);
}

/* Without any one of its blocks of memory a map is refused, and nothing is left behind. */
static void maps_without_memory(void **state) {
    (void)state;
    const sfm_scene_options o = {4, 600, 1, 0.5, 0, 1, 3, SFM_GENERAL, 0};
    const sf_map_options options = {.error_px = 4, .least_angle = 0.02, .least_seen = 10, .first_count = 20};
    sfm_scene s;
    long refused = 0;
    for (long fail_at = 1;; fail_at += 1 + fail_at / 8) {
        test_allocations memory = {0};
        const sf_allocator allocator = {test_count_alloc, test_count_free, &memory};
        sf_context *ctx;
        sf_map *map;
        assert_int_equal(
            sf_context_create(&ctx, &(sf_context_options){.allocator = &allocator, .threads = 1}), SF_OK);
        sfm_scene_make(ctx, &o, &s);
        sfm_scene_verify(&s);
        const sf_map_input input = sfm_scene_input(&s);
        long live = memory.live;
        memory.fail_at = memory.calls + fail_at;
        sf_status status = sf_mapper_run(ctx, &input, &options, NULL, NULL, &map);
        int has_failed = memory.calls >= memory.fail_at;
        if (status) assert_int_equal(status, has_failed ? SF_ERR_MEMORY : SF_ERR_EMPTY);
        sf_map_destroy(&map);
        assert_int_equal(memory.live, live);
        sfm_scene_free(&s);
        sf_context_destroy(&ctx);
        refused += status == SF_ERR_MEMORY;
        if (!has_failed) break;
    }
    assert_true(refused > 5);
}

static int count_in_log(const char *part) {
    int count = 0;
    for (const char *at = test_log; (at = strstr(at, part)); at++) count++;
    return count;
}

/* Of cameras with few pictures each the focal lengths are found, but in doubt; not where they are told,
 * and not where there are many pictures. */
static void few_pictures_are_told(void **state) {
    (void)state;
    static const struct {
        size_t views;
        int is_told, warnings;
    } cases[] = {{10, 0, 2}, {10, 1, 0}, {24, 0, 0}};
    sf_context *ctx = test_context();
    sf_map_options options = sf_map_options_default();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const sfm_scene_options o = {24, 2000, 2, 0.5, 0.1, 4, 1, SFM_GENERAL, 0};
        sfm_scene s;
        sf_map *map;
        sfm_scene_make(ctx, &o, &s);
        for (size_t v = cases[i].views; v < s.views; v++) s.pictures[v].is_left_out = 1;
        sfm_scene_verify(&s);
        for (size_t c = 0; c < 2 && cases[i].is_told; c++)
            s.known[c].lens = s.lenses[c], s.known[c].focal_prior = s.lenses[c].fx,
            s.known[c].focal_sigma = 0.05;
        const sf_map_input input = sfm_scene_input(&s);
        test_log_clear();
        assert_ok(ctx, sf_mapper_run(ctx, &input, &options, NULL, NULL, &map));
        assert_int_equal(map->placed_count, cases[i].views);
        assert_int_equal(count_in_log("hardly tell their focal length"), cases[i].warnings);
        if (cases[i].warnings) assert_int_equal(count_in_log("focal: the 5 photos of "), 2);
        sf_map_destroy(&map);
        sfm_scene_free(&s);
    }
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(tracks_are_joined),
        cmocka_unit_test(what_repeats_is_told),
        cmocka_unit_test(what_repeats_is_mapped_in_order),
        cmocka_unit_test(a_ring_is_mapped),
        cmocka_unit_test(cameras_may_be_mixed),
        cmocka_unit_test(lenses_may_be_mixed),
        cmocka_unit_test(few_pictures_are_told),
        cmocka_unit_test(errors_are_in_the_unit_of_features),
        cmocka_unit_test(threads_do_not_matter),
        cmocka_unit_test(maps_that_end_early),
        cmocka_unit_test(a_wall_is_mapped),
        cmocka_unit_test(a_turning_camera_is_refused),
        cmocka_unit_test(the_largest_place_is_mapped),
        cmocka_unit_test(maps_without_memory),
    };
    return cmocka_run_group_tests_name("sfm_mapper", tests, NULL, NULL);
}
