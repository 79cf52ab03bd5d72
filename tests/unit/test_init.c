/* test_init.c - distances to the nearest points, and Gaussians made of points. */
#include "init_fixture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "scene/init.h"
#include "scene/nearest.h"
#include "scene/random.h"

/* Distances. */

/* Mean distance from point i to its (up to) 3 nearest others, tried one by one in float64. */
static double distance_by_force(const float *points, size_t n, size_t i) {
    double nearest[3] = {INFINITY, INFINITY, INFINITY}, sum = 0;
    int found = 0;
    for (size_t k = 0; k < n; k++) {
        if (k == i) continue;
        double d = 0;
        for (size_t c = 0; c < 3; c++) {
            double off = (double)points[3 * k + c] - (double)points[3 * i + c];
            d += off * off;
        }
        for (int m = 0; m < 3; m++)
            if (d < nearest[m]) {
                double keep = nearest[m];
                nearest[m] = d;
                d = keep;
            }
    }
    for (; found < 3 && nearest[found] < INFINITY; found++) sum += sqrt(nearest[found]);
    return found ? sum / found : 0;
}

/* Every `every`-th point is tried by force. A difference of two floats is off by one rounding, so is each of
 * the few operations after it. */
static void check_distances(const float *points, size_t n, size_t every) {
    sf_context *ctx = test_context();
    float *distances = malloc((n + 1) * sizeof *distances);
    assert_non_null(distances);
    distances[n] = -7;
    assert_ok(ctx, sf_nearest_distances(ctx, points, n, distances));
    for (size_t i = 0; i < n; i += every) {
        double expected = distance_by_force(points, n, i);
        if (!(fabs((double)distances[i] - expected) <= 1e-6 * expected))
            fail_msg("point %zu of %zu: %.9g is not %.9g", i, n, (double)distances[i], expected);
    }
    assert_true(distances[n] == -7);
    free(distances);
    sf_context_destroy(&ctx);
}

/* Dense clusters far apart, of very different sizes. */
static void place_in_clusters(sf_rng *rng, size_t i, float *point) {
    static const double size[] = {1e-3, 0.1, 5, 1e-2};
    for (size_t k = 0; k < 3; k++)
        point[k] = (float)(100.0 * (double)((i + k) % 4) + size[i % 4] * sf_rng_normal(rng));
}

static void place_on_few(sf_rng *rng, size_t i, float *point) {
    (void)i;
    for (int k = 0; k < 3; k++) point[k] = (float)sf_rng_below(rng, 4);
}

static void place_on_line(sf_rng *rng, size_t i, float *point) {
    (void)rng;
    for (int k = 0; k < 3; k++) point[k] = (float)(i * i % 1009) * (float)(k + 1);
}

static void place_on_plane(sf_rng *rng, size_t i, float *point) {
    (void)i;
    init_place_anywhere(rng, i, point);
    point[1] = 3;
}

static void place_in_order(sf_rng *rng, size_t i, float *point) {
    (void)rng;
    point[0] = (float)i, point[1] = point[2] = 0;
}

static void place_at_one(sf_rng *rng, size_t i, float *point) {
    (void)rng, (void)i;
    point[0] = 1, point[1] = 2, point[2] = 3;
}

static void test_distances(void **state) {
    (void)state;
    static const place_fn all[] = {init_place_anywhere, place_in_clusters, place_on_few, place_on_line,
                                   place_on_plane,      place_in_order,    place_at_one};
    static const size_t counts[] = {0, 1, 2, 3, 4, 5, 8, 9, 10, 17, 18, 100, 513, 700};
    for (size_t w = 0; w < sizeof all / sizeof *all; w++)
        for (size_t c = 0; c < sizeof counts / sizeof *counts; c++) {
            float *points = init_place(all[w], counts[c], 100 * w + c + 1);
            check_distances(points, counts[c], 1);
            free(points);
        }
}

/* So many that anything quadratic would be felt; all in one place is the worst case of a careless tree. */
static void test_distances_of_many(void **state) {
    (void)state;
    static const place_fn all[] = {init_place_anywhere, place_in_clusters, place_on_few, place_at_one};
    for (size_t w = 0; w < sizeof all / sizeof *all; w++) {
        float *points = init_place(all[w], 20000, w + 1);
        check_distances(points, 20000, 457);
        free(points);
    }
}

static void test_distances_by_hand(void **state) {
    (void)state;
    static const float line[5][3] = {{0, 0, 0}, {1, 0, 0}, {3, 0, 0}, {6, 0, 0}, {10, 0, 0}};
    static const float one[] = {0}, two[] = {1, 1}, three[] = {2, 1.5f, 2.5f},
                       five[] = {10 / 3.f, 8 / 3.f, 8 / 3.f, 4, 20 / 3.f};
    static const struct {
        size_t n;
        const float *expected;
    } cases[] = {{1, one}, {2, two}, {3, three}, {5, five}};
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        float got[5];
        assert_ok(ctx, sf_nearest_distances(ctx, &line[0][0], cases[i].n, got));
        for (size_t k = 0; k < cases[i].n; k++) assert_float_equal(got[k], cases[i].expected[k], 1e-6);
    }
    sf_context_destroy(&ctx);
}

/* Gaussians from points. */

static void test_from_points(void **state) {
    (void)state;
    enum { POINTS = 211 };
    sf_context *ctx = test_context();
    sf_scene *scene = init_scene_of(ctx, 1);
    init_add_points(scene, init_place_anywhere, POINTS, 5);
    sf_init_options options = init_usual;
    options.random_count = 1; /* too few for random points beside these */
    content *c = init_make_first(scene, &options, 1);
    float xyz[POINTS][3];
    uint8_t rgb[POINTS][3];
    assert_int_equal(sf_scene_get_points(scene, 0, POINTS, &xyz[0][0], &rgb[0][0]), POINTS);
    assert_int_equal(c->count, POINTS);
    assert_memory_equal(c->means, xyz, sizeof xyz);
    init_check_common(c, &init_usual);
    for (size_t i = 0; i < POINTS; i++) {
        double distance = distance_by_force(&xyz[0][0], POINTS, i);
        assert_float_equal(c->log_scales[i][0], log(0.5 * distance), 1e-5);
        for (size_t ch = 0; ch < 3; ch++) /* drawn, it has the point's colour */
            assert_float_equal(0.5 + init_sh_c0 * (double)c->sh[i][0][ch], rgb[i][ch] / 255.0, 1e-6);
    }
    free(c);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Points in one place, a single one, and some so far apart that they would cover the scene. */
static void test_scales_have_limits(void **state) {
    (void)state;
    static const float far_apart[2][3] = {{-1e6f, 0, 0}, {1e6f, 0, 0}},
                       close[2][3] = {{0, 0, 0}, {1e-9f, 0, 0}};
    static const struct {
        const float *points;
        place_fn where;
        size_t n;
        double scale;
    } cases[] = {{NULL, place_at_one, 9, 0.1}, /* a hundredth of the extent */
                 {NULL, place_at_one, 1, 0.1},
                 {&far_apart[0][0], NULL, 2, 10}, /* the extent */
                 {&close[0][0], NULL, 2, 1e-6}};  /* 1e-7 of it */
    sf_context *ctx = test_context();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        sf_scene *scene = init_scene_of(ctx, 1);
        if (cases[i].where)
            init_add_points(scene, cases[i].where, cases[i].n, 1);
        else
            assert_ok(ctx, sf_scene_add_points(scene, cases[i].n, cases[i].points, NULL));
        sf_init_options options = init_usual;
        options.from = SF_INIT_POINTS;
        content *c = init_make_first(scene, &options, 1);
        assert_int_equal(c->count, cases[i].n);
        for (size_t k = 0; k < c->count; k++)
            assert_float_equal(c->log_scales[k][0], log(cases[i].scale), 1e-5);
        free(c);
        sf_scene_destroy(&scene);
    }
    sf_context_destroy(&ctx);
}

/* Whether Gaussian i of `c` is point k: position and colour. */
static int is_point(const content *c, size_t i, const float *xyz, const uint8_t *rgb) {
    int same = memcmp(c->means[i], xyz, 3 * sizeof *xyz) == 0;
    for (size_t ch = 0; ch < 3; ch++)
        same &= fabs(0.5 + init_sh_c0 * (double)c->sh[i][0][ch] - rgb[ch] / 255.0) < 1e-6;
    return same;
}

/* Too many points: exactly as many as allowed, each once, in their order, the same of any seed. */
static void test_more_points_than_allowed(void **state) {
    (void)state;
    enum { POINTS = 1100 };
    static const size_t allowed[] = {1, 2, 100, POINTS - 1, POINTS, MOST};
    sf_context *ctx = test_context();
    sf_scene *scene = init_scene_of(ctx, 1);
    init_add_points(scene, init_place_anywhere, POINTS, 8);
    static float xyz[POINTS][3];
    static uint8_t rgb[POINTS][3];
    assert_int_equal(sf_scene_get_points(scene, 0, POINTS, &xyz[0][0], &rgb[0][0]), POINTS);
    for (size_t a = 0; a < sizeof allowed / sizeof *allowed; a++) {
        sf_init_options options = init_usual;
        options.max_gaussians = allowed[a], options.random_count = 1;
        content *c = init_make_first(scene, &options, 1), *same = init_make_first(scene, &options, 2);
        assert_int_equal(c->count, allowed[a] < POINTS ? allowed[a] : POINTS);
        assert_memory_equal(c, same, sizeof *c);
        size_t found = 0;
        for (size_t k = 0; k < POINTS && found < c->count; k++)
            found += (size_t)is_point(c, found, xyz[k], rgb[k]);
        assert_int_equal(found, c->count);
        free(c);
        free(same);
    }
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* The choice is spread evenly over space, wherever points stand in the list: of a line, one in five, it
 * leaves no gap of more than ten, and of clusters of different sizes each
 * gets its share. */
static void test_choice_is_even(void **state) {
    (void)state;
    enum { POINTS = 1000, CHOSEN = 200 };
    sf_context *ctx = test_context();
    sf_scene *line = init_scene_of(ctx, 1), *clusters = init_scene_of(ctx, 1);
    init_add_points(line, place_in_order, POINTS, 1);
    init_add_points(clusters, place_in_clusters, POINTS, 1);
    sf_init_options options = init_usual;
    options.max_gaussians = CHOSEN;
    content *c = init_make_first(line, &options, 1);
    assert_true(c->means[0][0] < 5 && c->means[CHOSEN - 1][0] > POINTS - 6);
    for (size_t i = 1; i < CHOSEN; i++) assert_true(c->means[i][0] - c->means[i - 1][0] <= 10);
    free(c);
    c = init_make_first(clusters, &options, 1);
    size_t of_cluster[4] = {0};
    for (size_t i = 0; i < CHOSEN; i++) of_cluster[(size_t)lroundf(c->means[i][0] / 100) & 3]++;
    for (size_t k = 0; k < 4; k++) assert_between(of_cluster[k], 48, 52);
    free(c);
    sf_scene_destroy(&line);
    sf_scene_destroy(&clusters);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_distances),          cmocka_unit_test(test_distances_of_many),
        cmocka_unit_test(test_distances_by_hand),  cmocka_unit_test(test_from_points),
        cmocka_unit_test(test_scales_have_limits), cmocka_unit_test(test_more_points_than_allowed),
        cmocka_unit_test(test_choice_is_even),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
